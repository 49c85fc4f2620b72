"""Compiled: disjoint sets of the numbers 0 to n - 1 (union-find), and the positions of each number in a list.

Sets are stored as the parent (n,) of each number. The root of a set is its smallest member, so that labels of sets do
not depend on the order of unions.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.types import Ints


@compiled
def find_root(parent: Any, i: int) -> int:
    """Return the root of the set that contains ``i``, and shorten the path from ``i`` to it in ``parent`` (n,)."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@compiled
def unite(parent: Any, i: Any, j: Any) -> None:
    """Unite the sets that contain ``i`` and ``j``, in place in ``parent`` (n,); the smaller root is kept."""
    i, j = find_root(parent, i), find_root(parent, j)
    if i < j:
        parent[j] = i
    else:
        parent[i] = j


@compiled
def unite_pairs(parent: Any, pairs: Any) -> None:
    """Unite the sets of the two numbers of each of ``pairs`` (t, 2), in place in ``parent`` (n,)."""
    for t in range(len(pairs)):
        unite(parent, np.int64(pairs[t, 0]), np.int64(pairs[t, 1]))


@compiled
def unite_rows(parent: Any, starts: Any, columns: Any, first_row: int, first_column: int) -> None:
    """Unite the set of each row of a sparse matrix with those of its nonzero columns, in place in ``parent`` (n,).

    The matrix is given by the CSR arrays ``starts`` and ``columns``. Row i has the number ``first_row + i``, and column
    j has the number ``first_column + j``.
    """
    for i in range(len(starts) - 1):
        for k in range(starts[i], starts[i + 1]):
            unite(parent, first_row + i, first_column + columns[k])


@compiled
def label_sets(parent: Any) -> tuple[int, Ints]:
    """Return the number of sets, and each number's label (n,), from 0, ascending with the roots; shorten paths."""
    label = np.empty(len(parent), dtype=np.int64)
    sets = 0
    for i in range(len(parent)):
        root = find_root(parent, i)
        if root == i:
            label[i] = sets
            sets += 1
        else:  # the root is the smallest number of its set and has its label
            label[i] = label[root]
    return sets, label


def connected_components(count: int, pairs: Any) -> tuple[int, Ints]:
    """Return the number of connected components of a graph, and the component (count,) of each node.

    ``pairs`` (t, 2) are the edges between the nodes 0 to ``count`` - 1. Components ascend with their smallest nodes.
    """
    parent = np.arange(count)
    unite_pairs(parent, np.ascontiguousarray(pairs, dtype=np.int32))
    return label_sets(parent)


@compiled
def inverse_index(values: Any, n: int) -> tuple[Ints, Any]:
    """Return the positions of each integer below ``n`` in ``values``, in compressed rows.

    ``values`` (k,): integers from 0 to n - 1.
    ``n``: number of integers that may occur.
    Returned ``starts`` (n + 1,): the positions of i are ``places[starts[i] : starts[i + 1]]``, ascending.
    Returned ``places`` (k,) of the type of ``values``: positions in ``values``.
    """
    starts = np.empty(n + 1, dtype=np.int64)
    starts[:] = 0
    for value in values:
        starts[value + 1] += 1
    for i in range(n):
        starts[i + 1] += starts[i]
    places = np.empty(len(values), dtype=values.dtype)
    for at in range(len(values)):
        places[starts[values[at]]] = at
        starts[values[at]] += 1
    for i in range(n, 0, -1):
        starts[i] = starts[i - 1]
    starts[0] = 0
    return starts, places
