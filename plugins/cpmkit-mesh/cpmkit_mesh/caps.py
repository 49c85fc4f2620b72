"""Triangles without area whose corners lie along a line, taken out of a mesh without leaving a gap.

Such a cap lies along one edge of its neighbour, and its middle corner is on it. Where the mesh goes on, the neighbour
is cut in two there; at a rim the cap is left out, and the rim runs through its middle corner.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints
from cpmkit_mesh.reading import distinct_faces
from cpmkit_mesh.topology import topology

#: A triangle is a cap if it is lower than this share of its longest edge,
CAP_OF_LONGEST_SHARE = 1e-6
#: and than this share of its shortest.
CAP_OF_SHORTEST_SHARE = 1e-3
#: Rounds in which caps are looked for: of several side by side one is taken out in each.
CAP_ROUNDS = 30


def caps_of(points: Floats, faces: Ints) -> tuple[Bools, Ints]:
    """Return (m,) which triangles are caps, and (m,) the corner opposite the longest edge of each triangle."""
    length = np.linalg.norm(points[faces[:, [2, 0, 1]]] - points[faces[:, [1, 2, 0]]], axis=2)
    longest = length.max(axis=1)
    edges = points[faces[:, 1:]] - points[faces[:, :1]]
    height = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / longest
    return (height <= CAP_OF_LONGEST_SHARE * longest) & (
        height <= CAP_OF_SHORTEST_SHARE * length.min(axis=1)
    ), length.argmax(axis=1)


def without_caps(points: Floats, faces: Ints) -> tuple[Ints, Ints]:
    """Take the caps out of ``faces`` (m, 3).

    Returns
    -------
    rows : (k,) int64
        The faces that are left, ascending.
    corners : (k, 3) int64
        Their corners: which of ``faces.ravel()`` each one is.
    """
    rows, corners = np.arange(len(faces)), np.arange(3 * len(faces)).reshape(-1, 3)
    for _ in range(CAP_ROUNDS):
        cells = faces.ravel()[corners]
        is_cap, apex = caps_of(points, cells)
        caps = np.flatnonzero(is_cap)
        if not len(caps):
            break
        across = topology(points, cells).neighbours[caps, apex[caps]]
        free = _free(caps, across, len(cells))
        flipped = free & (across >= 0)
        _cut_neighbours(corners, cells, caps[flipped], across[flipped], apex[caps[flipped]])
        left = np.ones(len(cells), dtype=bool)
        left[caps[free & (across < 0)]] = False
        rows, corners = rows[left], corners[left]
        kept = distinct_faces(faces.ravel()[corners])  # of caps beside each other both may become the same
        rows, corners = rows[kept], corners[kept]
    return rows, corners


def _free(caps: Ints, across: Ints, count: int) -> Bools:
    """Return which caps may be taken out at once: neither they nor their neighbours take part in another's."""
    first = np.full(count, count)
    order = np.arange(len(caps))
    np.minimum.at(first, caps, order)
    np.minimum.at(first, across[across >= 0], order[across >= 0])
    return (first[caps] == order) & ((across < 0) | (first[np.maximum(across, 0)] == order))


def _cut_neighbours(corners: Ints, cells: Ints, caps: Ints, others: Ints, apex: Ints) -> None:
    """Cut each of ``others`` in two at the middle corner of its cap, which becomes one of both; in place."""
    shared = cells[caps, (apex + 1) % 3], cells[caps, (apex + 2) % 3]
    away = np.argmax((cells[others] != shared[0][:, None]) & (cells[others] != shared[1][:, None]), axis=1)
    middle, far = corners[caps, apex], corners[others, away]
    start, end = corners[others, (away + 1) % 3], corners[others, (away + 2) % 3]
    corners[others] = np.stack([far, start, middle], axis=1)
    corners[caps] = np.stack([far, middle, end], axis=1)
