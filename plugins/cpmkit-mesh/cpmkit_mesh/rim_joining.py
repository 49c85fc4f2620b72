"""Rims of a mesh joined: vertices that differ by rounding are merged, and T-junctions split."""

from __future__ import annotations

from itertools import chain

import numpy as np

from cpmkit.plugin import Floats, Ints, dots, norms
from cpmkit_mesh.chains import components
from cpmkit_mesh.topology import topology

#: Two vertices are merged if they are as near as this share of the shortest edge at them.
MERGED_EDGE_SHARE = 1e-6
#: So are two that single precision does not distinguish: as near as this share of the mesh's size,
SINGLE_PRECISION_SHARE = 5e-7
#: unless that is more than this share of the shortest edge at them.
MAX_MERGED_EDGE_SHARE = 1e-3
#: Two vertices nearer than the user's tolerance are merged unless that is more than this share of the shortest edge at
#: them: no triangle may vanish.
MAX_WELDED_EDGE_SHARE = 0.3
#: The number of neighbours of a vertex that are candidates.
MERGED_NEIGHBOURS = 8


def merge_rim_vertices(points: Floats, faces: Ints, weld: float | None = None) -> Ints:
    """Return (n,) the vertex with which each vertex is merged: the first of its group, or itself.

    ``faces`` (m, 3) are triangles between ``points`` (n, 3); ``weld`` is the distance up to which vertices are merged,
    None for that of rounding. Only vertices on rims are merged: those of triangles stored one by one in single
    precision, and of seams torn by rounding. The ends of an edge are not joined directly, since it is far longer than
    the tolerance.
    """
    from scipy.spatial import cKDTree

    same = np.arange(len(points))
    rim = np.unique(topology(points, faces).boundary)
    if len(rim) < 2:
        return same
    reach = joining_distance(points, faces, rim, weld)
    distance, other = cKDTree(points[rim]).query(
        points[rim], k=min(MERGED_NEIGHBOURS, len(rim)), distance_upper_bound=float(reach.max()) or np.inf
    )
    vertex = np.repeat(np.arange(len(rim)), distance.shape[1])
    distance, other = distance.ravel(), other.ravel()
    exists = other < len(rim)
    vertex, other, distance = vertex[exists], other[exists], distance[exists]
    merged = (vertex != other) & (distance <= np.minimum(reach[vertex], reach[other]))
    if not merged.any():
        return same
    part = components(np.stack([vertex[merged], other[merged]], axis=1), len(rim))
    first = np.unique(part, return_index=True)[1]
    same[rim] = rim[first[part]]
    return same


def joining_distance(points: Floats, faces: Ints, vertices: Ints, weld: float | None) -> Floats:
    """Return (k,) the distance up to which another vertex or an edge is joined to each of ``vertices`` (k,).

    They are corners of ``faces`` (m, 3) between ``points`` (n, 3). It is the rounding of coordinates, limited to a
    share of the shortest edge at the vertex; ``weld``, unless None, raises it to that length, within a larger share.
    """
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    wanted = np.zeros(len(points), dtype=bool)
    wanted[vertices] = True
    target = wanted[start] | wanted[end]
    start, end = start[target], end[target]
    length = np.linalg.norm(points[end] - points[start], axis=1)
    shortest = np.full(len(points), np.inf)
    np.minimum.at(shortest, start, length)
    np.minimum.at(shortest, end, length)
    shortest = shortest[vertices]
    size = float(np.ptp(points, axis=0).max())
    reach: Floats = np.minimum(
        MAX_MERGED_EDGE_SHARE * shortest, np.maximum(MERGED_EDGE_SHARE * shortest, SINGLE_PRECISION_SHARE * size)
    )
    return reach if weld is None else np.maximum(reach, np.minimum(weld, MAX_WELDED_EDGE_SHARE * shortest))


#: One edge of each triangle is split in a round: three, and edges of new triangles.
ROUNDS = 4


