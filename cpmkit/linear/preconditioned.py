"""Conjugate gradients for symmetric operators with any preconditioner, and preconditioners shared by similar operators.

Where constants are free on pieces of the manifold, the iteration runs in the orthogonal complement of the indicators of
these pieces, and the means that the border fixes are added afterwards.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np

from cpmkit.errors import ConvergenceError, SceneError
from cpmkit.linear.csr_matrices import SymmetricCsr, UnsignedCsr
from cpmkit.linear.direct import IndefiniteError
from cpmkit.linear.krylov import REMEDY, conjugate_gradients, solve_by_corrections
from cpmkit.linear.operators import Bordered
from cpmkit.linear.protocols import Operator, PreparedSolver
from cpmkit.linear.residuals import judge
from cpmkit.linear.solve_report import SolveReport
from cpmkit.types import Floats, Progress, no_progress

#: Accuracy where no tolerance is given: the preconditioned residual falls to this share, and the residual to this many
#: times as much. It leaves less than 0.05 percent of a discretisation's error, with conditions on curves too.
PRECONDITIONED_SHARE, RESIDUAL_SLACK = 1e-8, 100.0


class ApproximateInverse(Protocol):
    """A linear, symmetric and positive approximation of the inverse of A."""

    @property
    def products(self) -> int:
        """The number of products with A in one application."""

    def apply(self, b: Floats, /) -> Floats:
        """Return an approximate solution x (n, channels) of ``A x = b``."""


def split_border(operator: Operator, solver: str) -> tuple[Operator, Bordered | None]:
    """Return a real symmetric operator without its border, and the operator with its border, None if it has none.

    Raises
    ------
    SceneError
        If the operator is not real and symmetric; the message names the ``solver``.
    """
    bordered = operator if isinstance(operator, Bordered) else None
    inner = operator if bordered is None else bordered.operator
    if not inner.symmetric or np.iscomplexobj(inner.diagonal):
        raise SceneError(f"solver {solver!r} solves real symmetric systems, got another one; use solver='direct'.")
    return inner, bordered


@dataclass(frozen=True, eq=False)
class PreconditionedCG:
    """An operator with a preconditioner, ready to solve by conjugate gradients.

    Attributes
    ----------
    operator : Operator
        A, with its border where constants are free.
    matrix : UnsignedCsr or SymmetricCsr
        A without its border.
    bordered : Bordered, optional
        ``A + s F W`` where constants are free.
    preconditioner : ApproximateInverse
        The preconditioner of A.
    max_iterations : int
        Most iterations.
    solver : str
        Name of the solver, for reports.
    slack : float
        The preconditioned residual has to fall this many times below the tolerance of the residual.
    more_exact : callable, optional
        Returns a preconditioner with smaller rounding errors, which is tried before an error is raised.
    """

    operator: Operator
    matrix: UnsignedCsr | SymmetricCsr
    bordered: Bordered | None
    preconditioner: ApproximateInverse
    max_iterations: int
    solver: str
    slack: float = 1.0
    more_exact: Callable[[], ApproximateInverse] | None = None

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Return u (n, channels) with ``A u = b``, and a report.

        Raises
        ------
        ConvergenceError
            If a channel's recomputed residual is above the tolerance, or the system turns out to be indefinite.
        """
        try:
            return self._solve(b, tolerance, guess, progress)
        except ConvergenceError:
            if self.more_exact is None:
                raise
        return self._with_less_rounding.solve(b, tolerance, guess, progress)

    @cached_property
    def _with_less_rounding(self) -> PreconditionedCG:
        """The same iteration with the more exact preconditioner."""
        assert self.more_exact is not None
        return replace(self, preconditioner=self.more_exact(), more_exact=None)

    def _solve(
        self, b: Floats, tolerance: float, guess: Floats | None, progress: Progress
    ) -> tuple[Floats, SolveReport]:
        """Return u (n, channels) with ``A u = b``, and a report, by the first preconditioner alone."""
        compatible, means = self._compatible(b)

        def correct(residual: Floats, target: Floats, most: int) -> tuple[Floats, int, int]:
            """Return a correction of u, the iterations and the products with A, as a :data:`Correction`."""
            try:
                step, taken = conjugate_gradients(
                    self.matrix.apply, self.precondition, residual, target, most, progress, self.slack
                )
            except IndefiniteError as error:
                raise indefinite_error(self.solver, error, self.max_iterations - most, tolerance) from error
            return step, taken, (taken + (taken + 1) * self.preconditioner.products) * residual.shape[1]

        u, iterations, products = solve_by_corrections(
            lambda u: self.matrix.residual(u, compatible),
            b,
            guess,
            tolerance,
            correct,
            max_iterations=self.max_iterations,
            target_share=0.9,
            rounds=3,
            first_slack=self.slack,  # nothing is known of the preconditioned residual of a guess
        )
        if self.bordered is not None:
            border = self.bordered.border
            u += border.indicator @ (means - border.mean @ u)
        progress("solve", 1.0)
        return u, judge(self.operator, b, u, self.solver, tolerance, iterations, products, REMEDY)

    def _compatible(self, b: Floats) -> tuple[Floats, Floats]:
        """Return the part of b for which there is a solution on free pieces, and the rest's means (k, channels)."""
        if self.bordered is None:
            return b, np.zeros((0, b.shape[1]))
        indicator, load = self.bordered.border.indicator, self.bordered.border.constant_load
        excess = np.linalg.solve((indicator.T @ load).toarray(), indicator.T @ b)
        return b - load @ excess, excess / self.bordered.shift

    @property
    def step_products(self) -> int:
        """The number of products with A in one application of the preconditioner, for each channel."""
        return self.preconditioner.products

    def precondition(self, residual: Floats) -> Floats:
        """Return the preconditioned residual (n, channels), orthogonal to free constants."""
        return self._without_constants(self.preconditioner.apply(self._without_constants(residual)))

    def _without_constants(self, vector: Floats) -> Floats:
        """Return the part of ``vector`` (n, channels) that is orthogonal to the indicators of the free pieces."""
        if self.bordered is None:
            return vector
        indicator = self.bordered.border.indicator
        sums, members = indicator.T @ vector, indicator.sum(axis=0)
        return np.asarray(vector - indicator @ (sums / members[:, None]))


