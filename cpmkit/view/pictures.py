"""Pictures of solutions in PNG files."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from cpmkit.errors import InputError, MissingDependencyError, shown
from cpmkit.files.whole_files import written_whole
from cpmkit.runtime.messages import install_command
from cpmkit.scenefile.look import Look
from cpmkit.solution.display_mesh import DisplayMesh
from cpmkit.solution.modes import EigenRecord
from cpmkit.types import Floats
from cpmkit.view import marks
from cpmkit.view.camera import axes_of
from cpmkit.view.colours import Bar, make_bar
from cpmkit.view.drawing import Drawing, Shapes, draw
from cpmkit.view.marks import compose, model_width, picture_sheet, write_png

if TYPE_CHECKING:
    from cpmkit.scenefile.look import LookKeywords
    from cpmkit.solution.record import SolutionRecord

#: Most columns of a sheet of modes, and its colour map, for values of both signs.
SHEET_COLUMNS, SIGNED_CMAP = 3, "coolwarm"


@dataclass(frozen=True)
class Picture:
    """A picture that was drawn.

    Attributes
    ----------
    file : Path
        The PNG file.
    camera : str
        The direction of the view and the vertical axis, in words.
    """

    file: Path
    camera: str


def picture(solution: SolutionRecord, path: str | Path, **options: Unpack[LookKeywords]) -> Picture:
    """Draw a solution, or its estimated error, into a PNG file.

    All modes of an eigenvalue problem are drawn on one sheet, unless ``channel`` selects one.

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
        If the surface has no mesh, or an argument is not accepted.
    MissingDependencyError
        If matplotlib, which draws the text, is not installed.
    """
    look = Look.of(options)
    path = check_picture(path, look)
    image, camera = render(solution, look)
    with written_whole(path) as unfinished:
        write_png(image, unfinished)
    logging.getLogger("cpmkit").info("%s: %s.", path, camera)
    return Picture(path, camera)


def check_picture(path: str | Path, look: Look) -> Path:
    """Return ``path`` as a Path if a picture with this look can be drawn into such a file.

    Raises
    ------
    InputError
        If it does not end in ``.png``, or the options of the camera or the colour map are not accepted.
    MissingDependencyError
        If matplotlib is not installed.
    """
    path = Path(path)
    if path.suffix.lower() != ".png":
        raise InputError(f"A picture must be a .png file, got {shown(path.name)}.")
    check_look(look)
    return path


def check_look(look: Look) -> None:
    """Raise if the camera or the colour map of a look is not accepted, or matplotlib is not installed.

    Raises
    ------
    InputError
        If the options of the camera or the colour map are not accepted.
    MissingDependencyError
        If matplotlib is not installed.
    """
    if find_spec("matplotlib") is None:
        raise MissingDependencyError(f"Pictures need matplotlib; {install_command('view')} adds it.")
    if look.view is not None or look.up is not None:
        axes_of(look.view, look.up)
    make_bar(np.zeros(1), None, look.cmap)


def render(solution: SolutionRecord, look: Look) -> tuple[Any, str]:
    """Return the picture (rows, columns, 3) of a solution as bytes, and the description of its camera."""
    if isinstance(solution, EigenRecord) and look.channel is None and look.field != "error":
        return _sheet(solution, look)
    mesh = solution.display_mesh()
    values, bar = shown_values(solution, mesh, look)
    drawing = make_drawing(solution, mesh, look, bar)
    image = shade(drawing, solution, mesh, values, bar, look)
    return compose(image, bar, look.title, look.width), drawing.camera.description


def make_drawing(solution: SolutionRecord, mesh: DisplayMesh, look: Look, bar: Bar | None) -> Drawing:
    """Return the drawing of a mesh; it is not shaded beside a colour bar, unless the look asks for it."""
    lit = look.light == "shaded" or (look.light is None and bar is None)
    width = model_width(look.width, bar is not None, bar.label if bar else "")
    return _with_outlines(draw(solution, mesh, look, width, lit), look)


def _with_outlines(drawing: Drawing, look: Look) -> Drawing:
    """Return the drawing with the lines that do not depend on values: outlines if it is not shaded, and mesh edges."""
    ink = [drawing.ink]
    if not drawing.lit:
        ink.append(marks.outlines(drawing))
    if look.edges:
        ink.append(marks.mesh_edges(drawing))
    return replace(drawing, ink=Shapes.join(ink))


def shown_values(solution: SolutionRecord, mesh: DisplayMesh, look: Look) -> tuple[Floats, Bar | None]:
    """Return values (v, 1) at the mesh's vertices and their colour bar, or colours (v, 3) and None.

    Raises
    ------
    InputError
        If there is no such channel, the channels are no vectors, or isolines of colours are requested.
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
    else:
        return np.clip(values, 0, 1), None
    return values, make_bar(values, look.clim, look.cmap, label, look.unit)


def shade(
    drawing: Drawing, solution: SolutionRecord, mesh: DisplayMesh, values: Floats, bar: Bar | None, look: Look
) -> Floats:
    """Return the image (rows, columns, 3), from 0 to 1, of a drawing with its values, isolines and arrows."""
    from cpmkit.view.raster import pixels  # numba is imported here

    ink = [drawing.ink]
    if look.isolines and bar is not None:
        ink.append(marks.isolines(drawing, values[:, 0], look.levels(bar.ends.tolist()), bar))
    if look.vectors and bar is not None:
        ink.append(marks.arrows(drawing, solution, mesh, mesh.values, bar))
    return pixels(drawing, values, bar, Shapes.join(ink))


def check_channels(look: Look, channels: int, dim: int) -> None:
    """Raise if a solution of ``channels`` channels, in space of dimension ``dim``, cannot be drawn with this look.

    Raises
    ------
    InputError
        If there is no such channel, the channels are no vectors, or isolines of colours are requested.
    """
    if look.channel is not None and look.channel >= channels:
        raise InputError(f"channel must be below {channels}, the number of channels, got {look.channel}.")
    if look.field == "error":
        return
    if look.vectors and channels != dim:
        raise InputError(f"vectors have as many channels as coordinates, {dim}, got {channels}.")
    if look.isolines and not look.vectors and look.channel is None and channels == 3:
        raise InputError("isolines are those of one channel; give channel=.")


def _sheet(solution: EigenRecord, look: Look) -> tuple[Any, str]:
    """Return the picture of all modes in the same colours, each under its eigenvalue, and the camera's description."""
    mesh = solution.display_mesh()
    columns = min(SHEET_COLUMNS, solution.channels)
    most = float(np.abs(mesh.values).max())
    cmap = SIGNED_CMAP if look.cmap == Look.cmap else look.cmap
    bar = make_bar(mesh.values, look.clim or (-most, most), cmap, look.label, look.unit)
    width = model_width(look.width, True, bar.label)
    drawing = _with_outlines(draw(solution, mesh, look, width // columns, look.light == "shaded"), look)
    tiles = [
        shade(drawing, solution, mesh, mesh.values[:, k : k + 1], bar, replace(look, vectors=False))
        for k in range(solution.channels)
    ]
    sheet = picture_sheet(tiles, solution.titles, columns)
    return compose(sheet, bar, look.title, look.width), drawing.camera.description
