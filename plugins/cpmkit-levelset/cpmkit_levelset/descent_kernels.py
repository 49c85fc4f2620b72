"""The compiled steps of a descent: where they lead, which of them are kept, and when it has converged.

Each row is worked out for itself, so that a point's answer never depends on its batch.
"""

from __future__ import annotations

import math

from cpmkit.plugin import compiled, inlined

#: Where the squared distance bends less than this, near a centre of curvature, the step is made as for this value.
LEAST_SECOND_DERIVATIVE = 1e-3
#: Where it bends down, as on a ridge between two basins, the step is at least this share of the longest one: the force
#: is small there, and steps that only double would take thirty to leave.
RIDGE_STRIDE_SHARE = 0.25


@compiled
def fill_newton_steps(tangents, bending, force, stride, step, length):
    """Fill in tangential steps (n, d), cut to ``stride``, and their lengths (n,) before that.

    They are (I + bending)^-1 force, but that along directions in which the distance bends down they go downhill.
    ``tangents``, ``bending`` and ``force`` are those of a ``LocalShape``.
    """
    n, m, d = tangents.shape
    least = RIDGE_STRIDE_SHARE * stride
    u = v = 0.0
    for i in range(n):
        if m == 1:
            u = _step_along_direction(force[i, 0], 1.0 + bending[i, 0, 0], least)
        elif m == 2:
            u, v = _step_in_plane(force[i], 1.0 + bending[i, 0, 0], bending[i, 0, 1], 1.0 + bending[i, 1, 1], least)
        square = 0.0
        for k in range(d):
            step[i, k] = 0.0
            if m > 0:
                step[i, k] = u * tangents[i, 0, k]
            if m == 2:
                step[i, k] += v * tangents[i, 1, k]
            square += step[i, k] * step[i, k]
        length[i] = math.sqrt(square)
        if length[i] > stride:
            for k in range(d):
                step[i, k] *= stride / length[i]


@inlined
def _step_in_plane(force, a, b, c, least):
    """Return the step's coordinates for a force (2,) and the second derivative ((a, b), (b, c)), by principal axes.

    ``least`` is as for :func:`_step_along_direction`.
    """
    if 0.5 * (a + c) - math.hypot(0.5 * (a - c), b) >= LEAST_SECOND_DERIVATIVE:
        determinant = a * c - b * b
        return (c * force[0] - b * force[1]) / determinant, (a * force[1] - b * force[0]) / determinant
    mean, half, angle = 0.5 * (a + c), math.hypot(0.5 * (a - c), b), 0.5 * math.atan2(2 * b, a - c)
    cosine, sine = math.cos(angle), math.sin(angle)
    most = _step_along_direction(cosine * force[0] + sine * force[1], mean + half, least)
    other = _step_along_direction(cosine * force[1] - sine * force[0], mean - half, least)
    return cosine * most - sine * other, sine * most + cosine * other


@inlined
def _step_along_direction(force, second, least):
    """Return the step along one direction, in which half the squared distance has the slope -``force``.

    ``second`` is its whole second derivative there; where this is negative, the step is at least ``least`` long.
    """
    step = force / max(abs(second), LEAST_SECOND_DERIVATIVE)
    if second < -LEAST_SECOND_DERIVATIVE and abs(step) < least:
        return math.copysign(least, force)
    return step


@compiled
def keep_nearer_trials(x, y, best, moved, rows, trial, on, noise):
    """Keep the trials that are on the zero set and no farther from the queries; return how many rows go on.

    Parameters
    ----------
    x, y : (n, d) float64
        The queries, and where their points were.
    best, moved : (n, d) float64, (n,) bool
        Set in place where a trial is kept.
    rows : (r,) int64
        The first of them are overwritten by those whose trial is not kept, which go on.
    trial, on : (r, d) float64, (r,) bool
        The trials of ``rows``, and which are on the zero set.
    noise : (n,) float64
        By how much the squared distance may grow through rounding.
    """
    left = 0
    for i, row in enumerate(rows):
        gain = 0.0  # |x - trial|^2 - |x - y|^2, without the cancellation that far queries would suffer
        for k in range(x.shape[1]):
            change = trial[i, k] - y[row, k]
            gain += change * (change - 2 * (x[row, k] - y[row, k]))
        if on[i] and gain <= noise[row]:
            for k in range(x.shape[1]):
                best[row, k] = trial[i, k]
            moved[row] = True
        else:
            rows[left] = row
            left += 1
    return left


@compiled
def mark_converged(rows, length, moved, last, converged, least, loose):
    """Mark which rows have converged, by the lengths (r,) of their steps; return how many of them go on.

    Parameters
    ----------
    rows : (r,) int64
        The first of them are overwritten by those that go on.
    length, moved : (r,) float64, (r,) bool
        The lengths of the steps, and whether the points moved; others do not go on.
    last, converged : (n,) float64, (n,) bool
        The lengths of the steps before, replaced by these; set for those that have converged.
    least, loose : float
        Steps no longer than ``least`` are the last; so are those no longer than ``loose`` that no longer shrink:
        rounding, or a kink between cells of a grid, keeps them up.
    """
    left = 0
    for i, row in enumerate(rows):
        short = length[i] <= least or (length[i] <= loose and length[i] > 0.5 * last[row])
        last[row] = length[i]
        if short:
            converged[row] = True
        elif moved[i]:
            rows[left] = row
            left += 1
    return left
