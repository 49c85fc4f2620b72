"""The mesh that pictures and files show: the surface's own mesh, as fine as the lattice, cut along the boundaries.

A solution may jump across a boundary. Triangles that a boundary crosses are therefore split along it, and each of its
sides has vertices of its own at the same places, so that the jump stays sharp. Segments are split likewise; a point of
a cloud or of a union shows the value of the side on which it lies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from cpmkit.errors import InputError
from cpmkit.manifold.abilities import HasGivenMesh, HasNormals, HasSkin
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.manifold.vector_algebra import unit
from cpmkit.mesh.mesh import vertex_normals
from cpmkit.mesh.mixed_cells import CutCells, cells_with_corners, cut_by_distance, mesh_method, refine_mixed_cells
from cpmkit.scene.scene import Scene
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats, Ints, Side

#: Longest edge in spacings: longer edges are halved, since values are shown linear between vertices.
LONGEST_EDGE_SPACINGS = 2.0


@dataclass(frozen=True, eq=False)
class DisplayMesh:
    """A mesh of the surface with the solution at its vertices."""

    points: Floats  #: (v, d): vertices, in the scene's unit of length; on a boundary one for each side.
    cells: Ints  #: (m, k): triangles, segments of a curve, and points; rows with fewer corners than k end in -1.
    values: Floats  #: (v, channels): the solution at the vertices, each on the side that its cells lie on.
    #: (v, 3): unit normals of the uncut mesh, so that the cut does not show as a crease; those of points have an
    #: arbitrary sign. Zero where there are none; ``None`` in the plane and where there are only segments.
    normals: Floats | None
    original: int  #: Number of vertices of the surface's own mesh, which come first.
    #: (v, boundaries): 1 where a vertex lies on a boundary and has the left value, -1 where it has the right value, 0
    #: off the boundary. ``None`` for a mesh that was not cut by :func:`display_mesh`.
    sides: Ints | None = None

    @property
    def triangles(self) -> Ints:
        """Cells (t, 3) with three corners."""
        return cells_with_corners(self.cells, 3)

    @property
    def segments(self) -> Ints:
        """Cells (s, 2) with two corners."""
        return cells_with_corners(self.cells, 2)

    @property
    def dots(self) -> Ints:
        """Vertices (p,) that are cells with one corner."""
        return cells_with_corners(self.cells, 1)[:, 0]


def display_mesh(solution: SolutionRecord) -> DisplayMesh:
    """Return the surface's mesh with u, refined to edges of at most two spacings, cut along boundaries with sides.

    Raises InputError if the surface has no mesh.
    """
    surface = solution.scene.surface
    points, cells = mesh_method(surface)(solution.spacing)
    normals = _mesh_normals(surface, points, cells)
    attributes = points if normals is None else np.hstack([points, normals])
    dim, boundaries = points.shape[1], solution.scene.boundaries
    attributes, cells = refine_mixed_cells(attributes, cells, dim, LONGEST_EDGE_SPACINGS * solution.spacing)
    pieces = CutCells(attributes, np.zeros((len(attributes), len(boundaries)), dtype=np.int64), cells)
    for index, boundary in enumerate(boundaries):
        distance = solution.signed_distance(boundary.name, np.ascontiguousarray(pieces.attributes[:, :dim]))
        pieces = cut_by_distance(pieces, index, distance, dim, boundary.source, solution.spacing)
    cut_points = np.ascontiguousarray(pieces.attributes[:, :dim])
    return DisplayMesh(
        points=cut_points,
        cells=pieces.cells,
        values=evaluate_on_sides(solution, cut_points, pieces.sides),
        normals=None if normals is None else unit(pieces.attributes[:, dim:]),
        original=len(points),
        sides=pieces.sides,
    )


def _mesh_normals(surface: ClosestPointSource, points: Floats, cells: Ints) -> Floats | None:
    """Return unit normals (v, 3) at the vertices ``points`` (v, d) of ``cells`` (m, k): zero where only segments meet.

    Normals at cells with a single corner have any sign. None in the plane, and if all cells are segments.
    """
    triangles, dots = cells_with_corners(cells, 3), cells_with_corners(cells, 1)[:, 0]
    if points.shape[1] == 2 or not len(triangles) + len(dots):
        return None
    normals = vertex_normals(points, triangles)
    if len(dots):
        positions = np.ascontiguousarray(points[dots])
        own = surface.normals(surface.closest_point(positions)) if isinstance(surface, HasNormals) else None
        normals[dots] = plane_normals(positions) if own is None else own
    return normals


def plane_normals(points: Floats) -> Floats:
    """Return unit normals (p, 3), of arbitrary sign, of a point cloud ``points`` (p, 3), by which it is shaded.

    Each is normal to the plane fitted to a point and its eight nearest neighbours, or to all points if these are fewer
    than nine; it is zero where the points of the fit lie on a line, or there are fewer than three.
    """
    from scipy.spatial import cKDTree

    if len(points) < 3:
        return np.zeros_like(points)
    around = points[cKDTree(points).query(points, k=min(9, len(points)))[1]]
    offsets = around - around.mean(axis=1, keepdims=True)
    spread, axes = np.linalg.eigh(np.einsum("pki,pkj->pij", offsets, offsets))
    return np.where(spread[:, 1:2] > 1e-9 * spread[:, 2:], axes[:, :, 0], 0.0)


def evaluate_on_sides(solution: SolutionRecord, points: Floats, sides: Ints) -> Floats:
    """Return the solution (n, channels) at ``points`` (n, d), where points on boundaries are read from given ``sides``.

    ``sides`` (n, boundaries) is 1 for a point on the left side of a boundary, -1 on the right side, 0 off the boundary;
    a point is first projected onto the boundaries whose sides it is on. Without any side a point is read from the left.
    """
    values = np.empty((len(points), solution.channels))
    boundaries = solution.scene.boundaries
    moved = project_onto_boundaries(solution.scene, points, sides)
    for combination, rows in _group_by_sides(sides):
        on = [(boundary, code) for boundary, code in zip(boundaries, combination, strict=False) if code]
        side: dict[str, Side] = {boundary.name: "left" if code > 0 else "right" for boundary, code in on}
        values[rows] = solution.evaluate(moved[rows], side=side or None).reshape(len(rows), -1)
    return values


def project_onto_boundaries(scene: Scene, points: Floats, sides: Ints) -> Floats:
    """Return ``points`` (n, d) projected onto the boundaries for which ``sides`` (n, boundaries) is not zero.

    A solution has two values only on the boundary curve itself, and a cut, which is straight across a cell, is off the
    curve by a distance of second order. Where curves cross, alternating projections converge to the crossing.
    """
    moved = np.array(points)
    for combination, rows in _group_by_sides(sides):
        curves = [one.source for one, code in zip(scene.boundaries, combination, strict=False) if code]
        for _ in range(1 if len(curves) < 2 else 20):  # alternating projections converge to a crossing
            for curve in curves:
                moved[rows] = curve.closest_point(moved[rows]).points
    return moved


def _group_by_sides(sides: Ints) -> Iterator[tuple[Ints, Ints]]:
    """Yield each combination (boundaries,) of sides that occurs in ``sides`` (n, boundaries), and its rows."""
    combinations, member = np.unique(sides, axis=0, return_inverse=True)
    for index, combination in enumerate(combinations):
        yield combination, np.flatnonzero(member.ravel() == index)


def given_mesh_of(surface: ClosestPointSource) -> tuple[Floats, Ints]:
    """Return the vertices (n, d) and cells (m, k) of the mesh that the user made ``surface`` from, in their order.

    For a solid they are the vertices and cells of its boundary. Raises InputError if the surface, or the boundary of
    the solid, was not made from a mesh, a polyline or a cloud.
    """
    made = surface.skin if isinstance(surface, HasSkin) else surface
    if isinstance(made, HasGivenMesh):
        return made.given_mesh
    raise InputError(
        f"The surface {type(surface).__name__} was not made from vertices of yours; solution.evaluate(points) "
        "reads any points, and solution.display_mesh() is the mesh that pictures show."
    )


def values_at_vertices(solution: SolutionRecord, evaluate: Callable[[Floats], Floats]) -> Floats:
    """Return the values (n, ...) of ``evaluate`` at the n vertices of which the user made the surface, in their order.

    ``evaluate`` maps points (k, d) to values (k, ...). The values are NaN at a vertex that is not finite, or over half
    a spacing off the surface. Raises InputError if the surface was not made from vertices.
    """
    surface = solution.scene.surface
    vertices, _ = given_mesh_of(surface)
    rows = np.flatnonzero(np.isfinite(vertices).all(axis=1))
    distance = surface.closest_point(np.ascontiguousarray(vertices[rows])).distance
    rows = rows[distance <= 0.5 * solution.spacing]  # others are in no face
    read = evaluate(np.ascontiguousarray(vertices[rows]))
    values = np.full((len(vertices), *read.shape[1:]), np.nan)
    values[rows] = read
    return values
