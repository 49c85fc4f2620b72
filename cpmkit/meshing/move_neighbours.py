"""Vertices beside a boundary that is moved: they go along, so that no thin triangle between stands in its way.

A boundary is inserted along chords, and moved onto itself after. Where it runs along edges of the mesh that it is
inserted in, vertices lie nearer to the chords than these to the boundary.
"""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.vectors import norms
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.protocols import Bools, Floats, Ints

#: Vertices go along as far as this share of the longest edge of a boundary from it, less and less.
REACH_EDGE_SHARE = 0.5
#: Points of an edge between which the way of its ends is interpolated.
SHARES = np.array([0.0, 0.25, 0.5, 0.75])


def carried_along(mesh: SampleMesh, before: Floats, moved: Floats, free: Bools) -> tuple[Ints, Floats]:
    """Return the ``free`` vertices (v,) of triangles beside edges on boundaries, (k,), and where these carry them.

    Parameters
    ----------
    mesh : SampleMesh
        With edges on boundaries.
    before, moved : (v, d) float64
        Its vertices, and the same with those on boundaries moved onto these.
    free : (v,) bool
        Those that may go along.
    """
    from scipy.spatial import cKDTree

    none = np.zeros(0, dtype=np.int64)
    edges = mesh.cut[~mesh.extends]
    if mesh.manifold_dim == 1 or not len(edges) or np.array_equal(before, moved):
        return none, before[none]
    shares = SHARES[:, None, None]
    places, ways = (
        ((1 - shares) * one[edges[:, 0]] + shares * one[edges[:, 1]]).reshape(-1, mesh.dim)
        for one in (before, moved - before)
    )
    reach = REACH_EDGE_SHARE * float(norms(before[edges[:, 1]] - before[edges[:, 0]]).max())
    used = np.zeros(len(before), dtype=bool)
    used[mesh.cells] = True
    rows = np.flatnonzero(free & used)
    distance, nearest = cKDTree(places).query(before[rows], distance_upper_bound=reach)
    near = np.isfinite(distance)
    share = 1 - distance[near] / reach
    way = share[:, None] * ways[nearest[near]]
    going = np.flatnonzero(way.any(axis=1))
    rows = rows[near][going]
    return rows, before[rows] + way[going]
