"""A function sampled on a regular grid, interpolated by a polynomial of degree five in each coordinate.

Each cell has its own polynomial, through the 6^d nearest grid points (Saye, 2014): it is continuous from cell to cell,
and the level set is off by a fifth power of the spacing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints

#: Grid points along each axis that a cell's polynomial runs through.
STENCIL_NODES = 6
#: Coefficients (power, node) of the six Lagrange polynomials in t - 5/2, for the nodes t = 0, ..., 5.
LAGRANGE_COEFFICIENTS = np.linalg.inv(np.vander(np.arange(STENCIL_NODES) - 2.5, increasing=True))


@dataclass(frozen=True, eq=False)
class GridField:
    """Values on a grid.

    Attributes
    ----------
    values : (n0, n1[, n2]) float64
    origin, spacing : (d,) float64
        The point of the first value, and the distance of neighbouring values along each axis.
    """

    values: Floats
    origin: Floats
    spacing: Floats

    @property
    def dim(self) -> int:
        """Dimension of the space."""
        return self.values.ndim

    @property
    def box(self) -> Floats:
        """(2, d) the corners of the grid."""
        return np.stack([self.origin, self.origin + self.spacing * (np.array(self.values.shape) - 1)])

    def value(self, p: Floats) -> Floats:
        """Return phi (n,) at points ``p`` (n, d); outside of the grid NaN, as the derivatives are."""
        return self._derivative_table(p, 0).reshape(len(p))

    def gradient(self, p: Floats) -> tuple[Floats, Floats]:
        """Return phi (n,) and its gradient (n, d) at points ``p`` (n, d)."""
        table = self._derivative_table(p, 1)
        return _derivative(table, (0,) * self.dim), self._gradient(table)

    def jet(self, p: Floats) -> tuple[Floats, Floats, Floats]:
        """Return phi (n,), its gradient (n, d) and its Hessian (n, d, d) at points ``p`` (n, d)."""
        table, d = self._derivative_table(p, 2), self.dim
        hessian = np.empty((len(p), d, d))
        for i in range(d):
            for j in range(d):
                orders = tuple(int(k == i) + int(k == j) for k in range(d))
                hessian[:, i, j] = _derivative(table, orders) / (self.spacing[i] * self.spacing[j])
        return _derivative(table, (0,) * d), self._gradient(table), hessian

    def slope_error(self, p: Floats) -> float:
        """Return the root mean square error of gradients at ``p`` (n, d), as a share of their length.

        It is estimated from differences between the polynomials of a cell and of its neighbours.
        """
        slope = self.gradient(p)[1]
        apart = [
            np.sum((self._gradient(self._derivative_table(p, 1, shift)) - slope) ** 2, axis=1)
            for shift in np.eye(self.dim, dtype=np.int64)
        ]
        share = np.mean(apart, axis=0) / np.sum(slope**2, axis=1)
        return float(np.sqrt(np.mean(share[np.isfinite(share)])))

    def _gradient(self, table: Floats) -> Floats:
        """Return the gradient (n, d), per unit of length, from the ``table`` of :meth:`_derivative_table`."""
        units = [tuple(int(k == i) for k in range(self.dim)) for i in range(self.dim)]
        gradient: Floats = np.stack([_derivative(table, orders) for orders in units], axis=1) / self.spacing
        return gradient

    def _derivative_table(self, p: Floats, most: int, shift: Ints | int = 0) -> Floats:
        """Return the table (n, most + 1, ...) of derivatives at ``p`` (n, d), orders 0 to ``most`` in each coordinate.

        They are in units of the grid, NaN outside of it, and those of the polynomial of the cell ``shift``, () or (d,),
        cells on.
        """
        last = np.array(self.values.shape) - 1
        q = (p - self.origin) / self.spacing
        with np.errstate(invalid="ignore"):
            outside: Bools = np.logical_not(((q >= -1e-9) & (q <= last + 1e-9)).all(axis=1))
        q = np.where(outside[:, None], 0.0, q)
        first = np.clip(np.floor(q).astype(np.int64) - 2 + shift, 0, last - (STENCIL_NODES - 1))
        table = self._patches(first)
        for weights in _lagrange_weights((q - first - 2.5).T, most):
            table = np.einsum("ni...,nia->n...a", table, weights, optimize=False)
        table[outside] = np.nan
        return table

    def _patches(self, first: Ints) -> Floats:
        """Return (n, 6, 6[, 6]): the values of the polynomials' grid points, from the indices ``first`` (n, d) on."""
        index = tuple(
            first[:, axis].reshape(-1, *[1] * self.dim)
            + np.arange(STENCIL_NODES).reshape(-1, *[1] * (self.dim - 1 - axis))
            for axis in range(self.dim)
        )
        patches: Floats = self.values[index]
        return patches


def _derivative(table: Floats, orders: tuple[int, ...]) -> Floats:
    """Return (n,) the derivative of ``orders``, one a coordinate, from the table of GridField._derivative_table."""
    derivative: Floats = table[:, *orders]
    return derivative


def _lagrange_weights(t: Floats, most: int) -> Floats:
    """Return (d, n, 6, most + 1): the Lagrange polynomials and their derivatives at ``t`` (d, n), 0 in the middle."""
    weights = np.empty((*t.shape, STENCIL_NODES, most + 1))
    coefficients = LAGRANGE_COEFFICIENTS
    for order in range(most + 1):
        total = np.zeros((*t.shape, STENCIL_NODES))
        for row in coefficients[::-1]:
            total = total * t[..., None] + row
        weights[..., order] = total
        coefficients = coefficients[1:] * np.arange(1, len(coefficients))[:, None]
    return weights
