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
    for r in range(len(runs)):
        for one in range(len(stencil)):
            i = runs[r, one]
            for two in range(len(stencil)):
                j = runs[r, two]
                low: Any = np.uint64(indptr[i])
                high = np.uint64(indptr[i + 1])
                while low < high:
                    middle = (low + high) >> np.uint64(1)
                    if indices[middle] < j:
                        low = middle + np.uint64(1)
                    else:
                        high = middle
                data[low] += factors[r] * (stencil[one] * stencil[two])
