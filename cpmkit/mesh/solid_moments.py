"""Moments of a solid in lattice cells, from quadrature points on its skin, and quadrature weights that reproduce them.

In a cell let t be the coordinates from 0 to 1, L_a the orthonormal Legendre polynomials on [0, 1], a = 0 to 4, and IL_a
the integral of L_a from 0 to t. With n the outward unit normal on the part of the skin in the cell, and dS in units of
the spacing, the divergence theorem along axis 0 gives the moment of the solid

    m_ab = sum n_0 dS IL_a(t_0) L_b(t) + [a = 0] T_b,    T_b = sum of n_0 dS L_b(t) over all cells above in the column,

where L_b is the product over the other axes, and T_b the moment of the solid's part of the upper face of the cell. The
weights on the 5^d Gauss points t_g of a cell are ``W_g sum m_ab L_ab(t_g)``: integrals of polynomials up to degree 4
along each axis are exact, wherever the points lie. Weights may be negative, and points may lie outside the solid.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.grid.lattice import Codes, find_codes
from cpmkit.mesh.skin_pieces import SkinPieces
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats, Ints

#: Number of Legendre polynomials, and of Gauss points in a cut cell, along an axis: for products of quadratic splines.
MOMENTS = 5
#: Number of Gauss points along an axis in a full cell: they integrate degree 5 exactly.
FULL_POINTS = 3


def _legendre() -> tuple[Floats, Floats]:
    """Return the polynomials L_a and IL_a in t as coefficients (5, 6), that of 1 first."""
    table, integrals = np.zeros((MOMENTS, MOMENTS + 1)), np.zeros((MOMENTS, MOMENTS + 1))
    for a in range(MOMENTS):
        own = np.polynomial.Legendre.basis(a, domain=[0, 1]).convert(kind=np.polynomial.Polynomial).coef
        own = np.sqrt(2 * a + 1) * own
        table[a, : len(own)] = own
        integrals[a, 1 : len(own) + 1] = own / np.arange(1, len(own) + 1)
    return table, integrals


LEGENDRE, LEGENDRE_INTEGRALS = _legendre()


def gauss_points(count: int, dim: int) -> tuple[Floats, Floats]:
    """Return the Gauss points (count^dim, dim) on the unit cube, the last axis fastest, and weights (count^dim,)."""
    x, w = np.polynomial.legendre.leggauss(count)
    points = np.stack(np.meshgrid(*[0.5 * (x + 1)] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    weights = np.stack(np.meshgrid(*[0.5 * w] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    return points, weights.prod(axis=1)


@compiled
def evaluate(table: Floats, t: float, values: Floats) -> None:
    """Fill ``values`` (5,) with the polynomials ``table`` (5, 6) at ``t``."""
    for a in range(MOMENTS):
        value = table[a, MOMENTS]
        for k in range(MOMENTS - 1, -1, -1):
            value = value * t + table[a, k]
        values[a] = value


@compiled
def sum_moments(points: Floats, areas: Floats, owner: Ints, cells: Ints, moments: Floats, fluxes: Floats) -> None:
    """Add n_0 dS IL_a L_b to ``moments`` (c, 5, 5^(d-1)) and n_0 dS L_b to ``fluxes`` (c, 5^(d-1)).

    ``points``, ``areas`` (q, d) are quadrature points on the skin, in spacings, and their weights times normals; those
    with an ``owner`` (q,) number c >= 0 are summed there, in coordinates of the lattice cell ``cells`` (c, d).
    """
    d = points.shape[1]
    first, second, third = np.empty(MOMENTS), np.empty(MOMENTS), np.ones(MOMENTS)
    depth = MOMENTS if d == 3 else 1
    for q in range(len(points)):
        c = owner[q]
        if c < 0:
            continue
        evaluate(LEGENDRE_INTEGRALS, points[q, 0] - cells[c, 0] + 0.5, first)
        evaluate(LEGENDRE, points[q, 1] - cells[c, 1] + 0.5, second)
        if d == 3:
            evaluate(LEGENDRE, points[q, 2] - cells[c, 2] + 0.5, third)
        for j in range(MOMENTS):
            for k in range(depth):
                value = areas[q, 0] * second[j] * third[k]
                at = j * depth + k
                fluxes[c, at] += value
                for i in range(MOMENTS):
                    moments[c, i, at] += first[i] * value


@compiled
def sum_columns(column: Ints, below: Floats, above: Floats) -> None:
    """Fill ``above`` (c, k) with the sums of ``below`` (c, k) over the later rows with the same ``column`` (c,)."""
    for c in range(len(column) - 2, -1, -1):
        if column[c] == column[c + 1]:
            for k in range(below.shape[1]):
                above[c, k] = above[c + 1, k] + below[c + 1, k]


def sums_above(cells: Ints, axis: int, values: Floats) -> Floats:
    """Return for each of ``cells`` (c, d) the sum (c, k) of ``values`` over the cells above it along ``axis``."""
    others = np.delete(cells, axis, axis=1)
    order = np.lexsort([cells[:, axis], *others.T])
    column = np.cumsum(np.r_[True, (np.diff(others[order], axis=0) != 0).any(axis=1)])
    sums, ordered = np.zeros(values.shape), np.ascontiguousarray(values[order])
    sum_columns(column, ordered, sums)
    above = np.empty_like(sums)
    above[order] = sums
    return above


@dataclass(frozen=True, eq=False)
class CellTable:
    """Lattice cells in ascending order of their codes."""

    cells: Ints  #: (c, d): the cells.
    codes: Codes  #: A numbering of the cells of the box around them.

    @classmethod
    def of(cls, cells: Ints) -> CellTable:
        """Return the table of the distinct cells among ``cells`` (n, d)."""
        codes = Codes.from_points(cells, 1)
        return cls(codes.decode(np.unique(codes.encode(cells))), codes)

    @cached_property
    def sorted_codes(self) -> Ints:
        """(c,) the code of each cell, ascending."""
        return self.codes.encode(self.cells)

    def find(self, cells: Ints) -> Ints:
        """Return the row (n,) of each of ``cells`` (n, d), -1 for those that are not in the table."""
        return find_codes(self.sorted_codes, self.codes.encode(cells))


def moments_of(pieces: SkinPieces, table: CellTable) -> tuple[Floats, Floats]:
    """Return the moments (c, 5, 5^(d-1)) of the solid in the cells of a table, and sums (c,) over their columns.

    ``table`` must have the cells of all ``pieces``. A sum is that of n_0 dS over the whole column of a cell: zero but
    for rounding if the skin is closed.
    """
    cells, d = table.cells, table.cells.shape[1]
    count, width = len(cells), MOMENTS ** (d - 1)
    moments, fluxes = np.zeros((count, MOMENTS, width)), np.zeros((count, width))
    owner = table.find(pieces.cell)[pieces.piece]
    sum_moments(pieces.points, pieces.areas, owner, cells, moments, fluxes)
    above = sums_above(cells, 0, fluxes)
    moments[:, 0] += above
    column: Any = np.unique(cells[:, 1:], axis=0, return_inverse=True)[1]
    total = np.bincount(column.ravel(), fluxes[:, 0])[column.ravel()]
    return moments, total


def gauss_weights(moments: Floats) -> Floats:
    """Return the weights (c, 5^d) of Gauss points of cells, over the cell's volume, that reproduce the ``moments``."""
    d = 2 if moments.shape[2] == MOMENTS else 3
    points, weights = gauss_points(MOMENTS, d)
    values = np.polynomial.polynomial.polyval(points, LEGENDRE.T)  # (a, g, axis)
    basis = values[:, :, 0]
    for axis in range(1, d):
        basis = (basis[:, None] * values[None, :, :, axis]).reshape(-1, len(points))
    return np.asarray((moments.reshape(len(moments), -1) @ basis) * weights)


def full_cells(table: CellTable, upper: Floats) -> Ints:
    """Return the cells (f, d) between those of a table along axis 0 that lie inside the solid.

    ``upper`` (c,) is the solid's share of the upper face of each cell of the table along axis 0.
    """
    cells = table.cells
    order = np.lexsort([cells[:, 0], *cells[:, 1:].T])
    first, following = order[:-1], order[1:]
    gap = cells[following, 0] - cells[first, 0] - 1
    inside = (cells[first, 1:] == cells[following, 1:]).all(axis=1) & (upper[first] > 0.5) & (gap > 0)
    rows = np.repeat(first[inside], gap[inside])
    counts = gap[inside]
    rank = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
    full: Ints = cells[rows].copy()
    full[:, 0] += 1 + rank
    return full
