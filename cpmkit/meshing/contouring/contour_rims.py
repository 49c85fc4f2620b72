"""Rims of a surface: the open edges of its triangulation beside a rim, and vertices moved onto it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.meshing.contour_edges import (
    OpenEdges,
    collapse_edges,
    double_areas,
    edge_table,
    open_edges,
    shortest_at_both_ends,
)
from cpmkit.types import Bools, Floats, Ints

#: Beyond a rim, closest points of a query and of the moved query differ by at most this share of the move.
RIM_STAYS = 0.2


@dataclass(frozen=True, eq=False)
class RimTest:
    """A test whether a surface ends near a point."""

    source: LocalSource  #: The surface.
    spacing: float  #: Spacing of the contouring lattice.
    #: Whether the source marks closest points on rims. If not, queries on both sides of the surface decide.
    by_edge_numbers: bool

    def project(self, points: Floats, outward: Floats, normals: Floats, reach: Floats) -> tuple[Floats, Bools]:
        """Return the closest points (n, 3) of points moved outwards, and whether (n,) these lie on a rim near by.

        ``points`` (n, 3): points on the surface or near it.
        ``outward``, ``normals`` (n, 3): unit tangents of the surface, towards the rim, and unit normals of it.
        ``reach`` (n,): distances by which the points are moved.
        """
        answer = self.source.closest_point(points + reach[:, None] * outward)
        closest = answer.points
        is_close = norms(closest - points) <= 2.0 * self.spacing
        if self.by_edge_numbers:
            return closest, np.asarray(is_close & (answer.edge >= 0))
        stays = is_close & (dots(closest - points, outward) < (1 - 0.25 * RIM_STAYS) * reach)
        for side in (-0.7, 0.7):  # moved across the surface by that share of the way
            rows = np.flatnonzero(stays)
            direction = outward[rows] + side * normals[rows]
            stays[rows] = self._misses(points[rows], direction, reach[rows], closest[rows]) <= RIM_STAYS
        for side in (-1.0, 1.0):  # a little inside the rim there must be one sheet
            rows = np.flatnonzero(stays)
            inward, back = -outward[rows], np.full(len(rows), 0.1 * self.spacing)
            expected = closest[rows] + back[:, None] * inward
            stays[rows] = self._misses(closest[rows], inward + side * normals[rows], back, expected) <= 0.3
        return closest, stays

    def _misses(self, points: Floats, direction: Floats, reach: Floats, expected: Floats) -> Floats:
        """Return the distance (n,) of the closest point of each moved point from ``expected`` (n, 3), over ``reach``.

        ``points`` (n, 3) are moved by ``reach`` (n,) along ``direction`` (n, 3).
        """
        closest = self.source.closest_point(points + reach[:, None] * direction).points
        return norms(closest - expected) / reach

    def of_edges(self, vertices: Floats, edges: OpenEdges) -> Bools:
        """Return which of the open ``edges`` (b,), between ``vertices`` (v, 3), lie beside a rim."""
        at_rim = np.zeros(len(edges.edge), dtype=bool)
        normals = edges.normals(vertices)
        for reach in (0.05, 1.2, 2.0):  # spacings: a rim may be nearer than the next one beyond a gap
            rows = np.flatnonzero(~at_rim)
            if len(rows):
                way = np.full(len(rows), reach * self.spacing)
                at_rim[rows] = self.project(edges.midpoints[rows], edges.conormals[rows], normals[rows], way)[1]
        return at_rim


def move_to_rims(rims: RimTest, vertices: Floats, cells: Ints) -> tuple[Floats, Bools]:
    """Return the vertices (v, 3), border vertices near rims moved onto the rims, and a mask (v,) of rim vertices."""
    edges, moved, on_rim = edge_table(cells), vertices.copy(), np.zeros(len(vertices), dtype=bool)
    for reach in (1.2, 1.2, 2.0):  # spacings
        border = open_edges(moved, cells, edges)  # anew: vertices on the rim improve the conormals of their neighbours
        outward, normals = np.zeros_like(vertices), np.zeros_like(vertices)
        for end in range(2):
            np.add.at(outward, border.ends[:, end], border.conormals)
            normals[border.ends[:, end]] = border.normals(moved)
        outward = unit(outward)
        rows = np.flatnonzero((outward != 0).any(axis=1) & ~on_rim)
        way = np.full(len(rows), reach * rims.spacing)
        closest, hits = rims.project(moved[rows], outward[rows], normals[rows], way)
        moved[rows[hits]], on_rim[rows[hits]] = closest[hits], True
    return moved, on_rim


def remove_bridges(rims: RimTest, vertices: Floats, cells: Ints, on_rim: Bools) -> Ints:
    """Return the triangles (n, 3) without those between three rim vertices that leave the surface or have no area.

    Triangles without area are removed only if they have an open edge: they lie along one rim. ``on_rim`` is (v,).
    """
    while True:
        rows = np.flatnonzero(on_rim[cells].all(axis=1))
        corners = vertices[cells[rows]]
        centres = corners.mean(axis=1)
        removed = norms(rims.source.closest_point(centres).points - centres) > 0.1 * rims.spacing
        longest = norms(corners - np.roll(corners, 1, axis=1)).max(axis=1)
        edges = edge_table(cells)
        is_open = (edges.count[edges.of_cells[rows]] == 1).any(axis=1)
        removed |= is_open & (double_areas(vertices, cells[rows]) < 1e-3 * longest**2)
        if not removed.any():
            return cells
        cells = np.ascontiguousarray(np.delete(cells, rows[removed], axis=0))


def remove_folds(vertices: Floats, cells: Ints, on_rim: Bools, spacing: float) -> tuple[Ints, Floats]:
    """Return the triangles (n, 3) without folds beside a rim, and the centres (k, 3) of the folds that are left.

    Of two neighbours that lie on each other, the smaller one loses its shortest edge, if that is shorter than
    ``spacing``, of the contouring lattice. A vertex on the rim, where ``on_rim`` (v,), stays.
    """
    for _ in range(20):  # a limit; each round treats the result of the round before
        first, second = _folded_pairs(vertices, cells, on_rim)
        if not len(first):
            break
        is_first = double_areas(vertices, cells[first]) < double_areas(vertices, cells[second])
        ends, length = _shortest_edges(vertices, cells, np.unique(np.where(is_first, first, second)))
        is_short = length < spacing
        if not is_short.any():
            break
        chosen = ends[is_short][shortest_at_both_ends(ends[is_short], length[is_short], len(vertices))]
        swap = on_rim[chosen[:, 1]] & ~on_rim[chosen[:, 0]]
        cells = collapse_edges(cells, np.where(swap[:, None], chosen[:, ::-1], chosen), len(vertices))
    return cells, vertices[cells[_folded_pairs(vertices, cells, on_rim)[0]]].mean(axis=1)


def _folded_pairs(vertices: Floats, cells: Ints, on_rim: Bools) -> tuple[Ints, Ints]:
    """Return the triangles (k,), (k,) of pairs that share an edge, lie on each other and have a corner on a rim."""
    edges = edge_table(cells)
    edge = np.flatnonzero(edges.count == 2)
    pair = edges.slots_of(edge, 2)
    at_rim = np.flatnonzero(np.isin(pair // 3, np.flatnonzero(on_rim[cells].any(axis=1))).any(axis=1))
    edge, pair = edge[at_rim], pair[at_rim]
    tail, head = vertices[edges.ends[edge]].transpose(1, 0, 2)
    along = unit(head - tail)
    sides = [vertices[cells.ravel()[pair[:, k]]] - tail for k in range(2)]
    sides = [unit(side - dots(side, along)[:, None] * along) for side in sides]
    folded = np.flatnonzero(dots(sides[0], sides[1]) > 0.8)
    return pair[folded, 0] // 3, pair[folded, 1] // 3


def _shortest_edges(vertices: Floats, cells: Ints, chosen: Ints) -> tuple[Ints, Floats]:
    """Return the shortest edge (k, 2) of each triangle in ``chosen`` (k,), and its length (k,).

    Inner edges with both ends on the border are excluded; the length is infinite if no edge remains.
    """
    corners = cells[chosen]
    ends = corners[:, [[1, 2], [2, 0], [0, 1]]]
    length = norms(vertices[ends[..., 1]] - vertices[ends[..., 0]])
    edges = edge_table(cells)
    at_border = np.zeros(len(vertices), dtype=bool)
    at_border[edges.ends[edges.count == 1]] = True
    pinches = at_border[ends].all(axis=2) & (edges.count[edges.of_cells[chosen]] > 1)
    length = np.where(pinches, np.inf, length)
    rows, least = np.arange(len(chosen)), np.argmin(length, axis=1)
    return ends[rows, least], length[rows, least]


def weld_rim_corners(vertices: Floats, cells: Ints, spacing: float) -> Ints:
    """Return the triangles (n, 3) with coincident border vertices welded where two open edges run between such places.

    Several vertices may have been moved to one corner of a rim. Coincident means up to .002 times the ``spacing``.
    """
    from scipy.spatial import cKDTree

    edges = edge_table(cells)
    ends = edges.ends[edges.count == 1]
    border = np.unique(ends)
    pairs = border[cKDTree(vertices[border]).query_pairs(2e-3 * spacing, output_type="ndarray")]
    place = np.arange(len(vertices))
    np.minimum.at(place, pairs.max(axis=1), pairs.min(axis=1))
    line, count = np.unique(np.sort(place[ends], axis=1), axis=0, return_inverse=True, return_counts=True)[1:]
    doubled = np.isin(pairs, ends[count[line.ravel()] == 2]).all(axis=1)
    return collapse_edges(cells, np.sort(pairs[doubled], axis=1), len(vertices))
