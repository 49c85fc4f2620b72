"""Unordered points of curves, put in the order of travel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cpmkit.manifold.vector_algebra import dots
from cpmkit.types import Floats, Ints

#: Number of nearest points among which each point looks for its two neighbours.
CHAIN_NEIGHBOURS = 24
#: Least cosine between the chord to a neighbour and the tangents at both ends, and between the conormals there.
LEAST_CHORD_COSINE, LEAST_CONORMAL_COSINE = 0.5, 0.25
#: Weight of the sideways part of a chord against the part ahead, in the choice of the next point.
SIDEWAYS_WEIGHT = 4.0


class Chain(NamedTuple):
    """Numbers of points (k,) in the order of travel; in a closed chain the first point follows the last."""

    order: Ints
    closed: bool


def link_chains(points: Floats, tangents: Floats, conormals: Floats, reach: float) -> list[Chain]:
    """Return the chains of ``points`` (n, d) in the order of travel, one for each curve that passes through them.

    Two points are linked if each is the other's next point: the nearest within ``reach`` that lies ahead or behind,
    with sideways distance weighted more, and with its conormal to the same side. Branches that cross, parallel arms
    and neighbouring sheets of a surface therefore stay separate.

    Parameters
    ----------
    points : (n, d) float64
        Samples of the curves, a few times denser than ``reach``.
    tangents : (n, d) float64
        Unit tangents of any sign.
    conormals : (n, d) float64
        Unit vectors across the curve, of one sign along each curve.
    reach : float
        Largest distance of linked points.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    pairs = _links(points, tangents, conormals, reach)
    n = len(points)
    ends = np.concatenate([pairs, pairs[:, ::-1]]).T
    graph = coo_array((np.ones(2 * len(pairs)), (ends[0], ends[1])), (n, n)).tocsr()
    degree, chains = np.diff(graph.indptr), []
    count, label = connected_components(graph, directed=False)
    for piece in range(count):
        members = np.flatnonzero(label == piece)
        ends_of_piece = members[degree[members] < 2]
        closed = not len(ends_of_piece)
        start = members[0] if closed else ends_of_piece[0]
        order = np.asarray(breadth_first_order(graph, start, directed=False, return_predecessors=False), np.int64)
        # breadth first search visits a closed chain in both directions by turns
        chains.append(Chain(np.concatenate([order[:1], order[1::2], order[2::2][::-1]]) if closed else order, closed))
    return chains


def _links(points: Floats, tangents: Floats, conormals: Floats, reach: float) -> Ints:
    """Return the pairs (m, 2) of points that are linked (see :func:`link_chains`), the smaller number first."""
    from scipy.spatial import cKDTree

    n = len(points)
    distance, other = cKDTree(points).query(points, min(CHAIN_NEIGHBOURS, n), distance_upper_bound=reach)
    distance, other = (np.reshape(columns, (n, -1))[:, 1:] for columns in (distance, other))
    within_reach = np.isfinite(distance)
    other = np.where(within_reach, other, 0)
    chord = points[other] - points[:, None]
    ahead = dots(chord, tangents[:, None])
    fits = within_reach & (dots(conormals[other], conormals[:, None]) >= LEAST_CONORMAL_COSINE)
    fits &= np.minimum(np.abs(ahead), np.abs(dots(chord, tangents[other]))) >= LEAST_CHORD_COSINE * distance
    cost = np.where(fits, (1 + SIDEWAYS_WEIGHT) * distance**2 - SIDEWAYS_WEIGHT * ahead**2, np.inf)
    forward, backward = (_cheapest(other, np.where(side, cost, np.inf)) for side in (ahead > 0, ahead <= 0))
    choices = np.concatenate([np.stack([np.arange(n), number], axis=1)[number >= 0] for number in (forward, backward)])
    pairs, times = np.unique(np.sort(choices, axis=1), axis=0, return_counts=True)
    return np.asarray(pairs[times == 2], dtype=np.int64)


def _cheapest(other: Ints, cost: Floats) -> Ints:
    """Return the entry (n,) of ``other`` (n, k) of least ``cost`` in each row, -1 where all costs are infinite."""
    if not cost.shape[1]:
        return np.full(len(cost), -1)
    best = cost.argmin(axis=1)[:, None]
    finite = np.isfinite(np.take_along_axis(cost, best, 1)[:, 0])
    return np.where(finite, np.take_along_axis(other, best, 1)[:, 0], -1)
