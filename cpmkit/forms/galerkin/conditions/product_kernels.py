"""Compiled: sums over samples of products of what they read, each sum made dense where samples read the same unknowns."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled


@compiled
def starts_of_groups(columns: Any, order: Ints) -> Ints:
    """Return (g + 1,) where rows that read other unknowns than the row before them begin in ``order`` (k,)."""
    starts = np.empty(len(order) + 1, dtype=np.int64)
    used = 0
    for at in range(len(order)):
        same = at > 0
        if same:
            row, before = columns[order[at]], columns[order[at - 1]]
            for b in range(len(row)):
                if row[b] != before[b]:
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
    columns: Any,
    tested: Floats,
    by: Floats,
    unknowns: Any,
    indptr: Any,
    indices: Any,
    data: Floats,
) -> None:
    """Add the products of rows ``tested`` and ``by`` (k, w) over common ``columns``, and their transposes.

    Parameters
    ----------
    order, starts
        The rows group by group, all of one group with the same columns.
    columns, tested, by : (k, w)
        Entries of one row may have the same column.
    unknowns : (g, w)
        The columns of each group, ascending.
    indptr, indices, data
        The matrix (n, n), columns ascending, to which is added.
    """
    width = columns.shape[1]
    local = np.empty(len(indptr) - 1, dtype=np.int64)
    own = np.empty(width, dtype=np.int64)
    left, right, sums = np.empty(width), np.empty(width), np.empty((width, width))
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
            for b in range(width):
                place = local[columns[k, b]]
                left[place] += tested[k, b]
                right[place] += by[k, b]
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
