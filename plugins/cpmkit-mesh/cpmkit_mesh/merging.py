"""Vertices on the rims of a mesh that are the same but for rounding, made one."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, Ints
from cpmkit_mesh.chains import components
from cpmkit_mesh.topology import topology

#: Two vertices are one if they are as near as this share of the shortest edge at them, whatever the size of the mesh.
MERGED_EDGE_SHARE = 1e-6
#: So are two that single precision does not tell apart: as near as this share of the mesh's size,
SINGLE_PRECISION_SHARE = 5e-7
#: unless that is more than this share of the shortest edge at them.
MOST_MERGED_EDGE_SHARE = 1e-3
#: Two vertices that are nearer than the given tolerance are one unless that is more than this share of the shortest
#: edge at them: no triangle may vanish.
MOST_WELDED_EDGE_SHARE = 0.3
#: Neighbours of each that are looked at.
MERGED_NEIGHBOURS = 8


def merge_rims(points: Floats, faces: Ints, weld: float | None = None) -> Ints:
    """Return (n,) the vertex that stands for each one: the first of those that are one, elsewhere itself.

    Unless a distance ``weld`` is given, those are one that rounding parted.

    Only vertices at which the mesh ends are looked at: those of triangles that were stored one by one in single
    precision, or of a seam that was torn by rounding. Ends of an edge are never one: it is longer by far.
    """
    from scipy.spatial import cKDTree

    same = np.arange(len(points))
    rim = np.unique(topology(points, faces).boundary)
    if len(rim) < 2:
        return same
    reach = edge_reach(points, faces, rim, weld)
    distance, other = cKDTree(points[rim]).query(
        points[rim], k=min(MERGED_NEIGHBOURS, len(rim)), distance_upper_bound=float(reach.max()) or np.inf
    )
    one = np.repeat(np.arange(len(rim)), distance.shape[1])
    distance, other = distance.ravel(), other.ravel()
    found = other < len(rim)
    one, other, distance = one[found], other[found], distance[found]
    near = (one != other) & (distance <= np.minimum(reach[one], reach[other]))
    if not near.any():
        return same
    part = components(np.stack([one[near], other[near]], axis=1), len(rim))
    first = np.unique(part, return_index=True)[1]
    same[rim] = rim[first[part]]
    return same


def edge_reach(points: Floats, faces: Ints, vertices: Ints, weld: float | None) -> Floats:
    """Return (k,) how near another vertex, or an edge, must be to each of ``vertices`` to be the same, or hold it."""
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
        MOST_MERGED_EDGE_SHARE * shortest, np.maximum(MERGED_EDGE_SHARE * shortest, SINGLE_PRECISION_SHARE * size)
    )
    return reach if weld is None else np.maximum(reach, np.minimum(weld, MOST_WELDED_EDGE_SHARE * shortest))
