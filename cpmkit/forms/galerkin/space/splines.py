"""Tensor products of B-splines of degree 1, 2 or 3, evaluated as polynomials on the lattice cell of a patch.

Along each axis t = x / h - r + 1/2 is in [0, 1] inside the cell, whose centre is node r of the lattice of spacing h.
Points outside the cell are evaluated by the same polynomial.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from cpmkit.forms.galerkin.dof_map import DofMap

#: The degrees that splines may have.
DEGREES = (1, 2, 3)


@cache
def spline_pieces(degree: int) -> Floats:
    """Return the polynomials in t of the degree + 1 splines that are not zero on a cell, along an axis.

    Row k has the coefficients (degree + 1,) of spline k, that of 1 first, by the recursion of Cox and de
    Boor: spline k of degree p is (t + p - k)/p times spline k - 1 of degree p - 1, plus (k + 1 - t)/p times spline k of
    degree p - 1.
    """
    if degree == 0:
        return np.ones((1, 1))
    lower, pieces = spline_pieces(degree - 1), np.zeros((degree + 1, degree + 1))
    for k in range(degree + 1):
        for source, start, slope in ((k - 1, degree - k, 1), (k, k + 1, -1)):
            if 0 <= source < degree:
                pieces[k, :-1] += start * lower[source] / degree
                pieces[k, 1:] += slope * lower[source] / degree
    return pieces


def spline_values(t: Floats, degree: int) -> Floats:
    """Return the values (..., degree + 1) at t (...) of the splines that are not zero on a cell, along an axis."""
    return _evaluate(t, spline_pieces(degree).T)


def spline_slopes(t: Floats, degree: int) -> Floats:
    """Return the derivatives (..., degree + 1) at t (...) of the splines that are not zero on a cell, along an axis."""
    return _evaluate(t, np.asarray(np.polynomial.polynomial.polyder(spline_pieces(degree).T), dtype=np.float64))


def _evaluate(t: Floats, coefficients: Floats) -> Floats:
    """Return the values (..., w) of w polynomials at t (...) by Horner's rule; ``coefficients`` (k, w), of 1 first."""
    values = np.multiply.outer(t, coefficients[-1]) if len(coefficients) > 1 else np.zeros((*t.shape, 1))
    for row in coefficients[-2:0:-1]:
        values = (values + row) * t[..., None]
    return np.asarray(values + coefficients[0], dtype=np.float64)


def value_rows(dof_map: DofMap, patch: Ints, points: Floats) -> csr_array:
    """Return the matrix (k, n) that evaluates u at ``points`` (k, d), each by the splines of its ``patch`` (k,).

    A patch is a connected part of the manifold in one lattice cell, and has (degree + 1)^d splines. Points are relative
    to the origin of the lattice.
    """
    values = spline_values(_local(dof_map, patch, points), dof_map.degree)
    entries = values[:, 0]
    for axis in range(1, dof_map.dim):
        entries = _outer(entries, values[:, axis])
    return _rows(dof_map, patch, entries)


def derivative_rows(dof_map: DofMap, patch: Ints, points: Floats, directions: Floats) -> csr_array:
    """Return the matrix (k, n) that evaluates the derivative of u along ``directions`` (k, d) at ``points`` (k, d).

    Each point is evaluated by the splines that its ``patch`` (k,) reads.
    """
    t = _local(dof_map, patch, points)
    along = directions * dof_map.magnification(patch)[:, None] / dof_map.spacing
    values = spline_values(t, dof_map.degree)
    slopes = spline_slopes(t, dof_map.degree) * along[:, :, None]
    products, entries = values[:, 0], slopes[:, 0]
    for axis in range(1, dof_map.dim):
        entries = _outer(entries, values[:, axis]) + _outer(products, slopes[:, axis])
        products = _outer(products, values[:, axis])
    return _rows(dof_map, patch, entries)


def _local(dof_map: DofMap, patch: Ints, points: Floats) -> Floats:
    """Return the coordinates t (k, d) of ``points`` (k, d) in the cells of their patches (k,): in [0, 1] inside."""
    return np.asarray(dof_map.magnify(patch, points) / dof_map.spacing - dof_map.cells[patch] + 0.5)


def _outer(first: Floats, second: Floats) -> Floats:
    """Return the outer products (k, v w) of rows of ``first`` (k, v) and ``second`` (k, w); the latter runs fastest."""
    return (first[:, :, None] * second[:, None, :]).reshape(len(first), first.shape[1] * second.shape[1])


def _rows(dof_map: DofMap, patch: Ints, entries: Floats) -> csr_array:
    """Return the matrix (k, n) with ``entries`` (k, w) in the columns of the unknowns that the patches (k,) read."""
    from scipy.sparse import csr_array

    k, width = entries.shape
    if not k:  # without boundaries: SciPy's checks of an empty matrix take a twentieth of a small solve
        return csr_array((0, dof_map.size))
    index = np.int32 if max(k * width, dof_map.size) < 2**31 else np.int64
    starts = np.arange(0, k * width + 1, width, dtype=index)
    columns = dof_map.unknowns[patch].ravel().astype(index)
    rows = csr_array((entries.ravel(), columns, starts), shape=(k, dof_map.size))
    rows.sum_duplicates()
    return rows
