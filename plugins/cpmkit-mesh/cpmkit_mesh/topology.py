"""Adjacency of the triangles of a mesh: neighbours, boundary loops, and consistent winding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints
from cpmkit_mesh.chains import components

#: The entry of ``neighbours`` at an edge of three triangles or more.
BLOCKED = -1
#: The entry of ``neighbours`` at boundary edge k is ``FIRST_BOUNDARY - k``.
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
        Start and end vertex of each boundary edge, in the orientation of its triangle.
    boundary_face, boundary_edge : (k,) int64
        Triangle of each boundary edge, and which of its edges it is.
    loop : (k,) int64
        Number of the loop of each boundary edge, by decreasing length; loops that share a vertex are one.
    consistent : bool
        Whether the winding is consistent: two triangles pass a common edge in opposite directions.
    """

    neighbours: Ints
    boundary: Ints
    boundary_face: Ints
    boundary_edge: Ints
    loop: Ints
    consistent: bool


def topology(vertices: Floats, faces: Ints) -> Topology:
    """Return the adjacency of triangles ``faces`` (m, 3), none of which repeats a vertex.

    ``vertices`` (n, 3) are positions; the lengths of boundary loops follow from them.
    """
    start, end = faces[:, [1, 2, 0]].ravel(), faces[:, [2, 0, 1]].ravel()
    name = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
    order = np.argsort(name, kind="stable")
    first = np.flatnonzero(np.r_[True, np.diff(name[order]) != 0])
    uses = np.diff(np.r_[first, len(name)])
    neighbours = np.full(3 * len(faces), BLOCKED)
    slot, other = order[first[uses == 2]], order[first[uses == 2] + 1]
    neighbours[slot], neighbours[other] = other // 3, slot // 3
    alone = np.sort(order[first[uses == 1]])
    neighbours[alone] = FIRST_BOUNDARY - np.arange(len(alone))
    boundary = np.stack([start[alone], end[alone]], axis=1)
    return Topology(
        neighbours.reshape(-1, 3),
        boundary,
        alone // 3,
        alone % 3,
        _loops(vertices, boundary),
        not (start[slot] == start[other]).any(),
    )


def _loops(vertices: Floats, boundary: Ints) -> Ints:
    """Return (k,) the number of the connected part of each edge of ``boundary`` (k, 2), the longest part 0."""
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


def find_flipped_faces(faces: Ints, adjacency: Topology) -> tuple[Bools, Bools]:
    """Return the faces of ``faces`` (m, 3) whose winding must be reversed to make that of each component consistent.

    Components are connected by edges of two faces; none is flipped if the winding of ``adjacency`` is consistent.

    Returns
    -------
    flipped : (m,) bool
        Faces that are wound against most faces of their component; of equally many, against the first.
    one_sided : (m,) bool
        Faces of a component that cannot be wound consistently, as a Moebius strip; none of them is flipped.
    """
    count = len(faces)
    if adjacency.consistent:
        return np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    face, corner = np.nonzero(adjacency.neighbours > np.arange(count)[:, None])
    other = adjacency.neighbours[face, corner]
    start, end = faces[face, (corner + 1) % 3], faces[face, (corner + 2) % 3]
    along = (faces[other] == start[:, None]) & (np.roll(faces[other], -1, axis=1) == end[:, None])
    opposite = along.any(axis=1)
    # Each face is two nodes, as it is and flipped; links connect those that are consistent with each other.
    links = np.concatenate(
        [
            np.stack([face, np.where(opposite, other + count, other)], axis=1),
            np.stack([face + count, np.where(opposite, other, other + count)], axis=1),
        ]
    )
    part = components(links, 2 * count)
    as_it_is, flipped = part[:count], part[count:]
    one_sided = as_it_is == flipped
    component = np.minimum(as_it_is, flipped)
    _, first, number = np.unique(component, return_index=True, return_inverse=True)
    as_first = as_it_is == as_it_is[first][number]
    balance = np.bincount(component, np.where(as_first, 1, -1))
    return ~one_sided & (as_first == (balance[component] < 0)), one_sided
