"""Compiled: products with sparse matrices, sweeps with their upper halves, and Cholesky factors of dense matrices.

Sparse matrices are CSR arrays: ``pointers`` (n + 1,), ``columns`` and ``entries``; pointers and columns are unsigned,
so that no index is tested for its sign. Vectors are contiguous, (n, channels), and (channels, n) for upper halves,
whose rows begin with the entry on the diagonal.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.runtime.compilation import compiled, compiled_reordered, inlined
from cpmkit.types import Floats


@inlined
def _row_product(k: Any, stop: Any, columns: Any, entries: Any, x: Floats) -> float:
    """Return the scalar product of a vector x with entries k to ``stop`` - 1 of a matrix, a part of a row.

    ``columns`` and ``entries`` are CSR arrays. Four sums are formed, since additions to one sum depend on each other.
    """
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    while (stop - k) % np.uint64(4):
        a += np.float64(entries[k]) * x[columns[k]]
        k += np.uint64(1)
    while k < stop:
        a += np.float64(entries[k]) * x[columns[k]]
        b += np.float64(entries[k + np.uint64(1)]) * x[columns[k + np.uint64(1)]]
        c += np.float64(entries[k + np.uint64(2)]) * x[columns[k + np.uint64(2)]]
        d += np.float64(entries[k + np.uint64(3)]) * x[columns[k + np.uint64(3)]]
        k += np.uint64(4)
    total: float = (a + b) + (c + d)
    return total


@compiled
def momentum_step(
    start: int,
    stop: int,
    pointers: Any,
    columns: Any,
    entries: Any,
    x: Floats,
    b: Floats,
    inverse: Floats,
    momentum: float,
    factor: float,
    move: Floats,
    out: Floats,
) -> None:
    """Fill rows ``start`` to ``stop`` - 1 of ``move`` and ``out`` (n, channels) by one step for ``A x = b``.

    ``move`` becomes ``momentum move + factor D^-1 (b - A x)`` and ``out`` becomes ``x + move``; ``inverse`` (n,) is the
    diagonal of D^-1. A is given by its CSR arrays; x and b are (n, channels).
    """
    for i in range(start, stop):
        for m in range(x.shape[1]):
            rest = b[i, m] - _row_product(pointers[i], pointers[i + 1], columns, entries, x[:, m])
            move[i, m] = momentum * move[i, m] + factor * inverse[i] * rest
            out[i, m] = x[i, m] + move[i, m]


@compiled
def add_transposed(pointers: Any, columns: Any, entries: Any, fine: Floats, coarse: Floats) -> None:
    """Add ``P' fine`` to ``coarse`` (m, channels), P (n, m) given by its CSR arrays and ``fine`` (n, channels)."""
    for i in range(len(fine)):
        for k in range(pointers[i], pointers[i + 1]):
            for m in range(fine.shape[1]):
                coarse[columns[k], m] += entries[k] * fine[i, m]


@compiled
def add_product(start: int, stop: int, pointers: Any, columns: Any, entries: Any, coarse: Floats, fine: Floats) -> None:
    """Add rows ``start`` to ``stop`` - 1 of ``P coarse`` to ``fine`` (n, channels), P (n, m) by its CSR arrays."""
    for i in range(start, stop):
        for m in range(fine.shape[1]):
            fine[i, m] += _row_product(pointers[i], pointers[i + 1], columns, entries, coarse[:, m])


@compiled
def upper_half(indptr: Any, indices: Any, data: Floats, entries: Any) -> tuple[Any, Any, Any]:
    """Return pointers, columns and entries of the upper half of a square matrix, whose rows may be unsorted.

    The matrix is given by its CSR arrays. Each row begins with the diagonal, also if that is zero. The entries have the
    type of the array ``entries``, which is not read.
    """
    n = len(indptr) - 1
    pointers = np.empty(n + 1, dtype=np.uint64)
    used = n
    for i in range(n):
        for k in range(indptr[i], indptr[i + 1]):
            used += indices[k] > i
    columns, entries = np.empty(used, dtype=np.uint32), np.empty(used, dtype=entries.dtype)
    used = 0
    for i in range(n):
        pointers[i] = at = used
        columns[at], entries[at] = i, 0.0
        used += 1
        for k in range(indptr[i], indptr[i + 1]):
            if indices[k] > i:
                columns[used], entries[used] = indices[k], data[k]
                used += 1
            elif indices[k] == i:
                entries[at] += data[k]
    pointers[n] = used
    return pointers, columns, entries


