"""What a picture shows, as plain arrays: either renderer draws it, in this process or another."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import MissingDependencyError
from cpmkit.meshes.display_mesh import DisplayMesh
from cpmkit.protocols import BoundarySet, Floats, HasMesh, Ints
from cpmkit.runtime.installing import to_install
from cpmkit.scenefile.output_request import PICTURE_FIELDS
from cpmkit.view.camera import Camera, Direction, fit

if TYPE_CHECKING:
    from cpmkit.solution.solution import Solution

#: The values at the ends of the colour bar; None: the least and the greatest.
Span = tuple[float, float] | None

#: What a picture can show.
FIELDS = PICTURE_FIELDS

#: Share of its colour that a face keeps where no light falls; the light brings the rest.
AMBIENT = 0.5

#: Where the light comes from, in the picture's axes: over the viewer's left shoulder.
LIGHT = (-0.35, 0.5, 1.0)

#: Radius of boundary curves, of pins and of a curve that is itself the surface; shares of the picture's half width.
CURVE_RADIUS, PIN_RADIUS, STROKE_RADIUS = 0.0045, 0.012, 0.009

#: A point of a cloud is drawn as a disc with so many corners. On a curve in the plane its radius is half the distance
#: to the second neighbour, on a surface this share of that to the sixth: uneven clouds, too, are covered.
DISC_CORNERS, DISC_NEIGHBOURS, DISC_OVERLAP = 8, {2: 2, 3: 6}, {2: 0.5, 3: 0.85}

#: Points whose neighbours are farther away than so many spacings belong to no cloud.
LONELY_SPACINGS = 10.0

#: Width of the colour bar's column as a share of the picture's.
BAR_WIDTH = 0.12

INK = (0.12, 0.12, 0.14)


@dataclass(frozen=True, eq=False)
class Drawing:
    """Coloured cells, the boundaries over them, and the camera.

    Attributes
    ----------
    points, colours : (v, 3) float64
        Vertices and their colours from 0 to 1.
    triangles, segments : (t, 3) int64, (s, 2) int64
        The cells. Points of the mesh are discs, made of triangles.
    normals : (v, 3) float64
        Unit normals, zero at the ends of segments; no rows where nothing is shaded.
    curve_points, curve_cells : (c, 3) float64, (s, 2) int64
        The boundary curves.
    pins : (p, 3) float64
        The boundary points, and where nodes are doubled.
    centre, axes, half, pixels : arrays
        The fields of :class:`~cpmkit.view.camera.Camera`, which shows the model.
    width : int64
        Width of the whole picture in pixels: the model and the colour bar.
    span : (2,) or (0,) float64
        The values at the ends of the colour bar; empty where the colours are the data.
    """

    points: Floats
    triangles: Ints
    segments: Ints
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
        return Camera(self.centre, self.axes, self.half, self.pixels)

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
    view: Direction,
    up: Direction,
    curves: bool,
    span: Span = None,
    twins: bool = False,
    field: str = FIELDS[0],
) -> Drawing:
    """Return the drawing of a solution; arguments as for :func:`cpmkit.view.picture`."""
    mesh = solution.display_mesh()
    if field == "error":  # of several channels the largest
        mesh = replace(mesh, values=solution.error.on_mesh(mesh).max(axis=1, keepdims=True))
    points = in_space(mesh.points)
    colours, bar = _colours(mesh, span)
    curve_points, curve_cells, pins = _boundaries(solution.scene.boundaries if curves else (), solution.spacing)
    pins = np.concatenate([pins, in_space(solution.doubled)]) if twins else pins
    if mesh.points.shape[1] == 2:
        view, up = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
    model_width = width - round(BAR_WIDTH * width) if len(bar) else width
    camera = fit(np.concatenate([points, curve_points, pins]), model_width, view, up)
    normals = np.zeros((0, 3)) if mesh.normals is None else mesh.normals
    facing = normals[mesh.dots] if len(normals) else np.zeros((len(mesh.dots), 3))
    radii = _disc_radii(
        mesh.points[mesh.dots], solution.spacing, STROKE_RADIUS * camera.half[0], PIN_RADIUS * camera.half[0]
    )
    rims, fans = discs(points[mesh.dots], facing, radii, camera.axes[2])
    return Drawing(
        points=np.concatenate([points, rims]),
        triangles=np.concatenate([mesh.triangles, len(points) + fans]),
        segments=mesh.segments,
        colours=np.concatenate([colours, np.repeat(colours[mesh.dots], DISC_CORNERS, axis=0)]),
        normals=np.concatenate([normals, np.repeat(facing, DISC_CORNERS, axis=0)]) if len(normals) else normals,
        curve_points=curve_points,
        curve_cells=curve_cells,
        pins=pins,
        width=np.array(width),
        span=bar,
        **vars(camera),
    )


def discs(centres: Floats, normals: Floats, radii: Floats, viewer: Floats) -> tuple[Floats, Ints]:
    """Return discs as triangles.

    Parameters
    ----------
    centres : (p, 3) float64
    normals : (p, 3) float64
        Of unit length and any sign; a disc with a normal of zero faces the viewer.
    radii : (p,) float64
    viewer : (3,) float64
        Unit vector towards the viewer.

    Returns
    -------
    vertices, triangles : (p * CORNERS, 3) float64, (p * (CORNERS - 2), 3) int64
    """
    normals = np.where(normals.any(axis=1, keepdims=True), normals, viewer)
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    angle = 2 * np.pi * np.arange(DISC_CORNERS) / DISC_CORNERS
    around = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
    corner = np.arange(1, DISC_CORNERS - 1)
    fan = np.stack([np.zeros_like(corner), corner, corner + 1], axis=1)
    triangles = DISC_CORNERS * np.arange(len(centres))[:, None, None] + fan
    return (centres[:, None] + radii[:, None, None] * around).reshape(-1, 3), triangles.reshape(-1, 3)


def _disc_radii(points: Floats, spacing: float, least: float, alone: float) -> Floats:
    """Return (p,) radii with which discs around points (p, d) of a surface, or curve in the plane, leave no hole.

    No disc is smaller than ``least``; those that stand for points on no surface have the radius ``alone``.
    """
    from scipy.spatial import cKDTree

    neighbours, share = DISC_NEIGHBOURS[points.shape[1]], DISC_OVERLAP[points.shape[1]]
    if len(points) <= neighbours:
        return np.full(len(points), alone)
    reach = np.asarray(cKDTree(points).query(points, k=neighbours + 1)[0])[:, -1]
    lonely = reach > LONELY_SPACINGS * spacing
    usual = np.median(reach[~lonely]) if not lonely.all() else 0.0
    return np.where(lonely, alone, np.maximum(share * np.minimum(reach, 2 * usual), least))


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
        raise MissingDependencyError(f"Colours need matplotlib; {to_install('view')} adds it.") from error
    return np.asarray(colormaps["viridis"](share), dtype=np.float64)[:, :3]


def value_colours(values: Floats, span: Span = None) -> tuple[Floats, Floats]:
    """Return (v, 3) colours of (v,) values, and the values (2,) at the ends of the scale: ``span``, or the extremes."""
    ends = np.array([values.min(), values.max()] if span is None else span)
    extent = ends[1] - ends[0]
    share = (values - ends[0]) / extent if extent > 0 else np.full(len(values), 0.5)
    return viridis(share), ends


def _colours(mesh: DisplayMesh, span: Span) -> tuple[Floats, Floats]:
    if mesh.values.shape[1] == 3:
        return np.clip(mesh.values, 0, 1), np.zeros(0)
    return value_colours(mesh.values[:, 0], span)


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
