"""Cells of mixed dimension in one array (triangles, segments and points; shorter rows end in -1), cuts, polylines."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cpmkit.errors import InputError
from cpmkit.manifold.abilities import HasMesh, members_of
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.manifold.vector_algebra import norms
from cpmkit.mesh.mesh import Connectivity
from cpmkit.types import Bools, Floats, Ints


def cells_with_corners(cells: Ints, corners: int) -> Ints:
    """Return those rows of ``cells`` (m, k) that have this number of ``corners``, (n, corners), without padding.

    Examples
    --------
    >>> import numpy as np
    >>> cells = np.array([[0, 1, 2], [3, 4, -1], [5, -1, -1]])
    >>> cells_with_corners(cells, 2).tolist(), cells_with_corners(cells, 3).tolist()
    ([[3, 4]], [[0, 1, 2]])
    """
    if corners > cells.shape[1]:
        return np.zeros((0, corners), dtype=np.int64)
    return cells[(cells >= 0).sum(axis=1) == corners, :corners]


def stack_cells(parts: Iterable[Ints]) -> Ints:
    """Return ``parts``, arrays of cells (p, c), as one array (m, k) in their order; shorter rows are padded with -1."""
    non_empty = [part for part in parts if len(part)]
    width = max((part.shape[1] for part in non_empty), default=1)
    rows = [np.pad(part, ((0, 0), (0, width - part.shape[1])), constant_values=-1) for part in non_empty]
    return np.concatenate(rows) if rows else np.zeros((0, width), dtype=np.int64)


def renumber_cells(cells: Ints, number: Ints) -> Ints:
    """Return ``cells`` (m, k) with ``number[v]`` in place of each vertex v; ``number`` is (v,); padding stays -1."""
    return np.where(cells >= 0, number[cells], -1)


def number_edges(cells: Ints, count: int) -> tuple[Ints, Ints]:
    """Return the distinct edges (e, 2) of ``cells`` (m, k) of one dimension, and the edges (m, c) of each cell.

    Edge j of a cell joins its corners j and j + 1; a segment has one edge, a point none. ``count`` vertices exist.
    """
    edges = Connectivity(cells, count).edges
    return edges.ends, np.roll(edges.of_cells, 1, axis=1)


def rotate_triangles(cells: Ints, of_edges: Ints, first: Ints) -> tuple[Ints, Ints]:
    """Return ``cells`` and edges ``of_edges``, (m, 3), rotated to start at place ``first`` (m,) modulo 3, as (3, m)."""
    order = (first[:, None] + np.arange(3)) % 3
    return np.take_along_axis(cells, order, 1).T, np.take_along_axis(of_edges, order, 1).T


def mesh_method(surface: ClosestPointSource) -> Callable[[float], tuple[Floats, Ints]]:
    """Return the method of ``surface`` that takes a spacing and returns vertices (v, d) and cells (m, k).

    Raises InputError if the surface has no such method.
    """
    if isinstance(surface, HasMesh):
        return surface.mesh
    raise InputError(
        f"The surface {type(surface).__name__} has no method mesh(spacing), so it can be neither drawn nor saved as a "
        "mesh; give it one, or ask for 'solution.npz' and 'summary.json' alone."
    )


def member_dimensions(surface: ClosestPointSource) -> list[int]:
    """Return the different dimensions of a surface's members, ascending; if unknown, that of the space."""
    members = members_of(surface)
    return sorted({member.dim if member.manifold_dim is None else member.manifold_dim for member in members})


def cells_of_dimension(cells: Ints, surface: ClosestPointSource, dim: int) -> Ints:
    """Return the ``cells`` (n, k) of a surface's mesh, padded with -1, that have dimension ``dim``, as (m, dim + 1).

    Raises InputError if the mesh has cells of a dimension that no member has (a solid's boundary), or none of ``dim``.
    """
    dimensions = {corners - 1 for corners in (1, 2, 3) if len(cells_with_corners(cells, corners))}
    if dim not in dimensions or not dimensions <= {member.manifold_dim for member in members_of(surface)}:
        names = " and ".join({0: "points", 1: "segments", 2: "triangles"}[shown] for shown in sorted(dimensions))
        raise InputError(
            f"The mesh of {type(surface).__name__} has {names} "
            f"where a manifold of dimension {dim} is integrated over; curves, surfaces and areas of the plane with a "
            "mesh that fills them are accepted; for other solids use form='galerkin'."
        )
    return cells_with_corners(cells, dim + 1)