def stop_by_preconditioned_residual(prepared: PreparedSolver) -> tuple[PreparedSolver, float] | None:
    """Return a solver that stops by the preconditioned residual, and the tolerance for its residual.

    With a multigrid cycle the preconditioned residual is proportional to the error of u at any spacing; with the
    diagonal it is not. None for other solvers than multigrid.
    """
    if not isinstance(prepared, PreconditionedCG) or prepared.solver != "multigrid":
        return None
    return replace(prepared, slack=RESIDUAL_SLACK), RESIDUAL_SLACK * PRECONDITIONED_SHARE


def indefinite_error(solver: str, error: IndefiniteError, iterations: int, tolerance: float) -> ConvergenceError:
    """Return the ConvergenceError, with a report, for a solve whose system turned out to be indefinite."""
    report = SolveReport(solver, False, iterations, 0, np.inf, tolerance, str(error))
    return ConvergenceError(
        f"The system is indefinite, and solver {solver!r} stopped after {iterations} iterations: {error}; use "
        "solver='direct', or a smaller spacing.",
        report,
    )


@runtime_checkable
class ReusablePreconditioner(PreparedSolver, Protocol):
    """A prepared solver whose preconditioner also serves other operators of its size, with more iterations."""

    @property
    def operator(self) -> Operator:
        """The operator that the solver was prepared for."""

    def for_operator(self, operator: Operator, /) -> PreparedSolver:
        """Return the iteration with the same preconditioner for another operator."""


@dataclass(frozen=True, eq=False)
class SharedPreconditioner:
    """A solver with the preconditioner of a similar operator, and with the operator's own where that does not converge.

    Attributes
    ----------
    iteration : PreparedSolver
        The iteration with the preconditioner of the similar operator.
    prepare : callable
        Returns the iteration with the operator's own preconditioner.
    """

    iteration: PreparedSolver
    prepare: Callable[[], PreparedSolver]

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Return u (n, channels) with ``A u = b``, and a report.

        Raises
        ------
        ConvergenceError
            If the tolerance is reached with neither preconditioner.
        """
        try:
            return self.iteration.solve(b, tolerance, guess, progress)
        except ConvergenceError:
            return self.prepare().solve(b, tolerance, guess, progress)
