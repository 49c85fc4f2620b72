"""Polynomials in the coordinates: products of Chebyshev polynomials in a box."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from cpmkit.protocols import Floats, Ints

#: Points at which a combination is evaluated at a time.
POLYNOMIAL_CHUNK_POINTS = 1 << 14


@dataclass(frozen=True, eq=False)
class Polynomials:
    """All products of Chebyshev polynomials in the coordinates of at most a total degree; the first is 1.

    Attributes
    ----------
    lower, upper : (d,) float64
        Corners of the box in which none is larger than 1.
    degree : int
        The total degree.
    """

    lower: Floats
    upper: Floats
    degree: int

    @property
    def powers(self) -> Ints:
        """(m, d) the degree of each polynomial along each axis."""
        every = product(range(self.degree + 1), repeat=len(self.lower))
        return np.array([powers for powers in every if sum(powers) <= self.degree])

    def at(self, points: Floats) -> Floats:
        """Return the values (n, m) at points (n, d)."""
        first, *others = zip(self._of_axes(points), self.powers.T, strict=True)
        values: Floats = first[0][:, first[1]]
        for of_axis, powers in others:
            values *= of_axis[:, powers]
        return values

    def combined(self, factors: Floats, points: Floats) -> Floats:
        """Return their sum times ``factors`` (m, k) at points (n, d), as (n, k): axis by axis."""
        dim = len(self.lower)
        tensor = np.zeros((self.degree + 1,) * dim + factors.shape[1:])
        tensor[tuple(self.powers.T)] = factors
        sums = np.empty((len(points), factors.shape[1]))
        for start in range(0, len(points), POLYNOMIAL_CHUNK_POINTS):
            part = slice(start, start + POLYNOMIAL_CHUNK_POINTS)
            *others, last = self._of_axes(points[part])
            left = np.tensordot(last, tensor, axes=(1, dim - 1))
            for of_axis in reversed(others):
                left = np.einsum("np,n...pk->n...k", of_axis, left)
            sums[part] = left
        return sums

    def _of_axes(self, points: Floats) -> Floats:
        """Return the Chebyshev polynomials (d, n, degree + 1) of each coordinate."""
        extent = np.where(self.upper > self.lower, self.upper - self.lower, 1.0)
        scaled = 2.0 * (points - self.lower) / extent - 1.0
        values: Floats = np.asarray(np.polynomial.chebyshev.chebvander(scaled.T, self.degree), dtype=np.float64)
        return values
