"""Compiled: sums over samples of products of what they read, dense at first where samples read the same unknowns."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled


@compiled
def starts_of_groups(columns: Any, rows: Ints, order: Ints) -> Ints:
    """Return (g + 1,) where ``rows`` (k, s) that read other columns than those before them begin in ``order`` (k,)."""
    starts = np.empty(len(order) + 1, dtype=np.int64)
    used = 0
    for at in range(len(order)):
        same = at > 0
        for side in range(rows.shape[1]):
            if not same:
                break
            one, before = columns[rows[order[at], side]], columns[rows[order[at - 1], side]]
            for b in range(len(one)):
                if one[b] != before[b]:
                    same = False
                    break
        if not same:
            starts[used] = at
            used += 1
    starts[used] = len(order)
    return starts[: used + 1]


@compiled
def add_products(
    order: Ints,
    starts: Ints,
    rows: Ints,
    x: Floats,
    y: Floats,
    columns: Any,
    values: Floats,
    slopes: Floats,
    unknowns: Any,
    indptr: Any,
    indices: Any,
    data: Floats,
) -> None:
    """Add ``x y^T + y x^T`` over all k, x and y being sums over sides of factors times values and slopes.

    Parameters
    ----------
    order, starts
        The k group by group, all of one group with the same columns.
    rows : (k, s)
        What is read on each side, as rows of the next but two.
    x, y : (k, s, 2)
        Factors of values and of slopes.
    columns, values, slopes : (b, w)
        Entries of one row may have the same column.
    unknowns : (g, s w)
        The columns of each group, ascending.
    indptr, indices, data
        The matrix (n, n), columns ascending, to which is added.
    """
    sides, width = rows.shape[1], columns.shape[1]
    most = sides * width
    local, own = np.empty(len(indptr) - 1, dtype=np.int64), np.empty(most, dtype=np.int64)
    left, right, sums = np.empty(most), np.empty(most), np.empty((most, most))
    for g in range(len(starts) - 1):
        count = 0
        for j in unknowns[g]:
            if count == 0 or own[count - 1] != j:
                own[count] = j
                local[j] = count
                count += 1
        sums[:count, :count] = 0.0
        for at in range(starts[g], starts[g + 1]):
            k = order[at]
            left[:count] = 0.0
            right[:count] = 0.0
            for side in range(sides):
                row = rows[k, side]
                for b in range(width):
                    place, value, slope = local[columns[row, b]], values[row, b], slopes[row, b]
                    left[place] += x[k, side, 0] * value + x[k, side, 1] * slope
                    right[place] += y[k, side, 0] * value + y[k, side, 1] * slope
            for a in range(count):
                factor = left[a]
                for b in range(count):
                    sums[a, b] += factor * right[b]
        for a in range(count):
            at = indptr[own[a]]
            for b in range(count):
                while indices[at] != own[b]:
                    at += 1
                data[at] += sums[a, b] + sums[b, a]
