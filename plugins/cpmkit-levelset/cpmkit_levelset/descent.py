"""Descent on the zero set to a local minimum of the distance, by a damped Newton method that stays on the set.

Stage two of the search. The paper's Newton method on f(y, lambda) = |y - x|^2 / 2 + lambda phi(y) finds any stationary
point, the farthest too. Here lambda is eliminated: steps are those of the same KKT matrix with phi = 0, taken in the
tangent plane, made a descent where the distance bends the wrong way, returned to the surface by stage one, and taken
only if the distance falls.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Bools, Floats, norms
from cpmkit_levelset.descent_kernels import fill_newton_steps, keep_nearer_trials, mark_converged
from cpmkit_levelset.manifold import LocalShape, ZeroSet

LEVELSET_DESCENT_STEPS = 40
#: A Newton step shorter than this, relative to the size, is the last: the next one would be its square.
LAST_NEWTON_SHARE = 1e-9
#: A point whose last step was longer than this, relative to the size, has not converged.
LOOSE_STEP_SHARE = 1e-6
#: A step that increases the distance is cut to this share of itself, at most so many times.
STEP_CUT_FACTOR, MOST_STEP_CUTS = 0.3, 10


def minimize_distance(zero_set: ZeroSet, x: Floats, start: Floats, stride: float) -> tuple[Floats, Bools]:
    """Return, for each query, the point with the least distance that is found downhill from ``start``.

    Parameters
    ----------
    zero_set : ZeroSet
    x : (n, d) float64
        The queries.
    start : (n, d) float64
        Points of the zero set.
    stride : float
        The length of the longest step.

    Returns
    -------
    points : (n, d) float64
        On the zero set, never farther from the query than the start is.
    converged : (n,) bool
        Whether the last step was at most 1e-6 of the size: the next would be its square, unless rounding or a kink, or
        the largest number of steps, stopped the descent.
    """
    y, converged = start.copy(), np.zeros(len(x), dtype=bool)
    rows = np.arange(len(x))
    last = np.full(len(x), np.inf)
    least, loose = LAST_NEWTON_SHARE * zero_set.size, LOOSE_STEP_SHARE * zero_set.size
    for _ in range(LEVELSET_DESCENT_STEPS):
        queries, points = x[rows], y[rows]
        step, length = newton_steps(zero_set.local_shape(queries, points), stride)
        y[rows], moved = _line_search(zero_set, queries, points, step, stride)
        rows = rows[: mark_converged(rows, length, moved, last, converged, least, loose)]
        if not len(rows):
            break
    return y, converged | (last <= loose)


def newton_steps(shape: LocalShape, stride: float) -> tuple[Floats, Floats]:
    """Return tangential Newton steps (n, d) at ``shape``, cut to ``stride``, and their lengths (n,) before the cut."""
    n, _, d = shape.tangents.shape
    step, length = np.empty((n, d)), np.empty(n)
    fill_newton_steps(*shape, stride, step, length)
    return step, length


def _line_search(zero_set: ZeroSet, x: Floats, y: Floats, step: Floats, stride: float) -> tuple[Floats, Bools]:
    """Return ``y`` (n, d) after a line search along ``step`` (n, d), and whether (n,) each point moved.

    A trial is a share of the step, projected back on the zero set. Shares fall by `STEP_CUT_FACTOR` until a trial is no
    farther from ``x`` (n, d), for at most `MOST_STEP_CUTS` trials. A trial that projection moves farther than 2
    ``stride`` does not count.
    """
    moved, best = np.zeros(len(x), dtype=bool), y.copy()
    rows, share = np.arange(len(x)), 1.0
    noise = 8 * np.finfo(float).eps * zero_set.size * (norms(x - y) + zero_set.size)
    for _ in range(MOST_STEP_CUTS):
        trial, on = zero_set.project(y[rows] + share * step[rows], 2 * stride)
        rows = rows[: keep_nearer_trials(x, y, best, moved, rows, trial, on, noise)]
        share *= STEP_CUT_FACTOR
        if not len(rows):
            break
    return best, moved
