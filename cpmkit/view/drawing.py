"""What a picture shows, as plain arrays: either renderer draws it, in this process or another."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import MissingDependencyError
from cpmkit.protocols import BoundarySet, Floats, HasMesh, Ints
from cpmkit.surface_mesh import DisplayMesh
from cpmkit.view.camera import Camera, fit

if TYPE_CHECKING:
    from cpmkit.solution import Solution

#: Share of its colour that a face keeps where no light falls; the light brings the rest.
AMBIENT = 0.5

#: Where the light comes from, in the picture's axes: over the viewer's left shoulder.
LIGHT = (-0.35, 0.5, 1.0)

#: Radius of boundary curves, of pins and of a curve that is itself the surface; shares of the picture's half width.
CURVE, PIN, STROKE = 0.0045, 0.012, 0.009

#: Width of the colour bar's column as a share of the picture's.
BAR = 0.12

INK = (0.12, 0.12, 0.14)


@dataclass(frozen=True, eq=False)
class Drawing:
    """Coloured cells, the boundaries over them, and the camera.

    Attributes
    ----------
    points, cells, colours : (v, 3) float64, (m, k) int64, (v, 3) float64
        The mesh and its colours from 0 to 1.
    normals : (v, 3) float64
        Unit normals; no rows where the cells are segments or lie in a plane.
    curve_points, curve_cells : (c, 3) float64, (s, 2) int64
        The boundary curves.
    pins : (p, 3) float64
        The boundary points.
    centre, axes, half, pixels : arrays
        The fields of :class:`~cpmkit.view.camera.Camera`, which shows the model.
    width : int64
        Width of the whole picture in pixels: the model and the colour bar.
    span : (2,) or (0,) float64
        The values at the ends of the colour bar; empty where the colours are the data.
    """

    points: Floats
    cells: Ints
    colours: Floats
    normals: Floats
    curve_points: Floats
    curve_cells: Ints
    pins: Floats
    centre: Floats
    axes: Floats
    half: Floats
    pixels: Ints
    width: Ints
    span: Floats

    @property
    def camera(self) -> Camera:
        """The projection."""
        return Camera(self.centre, self.axes, self.half, (int(self.pixels[0]), int(self.pixels[1])))

    def save(self, path: Path) -> None:
        """Write all arrays to the ``.npz`` file ``path``."""
        np.savez(path, **vars(self))

    @classmethod
    def load(cls, path: Path) -> Drawing:
        """Read what :meth:`save` wrote."""
        with np.load(path) as arrays:
            return cls(**arrays)


def draw(
    solution: Solution,
    width: int,
    view: tuple[float, ...] | None,
    up: tuple[float, ...] | None,
    curves: bool,
) -> Drawing:
    """Return the drawing of a solution; arguments as for :func:`cpmkit.view.picture`."""
    mesh = solution.display_mesh()
    points = in_space(mesh.points)
    colours, span = _colours(mesh)
    curve_points, curve_cells, pins = _boundaries(solution.scene.boundaries if curves else (), solution.spacing)
    if mesh.points.shape[1] == 2:
        view, up = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
    model_width = width - round(BAR * width) if len(span) else width
    camera = fit(np.concatenate([points, curve_points, pins]), model_width, view, up)
    return Drawing(
        points=points,
        cells=mesh.cells,
        colours=colours,
        normals=np.zeros((0, 3)) if mesh.normals is None else mesh.normals,
        curve_points=curve_points,
        curve_cells=curve_cells,
        pins=pins,
        centre=camera.centre,
        axes=camera.axes,
        half=camera.half,
        pixels=np.array(camera.pixels),
        width=np.array(width),
        span=span,
    )


def in_space(points: Floats) -> Floats:
    """Return points of the plane as (n, 3) with z = 0, points of space as they are."""
    return points if points.shape[1] == 3 else np.pad(points, ((0, 0), (0, 1)))


def viridis(share: Floats) -> Floats:
    """Return (n, 3) colours for shares (n,) from 0 to 1.

    Raises
    ------
    MissingDependencyError
        If matplotlib is not installed.
    """
    try:
        from matplotlib import colormaps
    except ImportError as error:
        raise MissingDependencyError("Colours need matplotlib; `pip install '.[view]'` adds it.") from error
    return np.asarray(colormaps["viridis"](share), dtype=np.float64)[:, :3]


def value_colours(values: Floats) -> tuple[Floats, Floats]:
    """Return (v, 3) colours of (v,) values, and the least and the greatest value (2,)."""
    span = np.array([values.min(), values.max()])
    extent = span[1] - span[0]
    share = (values - span[0]) / extent if extent > 0 else np.full(len(values), 0.5)
    return viridis(share), span


def _colours(mesh: DisplayMesh) -> tuple[Floats, Floats]:
    if mesh.values.shape[1] == 3:
        return np.clip(mesh.values, 0, 1), np.zeros(0)
    return value_colours(mesh.values[:, 0])


def _boundaries(boundaries: Iterable[BoundarySet], spacing: float) -> tuple[Floats, Ints, Floats]:
    """Return the points and segments of all boundary curves, and the boundary points."""
    points, cells, pins, count = [np.zeros((0, 3))], [np.zeros((0, 2), dtype=np.int64)], [np.zeros((0, 3))], 0
    for boundary in boundaries:
        if not isinstance(boundary.source, HasMesh):
            continue
        vertices, elements = boundary.source.mesh(spacing)
        if elements.shape[1] == 2:
            points.append(in_space(vertices))
            cells.append(elements + count)
            count += len(vertices)
        elif elements.shape[1] == 1:
            pins.append(in_space(vertices))
    return np.concatenate(points), np.concatenate(cells), np.concatenate(pins)
