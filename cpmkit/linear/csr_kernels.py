"""Compiled: products and sweeps with sparse matrices, full or given by the upper halves of their rows if symmetric.

Matrices are CSR arrays: ``pointers`` (n + 1,), ``columns`` and ``entries``; pointers and columns are unsigned, so that
no index is tested for its sign. Vectors are contiguous, (n, channels), and (channels, n) for symmetric matrices, whose
rows begin with the entry on the diagonal.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.runtime.compilation import compiled, inlined
from cpmkit.types import Bools, Floats


@inlined
def _row(pointers: Any, columns: Any, entries: Any, i: int, x: Floats, m: int) -> float:
    """Return entry (i, m) of ``A x``, as the sum of four sums: additions to a single sum would wait for each other."""
    first, second, third, fourth = 0.0, 0.0, 0.0, 0.0
    k, stop = pointers[i], pointers[i + 1]
    last = stop - (stop - k) % np.uint64(4)
    while k < last:
        first += entries[k] * x[columns[k], m]
        second += entries[k + np.uint64(1)] * x[columns[k + np.uint64(1)], m]
        third += entries[k + np.uint64(2)] * x[columns[k + np.uint64(2)], m]
        fourth += entries[k + np.uint64(3)] * x[columns[k + np.uint64(3)], m]
        k += np.uint64(4)
    while k < stop:
        first += entries[k] * x[columns[k], m]
        k += np.uint64(1)
    total: float = (first + second) + (third + fourth)
    return total


@compiled
def fill_residual(
    start: int, stop: int, pointers: Any, columns: Any, entries: Any, x: Floats, b: Floats, out: Floats
) -> None:
    """Fill the rows from ``start`` to ``stop`` of ``out`` (n, channels) with those of ``b - A x``."""
    for i in range(start, stop):
        for m in range(x.shape[1]):
            out[i, m] = b[i, m] - _row(pointers, columns, entries, i, x, m)


@compiled
def step(
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
    """Update ``move`` and ``out`` (n, channels) in the rows from ``start`` to ``stop`` by one step of an iteration.

    ``move`` becomes ``momentum move + factor D^-1 (b - A x)`` and ``out`` becomes ``x + move``; ``inverse`` (n,) is the
    diagonal of D^-1.
    """
    for i in range(start, stop):
        for m in range(x.shape[1]):
            rest = b[i, m] - _row(pointers, columns, entries, i, x, m)
            move[i, m] = momentum * move[i, m] + factor * inverse[i] * rest
            out[i, m] = x[i, m] + move[i, m]


@compiled
def restrict(pointers: Any, columns: Any, entries: Any, fine: Floats, coarse: Floats) -> None:
    """Add ``P' fine`` to ``coarse`` (m, channels), P given by its CSR arrays and ``fine`` (n, channels)."""
    for i in range(len(fine)):
        for k in range(pointers[i], pointers[i + 1]):
            for m in range(fine.shape[1]):
                coarse[columns[k], m] += entries[k] * fine[i, m]


@compiled
def prolong(start: int, stop: int, pointers: Any, columns: Any, entries: Any, coarse: Floats, fine: Floats) -> None:
    """Add the rows from ``start`` to ``stop`` of ``P coarse`` to those of ``fine`` (n, channels)."""
    for i in range(start, stop):
        for m in range(fine.shape[1]):
            fine[i, m] += _row(pointers, columns, entries, i, coarse, m)


