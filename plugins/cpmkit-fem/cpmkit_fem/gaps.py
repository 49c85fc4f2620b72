"""Gaps between the vertices nearest to a curve, through which a solution would leak to the other side."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import ClosestPointSource, Ints
from cpmkit_fem.cell_mesh import CellMesh

#: A curve crosses an edge if it comes nearer to it, between ends that it separates, than this share of its length.
CROSSED_GAP_SHARE = 0.25


def ends_in_gaps(curve: ClosestPointSource, mesh: CellMesh, pinned: Ints) -> Ints:
    """Return the nearer end (k,) of each edge that ``curve`` crosses and of which no end is in ``pinned`` (p,).

    Where triangles are far from Delaunay, the nearest vertices of neighbouring points of a curve need not share an
    edge. With these ends every path along edges from one side to the other meets a pin. Points have none.
    """
    if curve.manifold_dim != 1:
        return np.zeros(0, dtype=np.int64)
    feet = curve.closest_point(mesh.nodes)
    away = mesh.nodes - feet.points
    edges = mesh.edges
    edges = edges[~np.isin(edges, pinned).any(axis=1)]
    start, end = edges.T
    past_an_end = (feet.edge[start] >= 0) & (feet.edge[start] == feet.edge[end])
    apart = ~past_an_end & (np.sum(away[start] * away[end], axis=1) < 0)
    start, end = start[apart], end[apart]
    share = feet.distance[start] / (feet.distance[start] + feet.distance[end])
    along = mesh.nodes[end] - mesh.nodes[start]
    miss = curve.closest_point(mesh.nodes[start] + share[:, None] * along).distance
    crossed = miss <= CROSSED_GAP_SHARE * np.linalg.norm(along, axis=1)
    return np.unique(np.where(share < 0.5, start, end)[crossed])
