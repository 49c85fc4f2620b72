"""What the edges of a mesh inherit from those of the mesh that was halved to it."""

from __future__ import annotations

import numpy as np

from cpmkit.mesh.edges import Edges
from cpmkit.protocols import Floats, Ints


def inherited_shares(edges: Edges, middle: Ints, share: Floats, of: Edges) -> Floats:
    """Return the shares of the edges ``of`` a mesh whose ``edges``, with each its ``share`` (e,), were halved.

    Both halves of an edge have its share, an edge between two middles that of the edge it is parallel to, one from a
    middle to the opposite corner the lesser of those of the two other edges there.
    """
    if (share == 1.0).all():
        return np.ones(len(of.ends))
    whole = np.flatnonzero(middle >= 0)
    first = int(middle[whole].min(initial=of.ends.max() + 1))
    parent = edges.ends[whole[np.argsort(middle[whole])]]  # (k, 2) of the vertices from ``first`` on
    count = np.int64(first)
    low, high = np.sort(edges.ends, axis=1).T
    order = np.argsort(low * count + high)
    codes = (low * count + high)[order]

    def between(one: Ints, other: Ints) -> Floats:
        """Return the share of the edge between each vertex and another."""
        return share[order[np.searchsorted(codes, np.minimum(one, other) * count + np.maximum(one, other))]]

    low, high = np.sort(of.ends, axis=1).T  # vertices that were added have the highest numbers
    found = np.empty(len(low))
    new = (low >= first).astype(int) + (high >= first)
    found[new == 0] = between(low[new == 0], high[new == 0])
    corner, ends = low[new == 1], parent[high[new == 1] - first]
    is_half = (ends == corner[:, None]).any(axis=1)
    across = np.where(is_half[:, None], ends, corner[:, None])
    found[new == 1] = np.minimum(between(across[:, 0], ends[:, 1]), between(across[:, 1], ends[:, 0]))
    one, other = parent[low[new == 2] - first], parent[high[new == 2] - first]
    shared = np.where((one[:, :1] == other).any(axis=1), one[:, 0], one[:, 1])
    found[new == 2] = between(one.sum(axis=1) - shared, other.sum(axis=1) - shared)
    return found
