"""What a picture shows, as plain arrays in the camera's axes: the mesh, and the boundaries over it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.protocols import BoundarySet, Floats, HasMesh, Ints
from cpmkit.scenefile.look import Look
from cpmkit.solution.display_mesh import DisplayMesh
from cpmkit.view.camera import Camera, fit
from cpmkit.view.colours import INK
from cpmkit.view.shapes import DISC_CORNERS, Shapes, disc_radii, discs, dots, lines, ribbons

if TYPE_CHECKING:
    from cpmkit.solution.record import SolutionRecord

#: Radius of boundary curves, of pins and of a curve that is itself the surface; shares of the picture's half width.
CURVE_RADIUS, PIN_RADIUS, STROKE_RADIUS = 0.0045, 0.012, 0.009

#: Curves lie so many of their radii before the surface, which is flat between its vertices.
CURVE_LIFT_RADII = 2.0


@dataclass(frozen=True, eq=False)
class Drawing:
    """Cells whose values may change from picture to picture, the boundaries over them, and the camera.

    Attributes
    ----------
    camera : Camera
    points : (v, 3) float64
        Vertices of ``triangles`` (t, 3), in the camera's axes: the mesh's own first, then those of strokes and discs,
        which stand for segments and points.
    owner : (v,) int64
        The vertex of the mesh of which each shows the value.
    normals : (v, 3) float64
        Unit normals in the camera's axes, zero on strokes; no rows in the plane and where there are segments alone.
    mesh_triangles : int
        The first so many triangles are the mesh's own.
    lit : bool
        Whether light falls on them.
    ink : Shapes
        The boundaries, and where nodes are doubled.
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
    """Return the drawing of a solution's mesh, ``width`` pixels wide."""
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
