"""Caps: triangles without area whose corners lie on a line, removed from a mesh without leaving a gap.

The middle corner of a cap lies on an edge of its neighbour, which is split in two there. At a rim, where there is no
neighbour, the cap is removed, and the rim passes its middle corner. At an edge of three or more triangles it is removed
too, and the others are not split.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints
from cpmkit_mesh.mesh_files import distinct_faces
from cpmkit_mesh.topology import topology

#: A triangle is a cap if its height is below this share of its longest edge,
CAP_OF_LONGEST_SHARE = 1e-6
#: and below this share of its shortest edge.
CAP_OF_SHORTEST_SHARE = 1e-3
#: A limit on rounds: of several neighbouring caps one is removed in each.
CAP_ROUNDS = 30


def find_caps(points: Floats, faces: Ints) -> tuple[Bools, Ints]:
    """Return (m,) whether each of ``faces`` (m, 3) is a cap, and (m,) the corner opposite to its longest edge."""
    length = np.linalg.norm(points[faces[:, [2, 0, 1]]] - points[faces[:, [1, 2, 0]]], axis=2)
    longest = length.max(axis=1)
    edges = points[faces[:, 1:]] - points[faces[:, :1]]
    height = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / longest
    return (height <= CAP_OF_LONGEST_SHARE * longest) & (
        height <= CAP_OF_SHORTEST_SHARE * length.min(axis=1)
    ), length.argmax(axis=1)


def remove_caps(points: Floats, faces: Ints) -> tuple[Ints, Ints]:
    """Remove triangles with their corners on a line from ``faces`` (m, 3), in at most :data:`CAP_ROUNDS` rounds.

    Neighbours are split, so that no gap is left, but at edges of three or more triangles. Faces that become equal to
    an earlier one are removed too.

    Returns
    -------
    rows : (k,) int64
        The remaining faces, ascending.
    corners : (k, 3) int64
        The position in ``faces.ravel()`` of each corner; a row that was a cap may hold a part of its split neighbour.
    """
    rows, corners = np.arange(len(faces)), np.arange(3 * len(faces)).reshape(-1, 3)
    for _ in range(CAP_ROUNDS):
        cells = faces.ravel()[corners]
        is_cap, apex = find_caps(points, cells)
        caps = np.flatnonzero(is_cap)
        if not len(caps):
            break
        across = topology(points, cells).neighbours[caps, apex[caps]]
        independent = _independent_caps(caps, across, len(cells))
        inner = independent & (across >= 0)
        _split_neighbours(corners, cells, caps[inner], across[inner], apex[caps[inner]])
        remains = np.ones(len(cells), dtype=bool)
        remains[caps[independent & (across < 0)]] = False
        rows, corners = rows[remains], corners[remains]
        distinct = distinct_faces(faces.ravel()[corners])  # neighbouring caps may become equal
        rows, corners = rows[distinct], corners[distinct]
    return rows, corners


def _independent_caps(caps: Ints, across: Ints, count: int) -> Bools:
    """Return (k,) which caps can be removed at once: no earlier cap is, or splits, their own triangle or neighbour.

    ``caps`` (k,) are triangles, ``across`` (k,) their neighbours at the longest edge, negative for none; ``count`` is
    the number of all triangles.
    """
    first = np.full(count, count)
    order = np.arange(len(caps))
    np.minimum.at(first, caps, order)
    np.minimum.at(first, across[across >= 0], order[across >= 0])
    return (first[caps] == order) & ((across < 0) | (first[np.maximum(across, 0)] == order))


def _split_neighbours(corners: Ints, cells: Ints, caps: Ints, others: Ints, apex: Ints) -> None:
    """Split each triangle of ``others`` (k,) at the corner ``apex`` (k,) of its cap; overwrite ``corners`` in place.

    ``corners`` (m, 3) are positions of corners and ``cells`` (m, 3) the vertices there. The row of the neighbour takes
    one half, that of the cap, in ``caps`` (k,), the other.
    """
    shared = cells[caps, (apex + 1) % 3], cells[caps, (apex + 2) % 3]
    away = np.argmax((cells[others] != shared[0][:, None]) & (cells[others] != shared[1][:, None]), axis=1)
    middle, far = corners[caps, apex], corners[others, away]
    start, end = corners[others, (away + 1) % 3], corners[others, (away + 2) % 3]
    corners[others] = np.stack([far, start, middle], axis=1)
    corners[caps] = np.stack([far, middle, end], axis=1)
