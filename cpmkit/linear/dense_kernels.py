"""Compiled: Cholesky factors of dense matrices, and solves with them, on one thread.

Up to some hundred unknowns they are as fast as LAPACK with one thread. LAPACK with several threads waits for them, and
takes fifty times as long while other programs run.
"""

from __future__ import annotations

import numpy as np

from cpmkit.runtime.compilation import compiled_reordered
from cpmkit.types import Floats


@compiled_reordered
def factorize_cholesky(a: Floats) -> bool:
    """Overwrite the lower triangle of ``a`` (n, n) with L of A = L L'; return False if a pivot is not above zero.

    The upper triangle is not read. Four entries of a row are computed together, so that the row is read once for all
    four.
    """
    for i in range(len(a)):
        j = 0
        while j + 4 <= i:
            first = second = third = fourth = 0.0
            for k in range(j):
                x = a[i, k]
                first += x * a[j, k]
                second += x * a[j + 1, k]
                third += x * a[j + 2, k]
                fourth += x * a[j + 3, k]
            p = (a[i, j] - first) / a[j, j]
            q = (a[i, j + 1] - second - p * a[j + 1, j]) / a[j + 1, j + 1]
            r = (a[i, j + 2] - third - p * a[j + 2, j] - q * a[j + 2, j + 1]) / a[j + 2, j + 2]
            s = a[i, j + 3] - fourth - p * a[j + 3, j] - q * a[j + 3, j + 1] - r * a[j + 3, j + 2]
            a[i, j], a[i, j + 1], a[i, j + 2], a[i, j + 3] = p, q, r, s / a[j + 3, j + 3]
            j += 4
        while j < i:
            total = 0.0
            for k in range(j):
                total += a[i, k] * a[j, k]
            a[i, j] = (a[i, j] - total) / a[j, j]
            j += 1
        squares = 0.0
        for k in range(i):
            squares += a[i, k] * a[i, k]
        pivot = a[i, i] - squares
        if not pivot > 0:  # NaN is refused too
            return False
        a[i, i] = np.sqrt(pivot)
    return True


@compiled_reordered
def solve_cholesky(lower: Floats, u: Floats) -> None:
    """Overwrite u (channels, n) with ``(L L')^-1 u``, L in the lower triangle of ``lower`` (n, n)."""
    n = len(lower)
    for channel in range(len(u)):
        for i in range(n):
            total = 0.0
            for k in range(i):
                total += lower[i, k] * u[channel, k]
            u[channel, i] = (u[channel, i] - total) / lower[i, i]
        for i in range(n - 1, -1, -1):
            u[channel, i] /= lower[i, i]
            for k in range(i):
                u[channel, k] -= u[channel, i] * lower[i, k]
