"""What is compiled of the search among samples: their models, and which of them may still lead to a nearer point.

Below, n queries look at k samples each, the nearest first.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import compiled, inlined


@compiled
def fill_models(x, gap, near, samples, tangents, curvatures, largest, covering, shares, lowest, minimum, promising):
    """Fill in the local models of the samples ``near`` (n, k) at the queries ``x`` (n, d), in place, as in ``Models``.

    Parameters
    ----------
    gap : (n, k) float64
        How far the samples are.
    samples, tangents, curvatures, largest, covering
        As in a ``Layer``, ``largest`` are the largest curvatures.
    shares : (3,) float64
        The trust, the farthest minimum and the room around stationary points, in the units of their constants.
    """
    n, d = x.shape
    m, r = tangents.shape[1], covering
    trust, farthest, stationary = shares[0], shares[1] * r, shares[2]
    for i in range(n):
        for j in range(near.shape[1]):
            s = near[i, j]
            bound, hopeful = -2 * m * trust * r * r * gap[i, j] * largest[s], True
            for k in range(d):
                minimum[i, j, k] = samples[s, k]
            for a in range(m):
                force, second = 0.0, 1.0
                for k in range(d):
                    across = x[i, k] - samples[s, k]
                    force += tangents[s, a, k] * across
                    second -= curvatures[s, a, k] * across
                size = abs(force)
                bound += -force * force / second if size <= r * second else r * (r * second - 2 * size)
                u = min(max(force / second, -farthest), farthest) if second > 0 else np.nan
                for k in range(d):
                    minimum[i, j, k] += u * tangents[s, a, k]
                hopeful &= size <= r * (max(second, 0.0) + stationary * (1.0 + gap[i, j] * largest[s]))
            lowest[i, j], promising[i, j] = bound, hopeful


@compiled
def clear_nearby_samples(untried, minimum, starts, rows, points, reach):
    """Clear in ``untried`` (n, k), in place, samples within ``reach`` of a point, or whose models have a minimum there.

    Parameters
    ----------
    minimum, starts : (n, k, d) float64
        The minima of the models, and the samples.
    rows : (p,) int64
        The queries of the points.
    points : (p, d) float64
        NaN crosses nothing off.
    """
    for p, i in enumerate(rows):
        for j in range(untried.shape[1]):
            if untried[i, j] and (
                _is_near(minimum[i, j], points[p], reach) or _is_near(starts[i, j], points[p], reach)
            ):
                untried[i, j] = False


@compiled
def discard_untried(untried, active, gap, lowest, best, sure):
    """Clear the samples that cannot lead to a point nearer than ``best`` (n,); return the number of open queries.

    ``untried`` (n, k) is changed in place; ``gap`` (n, k) are the samples' distances and ``lowest`` (n, k) as in
    ``Models``. ``active`` (a,) int64 are the queries that are looked at: the first of them are overwritten by those
    with something left, and ``sure`` (n,) is set for the others.
    """
    left = 0
    for i in active:
        some = False
        for j in range(untried.shape[1]):
            if untried[i, j]:
                # (gap - best) (gap + best), because the squares of far queries differ by less than they are rounded
                untried[i, j] = not (gap[i, j] - best[i]) * (gap[i, j] + best[i]) + lowest[i, j] > 0
                some |= untried[i, j]
        if some:
            active[left] = i
            left += 1
        else:
            sure[i] = True
    return left


@compiled
def choose_starts(untried, minimum, starts, active, room, most, reach, rows, columns):
    """Fill in pairs of queries and untried samples whose models lead to different places; return how many.

    Parameters
    ----------
    untried, minimum, starts : (n, k) bool, (n, k, d) float64, (n, k, d) float64
        Cleared where chosen; the models' minima and the samples, of which two within ``reach`` are one place.
    active : (a,) int64
        The queries.
    room : (n,) int64
        How many samples of a query may still be tried; lowered by those that are chosen.
    most : int
        At most so many for each query: the nearest.
    rows, columns : (len(active) most,) int64
        Filled with the pairs.
    """
    count = 0
    for i in active:
        first = count
        for j in range(untried.shape[1]):
            if count - first >= min(most, room[i]):
                break
            if not untried[i, j]:
                continue
            apart = True
            for c in range(first, count):
                led = minimum[i, columns[c]]
                apart &= not (_is_near(minimum[i, j], led, reach) or _is_near(starts[i, j], led, reach))
            if apart:
                rows[count], columns[count] = i, j
                untried[i, j] = False
                count += 1
        room[i] -= count - first
    return count


@compiled
def keep_nearest(points, best, rows, feet, distance):
    """Replace, in ``points`` and ``best`` (n,), the points of queries ``rows`` (p,) by nearer ``feet`` (p, d)."""
    for p, i in enumerate(rows):
        if distance[p] < best[i]:
            best[i] = distance[p]
            for k in range(points.shape[1]):
                points[i, k] = feet[p, k]


@inlined
def _is_near(a, b, reach):
    """Return whether two points are at most ``reach`` apart; False for NaN."""
    square = 0.0
    for k in range(len(a)):
        square += (a[k] - b[k]) ** 2
    return square <= reach * reach
