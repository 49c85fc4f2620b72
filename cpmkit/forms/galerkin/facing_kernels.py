"""Walking over cells: a union of sets in which each cell knows whether it is wound as the first of its set is."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Ints
from cpmkit.runtime.compilation import compiled


@compiled
def walk(facets: Ints, senses: Ints) -> Ints:
    """Return signs (m,) of cells, by the numbers of their ``facets`` (m, k), and ``senses`` (m, k), unlike if alike."""
    cells, k = facets.shape
    first = np.full(facets.max() + 1, -1)
    parent, sign = np.arange(cells), np.ones(cells, dtype=np.int64)
    for cell in range(cells):
        for j in range(k):
            facet = facets[cell, j]
            other = first[facet]
            if other < 0:
                first[facet] = cell * k + j
                continue
            relative = -senses[cell, j] * senses[other // k, other % k]
            a, a_sign = _root(parent, sign, cell)
            b, b_sign = _root(parent, sign, other // k)
            if a != b:
                parent[a] = b
                sign[a] = a_sign * b_sign * relative
    found = np.empty(cells, dtype=np.int64)
    for cell in range(cells):
        found[cell] = _root(parent, sign, cell)[1]
    return found


@compiled
def _root(parent: Ints, sign: Ints, cell: int) -> tuple[int, int]:
    total = 1
    while parent[cell] != cell:
        above = parent[cell]
        if parent[above] != above:  # halve the path
            sign[cell] *= sign[above]
            parent[cell] = parent[above]
        total *= sign[cell]
        cell = parent[cell]
    return cell, total
