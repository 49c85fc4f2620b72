"""Compiled: squares of differences of coefficients, added to the entries of a sparse matrix."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled


@compiled
def add_squares(runs: Ints, stencil: Floats, factors: Floats, matrix: Any) -> None:
    """Add the squares of differences: ``factors`` (r,) times (stencil . u[runs])^2 with ``runs`` (r, k)."""
    indptr, indices, data = matrix
    one_entry = np.uint64(1)
    for r in range(len(runs)):
        for one in range(len(stencil)):
            i = runs[r, one]
            for two in range(len(stencil)):
                j = runs[r, two]
                low: Any = np.uint64(indptr[i])  # unsigned, so that no index is tested for its sign
                size = np.uint64(indptr[i + 1]) - low
                while size > one_entry:  # no branch: which half it is cannot be foretold
                    half = size >> one_entry
                    low += half if indices[low + half] <= j else np.uint64(0)
                    size -= half
                data[low] += factors[r] * (stencil[one] * stencil[two])
