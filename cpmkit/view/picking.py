"""A window in which a line is drawn on a surface by clicks."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.errors import InputError, MissingDependencyError
from cpmkit.mesh.mixed_cells import with_corners
from cpmkit.protocols import ClosestPointSource, Floats, HasMesh
from cpmkit.runtime.messages import to_install
from cpmkit.scene.surface_input import Surface, as_source
from cpmkit.solution.solution import Solution
from cpmkit.view.drawing import in_space
from cpmkit.view.drawn_line import DrawnLine, check_line_file, start_line, write_line

#: Triangles of a source that is shown, and steps of the line, along the longest side of the surface.
SHOWN_CELLS, LINE_STEPS = 100, 200
#: Of the line in the window in its steps, and of the clicks in pixels.
TUBE_RADIUS_STEPS, POINT_SIZE = 0.8, 12
TOLD = "right click: a point,  BackSpace: take it back,  q: done"


def pick_line(shown: Surface | Solution, path: str | Path | None = None, *, closed: bool = False) -> Floats:
    """Show a surface or a solution in a window, in which clicks draw a line, and return the line.

    The right button puts a point under the mouse, the key BackSpace takes the last one back, q or closing the window
    ends it; the left button and the wheel turn and zoom. Between the points the line follows the surface. Left of it is
    at your left hand as you walk in the order of the clicks, the surface's outside up.

    Parameters
    ----------
    shown : ClosestPointSource or Solution
        What to draw on; also a mesh of another library, as for :class:`cpmkit.Scene`.
    path : path, optional
        A ``.csv``, ``.obj`` or ``.npy`` file, which the kind ``mesh.polyline`` reads; one that is there is replaced.
    closed : bool
        Whether the last point leads back to the first.

    Returns
    -------
    (n, d) float64
        Points of the surface, in the scene's coordinates; of a closed line the first is also the last.

    Raises
    ------
    InputError
        If it is no surface or has no mesh, the file is of another kind, or fewer than two points were picked, three of
        a closed line.
    MissingDependencyError
        If pyvista, which shows the window, is not installed.
    """
    surface = shown.scene.surface if isinstance(shown, Solution) else as_source(shown)
    place = None if path is None else check_line_file(path, surface)
    canvas = Canvas(start_line(surface, _size(surface) / LINE_STEPS, closed), shown_mesh(shown, surface))
    canvas.plotter.show()
    points = canvas.line.finished()
    if place is not None:
        write_line(points, place)
    return points


class Canvas:
    """The window: what is clicked becomes a point of the line, and the line is drawn anew.

    Attributes
    ----------
    line : DrawnLine
        So far.
    plotter : pyvista.Plotter
    """

    def __init__(self, line: DrawnLine, mesh: Any) -> None:
        self.line = line
        self.plotter = _pyvista().Plotter()
        coloured = {"scalars": "rgb", "rgb": True} if "rgb" in mesh.point_data else {}
        self.plotter.add_mesh(mesh, color=None if mesh.n_arrays else "wheat", **coloured)
        self.plotter.enable_surface_point_picking(
            callback=self.click, show_message=False, show_point=False, clear_on_no_selection=False
        )
        self.plotter.add_key_event("BackSpace", self.take_back)
        self.say(TOLD)

    def click(self, point: Any) -> None:
        """Add the surface's point nearest to the one (3,) under the mouse, or say why the line cannot go there."""
        try:
            self.line = self.line.clicked(point)
        except InputError as error:
            return self.say(str(error))
        self.draw()

    def take_back(self) -> None:
        """Remove the last point."""
        self.line = self.line.without_last()
        self.draw()

    def draw(self) -> None:
        """Draw the line as it is."""
        pyvista = _pyvista()
        self.plotter.remove_actor(["clicks", "line"])
        if len(self.line.clicks):
            marks = {"pickable": False, "reset_camera": False, "color": "black"}
            clicks, balls = pyvista.PolyData(in_space(self.line.clicks)), {"render_points_as_spheres": True}
            self.plotter.add_mesh(clicks, name="clicks", point_size=POINT_SIZE, **balls, **marks)
            if len(self.line.points) > 1:
                curve = pyvista.lines_from_points(in_space(self.line.points))
                tube = curve.tube(radius=TUBE_RADIUS_STEPS * self.line.step)  # a thin one is half hidden by triangles
                self.plotter.add_mesh(tube, name="line", **marks)
        self.say(TOLD)

    def say(self, sentence: str) -> None:
        """Write a sentence at the window's upper edge."""
        self.plotter.add_text(sentence, name="told", font_size=9, position="upper_left")


def shown_mesh(shown: Any, surface: ClosestPointSource) -> Any:
    """Return the ``pyvista.PolyData`` of a solution, or of a surface alone.

    Raises
    ------
    InputError, MissingDependencyError
        As :func:`pick_line` does.
    """
    pyvista = _pyvista()
    if isinstance(shown, Solution):
        return shown.to_pyvista()
    if not isinstance(surface, HasMesh):
        raise InputError("the surface has no mesh, without which it cannot be shown.")
    points, cells = surface.mesh(_size(surface) / SHOWN_CELLS)
    triangles = with_corners(cells, 3)
    if not len(triangles):  # a cloud
        return pyvista.PolyData(in_space(points))
    return pyvista.PolyData.from_regular_faces(in_space(points), triangles)


def _size(surface: ClosestPointSource) -> float:
    return float(np.ptp(surface.bounds, axis=0).max())


def _pyvista() -> Any:
    try:
        return import_module("pyvista")
    except ImportError as error:
        raise MissingDependencyError(
            f"pyvista, which shows the window, does not import: {error}; {to_install('view')} adds it."
        ) from error
