"""Compiled: what is made of symmetric sparse matrices by the upper halves of their rows.

The entries of a row begin with that on the diagonal, and those left of it are not kept. Pointers and columns are
unsigned, so that no index is tested for its sign.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.protocols import Floats
from cpmkit.runtime.compilation import compiled


@compiled
def upper_half(indptr: Any, indices: Any, data: Floats) -> tuple[Any, Any, Floats]:
    """Return pointers, columns and entries of the upper half of a matrix, whose rows need not be sorted."""
    n = len(indptr) - 1
    pointers = np.empty(n + 1, dtype=np.uint64)
    used = n
    for i in range(n):
        for k in range(indptr[i], indptr[i + 1]):
            used += indices[k] > i
    columns, entries = np.empty(used, dtype=np.uint32), np.empty(used)
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
    """Subtract ``A x`` from ``out``, both (channels, n): an entry that is read serves its row and its column."""
    one = np.uint64(1)
    for channel in range(len(x)):
        own, rest = x[channel], out[channel]
        for i in range(len(pointers) - 1):
            k, stop = pointers[i], pointers[i + 1]
            here, odd = own[i], 0.0
            even = entries[k] * here
            k += one
            if (stop - k) % np.uint64(2):
                entry, j = np.float64(entries[k]), columns[k]
                even += entry * own[j]
                rest[j] -= entry * here
                k += one
            while k < stop:  # two sums: one would wait for itself at every entry
                entry, j = np.float64(entries[k]), columns[k]
                even += entry * own[j]
                rest[j] -= entry * here
                entry, j = np.float64(entries[k + one]), columns[k + one]
                odd += entry * own[j]
                rest[j] -= entry * here
                k += np.uint64(2)
            rest[i] -= even + odd


@compiled
def move_by(rest: Floats, inverse: Floats, kept: float, added: float, x: Floats, move: Floats) -> None:
    """Set ``move = kept move + added D^-1 rest`` and ``rest = x + move``, with ``inverse`` D^-1, (n,)."""
    for i in range(len(inverse)):
        factor = added * inverse[i]
        for m in range(rest.shape[1]):
            move[i, m] = kept * move[i, m] + factor * rest[i, m]
            rest[i, m] = x[i, m] + move[i, m]


@compiled
def with_transposed(pointers: Any, columns: Any, entries: Floats) -> tuple[Any, Any, Floats]:
    """Return pointers, columns (in no order) and entries of ``T + T'``, T square."""
    n, one = len(pointers) - 1, np.uint64(1)
    starts = np.zeros(n + 1, dtype=np.uint64)
    for column in columns:
        starts[column + one] += one
    for i in range(n):
        starts[i + 1] += starts[i]
    free = starts[:n].copy()
    rows, turned = np.empty_like(columns), np.empty_like(entries)
    for i in range(n):
        for k in range(pointers[i], pointers[i + 1]):
            at = free[columns[k]]
            rows[at], turned[at] = i, entries[k]
            free[columns[k]] += one
    place = np.zeros(n, dtype=np.uint64)  # one above where a column stands, in this row or an earlier one
    sums = np.zeros(n + 1, dtype=np.uint64)
    found, both = np.empty(2 * len(columns), dtype=np.uint32), np.empty(2 * len(columns))
    used = np.uint64(0)
    for i in range(n):
        begin = used
        for k in range(pointers[i], pointers[i + 1]):  # no column twice
            found[used], both[used] = columns[k], entries[k]
            used += one
            place[columns[k]] = used
        for k in range(starts[i], starts[i + 1]):
            j = rows[k]
            if place[j] > begin:
                both[place[j] - one] += turned[k]
            else:
                found[used], both[used] = j, turned[k]
                used += one
        sums[i + 1] = used
    return sums, found[:used], both[:used]
