"""The nearest point of a manifold beside a given one, by its closest points alone."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Bools, ClosestPointSource, Floats, dots, norms

#: Rounds at most, and when a step has ended the descent, relative to the size of the numbers.
PROBE_ROUNDS, LAST_PROBE_SHARE = 100, 1e-13
#: The first probe goes this share of the way to the query, later ones at most this share.
FIRST_PROBE_SHARE, LONGEST_PROBE_SHARE = 0.5, 0.9


def descend(of: ClosestPointSource, x: Floats, start: Floats, reach: float) -> tuple[Floats, Bools]:
    """Return points of ``of`` from which queries ``x`` (n, d) are seen at a right angle, and which of them surely are.

    The foot y is replaced by the closest point of y + share (x - y). That is y itself where x - y is normal, and else
    nearer to x: a tangential error shrinks by (1 - share) / (1 - share |x - y| k), k the curvature towards x. Where
    another part of the manifold is nearer to the probe, the foot jumps or the distance grows: then the share is halved.

    Parameters
    ----------
    of : ClosestPointSource
    x, start : (n, d) float64
        Queries, and points of the manifold.
    reach : float
        The longest step.
    """
    y, distance, step = start.copy(), norms(x - start), np.zeros_like(x)
    share, most, longest = (np.full(len(x), value) for value in (FIRST_PROBE_SHARE, LONGEST_PROBE_SHARE, reach))
    ahead, ended, rows = np.zeros_like(x), np.zeros(len(x), dtype=bool), np.arange(len(x))
    rounding = LAST_PROBE_SHARE * (np.abs(x).max(axis=1, initial=0.0) + np.abs(start).max(axis=1, initial=0.0))
    for k in range(PROBE_ROUNDS):
        if not len(rows):
            break
        base = y[rows] + ahead[rows]
        foot = of.closest_point(base + share[rows, None] * (x[rows] - base)).points
        advance, reached = foot - y[rows], norms(x[rows] - foot)
        length = norms(advance)
        taken = (length <= longest[rows] + 2 * norms(ahead[rows])) & (reached <= distance[rows] + rounding[rows])
        moved = rows[taken]
        ended[rows] = taken & (length <= rounding[rows])
        if k % 3 == 1:  # two plain steps tell how fast they shrink, and so where they lead
            shrink = dots(advance, step[rows]) / np.maximum(dots(step[rows], step[rows]), np.finfo(float).tiny)
            shrink = np.where(taken, np.clip(shrink, 0.0, 0.95), 0.0)
            ahead[rows] = (shrink / (1 - shrink))[:, None] * advance
        else:
            ahead[rows] = 0.0
            # after a step back a longer share is not tried again
            most[rows] = np.where(taken | (k % 3 == 2), most[rows], 0.5 * share[rows])
        y[moved], distance[moved], longest[moved] = foot[taken], reached[taken], 2 * length[taken]
        step[rows] = np.where(taken[:, None], advance, 0.0)
        share[rows] = np.minimum(most[rows], np.where(taken, 1.5, 1.0) * share[rows])
        rows = rows[~ended[rows]]
    return y, ended