@compiled
def subtract_product(pointers: Any, columns: Any, entries: Any, x: Floats, out: Floats) -> None:
    """Subtract ``A x`` from ``out``, both (channels, n), for a symmetric A given by its upper half's CSR arrays."""
    unit = np.uint64(1)
    for channel in range(len(x)):
        values, rest = x[channel], out[channel]
        for i in range(len(pointers) - 1):
            k, stop = pointers[i], pointers[i + 1]
            here, odd = values[i], 0.0
            even = entries[k] * here
            k += unit
            if (stop - k) % np.uint64(2):
                even += entries[k] * values[columns[k]]
                rest[columns[k]] -= entries[k] * here
                k += unit
            while k < stop:  # two sums, which do not wait for each other
                even += entries[k] * values[columns[k]]
                rest[columns[k]] -= entries[k] * here
                odd += entries[k + unit] * values[columns[k + unit]]
                rest[columns[k + unit]] -= entries[k + unit] * here
                k += np.uint64(2)
            rest[i] -= even + odd


@compiled
def sweep_backward(pointers: Any, columns: Any, entries: Any, inverse: Floats, rest: Floats, x: Floats) -> None:
    """Update x and its residual ``rest`` = b - A x, both (channels, n), by a backward Gauss-Seidel sweep.

    Equations are solved from the last to the first, except where ``inverse`` (n,), 1 / diagonal or 0, is zero. A is
    symmetric, given by its upper half's CSR arrays.
    """
    unit = np.uint64(1)
    for channel in range(len(x)):
        values, left = x[channel], rest[channel]
        move = np.empty(len(inverse))
        move[:] = 0.0
        for i in range(len(inverse) - 1, -1, -1):
            first, stop = pointers[i] + unit, pointers[i + 1]
            here = left[i] - _row_product(first, stop, columns, entries, move)
            if inverse[i] == 0.0:
                left[i] = here
                continue
            move[i] = inverse[i] * here
            values[i] += move[i]
            left[i] = 0.0
            for k in range(first, stop):
                left[columns[k]] -= np.float64(entries[k]) * move[i]


@compiled
def sweep_forward(pointers: Any, columns: Any, entries: Any, inverse: Floats, b: Floats, x: Floats) -> None:
    """Update x (channels, n) by a forward Gauss-Seidel sweep for ``A x = b``; ``b`` (channels, n) is overwritten.

    Equations are solved from the first to the last, except where ``inverse`` (n,), 1 / diagonal or 0, is zero. A is
    symmetric, given by its upper half's CSR arrays.
    """
    unit = np.uint64(1)
    for channel in range(len(x)):
        values, left = x[channel], b[channel]
        for i in range(len(inverse)):
            first, stop = pointers[i] + unit, pointers[i + 1]
            if inverse[i] != 0.0:
                values[i] = inverse[i] * (left[i] - _row_product(first, stop, columns, entries, values))
            for k in range(first, stop):
                left[columns[k]] -= np.float64(entries[k]) * values[i]


@compiled_reordered
def factorize_cholesky(a: Floats) -> bool:
    """Overwrite the lower triangle of ``a`` (n, n) with L of A = L L'; return whether all pivots are above zero.

    At the first other pivot it stops. The upper triangle is not read. Up to some hundred unknowns this is as fast as
    LAPACK with one thread; LAPACK with several threads waits for them, and takes fifty times as long while other
    programs run.
    """
    for i in range(len(a)):
        for j in range(i + 1):
            total = 0.0
            for k in range(j):
                total += a[i, k] * a[j, k]
            if j < i:
                a[i, j] = (a[i, j] - total) / a[j, j]
            elif not a[i, i] - total > 0:  # NaN is refused too
                return False
            else:
                a[i, i] = np.sqrt(a[i, i] - total)
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
