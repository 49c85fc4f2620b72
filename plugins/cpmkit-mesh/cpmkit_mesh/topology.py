"""How the triangles of a mesh hang together: neighbours and boundary loops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Floats, Ints

#: What stands in ``neighbours`` where more than two triangles meet, and the walk has no one way on.
BLOCKED = -1
#: Boundary edge k stands in ``neighbours`` as ``FIRST_BOUNDARY - k``.
FIRST_BOUNDARY = -2


@dataclass(frozen=True, eq=False)
class Topology:
    """Adjacency of the triangles of a mesh; edge e of a triangle lies opposite its corner e.

    Attributes
    ----------
    neighbours : (m, 3) int64
        The triangle across each edge; ``FIRST_BOUNDARY - k`` for boundary edge k; ``BLOCKED``
        where three or more triangles share the edge.
    boundary : (k, 2) int64
        Start and end vertex of each boundary edge, as its triangle winds.
    boundary_face, boundary_edge : (k,) int64
        Triangle of each boundary edge, and which of its edges it is.
    loop : (k,) int64
        Number of the loop of each boundary edge, by decreasing length.
    consistent : bool
        True where triangles that share an edge wind alike.
    """

    neighbours: Ints
    boundary: Ints
    boundary_face: Ints
    boundary_edge: Ints
    loop: Ints
    consistent: bool


def topology(vertices: Floats, faces: Ints) -> Topology:
    """Return the adjacency of ``faces`` (m, 3), none of which repeats a vertex."""
    start, end = faces[:, [1, 2, 0]].ravel(), faces[:, [2, 0, 1]].ravel()
    name = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
    order = np.argsort(name, kind="stable")
    first = np.flatnonzero(np.r_[True, np.diff(name[order]) != 0])
    uses = np.diff(np.r_[first, len(name)])
    neighbours = np.full(3 * len(faces), BLOCKED)
    one, other = order[first[uses == 2]], order[first[uses == 2] + 1]
    neighbours[one], neighbours[other] = other // 3, one // 3
    alone = np.sort(order[first[uses == 1]])
    neighbours[alone] = FIRST_BOUNDARY - np.arange(len(alone))
    boundary = np.stack([start[alone], end[alone]], axis=1)
    return Topology(
        neighbours.reshape(-1, 3),
        boundary,
        alone // 3,
        alone % 3,
        _loops(vertices, boundary),
        not (start[one] == start[other]).any(),
    )


def _loops(vertices: Floats, boundary: Ints) -> Ints:
    """Number the connected parts of the boundary by decreasing length."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if not len(boundary):
        return np.zeros(0, dtype=np.int64)
    used, compact = np.unique(boundary, return_inverse=True)
    compact = compact.reshape(-1, 2)
    links = coo_array((np.ones(len(compact)), compact.T), shape=(len(used), len(used)))
    part = connected_components(links, directed=False)[1][compact[:, 0]]
    length = np.bincount(part, np.linalg.norm(vertices[boundary[:, 1]] - vertices[boundary[:, 0]], axis=1))
    rank = np.empty(len(length), dtype=np.int64)
    rank[np.argsort(-length, kind="stable")] = np.arange(len(length))
    return rank[part]
