"""What smooths the error on one level: equations one by one, and an exact solve on the strip that conditions tie.

On large levels, which all threads share, and where waves are, it is Chebyshev's iteration in place of the former.

Penalties and couplings make eigenvalues of D^-1 A large that only the strip's unknowns see. The strip is solved for
exactly, and the iteration runs on the other unknowns, whose eigenvalues no condition moves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.linear.csr_matrices import SymmetricCsr, UnsignedCsr
from cpmkit.linear.direct import PositiveFactors, SymmetricFactors
from cpmkit.protocols import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: The iteration damps the eigenvalues of D^-1 A from this share of the largest on; the coarser levels see the others.
#: Spheres take 19 to 21 iterations with 1/8, 16 to 19 with this, and no fewer with less where conditions stand.
SMOOTHED_SHARE = 1 / 16
#: Sweeps through the equations before and after a coarser level, of the finest and of all others; two there save no
#: iteration.
FINEST_SWEEPS, COARSER_SWEEPS = 2, 1


@dataclass(frozen=True, eq=False)
class Chebyshev:
    """Chebyshev's iteration with D^-1 A on the unknowns where ``inverse`` (n,), which is D^-1, is not zero.

    Attributes
    ----------
    matrix : UnsignedCsr or SymmetricCsr
        A.
    inverse : (n,) float64
        D^-1.
    largest : float
        The upper end of the interval that it damps, above all eigenvalues.
    steps : int
        How many products with A it takes.
    """

    matrix: UnsignedCsr | SymmetricCsr
    inverse: Floats
    largest: float
    steps: int

    @property
    def products(self) -> int:
        """How many products with A it takes before and after a coarser level."""
        return 2 * self.steps

    def before(self, x: Floats | None, b: Floats) -> tuple[Floats, Floats]:
        """Return x, from zero where it is None, nearer to the solution of ``A x = b``, and the residual."""
        x = self.smoothed(x, b)
        return x, self.matrix.residual(x, b)

    def after(self, x: Floats, b: Floats) -> Floats:
        """Return x nearer to the solution: the adjoint of ``before``, which it is itself."""
        return self.smoothed(x, b)

    def smoothed(self, x: Floats | None, b: Floats) -> Floats:
        """Return x, from zero where it is None, after the steps towards ``A x = b``.

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
    """Equations solved one by one, on the unknowns where ``inverse`` (n,), of A's diagonal, is not zero.

    Two sweeps do for the error what three steps of Chebyshev's iteration do, and bring the residual with them: five
    times through the finest matrix in an iteration, in place of seven. No eigenvalue has to be known. One sweep on the
    finest level takes one and a half to two times as many iterations. Not for several threads.

    Attributes
    ----------
    matrix : SymmetricCsr
        A.
    inverse : (n,) float64
        Of its diagonal.
    sweeps : int
        How often all equations are gone through, before a coarser level and after.
    """

    matrix: SymmetricCsr
    inverse: Floats
    sweeps: int

    @property
    def products(self) -> int:
        """How many products with A as much work as before and after a coarser level is."""
        return 2 * self.sweeps

    def before(self, x: Floats | None, b: Floats) -> tuple[Floats, Floats]:
        """Return x, from zero where it is None, nearer to the solution of ``A x = b``, and the residual."""
        return self.matrix.solved_upwards(x, b, self.inverse, self.sweeps)

    def after(self, x: Floats, b: Floats) -> Floats:
        """Return x nearer to the solution: the adjoint of ``before``."""
        return self.matrix.solved_downwards(x, b, self.inverse, self.sweeps)


@dataclass(frozen=True, eq=False)
class Strip:
    """Unknowns (k,) that are solved for exactly while the others are held.

    Attributes
    ----------
    unknowns : (k,) int64
        Their numbers.
    rows : UnsignedCsr
        Their rows of A, (k, n), rounded as the level's own are: else ``after`` is not the adjoint of ``before``.
    factors : SymmetricFactors
        Of A among them.
    """

    unknowns: Ints
    rows: UnsignedCsr
    factors: SymmetricFactors

    @classmethod
    def of(cls, rows: csr_array, unknowns: Ints, waves: bool = False, rounded: bool = True) -> Strip:
        """Return the strip of these unknowns, whose ``rows`` (k, n) of A are.

        A strip may be wide enough for a wave on a coarse level. Its rows are ``rounded`` where the level's are.

        Raises
        ------
        Indefinite
            If A among them has a pivot that is not positive, and there are to be no ``waves``.
        """
        kind = SymmetricFactors if waves else PositiveFactors
        factors = kind.of(rows[:, unknowns], "beside boundaries")
        own = UnsignedCsr.of(rows)
        return cls(unknowns, own.rounded() if rounded else own, factors)

    def solve(self, x: Floats | None, b: Floats) -> Floats:
        """Return x, from zero where it is None, with the strip's equations fulfilled."""
        if x is None:
            x = np.zeros_like(b)
            x[self.unknowns] = self.factors.solve(b[self.unknowns])
        else:
            x[self.unknowns] += self.factors.solve(self.rows.residual(x, b[self.unknowns]))
        return x


@dataclass(frozen=True, eq=False)
class Smoother:
    """An iteration, after a solve on the strip on the way down and before one on the way up.

    One is the other's adjoint, which makes the cycle symmetric.
    """

    iteration: Chebyshev | GaussSeidel
    strip: Strip | None

    def before(self, b: Floats) -> tuple[Floats, Floats]:
        """Return x, from zero, nearer to the solution of ``A x = b``, and the residual."""
        return self.iteration.before(None if self.strip is None else self.strip.solve(None, b), b)

    def after(self, x: Floats, b: Floats) -> Floats:
        """Return x nearer to the solution of ``A x = b``; x may be written to."""
        x = self.iteration.after(x, b)
        return x if self.strip is None else self.strip.solve(x, b)
