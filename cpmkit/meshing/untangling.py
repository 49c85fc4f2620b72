"""Triangles that turn over beside a curved boundary: their vertices or midpoints are moved back, or with the boundary.

A vertex may lie nearer to the chord of a boundary than the boundary does. The area of a triangle that turned over would
count twice; were the boundary left on its chord, samples would lie on its wrong side and get data of the other side.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import unit_normals
from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.mesh.mesh import Mesh
from cpmkit.types import Bools, Floats, Ints

#: A triangle whose area shrinks to less than this share, at one of its corners, counts as turned over.
LEAST_AREA_RATIO = 0.2
#: While vertices are moved onto a boundary, triangles may become as thin as this share: moved back, the vertices would
#: be a hundredth of a spacing off the boundary, where data may jump.
LEAST_MOVED_AREA_RATIO = 0.02
#: Step of differences for normals of a manifold that has no normals of its own, over the longest edge.
NORMAL_EDGE_SHARE = 0.1
#: Number of rounds, since moving vertices or midpoints back may turn over other triangles.
UNTANGLING_ROUNDS = 4


def untangle_vertices(mesh: Mesh, before: Floats, moved: Floats) -> Floats:
    """Return ``moved`` (v, d), with the positions ``before`` (v, d) for vertices of triangles that would turn over.

    A vertex may be nearer to a boundary than the boundary is to its chords: the boundary then passes it on the side on
    which its chords do.
    """
    if mesh.manifold_dim == 1:
        return moved
    moved = moved.copy()
    has_moved = np.any(moved != before, axis=1)
    for _ in range(UNTANGLING_ROUNDS):
        cells = mesh.cells[np.flatnonzero(has_moved[mesh.cells].any(axis=1))]
        turned_over = area_ratios(before[cells], moved[cells]) < LEAST_MOVED_AREA_RATIO
        rows = np.unique(cells[turned_over])
        rows = rows[has_moved[rows]]
        if not len(rows):
            break
        moved[rows], has_moved[rows] = before[rows], False
    return moved


def untangle_midpoints(
    mesh: Mesh,
    on_boundary: Ints,
    midpoints: Floats,
    free: Floats,
    source: LocalSource,
    project: Callable[[Floats], Floats],
) -> Floats:
    """Return the ``midpoints`` (e, d) of edges, changed where triangles beside boundaries would turn over.

    First the other midpoints of such triangles move along with the midpoint on the boundary; boundaries whose triangles
    still turn over are left on their chords.

    Parameters
    ----------
    mesh : Mesh
        Triangles.
    on_boundary : (c,) int64
        The edges on boundaries.
    midpoints, free : (e, d) float64
        Midpoints on the manifold, the rim and boundaries, and midpoints without regard to boundaries.
    source : LocalSource
        The manifold.
    project : callable
        Projects points (k, d) near the free midpoints onto the manifold.
    """
    folded = _folded_triangles(mesh, midpoints, source)
    if not len(folded):
        return midpoints
    is_on_boundary = np.zeros(len(midpoints), dtype=bool)
    is_on_boundary[on_boundary] = True
    moved = _move_with_boundary(mesh, is_on_boundary, folded, midpoints, free, project)
    for _ in range(UNTANGLING_ROUNDS):
        edges = mesh.edges.of_cells[_folded_triangles(mesh, moved, source)].ravel()
        if not len(edges):
            break
        rows = np.unique(edges[is_on_boundary[edges]])
        others = np.unique(edges[~is_on_boundary[edges]])
        moved[others] = midpoints[others]
        moved[rows] = project(free[rows])
    return moved


def area_ratios(before: Floats, moved: Floats) -> Floats:
    """Return the ratio (m,) of the signed areas of triangles after and before a move, from their corners (m, 3, d)."""
    return _signed_ratio(*_sides(before), *_sides(moved))


def is_folded(x: Floats, midpoints: Floats) -> Bools:
    """Return which quadratic triangles (m,) nearly turn over at a corner, from corners and midpoints (m, 3, d).

    A thin triangle beside a boundary does so where the boundary bends by more than the triangle's height.
    """
    following, previous = np.array([1, 2, 0]), np.array([2, 0, 1])
    ahead, behind = x[:, following], x[:, previous]
    first = 4 * midpoints[:, previous] - 3 * x - ahead
    second = 4 * midpoints[:, following] - 3 * x - behind
    ratios = _signed_ratio(ahead - x, behind - x, first, second)
    return np.asarray(np.any(ratios < LEAST_AREA_RATIO, axis=1))


def _sides(corners: Floats) -> tuple[Floats, Floats]:
    """Return the two sides (n, d) from the first corner of triangles with ``corners`` (n, 3, d)."""
    return corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]


def _signed_ratio(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """Return the ratio (n,) of the area spanned by c and d, projected on the plane of a and b, to that of a and b.

    All are (n, d) vectors; areas have signs, and the ratio is 1 where the area of a and b is zero.
    """
    size = dots(a, a) * dots(b, b) - dots(a, b) ** 2
    projected = dots(c, a) * dots(d, b) - dots(c, b) * dots(d, a)
    return np.asarray(np.divide(projected, size, out=np.ones_like(size), where=size > 0))


def _folded_triangles(mesh: Mesh, midpoints: Floats, source: LocalSource) -> Ints:
    """Return the triangles (k,) that turn over, seen along the manifold's normal.

    The plane of a triangle is no measure where the triangle is thinner than its edges bend with the manifold; it serves
    for preselection.
    """
    corners, of_cells = mesh.vertices[mesh.cells], mesh.edges.of_cells
    rows = np.flatnonzero(is_folded(corners, midpoints[of_cells]))
    if not len(rows):
        return rows
    x, middles = corners[rows], midpoints[of_cells[rows]]
    step = NORMAL_EDGE_SHARE * float(norms(x - np.roll(x, 1, axis=1)).max())
    normal = unit_normals(source, source.closest_point(x.mean(axis=1)), step)[:, None]
    x, middles = (points - dots(points, normal)[..., None] * normal for points in (x, middles))
    return rows[is_folded(x, middles)]


def _move_with_boundary(
    mesh: Mesh,
    is_on_boundary: Bools,
    folded: Ints,
    midpoints: Floats,
    free: Floats,
    project: Callable[[Floats], Floats],
) -> Floats:
    """Return the midpoints (e, d), displaced in ``folded`` triangles (k,) like the midpoint on the boundary."""
    edges = mesh.edges.of_cells[folded]
    edges = edges[is_on_boundary[edges].sum(axis=1) == 1]
    moved = midpoints.copy()
    if not len(edges):
        return moved
    on_boundary = edges[is_on_boundary[edges]]
    start, end = (mesh.vertices[mesh.edges.ends[on_boundary, k]] for k in range(2))
    chord, displacement = end - start, midpoints[on_boundary] - free[on_boundary]
    for rows in edges[~is_on_boundary[edges]].reshape(-1, 2).T:
        along = dots(free[rows] - start, chord) / dots(chord, chord)
        gap = norms(free[rows] - start - along[:, None] * chord) / norms(chord)
        share = np.maximum(4 * along * (1 - along), 0.0) * np.maximum(1 - gap, 0.0)
        moved[rows] = project(free[rows] + share[:, None] * displacement)
    return moved
