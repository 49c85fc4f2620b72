"""Compiled: which unknowns meet in the matrices: those of one patch, and those of one run along an axis."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.protocols import Ints
from cpmkit.runtime.compilation import compiled


@compiled
def inverted(values: Any, n: int) -> tuple[Ints, Any]:
    """Return ``starts`` (n + 1,), and ``places``, of the flat array's type: where each number below n stands in it."""
    starts = np.zeros(n + 1, dtype=np.int64)
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


@compiled
def following(unknowns: Ints, n: int, stride: int) -> tuple[Ints, Ints]:
    """Return ``starts`` (n + 1,) and ``after``: the neighbours of each unknown in the direction of an axis.

    Unknowns are neighbours where one patch reads both; ``stride`` is how far they stand apart in it.
    """
    head = np.full(n, -1)
    other, link = np.empty(n + 1, dtype=np.int64), np.empty(n + 1, dtype=np.int64)
    used = 0
    width = unknowns.shape[1]
    for p in range(len(unknowns)):
        for place in range(width):
            if place // stride % 3 == 2:
                continue
            i, j = unknowns[p, place], unknowns[p, place + stride]
            if i == j:  # a speck
                continue
            at = head[i]
            while at >= 0 and other[at] != j:
                at = link[at]
            if at < 0:
                if used == len(other):
                    other, link = _grown(other), _grown(link)
                other[used], link[used] = j, head[i]
                head[i] = used
                used += 1
    starts, after = np.empty(n + 1, dtype=np.int64), np.empty(used, dtype=np.int64)
    count = 0
    for i in range(n):
        starts[i] = count
        at = head[i]
        while at >= 0:
            after[count] = other[at]
            count += 1
            at = link[at]
    starts[n] = count
    return starts, after


@compiled
def _grown(values: Ints) -> Ints:
    more = np.empty(2 * len(values), dtype=values.dtype)
    more[: len(values)] = values
    return more


@compiled
def runs_of_four(starts: Ints, after: Ints) -> Any:
    """Return (r, 4) all ways to go three steps from neighbour to neighbour."""
    n = len(starts) - 1
    steps = np.ones((3, n + 1), dtype=np.int64)  # how many ways of so many steps begin at an unknown
    for length in range(3):
        for i in range(n):
            count = 0
            for at in range(starts[i], starts[i + 1]):
                count += 1 if length == 0 else steps[length - 1, after[at]]
            steps[length, i] = count
    runs = np.empty((steps[2, :n].sum(), 4), dtype=np.int32)
    used = 0
    for i in range(n):
        for one in range(starts[i], starts[i + 1]):
            j = after[one]
            for two in range(starts[j], starts[j + 1]):
                k = after[two]
                for three in range(starts[k], starts[k + 1]):
                    runs[used, 0], runs[used, 1], runs[used, 2], runs[used, 3] = i, j, k, after[three]
                    used += 1
    return runs


@compiled
def pattern(
    unknowns: Ints, starts: Ints, places: Ints, runs: Ints, run_starts: Ints, run_places: Ints, indptr: Any
) -> Any:
    """Return the columns of all rows, ascending, and fill in ``indptr`` (n + 1,), whose type they have.

    ``starts``, ``places``: the inverse of ``unknowns``; ``run_starts``, ``run_places``: that of ``runs`` (r, 4).
    """
    n = len(starts) - 1
    width = unknowns.shape[1]
    seen = np.full(n, -1, dtype=indptr.dtype)
    for filling in range(2):
        if filling:
            seen[:] = -1
            columns = np.empty(indptr[n], dtype=indptr.dtype)
        used = 0
        for i in range(n):
            for at in range(starts[i], starts[i + 1]):
                p = places[at] // width
                for place in range(width):
                    j = unknowns[p, place]
                    if seen[j] != i:
                        seen[j] = i
                        if filling:
                            columns[used] = j
                        used += 1
            for at in range(run_starts[i], run_starts[i + 1]):
                for place in range(4):
                    j = runs[run_places[at] // 4, place]
                    if seen[j] != i:
                        seen[j] = i
                        if filling:
                            columns[used] = j
                        used += 1
            indptr[i + 1] = used
        indptr[0] = 0
    # The pattern is symmetric: going through its rows in order fills those of its transpose in ascending order.
    ascending = np.empty(len(columns), dtype=indptr.dtype)
    free = indptr[:n].copy()
    for i in range(n):
        for at in range(indptr[i], indptr[i + 1]):
            j = columns[at]
            ascending[free[j]] = i
            free[j] += 1
    return ascending