@compiled
def multiply(
    needed: Bools,
    pointers: Any,
    columns: Any,
    entries: Floats,
    other_pointers: Any,
    other_columns: Any,
    other_entries: Floats,
    width: int,
    room: int,
    upper: bool,
    first: float,
) -> tuple[Any, Any, Floats]:
    """Return pointers, columns (unsorted) and entries of ``A B``, which has ``width`` columns.

    Rows that are not ``needed`` (n,) are empty. With ``upper``, rows have only the entry on the diagonal and those
    right of it. The first entry of each row of A is multiplied by ``first``. ``room`` is the expected number of entries
    of the product: unused room takes no memory, and an extension takes some time.
    """
    met, total = np.full(width, -1, dtype=np.int32), np.zeros(width)  # of each column the last row, the entry
    starts = np.zeros(len(pointers), dtype=np.uint64)
    out_columns, sums = np.empty(room, dtype=np.uint32), np.empty(room)
    used = np.uint64(0)
    for i in range(len(pointers) - 1):
        begin = used
        if not needed[i]:
            starts[i + 1] = used
            continue
        if used + np.uint64(width) >= np.uint64(len(sums)):
            most = used + np.uint64(1)
            for k in range(pointers[i], pointers[i + 1]):
                most += other_pointers[columns[k] + np.uint64(1)] - other_pointers[columns[k]]
            if most >= np.uint64(len(sums)):
                more, further = np.empty(2 * most, dtype=np.uint32), np.empty(2 * most)
                more[:used], further[:used] = out_columns[:used], sums[:used]
                out_columns, sums = more, further
        least = 0
        if upper:
            least, met[i], out_columns[used] = i, i, i
            used += np.uint64(1)
        for k in range(pointers[i], pointers[i + 1]):
            entry, row = entries[k] * (first if k == pointers[i] else 1.0), columns[k]
            for at in range(other_pointers[row], other_pointers[row + np.uint64(1)]):
                column = other_columns[at]
                if column < least:
                    continue
                total[column] += entry * other_entries[at]
                out_columns[used] = column  # stays if it is new: a branch would often be mispredicted
                used += np.uint64(met[column] != i)
                met[column] = i
        for at in range(begin, used):
            sums[at] = total[out_columns[at]]
            total[out_columns[at]] = 0.0
        starts[i + 1] = used
    return starts, out_columns[:used], sums[:used]


@compiled
def upper_half(indptr: Any, indices: Any, data: Floats, entries: Any) -> tuple[Any, Any, Any]:
    """Return pointers, columns and entries of the upper half of a matrix whose rows are unsorted.

    Each row begins with the diagonal. The entries have the type of the empty array ``entries``.
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
    """Subtract ``A x`` from ``out``, both (channels, n), for a symmetric A given by its upper half."""
    unit = np.uint64(1)
    for channel in range(len(x)):
        values, rest = x[channel], out[channel]
        for i in range(len(pointers) - 1):
            k, stop = pointers[i], pointers[i + 1]
            here, odd = values[i], 0.0
            even = entries[k] * here
            k += unit
            if (stop - k) % np.uint64(2):
                entry, j = np.float64(entries[k]), columns[k]
                even += entry * values[j]
                rest[j] -= entry * here
                k += unit
            while k < stop:  # two sums, which do not wait for each other
                entry, j = np.float64(entries[k]), columns[k]
                even += entry * values[j]
                rest[j] -= entry * here
                entry, j = np.float64(entries[k + unit]), columns[k + unit]
                odd += entry * values[j]
                rest[j] -= entry * here
                k += np.uint64(2)
            rest[i] -= even + odd


@compiled
def move_by(rest: Floats, inverse: Floats, momentum: float, factor: float, x: Floats, move: Floats) -> None:
    """Update ``move`` and ``rest`` (n, channels) by one step of an iteration, given the residual in ``rest``.

    ``move`` becomes ``momentum move + factor D^-1 rest`` and ``rest`` becomes ``x + move``; ``inverse`` (n,) is the
    diagonal of D^-1.
    """
    for i in range(len(inverse)):
        scale = factor * inverse[i]
        for m in range(rest.shape[1]):
            move[i, m] = momentum * move[i, m] + scale * rest[i, m]
            rest[i, m] = x[i, m] + move[i, m]


@compiled
def sweep_up(pointers: Any, columns: Any, entries: Any, inverse: Floats, rest: Floats, x: Floats) -> None:
    """Update x and its residual ``rest`` = b - A x, both (channels, n), by a backward Gauss-Seidel sweep.

    Equations are solved from the last to the first, where ``inverse`` (n,), of the diagonal, is not zero. A is
    symmetric and given by its upper half.
    """
    unit = np.uint64(1)
    for channel in range(len(x)):
        values, left = x[channel], rest[channel]
        move = np.zeros(len(inverse))
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
def sweep_down(pointers: Any, columns: Any, entries: Any, inverse: Floats, b: Floats, x: Floats) -> None:
    """Update x (channels, n) by a forward Gauss-Seidel sweep for ``A x = b``; ``b`` (channels, n) is overwritten.

    Equations are solved from the first to the last, where ``inverse`` (n,), of the diagonal, is not zero. A is
    symmetric and given by its upper half.
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


