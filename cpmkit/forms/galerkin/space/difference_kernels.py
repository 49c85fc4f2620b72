"""Compiled: squares of differences of coefficients, added to the entries of a sparse matrix."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled


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
