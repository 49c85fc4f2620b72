"""Compiled: which way cells are wound, found by walking over them.

The walk is a union of sets in which each cell knows whether it is wound as the first of its set is.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.protocols import Ints
from cpmkit.runtime.compilation import compiled


@compiled
def wound_alike(cells: Ints, facets: Ints, count: int) -> Any:
    """Return (m,) int8: 1 or -1 for each of the ``cells`` (m, k), and 0 beside a place where they are not alike.

    ``facets`` (m, k): the numbers, below ``count``, of those opposite to each corner.
    """
    m, k = facets.shape
    first, times, wound = np.full(count, -1), np.zeros(count, np.int32), np.zeros(count, np.int32)
    parent, sign = np.arange(m), np.ones(m, np.int8)
    for cell in range(m):
        for j in range(k):
            facet = facets[cell, j]
            other = first[facet]
            if other < 0:
                first[facet] = cell * k + j
                continue
            relative = -_sense(cells, cell, j) * _sense(cells, other // k, other % k)
            a, a_sign = _root(parent, sign, cell)
            b, b_sign = _root(parent, sign, other // k)
            if a != b:
                parent[a] = b
                sign[a] = a_sign * b_sign * relative
    found = np.empty(m, np.int8)
    for cell in range(m):
        found[cell] = _root(parent, sign, cell)[1]
        for j in range(k):
            times[facets[cell, j]] += 1
            wound[facets[cell, j]] += found[cell] * _sense(cells, cell, j)
    for cell in range(m):
        for j in range(k):
            facet = facets[cell, j]
            if times[facet] == 2 and wound[facet] != 0:  # two that are wound alike cancel
                found[cell] = 0
    return found


@compiled
def _sense(cells: Ints, cell: int, j: int) -> int:
    """Return 1 or -1, unlike for two cells on the two sides of a facet that are wound alike."""
    k = cells.shape[1]
    if k == 2:
        return 1 - 2 * j
    return 1 if cells[cell, (j + 1) % 3] < cells[cell, (j + 2) % 3] else -1


@compiled
def _root(parent: Ints, sign: Any, cell: int) -> tuple[int, int]:
    total = 1
    while parent[cell] != cell:
        above = parent[cell]
        if parent[above] != above:  # halve the path
            sign[cell] *= sign[above]
            parent[cell] = parent[above]
        total *= sign[cell]
        cell = parent[cell]
    return cell, total
