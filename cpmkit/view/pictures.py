"""Pictures of solutions in PNG files, and films of frames in time: one mesh, one camera, one colour bar."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from cpmkit.errors import InputError, MissingDependencyError, shown
from cpmkit.files.whole_files import write_png, written_whole
from cpmkit.runtime.arrays import positive
from cpmkit.runtime.messages import install_command
from cpmkit.scenefile.look import Look, LookKeywords
from cpmkit.solution.display_mesh import DisplayMesh
from cpmkit.solution.frames import EvolvedRecord, frames_of
from cpmkit.solution.modes import EigenRecord
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats
from cpmkit.view.colours import Bar, compose_picture, make_bar, model_width, picture_sheet
from cpmkit.view.drawing import Drawing, Shapes, arrows, camera_axes, draw_mesh, isolines, mesh_edges, outlines


@dataclass(frozen=True)
class Picture:
    """A picture that was drawn."""

    file: Path  #: The PNG file.
    camera: str  #: The direction of the view and the vertical axis, in words.


def picture(solution: SolutionRecord, path: str | Path, **options: Unpack[LookKeywords]) -> Picture:
    """Draw a solution, or its estimated error, into a PNG file, and return its path and the camera in words.

    All modes of an eigenvalue problem are drawn on one sheet, unless ``channel`` selects a mode. Of the errors of
    several channels, the largest at each point is drawn.

    Parameters
    ----------
    solution : Solution
        The solution. Its surface must have a mesh; boundaries are drawn if they have one.
    path : str or Path
        The file to write; must end in ``.png``.
    **options
        Options of :class:`~cpmkit.scenefile.look.Look`.

    Raises
    ------
    InputError
        If the surface has no mesh, an argument is not accepted, or the file cannot be written.
    MissingDependencyError
        If matplotlib, which draws the text, is not installed.
    CpmkitError
        If a requested error cannot be estimated.
    """
    look = Look.from_options(options)
    path = check_picture(path, look)
    image, camera = render(solution, look)
    write_png(path, image / 255)
    logging.getLogger("cpmkit").info("%s: %s.", path, camera)
    return Picture(path, camera)


def check_picture(path: str | Path, look: Look) -> Path:
    """Return ``path`` as a Path if a picture with this look can be drawn into such a file.

    Raises InputError if it does not end in ``.png``, and as :func:`check_look` does.
    """
    path = Path(path)
    if path.suffix.lower() != ".png":
        raise InputError(f"A picture must be a .png file, got {shown(path.name)}.")
    check_look(look)
    return path


def check_look(look: Look) -> None:
    """Check that a picture can have the camera and the colour map of a look.

    Raises InputError if one is not accepted, and MissingDependencyError if matplotlib is not installed.
    """
    if find_spec("matplotlib") is None:
        raise MissingDependencyError(f"Pictures need matplotlib; {install_command('view')} adds it.")
    if look.view is not None or look.up is not None:
        camera_axes(look.view, look.up)
    make_bar(np.zeros(1), None, look.cmap)


def render(solution: SolutionRecord, look: Look) -> tuple[Any, str]:
    """Return the picture (rows, columns, 3) uint8 of a solution, or of all modes, and the camera in words."""
    mesh = solution.display_mesh()
    bar: Bar | None
    if isinstance(solution, EigenRecord) and look.channel is None and look.field != "error":
        bar, columns = mode_colour_bar(mesh.values, look), min(3, solution.channels)
        plain = replace(look, vectors=False)
        drawing = make_drawing(solution, mesh, look, bar, columns)
        tiles = [render_values(drawing, mesh, mesh.values[:, k : k + 1], bar, plain) for k in range(solution.channels)]
        image = picture_sheet(tiles, solution.titles, columns)
    else:
        values, bar = shown_values(solution, mesh, look)
        drawing = make_drawing(solution, mesh, look, bar)
        image = render_values(drawing, mesh, values, bar, look)
    return compose_picture(image, bar, look.title, look.width), drawing.camera.description


def make_drawing(solution: SolutionRecord, mesh: DisplayMesh, look: Look, bar: Bar | None, columns: int = 1) -> Drawing:
    """Return the drawing of a mesh with the lines that do not depend on values, for one of several ``columns``.

    ``bar`` is the colour bar beside it, or None. A mesh with normals is shaded if ``look.light`` is "shaded", or is
    None while there is no bar; otherwise the drawing has outlines.
    """
    lit = look.light == "shaded" or (look.light is None and bar is None)
    width = model_width(look.width, bar is not None, bar.label if bar else "")
    drawn = draw_mesh(solution, mesh, look, width // columns, lit)
    ink = [drawn.ink, *([] if drawn.lit else [outlines(drawn)]), *([mesh_edges(drawn)] if look.edges else [])]
    return replace(drawn, ink=Shapes.join(ink))


def mode_colour_bar(values: Floats, look: Look) -> Bar:
    """Return the colour bar of modes (v, k): by default symmetric about zero, and ``coolwarm`` in place of viridis."""
    most = float(np.abs(values).max())
    cmap = "coolwarm" if look.cmap == Look.cmap else look.cmap
    return make_bar(values, look.clim or (-most, most), cmap, look.label, look.unit)


def shown_values(solution: SolutionRecord, mesh: DisplayMesh, look: Look) -> tuple[Floats, Bar | None]:
    """Return values (v, 1) at the mesh's vertices and their colour bar, or three channels as colours (v, 3) and None.

    Values are the error, the length of vectors or the channel that ``look`` selects, by default the first unless there
    are three. Raises InputError as :func:`check_channels`, and CpmkitError if a requested error cannot be estimated.
    """
    values, label, count = mesh.values, look.label, mesh.values.shape[1]
    check_channels(look, count, mesh.points.shape[1])
    if look.field == "error":  # of several channels the largest
        values = solution.error.on_mesh(mesh)
        values = values.max(axis=1, keepdims=True) if look.channel is None else values[:, [look.channel]]
        label = label or "estimated error"
    elif look.vectors:
        values = np.linalg.norm(values, axis=1, keepdims=True)
    elif look.channel is not None or count != 3:
        values = values[:, [look.channel or 0]]
        if isinstance(solution, EigenRecord):
            return values, mode_colour_bar(values, look)
    else:
        return np.clip(values, 0, 1), None
    return values, make_bar(values, look.clim, look.cmap, label, look.unit)


def render_values(drawing: Drawing, mesh: DisplayMesh, values: Floats, bar: Bar | None, look: Look) -> Floats:
    """Return the drawing as an image (r, c, 3), from 0 to 1, with ``values`` (v, 1), or colours (v, 3) if no bar."""
    from cpmkit.view.raster import rasterize_drawing  # numba is imported here

    ink = [drawing.ink]
    if look.isolines and bar is not None:
        ink.append(isolines(drawing, values[:, 0], look.levels(bar.ends.tolist()), bar))
    if look.vectors and bar is not None:
        ink.append(arrows(drawing, mesh, mesh.values, bar))
    return rasterize_drawing(drawing, values, bar, Shapes.join(ink))


def check_channels(look: Look, channels: int, dim: int) -> None:
    """Check that a solution of ``channels`` channels, in space of dimension ``dim``, can be drawn with this look.

    Raises InputError if there is no such channel, the channels are no vectors, or isolines of colours are requested.
    """
    if look.channel is not None and look.channel >= channels:
        raise InputError(f"channel must be below {channels}, the number of channels, got {look.channel}.")
    if look.field == "error":
        return
    if look.vectors and channels != dim:
        raise InputError(f"vectors have as many channels as coordinates, {dim}, got {channels}.")
    if look.isolines and not look.vectors and look.channel is None and channels == 3:
        raise InputError("isolines are those of one channel; give channel=.")


def animate(solution: SolutionRecord, path: str | Path, fps: float = 12.0, **options: Unpack[LookKeywords]) -> Path:
    """Write the frames of a run in time as a film, and return its path.

    Parameters
    ----------
    solution : EvolvedSolution
        A solution with frames; request them from the problem, such as ``Heat(..., frames=40)``.
    path : path
        Ends in ``.gif`` or ``.mp4``. A GIF has 256 colours per frame; an MP4 needs imageio and imageio-ffmpeg.
    fps : float
        Frames per second. In a GIF each frame lasts whole hundredths of a second, rounded down.
    **options
        Options of :class:`~cpmkit.scenefile.look.Look`; the default width is 700 pixels. The colour bar spans the
        values of all frames unless ``clim`` is given.

    Raises
    ------
    InputError
        If the solution has no frames, its surface no mesh, an argument is not accepted (nor the field "error", which is
        only known at the final time), or the file cannot be written.
    MissingDependencyError
        If matplotlib or the library that writes the film is not installed.
    """
    look = Look.from_options({"width": 700, **options}, "a film", ("fps",))
    check_look(look)
    path, fps = Path(path), positive(fps, "fps")
    check_film(path)
    images = frame_images(solution, look)
    with written_whole(path) as unfinished:
        (_write_gif if path.suffix.lower() == ".gif" else _write_mp4)(images, unfinished, fps)
    return path


def check_film(path: Path) -> None:
    """Check that a film can be written as ``path``.

    Raises InputError if it does not end in ``.gif`` or ``.mp4``, and MissingDependencyError if an MP4's library is not
    installed; Pillow, which writes a GIF, comes with matplotlib, which :func:`check_look` requires.
    """
    if path.suffix.lower() not in (".gif", ".mp4"):
        raise InputError(f"A film must be a .gif or .mp4 file, got {shown(path.name)}.")
    if path.suffix.lower() == ".mp4" and (find_spec("imageio") is None or find_spec("imageio_ffmpeg") is None):
        raise MissingDependencyError(
            f".mp4 films are written by imageio and imageio-ffmpeg; {install_command('view')} adds them."
        )


def frame_images(solution: SolutionRecord, look: Look) -> Iterator[Any]:
    """Yield the picture (rows, columns, 3) uint8 of each frame, with its time in the title and a common colour bar.

    Raises InputError if the solution has no frames, if ``look`` selects the error, and as :func:`check_channels`.
    """
    frames = frames_of(solution, "a film")
    if look.field == "error":
        raise InputError("field = 'error' is the error at the end, and frames are earlier; leave out field.")
    evolved: EvolvedRecord = frames[0]
    meshes = replace(evolved, frames=frames).frame_meshes()
    every = replace(meshes[0], values=np.concatenate([mesh.values for mesh in meshes]))
    _, bar = shown_values(evolved, every, look)
    drawing = make_drawing(evolved, meshes[0], look, bar)
    for frame, mesh in zip(frames, meshes, strict=True):
        values, _ = shown_values(frame, mesh, look)
        title = f"{look.title}, t = {frame.time:.4g}" if look.title else f"t = {frame.time:.4g}"
        yield compose_picture(render_values(drawing, mesh, values, bar, look), bar, title, look.width)


def _write_gif(images: Iterator[Any], path: Path, fps: float) -> None:
    """Write pictures (rows, columns, 3) uint8, ``fps`` a second, as a GIF that repeats for ever, not dithered."""
    from PIL import Image

    first, *others = [Image.fromarray(image).quantize(256, dither=Image.Dither.NONE) for image in images]
    first.save(path, "GIF", save_all=True, append_images=others, duration=1000 / fps, loop=0)


def _write_mp4(images: Iterator[Any], path: Path, fps: float) -> None:
    """Write pictures (rows, columns, 3) uint8, ``fps`` a second, as an MP4, padded to even rows and columns."""
    import imageio.v2

    opened: Any = imageio.v2.get_writer(path, format="FFMPEG", fps=fps, quality=8, macro_block_size=2)
    with opened as writer:
        for image in images:
            rows, columns = image.shape[:2]  # both must be even
            writer.append_data(np.pad(image, ((0, rows % 2), (0, columns % 2), (0, 0)), constant_values=255))
