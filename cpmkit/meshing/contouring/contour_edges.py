"""Edges of triangles: how many triangles each has, and the conormals of those with one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.protocols import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of triangles; edge j of a triangle is opposite to its corner j.

    Attributes
    ----------
    ends : (e, 2) int64
        Their vertices, the lower number first.
    of : (m, 3) int64
        The edges of each triangle.
    count : (e,) int64
        How many triangles each has.
    """

    ends: Ints
    of: Ints
    count: Ints

    @property
    def nonmanifold_share(self) -> float:
        """The share of edges with three triangles or more."""
        return float((self.count > 2).mean()) if len(self.count) else 0.0


def edges_of(cells: Ints) -> Edges:
    """Return the edges of triangles or quadrilaterals ``cells`` (m, k), the first from corner 1 to corner 2."""
    k = cells.shape[1]
    places = (np.arange(k)[:, None] + [1, 2]) % k
    ends = np.sort(cells[:, places].reshape(-1, 2), axis=1)
    size = int(cells.max(initial=0)) + 1
    codes, of, count = np.unique(ends[:, 0] * size + ends[:, 1], return_inverse=True, return_counts=True)
    return Edges(np.stack(np.divmod(codes, size), axis=1), of.reshape(-1, k), count.astype(np.int64))


@dataclass(frozen=True, eq=False)
class Border:
    """The edges of one triangle each.

    Attributes
    ----------
    edge : (b,) int64
        Their numbers among all edges.
    ends : (b, 2) int64
        Their vertices.
    middles, conormals : (b, 3) float64
        Halfway between those, and the unit vectors in the triangles' planes that point outwards there.
    """

    edge: Ints
    ends: Ints
    middles: Floats
    conormals: Floats

    def take(self, rows: Bools | Ints) -> Border:
        """Return the edges at ``rows``."""
        return Border(self.edge[rows], self.ends[rows], self.middles[rows], self.conormals[rows])

    def across(self, vertices: Floats) -> Floats:
        """Return unit normals (b, 3), of either sign, of the triangles at these edges."""
        return np.cross(unit(vertices[self.ends[:, 1]] - vertices[self.ends[:, 0]]), self.conormals)


def border_of(vertices: Floats, cells: Ints, edges: Edges) -> Border:
    """Return the edges that one triangle has alone."""
    cell, corner = np.nonzero(edges.count[edges.of] == 1)
    ends = np.stack([cells[cell, (corner + 1) % 3], cells[cell, (corner + 2) % 3]], axis=1)
    a, b, apex = vertices[ends[:, 0]], vertices[ends[:, 1]], vertices[cells[cell, corner]]
    middle, along = 0.5 * (a + b), unit(b - a)
    out = middle - apex
    conormal = unit(out - dots(out, along)[:, None] * along)
    flat = norms(conormal) == 0
    conormal[flat] = unit(out[flat])
    return Border(edges.of[cell, corner], ends, middle, conormal)


def split_fans(cells: Ints, edges: Edges, parted: Ints, pairs: Ints) -> tuple[Ints, Ints]:
    """Return the triangles with a vertex of its own for each fan, and of which vertex each of those is a copy.

    A fan goes on over the edges of its triangles; over the edges ``parted`` (k,) only between the corners (three a
    triangle, opposite to the edge) that are a pair of ``pairs`` (k, 2, 2).
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    slots = np.argsort(edges.of.ravel(), kind="stable")
    same = np.flatnonzero(np.diff(edges.of.ravel()[slots]) == 0)
    same = same[~np.isin(edges.of.ravel()[slots[same]], parted)]
    one, other = (np.concatenate([slots[same + k], pairs[:, :, k].ravel()]) for k in range(2))
    links = []
    for step in (1, 2):  # the corners at either end of a shared edge
        a = one // 3 * 3 + (one + step) % 3
        matches = [other // 3 * 3 + (other + k) % 3 for k in (1, 2)]
        alike = cells.ravel()[a] == cells.ravel()[matches[0]]
        links.append((a, np.where(alike, matches[0], matches[1])))
    rows, columns = (np.concatenate(ends) for ends in zip(*links, strict=True))
    corners = cells.size
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(corners, corners))
    count, fan = connected_components(graph, directed=False)
    copied = np.empty(count, dtype=np.int64)
    copied[fan] = cells.ravel()
    return fan.astype(np.int64).reshape(-1, 3), copied


#: Pieces with less area than this, in squares of the lattice's spacing, are specks: splines that saw them alone would
#: have a value of their own there, and none where there is no area at all (an ellipsoid 10 : 10 : 1 at spacings of its
#: thickness has some of up to .02; a sphere of a tenth of a spacing, which is found by chance alone, has .13).
SPECK_AREA = 0.1


def remove_isolated_components(vertices: Floats, cells: Ints, spacing: float) -> tuple[Ints, int]:
    """Return the triangles (m, 3) of pieces with an area, all of them where no piece has one, and how many have none.

    Pieces are what hangs together by vertices (v, 3).
    """
    return _without(vertices, cells, cells, spacing)


def without_hanging_specks(vertices: Floats, cells: Ints, spacing: float) -> Ints:
    """Return the triangles without pieces that have no area and hang on others by vertices alone."""
    return _without(vertices, cells, edges_of(cells).of, spacing)[0]


def _without(vertices: Floats, cells: Ints, links: Ints, spacing: float) -> tuple[Ints, int]:
    piece, areas = _pieces(vertices, cells, links)
    speck = areas < SPECK_AREA * spacing**2
    if speck.all():
        return cells, 0
    return np.ascontiguousarray(cells[~speck[piece]]), int(speck.sum())


def areas_of_pieces(vertices: Floats, cells: Ints) -> Floats:
    """Return the area of each piece, of those that hang together by vertices (v, 3)."""
    return _pieces(vertices, cells, cells)[1]


def _pieces(vertices: Floats, cells: Ints, links: Ints) -> tuple[Ints, Floats]:
    """Return the piece of each triangle, and the area of each, of those with common ``links`` (m, 3)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ends = np.concatenate([links[:, :2], links[:, 1:]])
    size = int(links.max(initial=-1)) + 1
    graph = coo_array((np.ones(len(ends), dtype=np.int8), tuple(ends.T)), shape=(size, size))
    label = connected_components(graph, directed=False)[1][links[:, 0]]
    piece = np.unique(label, return_inverse=True)[1]
    corners = vertices[cells]
    area = 0.5 * norms(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    return piece.astype(np.int64), np.asarray(np.bincount(piece, area), dtype=np.float64)
