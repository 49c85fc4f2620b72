"""Conjugate gradients with the diagonal as preconditioner, and an exact solve on what conditions tie.

It is for matrices that a mass dominates, such as M + factor A of short steps in time: their iterations are those of M,
90 to 100 for splines, and each takes an eighth of the time of one with a multigrid cycle. Penalties and couplings of
conditions make eigenvalues large that only the unknowns beside them see; without the exact solve there a circle that
holds values takes 440 to 620.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import ConvergenceError
from cpmkit.linear.csr_matrices import UnsignedCsr
from cpmkit.linear.direct import Indefinite, PositiveFactors
from cpmkit.linear.multigrid.solver import Multigrid
from cpmkit.linear.preconditioned import Preconditioned, indefinite, without_border
from cpmkit.protocols import Floats, Operator, PreparedSolver, Progress, no_progress

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from cpmkit.linear.solve_report import SolveReport
    from cpmkit.protocols import Ints

#: Where the median row of a matrix sums to at least this share of its diagonal entry, its mass dominates: iterations
#: are then 140 at most, and the multigrid's 16 to 20 take as long. Of -Lap that is a step up to some 140 spacings
#: squared.
LEAST_ROW_SHARE = 1 / 64
#: After so many iterations the multigrid would have been quicker: it goes on from the start.
MOST_BESIDE_MULTIGRID = 200


@dataclass(frozen=True, eq=False)
class Diagonal:
    """Division by the diagonal, and the exact solution on a strip of unknowns.

    Attributes
    ----------
    inverse : (n, 1) float64
        One over the diagonal.
    strip : (k,) int64
        The unknowns that are solved for together.
    factors : PositiveFactors, optional
        Of A among them; None where there are none.
    """

    inverse: Floats
    strip: Ints
    factors: PositiveFactors | None

    @classmethod
    def of(cls, matrix: csr_array, strip: Ints) -> Diagonal:
        """Return that of a matrix.

        Raises
        ------
        Indefinite
            If an entry of the diagonal, or a pivot on the strip, is not above zero.
        """
        diagonal = matrix.diagonal()[:, None]
        if not (diagonal > 0).all():
            raise Indefinite("it has entries on the diagonal that are not above zero")
        among = PositiveFactors.of(matrix[strip][:, strip].tocsr(), "beside boundaries") if len(strip) else None
        return cls(1 / diagonal, strip, among)

    @property
    def products(self) -> int:
        """None with the whole matrix."""
        return 0

    def apply(self, b: Floats) -> Floats:
        """Return x (n, channels)."""
        x = b * self.inverse
        if self.factors is not None:
            x[self.strip] = self.factors.solve(b[self.strip])
        return np.asarray(x)


@dataclass(frozen=True)
class Jacobi:
    """Conjugate gradients, preconditioned by the diagonal.

    Attributes
    ----------
    max_iterations : int
        At most.
    """

    max_iterations: int = 5000

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> Preconditioned:
        """Return the iteration; of ``levels`` the finest tells what conditions tie.

        Raises
        ------
        SceneError
            If the operator is not symmetric.
        ConvergenceError
            If it turns out to have an eigenvalue of the wrong sign.
        """
        inner, bordered = without_border(operator, "jacobi")
        matrix = inner.to_csr()
        tied = levels[0].strip if levels and bordered is None else np.zeros(0, dtype=np.int64)
        try:
            diagonal = Diagonal.of(matrix, tied)
        except Indefinite as error:
            raise indefinite("jacobi", error, 0, np.nan) from error
        return Preconditioned(operator, UnsignedCsr.of(matrix), bordered, diagonal, self.max_iterations, "jacobi")


@dataclass(frozen=True)
class Quicker:
    """The diagonal where a mass dominates the matrix, and else the multigrid's cycle.

    Attributes
    ----------
    multigrid : Multigrid
        With its most iterations.
    """

    multigrid: Multigrid

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> PreparedSolver:
        """Return what is quicker for an operator by the rows of its matrix."""
        if operator.symmetric and mass_dominates(operator.to_csr()):
            return Tried(Jacobi(MOST_BESIDE_MULTIGRID).prepare(operator, levels), self.multigrid, operator, levels)
        return self.multigrid.prepare(operator, levels)


def mass_dominates(matrix: csr_array) -> bool:
    """Tell whether conjugate gradients with the diagonal are quicker than with a cycle.

    Row sums see the mass alone where A 1 = 0, diagonal entries the mass and A: whatever the unit of length, the step
    and the diffusivity, the share of the one in the other tells the condition number.
    """
    sums = matrix @ np.ones(matrix.shape[1])
    return bool(np.median(sums / matrix.diagonal()) >= LEAST_ROW_SHARE)


@dataclass(frozen=True, eq=False)
class Tried:
    """The diagonal, and the cycle for each right-hand side with which that takes too long.

    Nothing is remembered from one to the next: a run in time that goes on from a checkpoint does the same.
    """

    diagonal: Preconditioned
    multigrid: Multigrid
    operator: Operator
    levels: Sequence[Any]

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Solve for all channels.

        Raises
        ------
        ConvergenceError
            If a channel's recomputed residual is above the tolerance, or the system turns out to be indefinite.
        """
        try:
            return self.diagonal.solve(b, tolerance, guess, progress)
        except ConvergenceError as error:
            wasted = error.report
        u, report = self._cycle.solve(b, tolerance, guess, progress)
        iterations = report.iterations + wasted.iterations
        products = report.operator_applications + wasted.operator_applications
        return u, replace(report, iterations=iterations, operator_applications=products)

    @cached_property
    def _cycle(self) -> PreparedSolver:
        return self.multigrid.prepare(self.operator, self.levels)