def split_t_junctions(points: Floats, faces: Ints, weld: float | None) -> tuple[Ints, Ints, Ints]:
    """Split triangles at vertices of others that lie on their edges, where the vertex or the edge is on a rim.

    There are at most :data:`ROUNDS` rounds, each of which splits one edge of a triangle.

    Parameters
    ----------
    points : (n, 3) float64
        Positions of the vertices.
    faces : (m, 3) int64
        Triangles.
    weld : float, optional
        The distance up to which a vertex on a rim lies on an edge on a rim; vertices inside are then not found. By
        default, and of other edges, that of rounding.

    Returns
    -------
    rows : (k,) int64
        The old triangle of which each new one is a part; the first m rows are 0 to m - 1.
    corners : (k, 3) int64
        The position in ``faces.ravel()`` of each corner.
    joined : (j,) int64
        The vertices that lay on edges.
    """
    rows, corners = np.arange(len(faces)), np.arange(faces.size).reshape(-1, 3)
    joined = np.zeros(0, dtype=np.int64)
    for _ in range(ROUNDS):
        cells = faces.ravel()[corners]
        cell, edge, vertex, share = _vertices_on_edges(points, cells, weld)
        if not len(cell):
            break
        first = np.full(len(cells), 3)  # one edge of each triangle is split at a time
        np.minimum.at(first, cell, edge)
        now = np.flatnonzero(edge == first[cell])
        now = now[np.lexsort((share[now], cell[now]))]
        corner_of = np.full(len(points), -1)
        corner_of[cells.ravel()[::-1]] = corners.ravel()[::-1]
        rows, corners = _split_triangles(rows, corners, cell[now], edge[now], corner_of[vertex[now]])
        joined = np.union1d(joined, vertex[now])
    return rows, corners, joined


def _split_triangles(rows: Ints, corners: Ints, cell: Ints, edge: Ints, middle: Ints) -> tuple[Ints, Ints]:
    """Return rows and corners of the triangles, with one edge of each ``cell`` split at the corners ``middle``.

    ``rows`` (m,) and ``corners`` (m, 3) are as :func:`split_t_junctions` returns them, and so are those returned, with
    a triangle more for each split. ``cell``, ``edge`` and ``middle`` (k,) have a row for each split, with ascending
    cells. Edge e is opposite corner e of its cell and leads from corner e + 1 to e + 2; its corners ``middle`` are in
    that order. The triangle becomes a fan around corner e.
    """
    corners = corners.copy()
    apex = corners[cell, edge]
    end = corners[cell, (edge + 2) % 3]
    is_last = np.append(cell[1:] != cell[:-1], True)
    following = np.where(is_last, end, np.append(middle[1:], -1))
    is_first = np.append(True, cell[1:] != cell[:-1])
    corners[cell[is_first], (edge[is_first] + 2) % 3] = middle[is_first]
    return np.append(rows, rows[cell]), np.concatenate([corners, np.stack([apex, middle, following], axis=1)])


def _vertices_on_edges(points: Floats, cells: Ints, weld: float | None) -> tuple[Ints, Ints, Ints, Floats]:
    """Return triangle, edge and vertex (k,) of each T-junction, and the share (k,) of the edge at the vertex.

    The T-junctions of triangles ``cells`` (m, 3) between ``points`` (n, 3) are vertices on edges of rims, and vertices
    of rims on any edge. With ``weld``, the distance up to which a vertex counts as on a rim's edge, only vertices of
    rims are found.
    """
    adjacency = topology(points, cells)
    at_rim = np.zeros(cells.size, dtype=bool)  # edge e of a triangle is opposite its corner e
    at_rim[3 * adjacency.boundary_face + adjacency.boundary_edge] = True
    used, rim = np.unique(cells), np.unique(adjacency.boundary)
    if not len(rim):
        return rim, rim, rim, np.zeros(0)
    reach = np.zeros(len(points))
    reach[used] = joining_distance(points, cells, used, None)
    edges, vertices = _edge_vertex_pairs(points, cells, np.flatnonzero(at_rim), used, reach)
    others = _edge_vertex_pairs(points, cells, np.flatnonzero(~at_rim), rim, reach)
    if weld is not None:
        reach[rim] = joining_distance(points, cells, rim, weld)
        edges, vertices = _edge_vertex_pairs(points, cells, np.flatnonzero(at_rim), rim, reach)
    edge, vertex = np.append(edges, others[0]), np.append(vertices, others[1])
    return edge // 3, edge % 3, vertex, _edge_shares(points, cells, edge, vertex)[0]


