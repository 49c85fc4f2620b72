"""Films of the frames of a run in time: one mesh, one camera, one colour bar."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from cpmkit.errors import InputError, MissingDependencyError, shown
from cpmkit.files.whole_files import written_whole
from cpmkit.runtime.arrays import positive
from cpmkit.scenefile.look import Look
from cpmkit.solution.frames import frames_of
from cpmkit.view.marks import compose
from cpmkit.view.pictures import check_look, make_drawing, shade, shown_values

if TYPE_CHECKING:
    from cpmkit.scenefile.look import LookKeywords
    from cpmkit.solution.frames import EvolvedRecord
    from cpmkit.solution.record import SolutionRecord

#: Default number of frames per second, and default width of a film in pixels.
FRAMES_A_SECOND, FILM_WIDTH = 12.0, 700


def animate(
    solution: SolutionRecord, path: str | Path, fps: float = FRAMES_A_SECOND, **options: Unpack[LookKeywords]
) -> Path:
    """Write the frames of a run in time as a film, and return its path.

    Parameters
    ----------
    solution : EvolvedSolution
        A solution with frames; request them from the problem, such as ``Heat(..., frames=40)``.
    path : path
        Ends in ``.gif`` or ``.mp4``. A GIF has 256 colours per frame; an MP4 needs imageio and imageio-ffmpeg.
    fps : float
        Frames per second.
    **options
        Options of :class:`~cpmkit.scenefile.look.Look`. The colour bar spans the values of all frames unless ``clim``
        is given.

    Raises
    ------
    InputError
        If the solution has no frames, or an argument is not accepted.
    MissingDependencyError
        If the library that writes the film is not installed.
    """
    look = Look.of({"width": FILM_WIDTH, **options}, "a film", ("fps",))
    check_look(look)
    path, fps = Path(path), positive(fps, "fps")
    writers = {".gif": _write_gif, ".mp4": _write_mp4}
    if path.suffix.lower() not in writers:
        raise InputError(f"A film must be a .gif or .mp4 file, got {shown(path.name)}.")
    if path.suffix.lower() == ".mp4" and (find_spec("imageio") is None or find_spec("imageio_ffmpeg") is None):
        raise MissingDependencyError(".mp4 films are written by imageio; `pip install imageio imageio-ffmpeg` adds it.")
    images = frame_images(solution, look)
    with written_whole(path) as unfinished:
        writers[path.suffix.lower()](images, unfinished, fps)
    return path


def frame_images(solution: SolutionRecord, look: Look) -> Iterator[Any]:
    """Yield the picture (rows, columns, 3) of each frame, as bytes, with its time in the title.

    Raises
    ------
    InputError
        If the solution has no frames.
    """
    frames = frames_of(solution, "a film")
    evolved: EvolvedRecord = frames[0]
    meshes = replace(evolved, frames=frames).frame_meshes()
    every = replace(meshes[0], values=np.concatenate([mesh.values for mesh in meshes]))
    _, bar = shown_values(evolved, every, look)
    drawing = make_drawing(evolved, meshes[0], look, bar)
    for frame, mesh in zip(frames, meshes, strict=True):
        values, _ = shown_values(frame, mesh, look)
        title = f"{look.title}, t = {frame.time:.4g}" if look.title else f"t = {frame.time:.4g}"
        yield compose(shade(drawing, frame, mesh, values, bar, look), bar, title, look.width)


def _write_gif(images: Iterator[Any], path: Path, fps: float) -> None:
    """Write pictures (rows, columns, 3) as a GIF file that repeats for ever, without dithering."""
    from PIL import Image

    first, *others = [Image.fromarray(image).quantize(256, dither=Image.Dither.NONE) for image in images]
    first.save(path, "GIF", save_all=True, append_images=others, duration=1000 / fps, loop=0)


def _write_mp4(images: Iterator[Any], path: Path, fps: float) -> None:
    """Write pictures (rows, columns, 3) as an MP4 file, padded to even numbers of rows and columns."""
    import imageio.v2

    opened: Any = imageio.v2.get_writer(path, format="FFMPEG", fps=fps, quality=8, macro_block_size=2)
    with opened as writer:
        for image in images:
            rows, columns = image.shape[:2]  # both must be even
            writer.append_data(np.pad(image, ((0, rows % 2), (0, columns % 2), (0, 0)), constant_values=255))
