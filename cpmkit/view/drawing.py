"""Contents of a picture as plain arrays in the camera's axes: the mesh, and the boundaries in front of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.manifold.abilities import HasMesh
from cpmkit.scene.boundary import BoundarySet
from cpmkit.scenefile.look import Look
from cpmkit.solution.display_mesh import DisplayMesh
from cpmkit.types import Floats, Ints
from cpmkit.view.camera import Camera, fit
from cpmkit.view.colours import INK

if TYPE_CHECKING:
    from cpmkit.solution.record import SolutionRecord


#: Number of corners of a disc around a point of a cloud, and of a dot.
DISC_CORNERS, DOT_CORNERS = 8, 24

#: Radius of a disc by the dimension of space: DISC_OVERLAP times the distance to neighbour number DISC_NEIGHBOURS, so
#: that discs also cover uneven clouds.
DISC_NEIGHBOURS, DISC_OVERLAP = {2: 2, 3: 6}, {2: 0.5, 3: 0.85}

#: Points whose neighbours are farther away than so many spacings are isolated points.
LONELY_SPACINGS = 10.0


@dataclass(frozen=True, eq=False)
class Shapes:
    """Triangles with a colour at each vertex, interpolated between.

    Attributes
    ----------
    points, colours : (v, 3) float64
        Vertices in the camera's axes, and their colours from 0 to 1.
    triangles : (t, 3) int64
    """

    points: Floats
    colours: Floats
    triangles: Ints

    @classmethod
    def join(cls, parts: list[Shapes]) -> Shapes:
        """Return all triangles of several shapes as one."""
        parts = [cls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)), *parts]
        starts = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
        return cls(
            np.concatenate([part.points for part in parts]),
            np.concatenate([part.colours for part in parts]),
            np.concatenate([part.triangles + start for part, start in zip(parts, starts, strict=True)]),
        )


def lines(starts: Floats, ends: Floats, half_width: float, lift: float, colour: Any) -> Shapes:
    """Return lines from ``starts`` to ``ends`` (s, 3), moved by ``lift`` towards the viewer, as rectangles.

    ``colour`` is (3,), or (s, 3) for each line.
    """
    points, triangles = ribbons(starts, ends, half_width)
    colours = np.broadcast_to(np.asarray(colour, dtype=np.float64), (len(starts), 3))
    return Shapes(points + [0, 0, lift], np.repeat(colours, 4, axis=0), triangles)


def dots(centres: Floats, radius: float, lift: float, colour: Any) -> Shapes:
    """Return round dots of one ``colour`` (3,) at ``centres`` (p, 3), moved by ``lift`` towards the viewer."""
    flat = np.zeros_like(centres)
    points, triangles = discs(centres, flat, np.full(len(centres), radius), np.array([0, 0, 1.0]), DOT_CORNERS)
    return Shapes(points + [0, 0, lift], np.tile(np.asarray(colour, dtype=np.float64), (len(points), 1)), triangles)


def ribbons(starts: Floats, ends: Floats, half_width: float) -> tuple[Floats, Ints]:
    """Return rectangles along segments, a little longer than these, that face the viewer.

    The result is vertices (4 s, 3), of which the first two of each rectangle are at its start and the others at its
    end, and triangles (2 s, 3).
    """
    along = (ends - starts)[:, :2]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = half_width * np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    flat = np.zeros(len(along))
    across, beyond = np.column_stack([-along[:, 1], along[:, 0], flat]), 0.5 * np.column_stack([along, flat])
    corners = (starts - beyond - across, starts - beyond + across, ends + beyond + across, ends + beyond - across)
    points = np.stack(corners, axis=1)
    fan = 4 * np.arange(len(starts))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    return points.reshape(-1, 3), fan.reshape(-1, 3)


def discs(
    centres: Floats, normals: Floats, radii: Floats, viewer: Floats, corners: int = DISC_CORNERS
) -> tuple[Floats, Ints]:
    """Return discs as triangles in the planes normal to ``normals``.

    Parameters
    ----------
    centres : (p, 3) float64
    normals : (p, 3) float64
        Of unit length and any sign; a disc with a normal of zero faces the viewer.
    radii : (p,) float64
    viewer : (3,) float64
        Unit vector towards the viewer.
    corners : int

    Returns
    -------
    vertices, triangles : (p * corners, 3) float64, (p * (corners - 2), 3) int64
    """
    normals = np.where(normals.any(axis=1, keepdims=True), normals, viewer)
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    angle = 2 * np.pi * np.arange(corners) / corners
    around = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
    corner = np.arange(1, corners - 1)
    fan = np.stack([np.zeros_like(corner), corner, corner + 1], axis=1)
    triangles = corners * np.arange(len(centres))[:, None, None] + fan
    return (centres[:, None] + radii[:, None, None] * around).reshape(-1, 3), triangles.reshape(-1, 3)


def disc_radii(points: Floats, spacing: float, least: float, alone: float) -> Floats:
    """Return radii (p,) with which discs around points (p, d) cover a surface, or a curve in the plane, without holes.

    No disc is smaller than ``least``; those of isolated points have the radius ``alone``.
    """
    from scipy.spatial import cKDTree

    neighbours, share = DISC_NEIGHBOURS[points.shape[1]], DISC_OVERLAP[points.shape[1]]
    if len(points) <= neighbours:
        return np.full(len(points), alone)
    reach = np.asarray(cKDTree(points).query(points, k=neighbours + 1)[0])[:, -1]
    lonely = reach > LONELY_SPACINGS * spacing
    usual = np.median(reach[~lonely]) if not lonely.all() else 0.0
    return np.where(lonely, alone, np.maximum(share * np.minimum(reach, 2 * usual), least))


#: Radii of boundary curves, of boundary points and of a curve that is itself the surface, as shares of the picture's
#: half width.
CURVE_RADIUS, PIN_RADIUS, STROKE_RADIUS = 0.0045, 0.012, 0.009

#: Distance of curves in front of the surface, in their radii, since it is flat between its vertices.
CURVE_LIFT_RADII = 2.0


@dataclass(frozen=True, eq=False)
class Drawing:
    """The cells of a mesh without values, which pictures may share, the boundaries over them, and the camera.

    Attributes
    ----------
    camera : Camera
    points : (v, 3) float64
        Vertices of ``triangles`` (t, 3), in the camera's axes: the mesh's own first, then those of strokes and discs,
        which stand for segments and points.
    owner : (v,) int64
        The vertex of the mesh whose value each vertex shows.
    normals : (v, 3) float64
        Unit normals in the camera's axes, zero on strokes; no rows in the plane and where there are only segments.
    mesh_triangles : int
        Number of triangles of the mesh itself, which come first.
    lit : bool
        Whether the triangles are shaded.
    ink : Shapes
        The boundaries and, if requested, points at doubled nodes.
    """

    camera: Camera
    points: Floats
    owner: Ints
    normals: Floats
    triangles: Ints
    mesh_triangles: int
    lit: bool
    ink: Shapes


def draw(solution: SolutionRecord, mesh: DisplayMesh, look: Look, width: int, lit: bool) -> Drawing:
    """Return the drawing of a solution's mesh, ``width`` pixels wide, with the boundaries that ``look`` requests.

    ``lit`` is whether the triangles are shaded, if they have normals.
    """
    points = in_space(mesh.points)
    curve_points, curve_cells, pins = boundary_meshes(
        solution.scene.boundaries if look.curves else (), solution.spacing
    )
    pins = np.concatenate([pins, in_space(solution.doubled)]) if look.twins else pins
    camera = fit(points, width, look.view, look.up, mesh.points.shape[1] == 2, np.concatenate([curve_points, pins]))
    half = camera.half[0]
    normals = np.zeros((0, 3)) if mesh.normals is None else mesh.normals @ camera.axes.T
    place = camera.project(points)
    facing = normals[mesh.dots] if len(normals) else np.zeros((len(mesh.dots), 3))
    radii = disc_radii(mesh.points[mesh.dots], solution.spacing, STROKE_RADIUS * half, PIN_RADIUS * half)
    rims, fans = discs(place[mesh.dots], facing, radii, np.array([0, 0, 1.0]))
    strokes, stroke_cells = ribbons(place[mesh.segments[:, 0]], place[mesh.segments[:, 1]], STROKE_RADIUS * half)
    curve = camera.project(curve_points)[curve_cells]
    radius = CURVE_RADIUS * half
    ink = [
        lines(curve[:, 0], curve[:, 1], radius, CURVE_LIFT_RADII * radius, INK),
        dots(camera.project(pins), PIN_RADIUS * half, PIN_RADIUS * half, INK),
    ]
    added = (np.repeat(facing, DISC_CORNERS, axis=0), np.zeros_like(strokes))
    return Drawing(
        camera=camera,
        points=np.concatenate([place, rims, strokes]),
        owner=np.concatenate(
            [np.arange(len(place)), np.repeat(mesh.dots, DISC_CORNERS), np.repeat(mesh.segments.ravel(), 2)]
        ),
        normals=np.concatenate([normals, *added]) if len(normals) else normals,
        triangles=np.concatenate([mesh.triangles, len(place) + fans, len(place) + len(rims) + stroke_cells]),
        mesh_triangles=len(mesh.triangles),
        lit=lit and len(normals) > 0,
        ink=Shapes.join(ink),
    )


def in_space(points: Floats) -> Floats:
    """Return points of the plane as (n, 3) with z = 0, points of space as they are."""
    return points if points.shape[1] == 3 else np.pad(points, ((0, 0), (0, 1)))


def boundary_meshes(boundaries: Iterable[BoundarySet], spacing: float) -> tuple[Floats, Ints, Floats]:
    """Return points (n, 3) and segments (m, 2) of all boundary curves with a mesh, and boundary points (k, 3)."""
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
