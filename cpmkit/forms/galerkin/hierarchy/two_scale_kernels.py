"""Compiled: finer unknowns as sums of the coarser ones of the patch that holds one of their readers."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.protocols import Ints
from cpmkit.runtime.compilation import compiled


@compiled
def two_scale(
    cells: Ints, unknowns: Ints, n: int, parent: Ints, coarse_cells: Ints, coarse_unknowns: Ints
) -> tuple[Any, Any, Any]:
    """Return pointers, columns (ascending in each row) and weights of P.

    ``cells`` (p, d) and ``unknowns`` (p, 3^d) of n are those of the finer patches, ``parent`` (p,) their coarser ones,
    whose cells and unknowns follow.
    """
    p, d = cells.shape
    width = 3**d
    reader = np.full(n, -1)
    for a in range(p):
        for place in range(width):
            if reader[unknowns[a, place]] < 0:
                reader[unknowns[a, place]] = a * width + place
    pointers = np.zeros(n + 1, dtype=np.int32)
    columns = np.empty(n << d, dtype=np.int32)
    weights = np.empty(n << d, dtype=np.float32)  # of multiples of 4^-d, exactly
    near, far = np.empty(d, dtype=np.int64), np.empty(d, dtype=np.int64)
    used = 0
    for i in range(n):
        a = reader[i] // width
        b, rest = parent[a], reader[i] % width
        stride = 1
        for axis in range(d - 1, -1, -1):
            node = cells[a, axis] + rest % 3 - 1
            place = (node >> 1) - coarse_cells[b, axis] + 1
            near[axis] = place * stride
            far[axis] = (place + 1 if node & 1 else place - 1) * stride
            rest //= 3
            stride *= 3
        begin = used
        for choice in range(1 << d):
            weight, place = 1.0, 0
            for axis in range(d):
                if choice >> axis & 1:
                    weight *= 0.25
                    place += far[axis]
                else:
                    weight *= 0.75
                    place += near[axis]
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
