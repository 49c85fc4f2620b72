"""Compiled steps of the descent, query by query: with NumPy its calls took most of the time for hundreds of queries."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import compiled

#: Least eigenvalue of the modified Hessian, in units of the metric J'J.
LEAST_EIGENVALUE = 1e-6
EPSILON = float(np.finfo(np.float64).eps)


@compiled
def newton_steps(p, J, second, x, s, periodic, longest):
    """Return the steps (n, m) from unit parameters ``s``, and their lengths (n,) in space, to first order.

    Parameters
    ----------
    p, J, second : (n, d), (n, m, d), (n, m, m, d) float64
        The points there, the first and the second derivatives.
    x : (n, d) float64
        The queries.
    s : (n, m) float64
    periodic : (m,) bool
        Other parameters do not step out of [0, 1] from 0 or 1; from inside they may.
    longest : (m,) float64
        Longest step along each parameter, by which the whole step is shortened.
    """
    n, m, d = J.shape
    step, length = np.empty((n, m)), np.empty(n)
    g, A, H, at_bound = np.empty(m), np.empty((m, m)), np.empty((m, m)), np.empty(m, np.bool_)
    for row in range(n):
        for i in range(m):
            g[i] = 0.0
            for k in range(d):
                g[i] += J[row, i, k] * (p[row, k] - x[row, k])
            for j in range(m):
                A[i, j] = H[i, j] = 0.0
                for k in range(d):
                    A[i, j] += J[row, i, k] * J[row, j, k]
                    H[i, j] += second[row, i, j, k] * (p[row, k] - x[row, k])
                H[i, j] += A[i, j]
        for i in range(m):
            at_bound[i] = not periodic[i] and ((s[row, i] <= 0 and g[i] > 0) or (s[row, i] >= 1 and g[i] < 0))
            if at_bound[i]:
                g[i] = 0.0
        if m == 1:
            _solve_one_parameter(A, H, g, step[row])
        else:
            _solve_two_parameters(A, H, g, at_bound, step[row])
        most = 1.0
        for i in range(m):
            most = max(most, abs(step[row, i] / longest[i]))
        squared = 0.0
        for i in range(m):
            step[row, i] *= -1 / most
        for k in range(d):
            along = 0.0
            for i in range(m):
                along += J[row, i, k] * step[row, i]
            squared += along * along
        length[row] = np.sqrt(squared)
    return step, length


@compiled
def _solve_one_parameter(A, H, g, step):
    """Fill ``step`` (1,) with g / |H|, where |H| is at least LEAST_EIGENVALUE A; with 0 where both vanish."""
    positive = abs(H[0, 0])
    if positive < LEAST_EIGENVALUE * A[0, 0]:
        positive = LEAST_EIGENVALUE * A[0, 0]
    step[0] = g[0] / positive if positive > 0 else 0.0


@compiled
def _solve_two_parameters(A, H, g, at_bound, step):
    """Fill ``step`` (2,) with the solution of (H + mu A) step = g, for the metric A and the Hessian H (2, 2).

    mu is such that the least eigenvalue relative to A is |itself|, at least LEAST_EIGENVALUE. A parameter that
    ``at_bound`` (2,) holds keeps a row and column of A alone. Where the metric is singular (a pole) it is made regular.
    """
    free = not (at_bound[0] or at_bound[1])
    a, b, c = A[0, 0], A[0, 1] if free else 0.0, A[1, 1]
    trace = a + c
    regular = 1e-30 * (trace if trace > 0 else 1.0)
    a, c = a + regular, c + regular
    h, k, q = (
        a if at_bound[0] else H[0, 0] + regular,
        H[0, 1] if free else 0.0,
        c if at_bound[1] else H[1, 1] + regular,
    )
    metric = a * c - b * b
    half = 0.5 * (c * h - 2 * b * k + a * q) / metric
    under = half * half - (h * q - k * k) / metric
    least = half - (0.0 if under < 0 else np.sqrt(under))
    mu = 0.0
    if least < LEAST_EIGENVALUE:
        mu = max(abs(least), LEAST_EIGENVALUE) - least
    h, k, q = h + mu * a, k + mu * b, q + mu * c
    determinant = h * q - k * k
    if not determinant > 0:
        determinant = np.inf
    step[0], step[1] = (q * g[0] - k * g[1]) / determinant, (h * g[1] - k * g[0]) / determinant


@compiled
def is_farther(q, p, x, size):
    """Return (n,) which ``q`` are farther from ``x`` than ``p`` (n, d), or NaN; ``size``, a length, judges rounding."""
    n, d = q.shape
    farther = np.empty(n, np.bool_)
    for row in range(n):
        change = squared = 0.0  # |q - x|^2 - |p - x|^2 without cancellation
        for k in range(d):
            change += (q[row, k] - p[row, k]) * (q[row, k] + p[row, k] - 2 * x[row, k])
            squared += (p[row, k] - x[row, k]) ** 2
        farther[row] = not change <= 8 * EPSILON * size * (np.sqrt(squared) + EPSILON * size)
    return farther


@compiled
def point_distances(p, x):
    """Return (n,) how far points ``p`` (n, d) are from ``x`` (n, d)."""
    n, d = p.shape
    found = np.empty(n)
    for row in range(n):
        squared = 0.0
        for k in range(d):
            squared += (p[row, k] - x[row, k]) ** 2
        found[row] = np.sqrt(squared)
    return found


@compiled
def nearest_rows(query, distance, n):
    """Return (n,) the row of least ``distance`` (k,), NaN the largest, of those of each of n queries; -1 for none.

    ``query`` (k,) is the query of each row. Of rows equally near it is the first.
    """
    best = np.full(n, -1)
    for row in range(len(query)):
        one = best[query[row]]
        if one < 0 or distance[row] < distance[one] or (np.isnan(distance[one]) and not np.isnan(distance[row])):
            best[query[row]] = row
    return best
