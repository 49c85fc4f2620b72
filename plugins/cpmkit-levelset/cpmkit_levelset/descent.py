"""From a point of the zero set down to the nearest one of its basin: a damped Newton method that never leaves it.

Stage two of the search. The paper's Newton method on f(y, lambda) = |y - x|^2 / 2 + lambda phi(y) finds any stationary
point, the farthest too. Here lambda is eliminated: steps are those of the same KKT matrix with phi = 0, taken in the
tangent plane, made a descent where the distance bends the wrong way, returned to the surface by stage one, and taken
only if the distance falls.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Bools, Floats, dots, norms
from cpmkit_levelset.manifold import LocalShape, ZeroSet

LEVELSET_DESCENT_STEPS = 40
#: Where the squared distance bends less than this, near a centre of curvature, the step is made as if it bent so.
LEAST_BENDING_OF_DISTANCE = 1e-3
#: A Newton step shorter than this, relative to the size, is the last: the next one would be its square.
LAST_NEWTON_SHARE = 1e-9
#: A point whose shortest step still was longer than this, relative to the size, has not converged.
LOOSE_STEP_SHARE = 1e-6
#: A step that does not shorten the distance is cut to this share, so many times.
STEP_CUT_FACTOR, MOST_STEP_CUTS = 0.3, 10


def descend(zero_set: ZeroSet, x: Floats, start: Floats, stride: float) -> tuple[Floats, Bools]:
    """Return, for each query, the point with the least distance that is found downhill from ``start``.

    Parameters
    ----------
    zero_set : ZeroSet
    x : (n, d) float64
        The queries.
    start : (n, d) float64
        Points of the zero set.
    stride : float
        No step is longer than this.

    Returns
    -------
    points : (n, d) float64
        On the zero set, never farther from the query than the start is.
    converged : (n,) bool
        Whether the point is stationary: to 1e-12 of the size, or as far as rounding (or a kink) lets it come.
    """
    y, converged = start.copy(), np.zeros(len(x), dtype=bool)
    rows = np.arange(len(x))
    last = np.full(len(x), np.inf)
    for _ in range(LEVELSET_DESCENT_STEPS):
        step = newton_step(zero_set.shape(x[rows], y[rows]))
        length = norms(step)
        shortened = step * np.divide(stride, length, out=np.ones_like(length), where=length > stride)[:, None]
        y[rows], moved = _downhill(zero_set, x[rows], y[rows], shortened, stride)
        # where steps are short and no longer shrink, rounding or a kink between cells of a grid keeps them up
        stuck = (length <= LOOSE_STEP_SHARE * zero_set.size) & (length > 0.5 * last[rows])
        short = (length <= LAST_NEWTON_SHARE * zero_set.size) | stuck
        last[rows] = length
        converged[rows[short]] = True
        rows = rows[moved & ~short]
        if not len(rows):
            break
    return y, converged | (last <= LOOSE_STEP_SHARE * zero_set.size)


def newton_step(shape: LocalShape) -> Floats:
    """Return tangential steps (n, d): (I + bending)^-1 force, with I + bending shifted until it is positive."""
    force, bending = shape.force, shape.bending
    m = force.shape[1]
    if m == 0:
        return np.zeros((len(force), shape.tangents.shape[2]))
    with np.errstate(all="ignore"):
        if m == 1:
            coordinates = force / _raised(1.0 + bending[:, 0])
        else:
            a, b, c = 1.0 + bending[:, 0, 0], bending[:, 0, 1], 1.0 + bending[:, 1, 1]
            least = 0.5 * (a + c) - np.hypot(0.5 * (a - c), b)
            shift = _raised(least) - least
            a, c = a + shift, c + shift
            determinant = a * c - b * b
            u, v = force.T
            coordinates = np.stack([c * u - b * v, a * v - b * u], axis=1) / determinant[:, None]
        step: Floats = np.einsum("na,nai->ni", coordinates, shape.tangents, optimize=False)
    return step


def _raised(bending: Floats) -> Floats:
    raised: Floats = np.maximum(np.abs(bending), LEAST_BENDING_OF_DISTANCE)
    return raised


def _downhill(zero_set: ZeroSet, x: Floats, y: Floats, step: Floats, stride: float) -> tuple[Floats, Bools]:
    """Return ``y`` moved along ``step`` and back to the zero set, cut until no farther from ``x``; and if it moved."""
    moved, best = np.zeros(len(x), dtype=bool), y.copy()
    rows, share = np.arange(len(x)), 1.0
    noise = 8 * np.finfo(float).eps * zero_set.size * (norms(x - y) + zero_set.size)
    for _ in range(MOST_STEP_CUTS):
        trial, on = zero_set.project(y[rows] + share * step[rows], 2 * stride)
        change = trial - y[rows]
        # |x - trial|^2 - |x - y|^2, without the cancellation that far queries would suffer
        gain = dots(change, change - 2 * (x[rows] - y[rows]))
        good = on & (gain <= noise[rows])
        best[rows[good]], moved[rows[good]] = trial[good], True
        rows, share = rows[~good], STEP_CUT_FACTOR * share
        if not len(rows):
            break
    return best, moved
