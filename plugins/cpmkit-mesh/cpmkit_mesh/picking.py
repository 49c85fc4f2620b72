"""Lines that a user draws on a surface by mouse clicks in a window."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.plugin import (
    ClosestPointSource,
    Floats,
    HasMesh,
    InputError,
    MissingDependencyError,
    in_three_dimensions,
    shown,
    written_whole,
)

if TYPE_CHECKING:
    from cpmkit.plugin import Solution, Surface

#: Largest distance of neighbouring points of a line, in steps; a longer gap is a jump to another part of the surface.
LARGEST_GAP_STEPS = 4.0
#: Largest distance, in steps, of a repeated click from the click before.
SAME_CLICK_STEPS = 1e-6
#: Files that the kind mesh.polyline reads.
LINE_SUFFIXES = (".csv", ".obj", ".npy")


@dataclass(frozen=True, eq=False)
class DrawnLine:
    """A line on a surface through the clicked points, in order.

    Attributes
    ----------
    surface : ClosestPointSource
        The surface on which the line lies.
    step : float
        Largest distance between neighbouring points of the line where the surface is flat.
    clicks : (k, d) float64
        The clicked points of the surface.
    closed : bool
        Whether the last click is connected to the first.
    """

    surface: ClosestPointSource
    step: float
    clicks: Floats
    closed: bool = False

    @cached_property
    def points(self) -> Floats:
        """Points (n, d) of the line on the surface, including the clicks; a closed line ends with its first point."""
        ends = np.concatenate([self.clicks, self.clicks[:1]]) if self.closed and len(self.clicks) > 1 else self.clicks
        if len(ends) < 2:
            return ends
        counts = np.maximum(np.ceil(np.linalg.norm(np.diff(ends, axis=0), axis=1) / self.step), 1).astype(np.int64)
        start = np.repeat(np.arange(len(counts)), counts)
        share = (np.arange(len(start)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[start]
        chords = ends[start] + share[:, None] * (ends[start + 1] - ends[start])
        return np.concatenate([self.surface.closest_point(chords).points, ends[-1:]])

    def with_click(self, point: Floats) -> DrawnLine:
        """Return the line with a further click, the surface point closest to ``point``, (d,) or, in the plane, (3,).

        A click at the place of the last one returns the line itself. Raise InputError if the line from the last click
        to the new one would leave the surface and jump.
        """
        place = np.asarray(point, dtype=np.float64)[None, : self.surface.dim]
        foot = self.surface.closest_point(np.ascontiguousarray(place)).points
        if len(self.clicks) and np.linalg.norm(foot[0] - self.clicks[-1]) <= SAME_CLICK_STEPS * self.step:
            return self
        check_no_jump(replace(self, clicks=np.concatenate([self.clicks[-1:], foot]), closed=False))
        return replace(self, clicks=np.concatenate([self.clicks, foot]))

    def without_last(self) -> DrawnLine:
        """Return the line without its last click."""
        return replace(self, clicks=self.clicks[:-1])

    def checked_points(self) -> Floats:
        """Return the points (n, d) of the finished line.

        Raise InputError if it has fewer than two clicks (three if it is closed), or its end cannot be connected to its
        start.
        """
        least = 3 if self.closed else 2
        if len(self.clicks) < least:
            kind = "a closed line" if self.closed else "a line"
            raise InputError(f"{kind} needs {least} points at least, and {len(self.clicks)} were picked.")
        check_no_jump(self)
        return self.points


def start_line(surface: ClosestPointSource, step: float, closed: bool = False) -> DrawnLine:
    """Return a line on ``surface`` without clicks, with points at most ``step`` apart, closed or open.

    Raise InputError if ``surface`` is no surface but points, a curve or a solid.
    """
    if surface.manifold_dim not in (2, None):
        kind = {0: "points", 1: "a curve"}.get(surface.manifold_dim, "a solid")
        raise InputError(f"lines are drawn on surfaces, and this is {kind}.")
    return DrawnLine(surface, step, np.zeros((0, surface.dim)), closed)


def check_no_jump(line: DrawnLine) -> None:
    """Raise InputError if neighbouring points of ``line`` are farther apart than :data:`LARGEST_GAP_STEPS` steps."""
    gaps = np.linalg.norm(np.diff(line.points, axis=0), axis=1)
    if len(gaps) and gaps.max() > LARGEST_GAP_STEPS * line.step:
        place = ", ".join(f"{x:.4g}" for x in line.points[int(gaps.argmax())])
        raise InputError(
            f"the straight line between two points leaves the surface near ({place}); pick one between them."
        )


def check_line_file(path: str | Path, surface: ClosestPointSource) -> Path:
    """Return ``path`` if a line on ``surface`` can be written to such a file.

    Raise InputError if the suffix is not accepted, or it is an OBJ file and the surface is in the plane.
    """
    path = Path(path)
    if path.suffix.lower() not in LINE_SUFFIXES:
        raise InputError(f"A line is saved as {', '.join(LINE_SUFFIXES)}, got {shown(path.name)}.")
    if path.suffix.lower() == ".obj" and surface.dim == 2:
        raise InputError("OBJ files hold points of space, and the line is in the plane; use .csv.")
    return path


def write_line(points: Floats, path: Path) -> None:
    """Write points (n, d) to a file, by its suffix, that ``mesh.polyline`` reads; an existing file is replaced."""
    rows = [[f"{x:.17g}" for x in point] for point in points.tolist()]
    with written_whole(path) as unfinished:
        if path.suffix.lower() == ".npy":
            with unfinished.open("wb") as file:
                np.save(file, points)
        elif path.suffix.lower() == ".csv":
            unfinished.write_text("".join(",".join(row) + "\n" for row in rows), encoding="utf-8")
        else:
            closed = len(points) > 1 and bool((points[0] == points[-1]).all())
            vertices = rows[:-1] if closed else rows
            numbers = [*range(1, len(vertices) + 1), *([1] if closed else [])]
            text = "".join("v " + " ".join(row) + "\n" for row in vertices) + "l " + " ".join(map(str, numbers)) + "\n"
            unfinished.write_text(text, encoding="utf-8")


#: Number of triangles of a displayed source, and of steps of the line, along the longest side of the surface.
SHOWN_CELLS, LINE_STEPS = 100, 200
#: Radius of the line in the window, in steps, and size of the clicks in pixels.
TUBE_RADIUS_STEPS, POINT_SIZE = 0.8, 12
#: Text in the window.
HELP = "right click: add a point,  BackSpace: remove it,  q: done"


def pick_line(shown: Surface | Solution, path: str | Path | None = None, *, closed: bool = False) -> Floats:
    """Return the points (n, d) of a line that the user draws by clicks in a window that shows a surface or a solution.

    Block until the window closes; write the line to ``path`` if given. See :func:`cpmkit.pick_line`.
    """
    from cpmkit.plugin import Solution, as_source

    surface = shown.scene.surface if isinstance(shown, Solution) else as_source(shown)
    place = None if path is None else check_line_file(path, surface)
    canvas = Canvas(start_line(surface, _size(surface) / LINE_STEPS, closed), shown_mesh(shown, surface))
    canvas.plotter.show()
    points = canvas.line.checked_points()
    if place is not None:
        write_line(points, place)
    return points


class Canvas:
    """A window in which each click adds a point to a line and draws the line again.

    Attributes
    ----------
    line : DrawnLine
        The line so far.
    plotter : pyvista.Plotter
        The plotter of the window.
    """

    def __init__(self, line: DrawnLine, mesh: Any) -> None:
        """Prepare, but do not yet show, the window with a mesh of pyvista; clicks already in ``line`` are not drawn."""
        self.line = line
        self.plotter = _pyvista().Plotter()
        coloured = {"scalars": "rgb", "rgb": True} if "rgb" in mesh.point_data else {}
        self.plotter.add_mesh(mesh, color=None if mesh.n_arrays else "wheat", **coloured)
        self.plotter.enable_surface_point_picking(
            callback=self.click, show_message=False, show_point=False, clear_on_no_selection=False
        )
        self.plotter.add_key_event("BackSpace", self.remove_last)
        self.say(HELP)

    def click(self, point: Any) -> None:
        """Add the surface point closest to ``point`` (3,) to the line and draw it, or show why that is refused."""
        try:
            self.line = self.line.with_click(point)
        except InputError as error:
            return self.say(str(error))
        self.draw()

    def remove_last(self) -> None:
        """Remove the last click from the line and draw it again."""
        self.line = self.line.without_last()
        self.draw()

    def draw(self) -> None:
        """Replace the line and its clicks in the window by those of :attr:`line`, and show the help text."""
        pyvista = _pyvista()
        self.plotter.remove_actor(["clicks", "line"])
        if len(self.line.clicks):
            marks = {"pickable": False, "reset_camera": False, "color": "black"}
            clicks, balls = pyvista.PolyData(in_three_dimensions(self.line.clicks)), {"render_points_as_spheres": True}
            self.plotter.add_mesh(clicks, name="clicks", point_size=POINT_SIZE, **balls, **marks)
            if len(self.line.points) > 1:
                curve = pyvista.lines_from_points(in_three_dimensions(self.line.points))
                tube = curve.tube(radius=TUBE_RADIUS_STEPS * self.line.step)  # a thin tube is half hidden by triangles
                self.plotter.add_mesh(tube, name="line", **marks)
        self.say(HELP)

    def say(self, sentence: str) -> None:
        """Replace the text at the upper left of the window by ``sentence``."""
        self.plotter.add_text(sentence, name="sentence", font_size=9, position="upper_left")


def shown_mesh(shown: Any, surface: ClosestPointSource) -> Any:
    """Return the ``pyvista.PolyData`` on which :func:`pick_line` draws: of a solution ``shown``, else of ``surface``.

    A source without triangles gives its points. Raise InputError if it has no mesh, MissingDependencyError without
    pyvista.
    """
    pyvista = _pyvista()
    from cpmkit.plugin import Solution

    if isinstance(shown, Solution):
        return shown.to_pyvista()
    if not isinstance(surface, HasMesh):
        raise InputError("the surface has no mesh, without which it cannot be shown.")
    points, cells = surface.mesh(_size(surface) / SHOWN_CELLS)
    triangles = cells[(cells >= 0).sum(axis=1) == 3]
    if not len(triangles):  # a point cloud
        return pyvista.PolyData(in_three_dimensions(points))
    return pyvista.PolyData.from_regular_faces(in_three_dimensions(points), triangles)


def _size(surface: ClosestPointSource) -> float:
    """Return the longest side of the surface's bounding box."""
    return float(np.ptp(surface.bounds, axis=0).max())


def _pyvista() -> Any:
    """Return the module pyvista; raise MissingDependencyError if it does not import."""
    try:
        return import_module("pyvista")
    except ImportError as error:
        raise MissingDependencyError(
            f"pyvista, which shows the window, does not import: {error}; `pip install 'cpmkit[view]'` adds it."
        ) from error
