"""Kernels of the sparsity pattern: unknowns are coupled within a patch, and within a run along an axis."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats, Ints


@compiled
def following(unknowns: Ints, n: int, stride: int, along: int) -> tuple[Ints, Ints]:
    """Return ``starts`` (n + 1,) and ``after``: the neighbours of each unknown in the direction of an axis.

    Unknowns are neighbours where one patch reads both; ``stride`` is how far they stand apart in it, ``along`` how many
    it reads along an axis.
    """
    head = np.full(n, -1)
    other, link = np.empty(n + 1, dtype=np.int64), np.empty(n + 1, dtype=np.int64)
    used = 0
    before = np.array([place for place in range(unknowns.shape[1]) if place // stride % along < along - 1])
    for p in range(len(unknowns)):
        for place in before:
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
def runs_of(starts: Ints, after: Ints, length: int) -> Any:
    """Return (r, length) all ways to go from neighbour to neighbour, so many unknowns each."""
    n = len(starts) - 1
    runs = np.arange(n).astype(np.int32).reshape(n, 1)
    for size in range(1, length):
        count = 0
        for r in range(len(runs)):
            last = runs[r, size - 1]
            count += starts[last + 1] - starts[last]
        longer = np.empty((count, size + 1), dtype=np.int32)
        used = 0
        for r in range(len(runs)):
            last = runs[r, size - 1]
            for at in range(starts[last], starts[last + 1]):
                longer[used, :size] = runs[r]
                longer[used, size] = after[at]
                used += 1
        runs = longer
    return runs


@compiled
def pattern(
    unknowns: Ints, starts: Ints, places: Ints, runs: Ints, run_starts: Ints, run_places: Ints, indptr: Any
) -> Any:
    """Return the columns of all rows, ascending, and fill in ``indptr`` (n + 1,), whose type they have.

    ``starts``, ``places``: the inverse of ``unknowns``; ``run_starts``, ``run_places``: that of ``runs`` (r, k).
    """
    n = len(starts) - 1
    width, steps = unknowns.shape[1], runs.shape[1]
    seen = np.full(n, -1, dtype=indptr.dtype)
    columns = np.empty(max(len(places), 1), dtype=indptr.dtype)
    used = np.uint64(0)  # unsigned, so that no index is tested for its sign
    indptr[0] = 0
    for i in range(n):
        most = used + np.uint64((starts[i + 1] - starts[i]) * width + (run_starts[i + 1] - run_starts[i]) * steps + 1)
        while most > len(columns):
            columns = _grown(columns)
        for at in range(starts[i], starts[i + 1]):
            row = unknowns[places[at] // width]
            for j in row:
                columns[used] = j  # and stays where it is new: no branch, which would often be guessed wrongly
                used += np.uint64(seen[j] != i)
                seen[j] = i
        for at in range(run_starts[i], run_starts[i + 1]):
            run = runs[run_places[at] // steps]
            for j in run:
                columns[used] = j
                used += np.uint64(seen[j] != i)
                seen[j] = i
        indptr[i + 1] = used
    columns = columns[:used]
    # The pattern is symmetric: going through its rows in order fills those of its transpose in ascending order.
    ascending = np.empty(len(columns), dtype=indptr.dtype)
    free = indptr[:n].copy()
    for i in range(n):
        for at in range(indptr[i], indptr[i + 1]):
            j = columns[at]
            ascending[free[j]] = i
            free[j] += 1
    return ascending


@compiled
def add_squares(runs: Ints, starts: Ints, places: Any, stencil: Floats, factors: Floats, matrix: Any) -> None:
    """Add the squares of differences: ``factors`` (r,) times (stencil . u[runs])^2 with ``runs`` (r, k).

    Row after row of the matrix; ``starts`` (n + 1,) and ``places`` are the inverse of ``runs.ravel()``.
    """
    indptr, indices, data = matrix
    k = len(stencil)
    standing = np.empty(len(indptr) - 1, dtype=np.uint32)
    for i in range(len(starts) - 1):
        if starts[i] == starts[i + 1]:
            continue
        first: Any = np.uint64(indptr[i])  # unsigned, so that no index is tested for its sign
        row = indices[first : indptr[i + 1]]
        for at in range(len(row)):
            standing[row[at]] = at
        for at in range(starts[i], starts[i + 1]):
            r, one = places[at] // k, places[at] % k
            for two in range(k):
                data[first + np.uint64(standing[runs[r, two]])] += factors[r] * (stencil[one] * stencil[two])
