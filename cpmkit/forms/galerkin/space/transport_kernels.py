"""Compiled: integrals of u times the derivative of v along a vector field, which are not symmetric."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.space.sample_kernels import spline_products
from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled


@compiled
def add_transport(
    unknowns: Ints,
    cells: Ints,
    spacing: float,
    order: Any,
    start: Ints,
    points: Floats,
    fields: Floats,
    matrix: Any,
) -> None:
    """Add sum over samples of N_j (field . grad N_i) to entry (i, j); ``fields`` (q, d) with the samples' weights."""
    indptr, indices, data = matrix
    width, d = unknowns.shape[1], cells.shape[1]
    values, along, rest = np.empty(width), np.empty(width), np.empty((3, 3))
    block = np.empty((width, width))
    for p in range(len(cells)):
        block[:] = 0.0
        for s in range(start[p], start[p + 1]):
            q = order[s]
            spline_products(points[q], cells[p], spacing, values)
            along[:] = 0.0
            for axis in range(d):
                if fields[q, axis] == 0.0:
                    continue
                for other in range(d):
                    t = points[q, other] / spacing - cells[p, other] + 0.5
                    r = 1.0 - t
                    if other == axis:
                        rest[other, 0], rest[other, 1], rest[other, 2] = -r, r - t, t
                    else:
                        rest[other, 0], rest[other, 1], rest[other, 2] = 0.5 * r * r, 0.5 + t * r, 0.5 * t * t
                for place in range(width):
                    product, left = fields[q, axis] / spacing, place
                    for other in range(d - 1, -1, -1):
                        product *= rest[other, left % 3]
                        left //= 3
                    along[place] += product
            for i in range(width):
                for j in range(width):
                    block[i, j] += along[i] * values[j]
        add_block(block, unknowns[p], indptr, indices, data)


@compiled
def add_block(block: Floats, columns: Ints, indptr: Any, indices: Any, data: Floats) -> None:
    """Add a ``block`` (k, k) of the unknowns ``columns`` (k,), some of which may be the same, to a matrix."""
    order = np.argsort(columns)
    for i in range(len(columns)):
        to = indptr[columns[i]]
        for j in order:
            while indices[to] < columns[j]:
                to += 1
            data[to] += block[i, j]
