"""Points of curves put in the order in which the curves pass them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cpmkit.manifold.vectors import dots
from cpmkit.protocols import Bools, Floats, Ints

#: Neighbours that are looked at.
CHAIN_NEIGHBOURS = 24
#: Least cosine between the way to the next point and the tangents at both, and between the conormals there.
LEAST_AHEAD_COSINE, LEAST_CONORMAL_COSINE = 0.5, 0.25
#: How much more a way to the side counts than a way ahead.
SIDEWAYS_WEIGHT = 4.0


class Chain(NamedTuple):
    """Numbers of points (k,) in the order of travel; a closed chain goes on from the last to the first."""

    order: Ints
    closed: bool


def chains(points: Floats, tangents: Floats, conormals: Floats, reach: float) -> list[Chain]:
    """Return the curves that pass through points (n, d).

    Two points are neighbours where each is the next for the other: the nearest within ``reach`` that lies ahead or
    behind, the way sideways counted more, and with its conormal to the same side. So two branches that cross, two
    arms side by side and two sheets of a surface stay apart.

    Parameters
    ----------
    points : (n, d) float64
        A few times denser than ``reach``.
    tangents : (n, d) float64
        Unit tangents of any sign.
    conormals : (n, d) float64
        Unit vectors across the curve, of one sign along each curve.
    reach : float
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    pairs = _links(points, tangents, conormals, reach)
    n = len(points)
    ends = np.concatenate([pairs, pairs[:, ::-1]]).T
    graph = coo_array((np.ones(2 * len(pairs)), (ends[0], ends[1])), (n, n)).tocsr()
    degree, found = np.diff(graph.indptr), []
    count, label = connected_components(graph, directed=False)
    for piece in range(count):
        members = np.flatnonzero(label == piece)
        open_at = members[degree[members] < 2]
        closed = not len(open_at)
        start = members[0] if closed else open_at[0]
        order = np.asarray(breadth_first_order(graph, start, directed=False, return_predecessors=False), np.int64)
        # breadth first goes round a closed chain both ways in turn
        found.append(Chain(np.concatenate([order[:1], order[1::2], order[2::2][::-1]]) if closed else order, closed))
    return found


def _links(points: Floats, tangents: Floats, conormals: Floats, reach: float) -> Ints:
    """Return the pairs (m, 2) of neighbours, the smaller number first."""
    from scipy.spatial import cKDTree

    n = len(points)
    distance, other = cKDTree(points).query(points, min(CHAIN_NEIGHBOURS, n), distance_upper_bound=reach)
    distance, other = (np.reshape(found, (n, -1))[:, 1:] for found in (distance, other))
    within_reach = np.isfinite(distance)
    other = np.where(within_reach, other, 0)
    chord = points[other] - points[:, None]
    ahead = dots(chord, tangents[:, None])
    fits = within_reach & (dots(conormals[other], conormals[:, None]) >= LEAST_CONORMAL_COSINE)
    fits &= np.minimum(np.abs(ahead), np.abs(dots(chord, tangents[other]))) >= LEAST_AHEAD_COSINE * distance
    cost = np.where(fits, (1 + SIDEWAYS_WEIGHT) * distance**2 - SIDEWAYS_WEIGHT * ahead**2, np.inf)
    forward, backward = (_next(other, np.where(side, cost, np.inf)) for side in (ahead > 0, ahead <= 0))
    wishes = np.concatenate([np.stack([np.arange(n), wish], axis=1)[wish >= 0] for wish in (forward, backward)])
    ordered, times = np.unique(np.sort(wishes, axis=1), axis=0, return_counts=True)
    return np.asarray(ordered[times == 2], dtype=np.int64)


def _next(other: Ints, cost: Floats) -> Ints:
    if not cost.shape[1]:
        return np.full(len(cost), -1)
    best = cost.argmin(axis=1)[:, None]
    found: Bools = np.isfinite(np.take_along_axis(cost, best, 1)[:, 0])
    return np.where(found, np.take_along_axis(other, best, 1)[:, 0], -1)
