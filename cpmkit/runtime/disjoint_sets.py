"""Compiled: sets of numbers that are united pair by pair.

Roots are the smallest of their set, so that numbers do not depend on the order of unions.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.protocols import Ints
from cpmkit.runtime.compilation import compiled


@compiled
def find(parent: Any, i: int) -> int:
    """Return the root of ``i``, halving the path to it."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@compiled
def unite(parent: Any, i: int, j: int) -> None:
    """Make the sets of ``i`` and ``j`` one."""
    i, j = find(parent, i), find(parent, j)
    if i < j:
        parent[j] = i
    else:
        parent[i] = j


@compiled
def unite_pairs(parent: Any, pairs: Any) -> None:
    """Make one set of each of ``pairs`` (t, 2)."""
    for t in range(len(pairs)):
        unite(parent, pairs[t, 0], pairs[t, 1])


@compiled
def unite_rows(parent: Any, starts: Any, columns: Any, first_row: int, first_column: int) -> None:
    """Make one set of each row of a sparse matrix and of the columns in it, from these numbers on."""
    for i in range(len(starts) - 1):
        for k in range(starts[i], starts[i + 1]):
            unite(parent, first_row + i, first_column + columns[k])


@compiled
def numbered(parent: Any) -> tuple[int, Ints]:
    """Return how many sets there are, and the number of each member's set."""
    label = np.empty(len(parent), dtype=np.int64)
    sets = 0
    for i in range(len(parent)):
        root = find(parent, i)
        if root == i:
            label[i] = sets
            sets += 1
        else:  # the root is the first of its set
            label[i] = label[root]
    return sets, label
