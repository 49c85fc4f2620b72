"""Compiled: products of a sparse matrix with vectors of several channels, and what a smoother does along with them.

Pointers and columns are unsigned, so that no index is tested for its sign; vectors are (n, channels) and contiguous.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.protocols import Bools, Floats
from cpmkit.runtime.compilation import compiled, inlined


@inlined
def _row(pointers: Any, columns: Any, entries: Any, i: int, x: Floats, m: int) -> float:
    """Return row i of ``A x``, channel m, in four sums: one would wait for itself at every entry."""
    one, two, three, four = 0.0, 0.0, 0.0, 0.0
    k, stop = pointers[i], pointers[i + 1]
    last = stop - (stop - k) % np.uint64(4)
    while k < last:
        one += entries[k] * x[columns[k], m]
        two += entries[k + np.uint64(1)] * x[columns[k + np.uint64(1)], m]
        three += entries[k + np.uint64(2)] * x[columns[k + np.uint64(2)], m]
        four += entries[k + np.uint64(3)] * x[columns[k + np.uint64(3)], m]
        k += np.uint64(4)
    while k < stop:
        one += entries[k] * x[columns[k], m]
        k += np.uint64(1)
    total: float = (one + two) + (three + four)
    return total


@compiled
def subtract(
    start: int, stop: int, pointers: Any, columns: Any, entries: Any, x: Floats, b: Floats, out: Floats
) -> None:
    """Set the rows from ``start`` to ``stop`` of ``out`` to those of ``b - A x``."""
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
    kept: float,
    added: float,
    move: Floats,
    out: Floats,
) -> None:
    """Set ``move = kept move + added D^-1 (b - A x)``, ``out = x + move``, with ``inverse`` D^-1, (n,)."""
    for i in range(start, stop):
        for m in range(x.shape[1]):
            rest = b[i, m] - _row(pointers, columns, entries, i, x, m)
            move[i, m] = kept * move[i, m] + added * inverse[i] * rest
            out[i, m] = x[i, m] + move[i, m]


@compiled
def restrict(pointers: Any, columns: Any, entries: Any, fine: Floats, coarse: Floats) -> None:
    """Add ``P' fine`` to ``coarse``."""
    for i in range(len(fine)):
        for k in range(pointers[i], pointers[i + 1]):
            for m in range(fine.shape[1]):
                coarse[columns[k], m] += entries[k] * fine[i, m]


@compiled
def prolong(start: int, stop: int, pointers: Any, columns: Any, entries: Any, coarse: Floats, fine: Floats) -> None:
    """Add the rows from ``start`` to ``stop`` of ``P coarse`` to ``fine``."""
    for i in range(start, stop):
        for m in range(fine.shape[1]):
            fine[i, m] += _row(pointers, columns, entries, i, coarse, m)


@compiled
def multiply(
    wanted: Bools,
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
    """Return pointers, columns (in no order) and entries of ``A B``, which has ``width`` columns.

    Rows that are not ``wanted`` (n,) are empty, and of others only the ``upper`` halves may be asked for, the diagonal
    before all else; the ``first`` entries of A's rows count so much. ``room`` is about the number of entries: what is
    not needed costs no memory, what is lacking some time.
    """
    met, total = np.full(width, -1, dtype=np.int32), np.zeros(width)  # the last row with each column, its entry there
    starts = np.zeros(len(pointers), dtype=np.uint64)
    found, sums = np.empty(room, dtype=np.uint32), np.empty(room)
    used = np.uint64(0)
    for i in range(len(pointers) - 1):
        begin = used
        if not wanted[i]:
            starts[i + 1] = used
            continue
        if used + np.uint64(width) >= np.uint64(len(sums)):
            most = used + np.uint64(1)
            for k in range(pointers[i], pointers[i + 1]):
                most += other_pointers[columns[k] + np.uint64(1)] - other_pointers[columns[k]]
            if most >= np.uint64(len(sums)):
                more, further = np.empty(2 * most, dtype=np.uint32), np.empty(2 * most)
                more[:used], further[:used] = found[:used], sums[:used]
                found, sums = more, further
        least = 0
        if upper:
            least, met[i], found[used] = i, i, i
            used += np.uint64(1)
        for k in range(pointers[i], pointers[i + 1]):
            entry, row = entries[k] * (first if k == pointers[i] else 1.0), columns[k]
            for at in range(other_pointers[row], other_pointers[row + np.uint64(1)]):
                column = other_columns[at]
                if column < least:
                    continue
                total[column] += entry * other_entries[at]
                found[used] = column  # and stays where it is new: no branch, which would often be guessed wrongly
                used += np.uint64(met[column] != i)
                met[column] = i
        for at in range(begin, used):
            sums[at] = total[found[at]]
            total[found[at]] = 0.0
        starts[i + 1] = used
    return starts, found[:used], sums[:used]