@inlined
def _row_product(k: Any, stop: Any, columns: Any, entries: Any, x: Floats) -> float:
    """Return the scalar product of x with the entries from k to ``stop``.

    Four sums are formed, which do not wait for each other.
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
def symmetric_sum(pointers: Any, columns: Any, entries: Floats) -> tuple[Any, Any, Floats]:
    """Return pointers, columns and entries of the upper half of ``T + T'``, for a square T given by its CSR arrays."""
    n, unit = len(pointers) - 1, np.uint64(1)
    starts = np.zeros(n + 1, dtype=np.uint64)
    for i in range(n):
        for k in range(pointers[i], pointers[i + 1]):
            if columns[k] < i:
                starts[columns[k] + unit] += unit
    for i in range(n):
        starts[i + 1] += starts[i]
    free = starts[:n].copy()
    rows, turned = np.empty(starts[n], dtype=np.uint32), np.empty(starts[n])
    for i in range(n):
        for k in range(pointers[i], pointers[i + 1]):
            if columns[k] < i:
                at = free[columns[k]]
                rows[at], turned[at] = i, entries[k]
                free[columns[k]] += unit
    place = np.zeros(n, dtype=np.uint64)  # one above the position of a column, in this row or an earlier one
    sums = np.zeros(n + 1, dtype=np.uint64)
    room = len(columns) + n  # the diagonal of each row, and at most all its entries of T and T'
    out_columns, both = np.empty(room, dtype=np.uint32), np.empty(room)
    used = np.uint64(0)
    for i in range(n):
        begin = used
        out_columns[used], both[used] = i, 0.0
        used += unit
        for k in range(pointers[i], pointers[i + 1]):  # each column is there once
            if columns[k] == i:
                both[begin] = 2.0 * entries[k]
            elif columns[k] > i:
                out_columns[used], both[used] = columns[k], entries[k]
                used += unit
                place[columns[k]] = used
        for k in range(starts[i], starts[i + 1]):
            j = rows[k]
            if place[j] > begin:
                both[place[j] - unit] += turned[k]
            else:
                out_columns[used], both[used] = j, turned[k]
                used += unit
        sums[i + 1] = used
    return sums, out_columns[:used], both[:used]


@compiled
def full_matrix(pointers: Any, columns: Any, entries: Any) -> tuple[Any, Any, Any]:
    """Return pointers, columns (ascending) and entries of a full symmetric matrix, given its upper half."""
    n, unit = len(pointers) - 1, np.uint64(1)
    starts = np.zeros(n + 1, dtype=np.uint64)
    for i in range(n):
        starts[i + 1] += pointers[i + 1] - pointers[i]
        for k in range(pointers[i] + unit, pointers[i + 1]):
            starts[columns[k] + unit] += unit
    for i in range(n):
        starts[i + 1] += starts[i]
    free = starts[:n].copy()
    out_columns, whole = np.empty(starts[n], dtype=np.uint32), np.empty(starts[n], dtype=entries.dtype)
    for i in range(n):
        for k in range(pointers[i], pointers[i + 1]):
            j = columns[k]
            if j != i:  # the entries of row i left of the diagonal are there already
                out_columns[free[j]], whole[free[j]] = i, entries[k]
                free[j] += unit
            out_columns[free[i]], whole[free[i]] = j, entries[k]
            free[i] += unit
    return starts, out_columns, whole