def _edge_vertex_pairs(points: Floats, cells: Ints, edges: Ints, vertices: Ints, reach: Floats) -> tuple[Ints, Ints]:
    """Return (k,) and (k,) the pairs of an edge and a vertex inside it, up to the vertex's ``reach`` (n,).

    ``edges`` are numbers 3 cell + edge of edges of ``cells`` (m, 3), ``vertices`` candidate rows of ``points`` (n, 3).
    """
    start, end = _edge_ends(cells, edges)
    middle, half = 0.5 * (points[start] + points[end]), 0.5 * norms(points[end] - points[start])
    size = np.floor(np.log2(half, where=half > 0, out=np.zeros(len(half))))
    pairs = [(edges[:0], vertices[:0])]
    for exponent in np.unique(size):  # edges of similar length, so that no ball is much too large
        members = np.flatnonzero(size == exponent)
        rows, columns = _close_pairs(points[vertices], middle[members], half[members].max() + reach[vertices])
        edge, vertex = edges[members[columns]], vertices[rows]
        share, off = _edge_shares(points, cells, edge, vertex)
        length, least = 2 * half[members[columns]], reach[vertex]
        inside = (share * length > least) & ((1 - share) * length > least)
        is_foreign = (cells[edge // 3] != vertex[:, None]).all(axis=1)
        lies_on = inside & is_foreign & (off <= least)
        pairs.append((edge[lies_on], vertex[lies_on]))
    edge, vertex = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    return edge, vertex


def _close_pairs(points: Floats, others: Floats, distance: Floats) -> tuple[Ints, Ints]:
    """Return (k,) and (k,) the row numbers of all pairs of ``points`` (n, 3) and ``others`` within ``distance`` (n,).

    If there are fewer others than points, the largest of the distances holds for all.
    """
    from scipy.spatial import cKDTree

    if len(others) < len(points):
        columns, rows = _close_pairs(others, points, np.full(len(others), distance.max()))
        return rows, columns
    lists = cKDTree(others).query_ball_point(points, distance)
    rows = np.repeat(np.arange(len(points)), np.fromiter(map(len, lists), np.int64, len(lists)))
    return rows, np.fromiter(chain.from_iterable(lists), np.int64, len(rows))


def _edge_shares(points: Floats, cells: Ints, edge: Ints, vertex: Ints) -> tuple[Floats, Floats]:
    """Return (k,) the shares of edges at which vertices project on them, and (k,) their distances from the lines.

    ``edge`` (k,) are numbers 3 cell + edge of ``cells`` (m, 3), ``vertex`` (k,) rows of ``points`` (n, 3).
    """
    start, end = _edge_ends(cells, edge)
    way, off = points[end] - points[start], points[vertex] - points[start]
    share = dots(off, way) / dots(way, way)
    return share, norms(off - share[:, None] * way)


def _edge_ends(cells: Ints, edge: Ints) -> tuple[Ints, Ints]:
    """Return (k,) and (k,) the start and end vertices of edges ``edge`` (k,), numbers 3 cell + edge of ``cells``."""
    return cells[edge // 3, (edge + 1) % 3], cells[edge // 3, (edge + 2) % 3]
