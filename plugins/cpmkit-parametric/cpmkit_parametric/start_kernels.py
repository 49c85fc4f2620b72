"""Compiled: of the cells that may hold the foot of a query, those that descents start in."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import compiled


@compiled
def find_starts(x, found, neighbours, neighbours_along, ends, shape, centres, inverses, most):
    """Return the query (k,) and the unit parameters (k, m) of each start, sorted by query.

    First one in each cell that is nearer to the query than its neighbours, the nearest first; then one in each cell at
    an end that is nearer than its neighbours along the end. At most ``most`` of either kind for a query.

    Parameters
    ----------
    x : (n, d) float64
        The queries.
    found : (query, cell, distance), each (p,), of each pair that may be closest
        Sorted by query; distances are those of the cells' discs.
    neighbours, neighbours_along, ends, centres, inverses
        Of the finest cells, as in a ``CellTree``.
    shape : (m,) int64
        How many of these lie along each parameter.
    most : int
    """
    query, cell, distance = found
    cells, m = ends.shape
    place, chosen = np.full(cells, -1), np.empty(most, np.int64)
    starts, parameters = np.empty(2 * len(query), np.int64), np.empty((2 * len(query), m))
    count = begin = 0
    while begin < len(query):
        end = begin
        while end < len(query) and query[end] == query[begin]:
            end += 1
        for along in range(2):
            around = neighbours_along if along else neighbours
            for pair in range(begin, end):
                if not along or _touches_end(ends, cell[pair]):
                    place[cell[pair]] = pair
            valleys = np.int64(0)
            for pair in range(begin, end):
                if place[cell[pair]] == pair and _is_local_minimum(pair, cell, distance, place, around):
                    valleys = _insert_sorted(chosen, valleys, pair, cell, distance)
            for k in range(valleys):
                c = cell[chosen[k]]
                starts[count] = query[begin]
                _fill_parameters(x[query[begin]], c, shape, centres, inverses, parameters[count])
                for i in range(m):
                    if along and np.isfinite(ends[c, i]):
                        parameters[count, i] = ends[c, i]
                count += 1
            for pair in range(begin, end):
                place[cell[pair]] = -1
        begin = end
    return starts[:count].copy(), parameters[:count].copy()


@compiled
def _touches_end(ends, cell):
    """Return whether a cell touches an end of a bounded parameter."""
    touches = False
    for i in range(ends.shape[1]):
        touches |= np.isfinite(ends[cell, i])
    return touches


@compiled
def _is_nearer(one, other, cell, distance):
    """Return whether pair ``one`` is nearer than ``other`` of the same query, or as near in an earlier cell."""
    return distance[one] < distance[other] or (distance[one] == distance[other] and cell[one] < cell[other])


@compiled
def _is_local_minimum(pair, cell, distance, place, around):
    """Return whether the cell of ``pair`` is nearer to its query than its neighbours ``around`` (c, k).

    Only neighbours count that have a pair of the same query, which is ``place`` (c,) >= 0.
    """
    for k in range(around.shape[1]):
        other = place[around[cell[pair], k]]
        if other >= 0 and _is_nearer(other, pair, cell, distance):
            return False
    return True


@compiled
def _insert_sorted(chosen, count, pair, cell, distance):
    """Insert a pair by distance among the first ``count`` of ``chosen``, in place; return how many there are then.

    If ``chosen`` is full, the farthest drops out.
    """
    at = count
    while at > 0 and _is_nearer(pair, chosen[at - 1], cell, distance):
        at -= 1
    if at == len(chosen):
        return count
    last = min(count, len(chosen) - 1)
    for k in range(last, at, -1):
        chosen[k] = chosen[k - 1]
    chosen[at] = pair
    return last + 1


@compiled
def _fill_parameters(x, cell, shape, centres, inverses, parameters):
    """Fill in the unit parameters (m,) of the projection of ``x`` (d,) on the plane of a finest cell's spans.

    Each parameter is clamped to the cell by itself: on a skew cell this is not the nearest point.
    """
    m = len(shape)
    rest = cell
    for i in range(m - 1, -1, -1):
        offset = 0.0
        for k in range(len(x)):
            offset += (x[k] - centres[cell, k]) * inverses[cell, k, i]
        parameters[i] = (rest % shape[i] + 0.5 + min(max(offset, -0.5), 0.5)) / shape[i]
        rest //= shape[i]
