"""The solver ``jacobi``: conjugate gradients preconditioned by the diagonal and an exact solve near conditions.

It is for matrices in which the mass dominates, such as M + factor A of short steps in time: they need as many
iterations as M, 90 to 100 for splines, each in an eighth of the time of a multigrid cycle. Penalties and couplings of
conditions cause large eigenvalues whose eigenvectors are zero except near the conditions; without the exact solve
there, a circle with Dirichlet values takes 440 to 620 iterations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import ConvergenceError
from cpmkit.linear.csr_matrices import UnsignedCsr
from cpmkit.linear.direct import IndefiniteError, PositiveFactors
from cpmkit.linear.multigrid.solver import MultigridSolver
from cpmkit.linear.preconditioned import PreconditionedCG, indefinite_error, split_border
from cpmkit.linear.protocols import Operator, PreparedSolver
from cpmkit.types import Floats, Progress, no_progress

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from cpmkit.linear.solve_report import SolveReport
    from cpmkit.types import Ints

#: The mass dominates a matrix whose median row sums to at least this share of its diagonal entry: there are at most 140
#: iterations then, which take as long as 16 to 20 of multigrid. For -Lap those are steps up to 140 spacings squared.
MIN_ROW_SHARE = 1 / 64
#: Iterations after which multigrid would have been faster, and takes over.
MAX_BEFORE_MULTIGRID = 200


@dataclass(frozen=True, eq=False)
class JacobiPreconditioner:
    """Division by the diagonal, with an exact solve for the unknowns near conditions.

    Attributes
    ----------
    inverse : (n, 1) float64
        Inverse of the diagonal.
    strip : (k,) int64
        The unknowns near conditions, which are solved for together.
    factors : PositiveFactors, optional
        Factors of the rows and columns of the strip; None if the strip is empty.
    """

    inverse: Floats
    strip: Ints
    factors: PositiveFactors | None

    @classmethod
    def of(cls, matrix: csr_array, strip: Ints) -> JacobiPreconditioner:
        """Return the preconditioner of a matrix, with an exact solve for the unknowns ``strip`` (k,).

        Raises
        ------
        IndefiniteError
            If an entry of the diagonal, or a pivot on the strip, is not above zero.
        """
        diagonal = matrix.diagonal()[:, None]
        if not (diagonal > 0).all():
            raise IndefiniteError("it has entries on the diagonal that are not above zero")
        block = PositiveFactors.of(matrix[strip][:, strip].tocsr(), "beside boundaries") if len(strip) else None
        return cls(1 / diagonal, strip, block)

    @property
    def products(self) -> int:
        """The number of products with the matrix in one application: zero."""
        return 0

    def apply(self, b: Floats) -> Floats:
        """Return the preconditioned b (n, channels)."""
        x = b * self.inverse
        if self.factors is not None:
            x[self.strip] = self.factors.solve(b[self.strip])
        return np.asarray(x)


@dataclass(frozen=True)
class JacobiSolver:
    """The solver: conjugate gradients preconditioned by the diagonal, with at most ``max_iterations`` iterations."""

    max_iterations: int = 5000

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> PreconditionedCG:
        """Return the iteration for an operator; the first of ``levels`` gives the unknowns near conditions.

        Raises
        ------
        SceneError
            If the operator is not symmetric.
        ConvergenceError
            If the diagonal or the strip shows an eigenvalue of the wrong sign.
        """
        inner, bordered = split_border(operator, "jacobi")
        matrix = inner.to_csr()
        strip = levels[0].strip if levels and bordered is None else np.zeros(0, dtype=np.int64)
        try:
            diagonal = JacobiPreconditioner.of(matrix, strip)
        except IndefiniteError as error:
            raise indefinite_error("jacobi", error, 0, np.nan) from error
        return PreconditionedCG(operator, UnsignedCsr.of(matrix), bordered, diagonal, self.max_iterations, "jacobi")


@dataclass(frozen=True)
class JacobiOrMultigrid:
    """The solver that preconditions by the diagonal if the mass dominates the matrix, else by ``multigrid``."""

    multigrid: MultigridSolver

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> PreparedSolver:
        """Return the faster iteration for an operator, chosen by the row sums of its matrix."""
        if operator.symmetric and mass_dominates(operator.to_csr()):
            return JacobiThenMultigrid(
                JacobiSolver(MAX_BEFORE_MULTIGRID).prepare(operator, levels), self.multigrid, operator, levels
            )
        return self.multigrid.prepare(operator, levels)


def mass_dominates(matrix: csr_array) -> bool:
    """Return whether conjugate gradients are faster with the diagonal than with a multigrid cycle.

    As A 1 = 0, the row sums of M + factor A are those of M alone, while the diagonal is the sum of both: their ratio
    determines the condition number for any unit of length, step and diffusivity.
    """
    sums = matrix @ np.ones(matrix.shape[1])
    return bool(np.median(sums / matrix.diagonal()) >= MIN_ROW_SHARE)


@dataclass(frozen=True, eq=False)
class JacobiThenMultigrid:
    """Conjugate gradients with the diagonal, and with multigrid for each right-hand side where they do not converge.

    Each right-hand side starts with the diagonal again, so that a run in time is reproduced from a checkpoint.
    """

    diagonal: PreconditionedCG
    multigrid: MultigridSolver
    operator: Operator
    levels: Sequence[Any]

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Return u (n, channels) with ``A u = b``, and a report that counts the work of both iterations.

        Raises
        ------
        ConvergenceError
            If a channel's recomputed residual is above the tolerance, or the system turns out to be indefinite.
        """
        try:
            return self.diagonal.solve(b, tolerance, guess, progress)
        except ConvergenceError as error:
            failed = error.report
        u, report = self._prepared_multigrid.solve(b, tolerance, guess, progress)
        iterations = report.iterations + failed.iterations
        products = report.operator_applications + failed.operator_applications
        return u, replace(report, iterations=iterations, operator_applications=products)

    @cached_property
    def _prepared_multigrid(self) -> PreparedSolver:
        """The multigrid iteration, prepared at its first use."""
        return self.multigrid.prepare(self.operator, self.levels)