def refine_mixed_cells(attributes: Floats, cells: Ints, dim: int, longest: float) -> tuple[Floats, Ints]:
    """Return attributes (v', w) and cells (m', k) of a mesh with edges halved until none is longer than ``longest``.

    The given vertices come first; neighbouring triangles share midpoints. Triangles come before segments, points last.
    ``attributes`` (v, w): the first ``dim``, 2 or 3, columns are positions; all are averaged at midpoints of edges.
    ``cells`` (m, k): triangles, segments and points; shorter rows end in -1.
    ``longest``: longest edge, in the unit of the positions.
    """
    from cpmkit.mesh.mesh_kernels import split_triangles

    parts = []
    for corners in (3, 2):
        part = cells_with_corners(cells, corners)
        while True:
            edges = Connectivity(part, len(attributes)).edges
            long = edges.lengths(attributes[:, :dim]) > longest
            if not long.any():
                break
            middle = np.where(long, len(attributes) + np.cumsum(long) - 1, -1)
            attributes = np.concatenate([attributes, attributes[edges.ends[long]].mean(axis=1)])
            if corners == 3:
                points = np.ascontiguousarray(attributes[:, :dim])
                part = split_triangles(np.ascontiguousarray(part), edges.of_cells, middle, points)
            else:
                (a, b), p = part[long].T, middle[long]
                part = np.concatenate([part[~long], np.stack([a, p], axis=1), np.stack([p, b], axis=1)])
        parts.append(part)
    return attributes, stack_cells([*parts, cells_with_corners(cells, 1)])


class Polyline(NamedTuple):
    """Points (n, d) in the direction of travel; a closed polyline continues from the last point to the first."""

    points: Floats
    closed: bool


def chain_segments(vertices: Floats, segments: Ints) -> list[Polyline]:
    """Return the polylines formed by directed segments (m, 2) between vertices (v, d).

    A polyline passes through vertices at which exactly one segment ends and one starts, and ends at all others.
    """
    starts, ends = segments.T
    count = int(segments.max(initial=-1)) + 1
    is_passed = (np.bincount(starts, minlength=count) == 1) & (np.bincount(ends, minlength=count) == 1)
    following = np.full(count, -1)
    following[starts] = ends
    polylines, seen = [], np.zeros(count, dtype=bool)
    for chain in ([start, end] for start, end in segments.tolist() if not is_passed[start]):
        while is_passed[chain[-1]]:
            seen[chain[-1]] = True
            chain.append(int(following[chain[-1]]))
        closed = chain[0] == chain[-1]
        polylines.append(Polyline(vertices[chain[:-1] if closed else chain], closed))
    for first in np.flatnonzero(is_passed).tolist():
        if not seen[first]:
            chain = [first]
            while not seen[chain[-1]]:
                seen[chain[-1]] = True
                chain.append(int(following[chain[-1]]))
            polylines.append(Polyline(vertices[chain[:-1]], True))
    return polylines


#: A vertex nearer to a boundary than this share of the spacing lies on it.
ON_CURVE_SPACINGS = 1e-6

#: An edge crosses a boundary if the zero on it lies nearer to the boundary than this share of its length.
CROSSED_EDGE_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class CutCells:
    """Cells of mixed dimension after some cuts along boundaries; cuts interpolate ``attributes``."""

    attributes: Floats  # (v, d) or (v, 2 d): points, and normals if any
    sides: Ints  # (v, boundaries): 1 left, -1 right, 0 for vertices not on that boundary
    cells: Ints  # (m, k): triangles, segments and points, shorter rows end in -1


