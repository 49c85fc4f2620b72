"""Smoothers of a level: Gauss-Seidel or Chebyshev iterations, and an exact solve on the strip near conditions.

Chebyshev's iteration is for large levels, whose products use all threads, and for waves. Penalties and couplings of
conditions cause large eigenvalues of D^-1 A whose eigenvectors are zero outside the strip. The strip is solved
exactly, and the iteration runs on the other unknowns, whose eigenvalues the conditions do not change.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.linear.csr_matrices import SymmetricCsr, UnsignedCsr
from cpmkit.linear.direct import PositiveFactors, SymmetricFactors
from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Chebyshev's iteration damps eigenvalues of D^-1 A above this share of the largest; coarser levels damp the others.
#: Spheres take 19 to 21 iterations with 1/8 and 16 to 19 with 1/16; scenes with conditions take no fewer with less.
SMOOTHED_SHARE = 1 / 16
#: Gauss-Seidel sweeps before and after a coarser level, on the finest level and on others, where two save no iteration.
FINEST_SWEEPS, COARSER_SWEEPS = 2, 1


@dataclass(frozen=True, eq=False)
class Chebyshev:
    """Chebyshev's iteration with D^-1 A on the unknowns where ``inverse`` (n,), the diagonal of D^-1, is not zero.

    Attributes
    ----------
    matrix : UnsignedCsr or SymmetricCsr
        A.
    inverse : (n,) float64
        The diagonal of D^-1.
    largest : float
        Upper end of the interval of damped eigenvalues, an upper bound of all eigenvalues.
    steps : int
        Number of products with A.
    """

    matrix: UnsignedCsr | SymmetricCsr
    inverse: Floats
    largest: float
    steps: int

    @property
    def products(self) -> int:
        """The number of products with A before and after a coarser level together."""
        return 2 * self.steps

    def before(self, x: Floats | None, b: Floats) -> tuple[Floats, Floats]:
        """Return x and ``b - A x``, both (n, channels), after :attr:`steps` steps from x, zero if None."""
        x = self.after(x, b)
        return x, self.matrix.residual(x, b)

    def after(self, x: Floats | None, b: Floats) -> Floats:
        """Return x (n, channels) after :attr:`steps` steps towards the solution of ``A x = b`` from x, zero if None.

        The steps are their own adjoint.

        Notes
        -----
        Saad, *Iterative methods for sparse linear systems* (2003), algorithm 12.1.
        """
        centre, radius = self.largest * (1 + SMOOTHED_SHARE) / 2, self.largest * (1 - SMOOTHED_SHARE) / 2
        rho = radius / centre
        if x is None:
            move = b * (self.inverse / centre)[:, None]
            x = move.copy()
        else:
            move = np.zeros_like(b)
            x = self.matrix.step(x, b, self.inverse, 0.0, 1 / centre, move)
        for _ in range(self.steps - 1):
            after = 1 / (2 * centre / radius - rho)
            x = self.matrix.step(x, b, self.inverse, after * rho, 2 * after / radius, move)
            rho = after
        return x


@dataclass(frozen=True, eq=False)
class GaussSeidel:
    """Gauss-Seidel sweeps on the unknowns where ``inverse`` (n,), of A's diagonal, is not zero; for one thread.

    Two sweeps reduce the error as much as three steps of Chebyshev's iteration, and update the residual as well: an
    iteration reads the finest matrix five times instead of seven, and needs no eigenvalue. One sweep on the finest
    level takes one and a half to two times as many iterations.

    Attributes
    ----------
    matrix : SymmetricCsr
        A.
    inverse : (n,) float64
        Inverse of its diagonal.
    sweeps : int
        Number of sweeps before, and after, a coarser level.
    """

    matrix: SymmetricCsr
    inverse: Floats
    sweeps: int

    @property
    def products(self) -> int:
        """The number of products with A that take as much time as all sweeps."""
        return 2 * self.sweeps

    def before(self, x: Floats | None, b: Floats) -> tuple[Floats, Floats]:
        """Return x and ``b - A x``, both (n, channels), after backward sweeps from x, zero if None."""
        return self.matrix.sweep_backward(x, b, self.inverse, self.sweeps)

    def after(self, x: Floats, b: Floats) -> Floats:
        """Return x (n, channels) after forward sweeps for ``A x = b``, the adjoint of :meth:`before`."""
        return self.matrix.sweep_forward(x, b, self.inverse, self.sweeps)


@dataclass(frozen=True, eq=False)
class Strip:
    """The unknowns near conditions, which are solved for exactly while the others are fixed.

    Attributes
    ----------
    unknowns : (k,) int64
        Numbers of these unknowns.
    rows : UnsignedCsr
        Their rows of A, (k, n), rounded like the level's matrix: otherwise ``after`` is not the adjoint of ``before``.
    factors : SymmetricFactors
        Factors of A restricted to them.
    """

    unknowns: Ints
    rows: UnsignedCsr
    factors: SymmetricFactors

    @classmethod
    def of(cls, rows: csr_array, unknowns: Ints, waves: bool = False, is_rounded: bool = True) -> Strip:
        """Return the strip of ``unknowns`` (k,), given their ``rows`` (k, n) of A.

        ``is_rounded`` is that of the level's matrix. With ``waves`` A may be indefinite on the strip, which can be as
        wide as a wave on a coarse level.

        Raises
        ------
        IndefiniteError
            If A restricted to the strip has a pivot that is not positive, and no ``waves`` are expected.
        """
        kind = SymmetricFactors if waves else PositiveFactors
        factors = kind.of(rows[:, unknowns], "beside boundaries")
        compiled_rows = UnsignedCsr.of(rows)
        return cls(unknowns, compiled_rows.in_float32() if is_rounded else compiled_rows, factors)

    def solve(self, x: Floats | None, b: Floats) -> Floats:
        """Return x (n, channels), zero if None, changed on the strip so that its equations hold; x is overwritten."""
        if x is None:
            x = np.zeros_like(b)
            x[self.unknowns] = self.factors.solve(b[self.unknowns])
        else:
            x[self.unknowns] += self.factors.solve(self.rows.residual(x, b[self.unknowns]))
        return x


@dataclass(frozen=True, eq=False)
class Smoother:
    """A solve on the strip and then an iteration before the coarser level; both in reverse order after it.

    Each is the adjoint of the other, which makes the cycle symmetric.
    """

    iteration: Chebyshev | GaussSeidel
    strip: Strip | None

    def before(self, b: Floats) -> tuple[Floats, Floats]:
        """Return x and ``b - A x``, both (n, channels), after smoothing from zero towards the solution."""
        return self.iteration.before(None if self.strip is None else self.strip.solve(None, b), b)

    def after(self, x: Floats, b: Floats) -> Floats:
        """Return x (n, channels) after smoothing towards the solution of ``A x = b``; x may be overwritten."""
        x = self.iteration.after(x, b)
        return x if self.strip is None else self.strip.solve(x, b)
