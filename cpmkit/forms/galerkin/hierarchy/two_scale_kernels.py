"""Compiled: finer unknowns as sums of the coarser ones of the patch that holds one of their readers."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled


@compiled
def two_scale(
    cells: Ints, unknowns: Ints, n: int, parent: Ints, coarse_cells: Ints, coarse_unknowns: Ints, shares: Floats
) -> tuple[Any, Any, Any]:
    """Return pointers, columns (ascending in each row) and weights of P.

    ``cells`` (p, d) and ``unknowns`` (p, (degree + 1)^d) of n are those of the finer patches, ``parent`` (p,) their
    coarser ones, whose cells and unknowns follow. ``shares`` (degree + 2,): what a coarser spline is of finer ones.
    """
    p, d = cells.shape
    width, along = unknowns.shape[1], len(shares) - 1
    before = (along - 1) // 2
    reader = np.full(n, -1)
    for a in range(p):
        for place in range(width):
            if reader[unknowns[a, place]] < 0:
                reader[unknowns[a, place]] = a * width + place
    most = (along + 2) // 2  # coarser splines an axis that a finer one is part of
    pointers = np.zeros(n + 1, dtype=np.int32)
    columns = np.empty(n * most**d, dtype=np.int32)
    weights = np.empty(n * most**d, dtype=np.float32)  # of multiples of 2^(-degree d), exactly
    own, at = np.empty((d, most)), np.empty((d, most), dtype=np.int64)
    counts = np.empty(d, dtype=np.int64)
    used = 0
    for i in range(n):
        a = reader[i] // width
        b, rest = parent[a], reader[i] % width
        stride, ways = 1, 1
        for axis in range(d - 1, -1, -1):
            node, first = cells[a, axis] + rest % along - before, coarse_cells[b, axis] - before
            counts[axis] = 0
            for place in range(along):
                k = node - 2 * (first + place) + along - 1 - before
                if 0 <= k < len(shares):
                    own[axis, counts[axis]], at[axis, counts[axis]] = shares[k], place * stride
                    counts[axis] += 1
            ways *= counts[axis]
            rest //= along
            stride *= along
        begin = used
        for choice in range(ways):
            weight, place, left = 1.0, 0, choice
            for axis in range(d):
                weight *= own[axis, left % counts[axis]]
                place += at[axis, left % counts[axis]]
                left //= counts[axis]
            used = _put(columns, weights, begin, used, coarse_unknowns[b, place], weight)
        pointers[i + 1] = used
    return pointers, columns[:used].copy(), weights[:used].copy()


@compiled
def _put(columns: Any, weights: Any, begin: int, used: int, column: int, weight: float) -> int:
    """Add a weight to the row that starts at ``begin`` and return where it ends now."""
    at = begin
    while at < used and columns[at] < column:
        at += 1
    if at < used and columns[at] == column:  # of a speck, all of whose nodes are one unknown
        weights[at] += weight
        return used
    for k in range(used, at, -1):
        columns[k], weights[k] = columns[k - 1], weights[k - 1]
    columns[at], weights[at] = column, weight
    return used + 1