def cut_by_distance(
    pieces: CutCells, boundary: int, distance: Floats, dim: int, curve: ClosestPointSource, spacing: float
) -> CutCells:
    """Return a mesh to draw, with cells split where a boundary crosses them, and separate vertices on its two sides.

    ``pieces``: the mesh before the cut. Triangles in which the boundary ends stay whole.
    ``boundary``: the boundary's column in ``pieces.sides``.
    ``distance`` (v,): signed distances of vertices from the boundary, positive on the left, NaN without a side.
    ``dim``: 2 or 3. ``curve``: the boundary.
    ``spacing``: spacing of the solution, the unit of :data:`ON_CURVE_SPACINGS`.
    """
    count, points = len(distance), pieces.attributes[:, :dim]
    # The distance is measured along the surface's tangent, so it also vanishes beside the boundary on another sheet,
    # such as the other leg of an animal; such a point is not on the boundary, and has no side.
    sign: Floats = np.sign(distance)
    zero = np.flatnonzero(np.abs(distance) < ON_CURVE_SPACINGS * spacing)
    sign[zero] = np.where(_distance_from_curve(points[zero], curve) < CROSSED_EDGE_SHARE * spacing, 0.0, np.nan)
    edges, cells, sides = np.zeros((0, 2), dtype=np.int64), [], []
    for corners, split in ((3, _cut_triangles), (2, _cut_segments), (1, None)):
        part = cells_with_corners(pieces.cells, corners)
        if not len(part):
            continue
        part_edges, cell_edges = number_edges(part, count)
        crossed = _crossed_edges(points, part_edges, distance, sign, curve)
        # The crossing of edge e is called vertex count + e; only those that are used will be made.
        after, side = part, _side_of_cells(part, sign)  # nothing cuts a point
        if split is not None:
            after, side = split(part, count + len(edges) + cell_edges, crossed[cell_edges], sign)
        edges = np.concatenate([edges, part_edges])
        cells.append(after)
        sides.append(side)
    after = stack_cells(cells)
    used = np.unique(after[after >= count]) - count
    number = np.zeros(count + len(edges), dtype=np.int64)
    number[:count] = np.arange(count)
    number[count + used] = count + np.arange(len(used))
    on_boundary = np.concatenate([sign == 0, np.ones(len(used), dtype=bool)])
    a, b = edges[used].T
    attributes = np.concatenate([pieces.attributes, _zero_on_edges(pieces.attributes, edges[used], distance)])
    # A crossing on an edge along an earlier boundary inherits its side.
    side_of_crossings = np.where(pieces.sides[a] == pieces.sides[b], pieces.sides[a], 0)
    of_vertices = np.concatenate([pieces.sides, side_of_crossings])
    with_crossings = CutCells(attributes, of_vertices, renumber_cells(after, number))
    return _separate_sides(with_crossings, boundary, on_boundary, np.concatenate(sides))


def _crossed_edges(points: Floats, edges: Ints, distance: Floats, sign: Floats, curve: ClosestPointSource) -> Bools:
    """Return which of ``edges`` (e, 2) the boundary ``curve`` crosses, (e,).

    ``distance``, ``sign`` (v,) are the signed distances of the ``points`` (v, d), and their signs: 0 on the boundary,
    NaN where there is no side. Opposite signs at the ends do not suffice: the zero of the distance must be near the
    curve. Signs also differ across the tangent plane on another sheet, and halfway between two arms of a curve.
    """
    a, b = edges.T
    crossed: Bools = sign[a] * sign[b] < 0
    candidates = edges[crossed]
    length = np.linalg.norm(points[candidates[:, 1]] - points[candidates[:, 0]], axis=1)
    crossed[crossed] = (
        _distance_from_curve(_zero_on_edges(points, candidates, distance), curve) < CROSSED_EDGE_SHARE * length
    )
    return crossed


def _zero_on_edges(attributes: Floats, edges: Ints, distance: Floats) -> Floats:
    """Return ``attributes`` (v, w), interpolated linearly, at the zero of ``distance`` (v,) on ``edges``, (e, w)."""
    a, b = edges.T
    share = (distance[a] / (distance[a] - distance[b]))[:, None]
    return np.asarray((1 - share) * attributes[a] + share * attributes[b])


def _distance_from_curve(points: Floats, curve: ClosestPointSource) -> Floats:
    """Return the distances (n,) of ``points`` (n, d) from ``curve``."""
    return norms(curve.closest_point(np.ascontiguousarray(points)).points - points)


