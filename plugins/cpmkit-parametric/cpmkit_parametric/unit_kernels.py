"""Compiled: unit parameters and the user's, derivatives by both, and where a step in them leads."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import compiled


@compiled
def user_parameters(s, lower, upper):
    """Return the user's parameters (n, m) of unit ones ``s`` (n, m) between bounds (m,), exact at 0 and 1."""
    n, m = s.shape
    t = np.empty((n, m))
    for row in range(n):
        for i in range(m):
            if s[row, i] == 0:
                t[row, i] = lower[i]
            elif s[row, i] == 1:
                t[row, i] = upper[i]
            else:
                t[row, i] = lower[i] + (upper[i] - lower[i]) * s[row, i]
    return t


@compiled
def scale_derivatives(J, H, width):
    """Return derivatives ``J`` (n, m, d) and ``H`` (n, m, m, d) times the ranges ``width`` (m,), 0 if not finite."""
    n, m, d = J.shape
    first, second = np.empty(J.shape), np.empty(H.shape)
    for row in range(n):
        for i in range(m):
            for k in range(d):
                value = J[row, i, k] * width[i]
                first[row, i, k] = value if np.isfinite(value) else 0.0
                for j in range(m):
                    value = H[row, i, j, k] * (width[i] * width[j])
                    second[row, i, j, k] = value if np.isfinite(value) else 0.0
    return first, second


@compiled
def unpack_jets(rows, m, d):
    """Return points (n, d), derivatives (n, m, d) and second derivatives (n, m, m, d) from ``rows`` (r, n).

    Rows are the d coordinates, then those of the derivatives by each parameter, then by each pair of them, the first
    with the first, the first with the second and so on.
    """
    n = rows.shape[1]
    p, J, H = np.empty((n, d)), np.empty((n, m, d)), np.empty((n, m, m, d))
    for row in range(n):
        for k in range(d):
            p[row, k] = rows[k, row]
            pair = 0
            for i in range(m):
                J[row, i, k] = rows[d * (1 + i) + k, row]
                for j in range(i, m):
                    H[row, i, j, k] = H[row, j, i, k] = rows[d * (1 + m + pair) + k, row]
                    pair += 1
    return p, J, H


@compiled
def advance_parameters(s, step, periodic, flip, poles, most_share):
    """Return where steps (n, m) from unit parameters ``s`` (n, m) lead: wrapped if ``periodic`` (m,), else in [0, 1].

    ``poles`` (m, 2) is True where the side at 0 or at 1 of a parameter is a pole: no step takes more than
    ``most_share`` of the way to it. With ``flip``, an odd number of turns of the first parameter takes the second, t,
    to 1 - t.
    """
    n, m = s.shape
    found = np.empty((n, m))
    for row in range(n):
        turns = 0.0
        for i in range(m):
            own = step[row, i]
            if poles[i, 0]:
                own = max(own, -most_share * s[row, i])
            if poles[i, 1]:
                own = min(own, most_share * (1 - s[row, i]))
            t = s[row, i] + own
            if i == 0:
                turns = np.floor(t)
            elif flip and turns % 2 == 1:
                t = 1 - t
            found[row, i] = t - np.floor(t) if periodic[i] else min(max(t, 0.0), 1.0)
    return found
