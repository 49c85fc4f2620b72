"""Tensor products of quadratic B-splines, read through the polynomial of a patch.

With z = x / h and the patch's cell r, t = z - r + 1/2 runs over [0, 1] inside the cell; outside of it the same
polynomial goes on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.galerkin.parting import Parting
from cpmkit.protocols import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def spline_values(t: Floats) -> Floats:
    """Return (..., 3) the splines of nodes r - 1, r, r + 1 at t."""
    return np.stack(((1 - t) ** 2 / 2, 0.5 + t * (1 - t), t**2 / 2), axis=-1)


def spline_slopes(t: Floats) -> Floats:
    """Return (..., 3) their derivatives with respect to t."""
    return np.stack((t - 1, 1 - 2 * t, t), axis=-1)


def value_rows(parting: Parting, patch: Ints, points: Floats) -> csr_array:
    """Return (k, n) the rows that read u at ``points`` (k, d) through the ``patch`` (k,) of each.

    Points are relative to the lattice's origin, as everywhere inside the form.
    """
    return _rows(parting, patch, _product(spline_values(_local(parting, patch, points))))


def derivative_rows(parting: Parting, patch: Ints, points: Floats, directions: Floats) -> csr_array:
    """Return (k, n) the rows that read the derivatives of u along ``directions`` (k, d), in their unit per length."""
    t = _local(parting, patch, points)
    values, slopes = spline_values(t), spline_slopes(t)
    entries = np.zeros((len(t), 3**parting.dim))
    for axis in range(parting.dim):
        factors = values.copy()
        factors[:, axis] = slopes[:, axis] * (directions[:, axis, None] / parting.spacing)
        entries += _product(factors)
    return _rows(parting, patch, entries)


def _local(parting: Parting, patch: Ints, points: Floats) -> Floats:
    return np.asarray(points / parting.spacing - parting.cells[patch] + 0.5)


def _product(factors: Floats) -> Floats:
    """Return (k, 3^d) the products over axes of ``factors`` (k, d, 3), the last axis running fastest."""
    entries = factors[:, 0]
    for axis in range(1, factors.shape[1]):
        entries = (entries[:, :, None] * factors[:, axis, None, :]).reshape(len(entries), 3 ** (axis + 1))
    return entries


def _rows(parting: Parting, patch: Ints, entries: Floats) -> csr_array:
    from scipy.sparse import csr_array

    k, width = entries.shape
    index = np.int32 if max(k * width, parting.size) < 2**31 else np.int64
    starts = np.arange(0, k * width + 1, width, dtype=index)
    columns = parting.unknowns[patch].ravel().astype(index)
    rows = csr_array((entries.ravel(), columns, starts), shape=(k, parting.size))
    rows.sum_duplicates()
    return rows