def _cut_segments(cells: Ints, crossings: Ints, crossing: Bools, sign: Floats) -> tuple[Ints, Floats]:
    """Return the segments (k, 2) after the cut and the side (k,) of each: 1 left, -1 right, 0 on both or neither.

    ``crossings`` (m, 1) is the vertex where the boundary crosses each of ``cells`` (m, 2), where ``crossing`` (m, 1) is
    True. ``sign`` (v,) is the side of each vertex: 1, -1, 0 on the boundary, NaN unknown.
    """
    cut = crossing[:, 0]
    a, b = cells[cut].T
    p = crossings[cut, 0]
    whole = cells[~cut]
    return (
        np.concatenate([whole, np.stack([a, p], axis=1), np.stack([p, b], axis=1)]),
        np.concatenate([_side_of_cells(whole, sign), sign[a], sign[b]]),
    )


def _cut_triangles(cells: Ints, crossings: Ints, crossing: Bools, sign: Floats) -> tuple[Ints, Floats]:
    """Return the triangles (k, 3) after the cut and the side (k,) of each: 1 left, -1 right, 0 on both or neither.

    ``crossings`` (m, 3) are the vertices where the boundary crosses the edges of ``cells`` (m, 3), where ``crossing``
    (m, 3) is True; edge k joins corners k and k + 1. ``sign`` (v,) is the side of each vertex as in
    :func:`_cut_segments`. A triangle is cut from edge to edge, or from a corner on the curve to the opposite edge. A
    triangle that the curve enters and does not leave stays whole.
    """
    count = crossing.sum(axis=1)
    two = count == 2
    across = (count == 1) & (sign[np.take_along_axis(cells, (crossing.argmax(axis=1)[:, None] + 2) % 3, 1)[:, 0]] == 0)
    whole = cells[~(two | across)]

    # The lone corner a comes first: it faces the one edge that is not crossed.
    (a, b, c), (p, _, q) = rotate_triangles(cells[two], crossings[two], crossing[two].argmin(axis=1) + 2)
    parts = [(whole, _side_of_cells(whole, sign))]
    parts += [
        (np.stack(corners, axis=1), s)
        for corners, s in [((a, p, q), sign[a]), ((p, b, c), sign[b]), ((p, c, q), sign[b])]
    ]

    # The corner a on the curve comes first: it faces the one edge that is crossed.
    (a, b, c), (_, p, _) = rotate_triangles(cells[across], crossings[across], crossing[across].argmax(axis=1) + 2)
    parts += [(np.stack(corners, axis=1), s) for corners, s in [((a, b, p), sign[b]), ((a, p, c), sign[c])]]
    return np.concatenate([part for part, _ in parts]), np.concatenate([side for _, side in parts])


def _side_of_cells(cells: Ints, sign: Floats) -> Floats:
    """Return the side (m,) of each cell: 1 or -1 if only this ``sign`` (v,) occurs at its corners, else 0."""
    signs = np.nan_to_num(sign[cells])
    left, right = (signs > 0).any(axis=1), (signs < 0).any(axis=1)
    return np.where(left == right, 0.0, np.where(left, 1.0, -1.0))


def _separate_sides(pieces: CutCells, boundary: int, on_boundary: Bools, side: Floats) -> CutCells:
    """Return the mesh with copies of the vertices ``on_boundary`` (v,) in the cells on the right (``side`` (m,) < 0).

    The original vertices belong to the left side; ``boundary`` is the column of ``sides`` that records this.
    """
    copied = np.flatnonzero(on_boundary)
    copy = np.arange(len(on_boundary))
    copy[copied] = len(on_boundary) + np.arange(len(copied))
    left, right = pieces.sides.copy(), pieces.sides[copied].copy()
    left[copied, boundary], right[:, boundary] = 1, -1
    return CutCells(
        np.concatenate([pieces.attributes, pieces.attributes[copied]]),
        np.concatenate([left, right]),
        np.where((side < 0)[:, None], renumber_cells(pieces.cells, copy), pieces.cells),
    )
