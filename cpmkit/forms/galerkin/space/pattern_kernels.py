"""Kernels of the sparsity pattern: unknowns are coupled if one patch reads both, or if both are in one run.

A patch, which is a connected part of the manifold in one lattice cell, reads the unknowns of the splines that are not
zero there. A run is a sequence of neighbouring unknowns along an axis.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.dof_map import with_double_room
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats, Ints


@compiled
def sparsity_pattern(
    unknowns: Ints, starts: Ints, places: Ints, runs: Ints, run_starts: Ints, run_places: Ints, indptr: Any
) -> Any:
    """Return the column indices (z,) of the sparsity pattern of a spline space in CSR, and fill ``indptr`` (n + 1,).

    All matrices share it: unknowns are coupled if a row of ``unknowns`` (p, w) or of ``runs`` (r, k) has both.
    Columns ascend in each row and have the type of ``indptr``. ``starts`` and ``places`` are the inverse index of
    ``unknowns.ravel()``; ``run_starts`` and ``run_places`` that of ``runs.ravel()``.
    """
    n = len(starts) - 1
    width, steps = unknowns.shape[1], runs.shape[1]
    seen, columns = np.empty(n, dtype=indptr.dtype), np.empty(max(len(places), 1), dtype=indptr.dtype)
    seen[:] = -1
    used = np.uint64(0)  # unsigned, so that no index is tested for its sign
    indptr[0] = 0
    for i in range(n):
        most = used + np.uint64((starts[i + 1] - starts[i]) * width + (run_starts[i + 1] - run_starts[i]) * steps + 1)
        while most > len(columns):
            columns = with_double_room(columns)
        for at in range(starts[i], starts[i + 1]):
            row = unknowns[places[at] // width]
            for j in row:
                columns[used] = j  # counted only if it is new; without a branch, which would often be mispredicted
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
def add_squared_differences(
    runs: Ints, starts: Ints, places: Any, stencil: Floats, factors: Floats, matrix: Any
) -> None:
    """Add the quadratic form sum_r factors[r] (stencil . u[runs[r]])^2 to a CSR ``matrix`` (indptr, indices, data).

    ``data`` is changed in place; the pattern must couple all unknowns of each run. ``stencil`` (k,) are the
    coefficients of a difference, ``runs`` (r, k) sequences of unknowns, ``factors`` (r,). ``starts`` (n + 1,) and
    ``places`` (r k,) are the inverse index of ``runs.ravel()``, by which the matrix is filled row by row.
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


@compiled
def scatter(
    block: Floats, room: int, columns: Ints, indptr: Any, indices: Any, data: Floats, standing: Any, symmetric: bool
) -> None:
    """Add a dense ``block`` (k room,) to the ``data`` of a CSR matrix; a ``symmetric`` block has the upper half only.

    ``columns`` (k,) are the unknowns of its rows and columns, ``room`` is the length of its rows. ``standing`` (n,) is
    work space for the position of each column in a row of the matrix.
    """
    width = len(columns)
    for i in range(width):
        first: Any = np.uint64(indptr[columns[i]])  # unsigned, so that no index is tested for its sign
        row = indices[first : indptr[columns[i] + 1]]
        for k in range(len(row)):
            standing[row[k]] = k
        filled = i if symmetric else 0
        for j in range(filled):
            data[first + np.uint64(standing[columns[j]])] += block[j * room + i]
        for j in range(filled, width):
            data[first + np.uint64(standing[columns[j]])] += block[i * room + j]
