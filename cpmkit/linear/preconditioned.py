"""Conjugate gradients for symmetric operators, with a step of whatever kind as preconditioner.

Where constants are free on pieces of the manifold, the iteration runs in the complement of the pieces' indicators, and
what the border adds is added after.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np

from cpmkit.errors import ConvergenceError, SceneError
from cpmkit.linear.csr_matrices import SymmetricCsr, UnsignedCsr
from cpmkit.linear.direct import Indefinite
from cpmkit.linear.krylov import conjugate_gradients
from cpmkit.linear.operators import Bordered
from cpmkit.linear.solve_report import SolveReport, judge
from cpmkit.protocols import Floats, Operator, PreparedSolver, Progress, no_progress

#: The recursive residual is driven this much below the tolerance, because it drifts from the true one, a little.
RECURSION_SHARE = 0.9
#: At most this many fresh starts from the true residual.
FRESH_STARTS = 3
#: Where nothing is asked for: the preconditioned residual falls to this share, the residual to so many times as much.
#: It leaves less than .05 percent of a discretisation's error, with conditions on curves too.
PRECONDITIONED_SHARE, RESIDUAL_SLACK = 1e-8, 100.0


class Step(Protocol):
    """What preconditions: linear, symmetric and positive."""

    @property
    def products(self) -> int:
        """How many products with the matrix it takes."""

    def apply(self, b: Floats, /) -> Floats:
        """Return x (n, channels), about the solution of ``A x = b``."""


def without_border(operator: Operator, solver: str) -> tuple[Operator, Bordered | None]:
    """Return a real symmetric operator, and its border where it has one.

    Raises
    ------
    SceneError
        If it is another one; ``solver`` is named.
    """
    bordered = operator if isinstance(operator, Bordered) else None
    inner = operator if bordered is None else bordered.operator
    if not inner.symmetric or np.iscomplexobj(inner.diagonal):
        raise SceneError(f"solver {solver!r} solves real symmetric systems, got another one; use solver='direct'.")
    return inner, bordered


@dataclass(frozen=True, eq=False)
class Preconditioned:
    """An operator with what preconditions it.

    Attributes
    ----------
    operator : Operator
        What is solved with.
    matrix : UnsignedCsr or SymmetricCsr
        A.
    bordered : Bordered, optional
        ``A + s F W`` where constants are free.
    preconditioner : Step
        Of A.
    max_iterations : int
        At most.
    solver : str
        The solver's name, for reports.
    slack : float
        How many times the preconditioned residual has to fall below the tolerance, which is the residual's.
    more_exact : callable, optional
        Returns a preconditioner with less rounding, to be tried before a system is refused.
    """

    operator: Operator
    matrix: UnsignedCsr | SymmetricCsr
    bordered: Bordered | None
    preconditioner: Step
    max_iterations: int
    solver: str
    slack: float = 1.0
    more_exact: Callable[[], Step] | None = None

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
            return self._solve(b, tolerance, guess, progress)
        except ConvergenceError:
            if self.more_exact is None:
                raise
        return self._with_less_rounding.solve(b, tolerance, guess, progress)

    @cached_property
    def _with_less_rounding(self) -> Preconditioned:
        assert self.more_exact is not None
        return replace(self, preconditioner=self.more_exact(), more_exact=None)

    def _solve(
        self, b: Floats, tolerance: float, guess: Floats | None, progress: Progress
    ) -> tuple[Floats, SolveReport]:
        size = np.linalg.norm(b, axis=0)
        u = np.zeros_like(b) if guess is None else guess.copy()
        u[:, size == 0] = 0.0  # the solution there; no guess gets nearer, and there is no relative residual to aim at
        compatible, means = self._compatible(b)
        iterations = products = 0
        for started in range(FRESH_STARTS):
            residual = self.matrix.residual(u, compatible)
            products += b.shape[1]
            accepted = tolerance if started else tolerance / self.slack  # a guess has no preconditioned residual yet
            open_ = np.flatnonzero(np.linalg.norm(residual, axis=0) > accepted * size)
            if not len(open_) or iterations >= self.max_iterations:
                break
            left, target = self.max_iterations - iterations, RECURSION_SHARE * tolerance * size[open_]
            residual = np.ascontiguousarray(residual[:, open_])
            try:
                step, taken = conjugate_gradients(
                    self.matrix.apply, self.precondition, residual, target, left, progress, self.slack
                )
            except Indefinite as error:
                raise indefinite(self.solver, error, iterations, tolerance) from error
            u[:, open_] += step
            iterations += taken
            products += (taken + (taken + 1) * self.preconditioner.products) * len(open_)
        if self.bordered is not None:
            border = self.bordered.border
            u += border.indicator @ (means - border.mean @ u)
        progress("solve", 1.0)
        remedy = "ask for a larger solver_tolerance or more max_iterations, or use solver='direct'"
        return u, judge(self.operator, b, u, self.solver, tolerance, iterations, products, remedy)

    def _compatible(self, b: Floats) -> tuple[Floats, Floats]:
        """Return b less what has no solution on free pieces, and the means (k, channels) that this is moved to."""
        if self.bordered is None:
            return b, np.zeros((0, b.shape[1]))
        indicator, carried = self.bordered.border.indicator, self.bordered.border.carried
        excess = np.linalg.solve((indicator.T @ carried).toarray(), indicator.T @ b)
        return b - carried @ excess, excess / self.bordered.shift

    @property
    def step_products(self) -> int:
        """How many products with A the preconditioner takes, a channel."""
        return self.preconditioner.products

    def precondition(self, residual: Floats) -> Floats:
        """Return one step from a residual (n, channels)."""
        return self._centred(self.preconditioner.apply(self._centred(residual)))

    def _centred(self, vector: Floats) -> Floats:
        """Return the part of a vector that is orthogonal to the free pieces' indicators."""
        if self.bordered is None:
            return vector
        indicator = self.bordered.border.indicator
        sums, members = indicator.T @ vector, indicator.sum(axis=0)
        return np.asarray(vector - indicator @ (sums / members[:, None]))


