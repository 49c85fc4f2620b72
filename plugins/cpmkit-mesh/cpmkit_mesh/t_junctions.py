"""T-junctions: vertices that lie on edges of other triangles, which are divided there, one of both at a rim."""

from __future__ import annotations

from itertools import chain

import numpy as np

from cpmkit.plugin import Floats, Ints, dots, norms
from cpmkit_mesh.merging import edge_reach
from cpmkit_mesh.topology import topology

#: An edge of each triangle is divided in each round: three, and those that the divided triangles gain on others.
ROUNDS = 4


def divided_at_t_junctions(points: Floats, faces: Ints, weld: float | None) -> tuple[Ints, Ints, Ints]:
    """Divide the triangles on whose edges others' vertices lie, where the vertex or the edge is at a rim.

    Parameters
    ----------
    points : (n, 3) float64
    faces : (m, 3) int64
    weld : float, optional
        How near a vertex of a rim is to an edge of a rim on which it lies; unless given, and elsewhere, as near as
        rounding leaves it.

    Returns
    -------
    rows : (k,) int64
        The triangle that each of the new ones is a part of; the first m are what is left of the old ones.
    corners : (k, 3) int64
        Their corners: which of ``faces.ravel()`` each one is.
    joined : (j,) int64
        The vertices that lay on edges.
    """
    rows, corners = np.arange(len(faces)), np.arange(faces.size).reshape(-1, 3)
    joined = np.zeros(0, dtype=np.int64)
    for _ in range(ROUNDS):
        cells = faces.ravel()[corners]
        cell, edge, vertex, share = _on_edges(points, cells, weld)
        if not len(cell):
            break
        first = np.full(len(cells), 3)  # of each triangle one edge is divided at a time
        np.minimum.at(first, cell, edge)
        now = np.flatnonzero(edge == first[cell])
        now = now[np.lexsort((share[now], cell[now]))]
        corner_of = np.full(len(points), -1)
        corner_of[cells.ravel()[::-1]] = corners.ravel()[::-1]
        rows, corners = _divided(rows, corners, cell[now], edge[now], corner_of[vertex[now]])
        joined = np.union1d(joined, vertex[now])
    return rows, corners, joined


def _divided(rows: Ints, corners: Ints, cell: Ints, edge: Ints, middle: Ints) -> tuple[Ints, Ints]:
    """Return the triangles with one edge of each ``cell``, ascending, divided at the corners ``middle`` in order.

    Where one edge has several, the triangle becomes a fan around its third corner.
    """
    corners = corners.copy()
    apex = corners[cell, edge]
    end = corners[cell, (edge + 2) % 3]
    is_last = np.append(cell[1:] != cell[:-1], True)
    following = np.where(is_last, end, np.append(middle[1:], -1))
    is_first = np.append(True, cell[1:] != cell[:-1])
    corners[cell[is_first], (edge[is_first] + 2) % 3] = middle[is_first]
    return np.append(rows, rows[cell]), np.concatenate([corners, np.stack([apex, middle, following], axis=1)])


def _on_edges(points: Floats, cells: Ints, weld: float | None) -> tuple[Ints, Ints, Ints, Floats]:
    """Return triangles, their edges, the vertices that lie inside of these, and the vertices' shares of the way.

    Looked at are all vertices on edges of rims, and vertices of rims on other edges.
    """
    adjacency = topology(points, cells)
    at_rim = np.zeros(cells.size, dtype=bool)  # edge e of a triangle is opposite its corner e
    at_rim[3 * adjacency.boundary_face + adjacency.boundary_edge] = True
    used, rim = np.unique(cells), np.unique(adjacency.boundary)
    if not len(rim):
        return rim, rim, rim, np.zeros(0)
    reach = np.zeros(len(points))
    reach[used] = edge_reach(points, cells, used, None)
    edges, vertices = _pairs(points, cells, np.flatnonzero(at_rim), used, reach)
    others = _pairs(points, cells, np.flatnonzero(~at_rim), rim, reach)
    if weld is not None:
        reach[rim] = edge_reach(points, cells, rim, weld)
        edges, vertices = _pairs(points, cells, np.flatnonzero(at_rim), rim, reach)
    edge, vertex = np.append(edges, others[0]), np.append(vertices, others[1])
    return edge // 3, edge % 3, vertex, _shares(points, cells, edge, vertex)[0]


def _pairs(points: Floats, cells: Ints, edges: Ints, vertices: Ints, reach: Floats) -> tuple[Ints, Ints]:
    """Return the pairs of one of ``edges`` and one of ``vertices`` that lies inside of it, as near as its ``reach``."""
    start, end = _ends(cells, edges)
    middle, half = 0.5 * (points[start] + points[end]), 0.5 * norms(points[end] - points[start])
    size = np.floor(np.log2(half, where=half > 0, out=np.zeros(len(half))))
    found = [(edges[:0], vertices[:0])]
    for one in np.unique(size):  # of about one length, so that no ball is much too large
        own = np.flatnonzero(size == one)
        rows, columns = _within(points[vertices], middle[own], half[own].max() + reach[vertices])
        edge, vertex = edges[own[columns]], vertices[rows]
        share, off = _shares(points, cells, edge, vertex)
        length, least = 2 * half[own[columns]], reach[vertex]
        inside = (share * length > least) & ((1 - share) * length > least)
        apart = (cells[edge // 3] != vertex[:, None]).all(axis=1)
        kept = inside & apart & (off <= least)
        found.append((edge[kept], vertex[kept]))
    edge, vertex = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return edge, vertex


def _within(points: Floats, others: Floats, distance: Floats) -> tuple[Ints, Ints]:
    """Return all pairs of one of ``points`` (n, 3) and one of ``others`` within the point's ``distance`` (n,)."""
    from scipy.spatial import cKDTree

    if len(others) < len(points):
        columns, rows = _within(others, points, np.full(len(others), distance.max()))
        return rows, columns
    near = cKDTree(others).query_ball_point(points, distance)
    rows = np.repeat(np.arange(len(points)), np.fromiter(map(len, near), np.int64, len(near)))
    return rows, np.fromiter(chain.from_iterable(near), np.int64, len(rows))


def _shares(points: Floats, cells: Ints, edge: Ints, vertex: Ints) -> tuple[Floats, Floats]:
    """Return (k,) the vertices' shares of the way along edges, and their distances from the lines through these."""
    start, end = _ends(cells, edge)
    way, off = points[end] - points[start], points[vertex] - points[start]
    share = dots(off, way) / dots(way, way)
    return share, norms(off - share[:, None] * way)


def _ends(cells: Ints, edge: Ints) -> tuple[Ints, Ints]:
    return cells[edge // 3, (edge + 1) % 3], cells[edge // 3, (edge + 2) % 3]