def followed_by_error(prepared: PreparedSolver) -> tuple[PreparedSolver, float] | None:
    """Return the solver that looks at its preconditioned residual first, and its tolerance; None where it is no better.

    With a multigrid's cycle that residual follows the error of u, whatever the spacing; with a diagonal it does not.
    """
    if not isinstance(prepared, Preconditioned) or prepared.solver != "multigrid":
        return None
    return replace(prepared, slack=RESIDUAL_SLACK), RESIDUAL_SLACK * PRECONDITIONED_SHARE


def indefinite(solver: str, error: Indefinite, iterations: int, tolerance: float) -> ConvergenceError:
    """Return what tells that a system is indefinite, and where that showed."""
    report = SolveReport(solver, False, iterations, 0, np.inf, tolerance, str(error))
    return ConvergenceError(
        f"The system is indefinite, and solver {solver!r} stopped after {iterations} iterations: {error}; use "
        "solver='direct', or a smaller spacing.",
        report,
    )


@runtime_checkable
class Lends(PreparedSolver, Protocol):
    """A prepared solver whose preconditioner serves other operators of its size, with more iterations."""

    @property
    def operator(self) -> Operator:
        """That it was made for."""

    def for_operator(self, operator: Operator, /) -> PreparedSolver:
        """Return the iteration for another operator with the same preconditioner."""


@dataclass(frozen=True, eq=False)
class Lent:
    """The iteration with what another one lends, and what prepares its own should that not do.

    Attributes
    ----------
    iteration : PreparedSolver
        With the preconditioner that was lent.
    prepare : callable
        Returns the one with its own.
    """

    iteration: PreparedSolver
    prepare: Callable[[], PreparedSolver]

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Solve for all channels.

        Raises
        ------
        ConvergenceError
            If neither preconditioner leads to the tolerance.
        """
        try:
            return self.iteration.solve(b, tolerance, guess, progress)
        except ConvergenceError:
            return self.prepare().solve(b, tolerance, guess, progress)
