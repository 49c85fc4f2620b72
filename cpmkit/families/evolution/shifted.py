"""Solving the linear systems of implicit steps: M + factor A, a few factors in all, one for nearly every step."""

from __future__ import annotations

from dataclasses import dataclass, field

from cpmkit.families.context import SolveContext, left_side
from cpmkit.families.evolution.semidiscrete import SemiDiscrete
from cpmkit.linear.report import SolveReport
from cpmkit.protocols import Floats, PreparedSolver


@dataclass
class SolveTally:
    """What the steps of a run did so far.

    Attributes
    ----------
    iterations : int
        Of all steps.
    operator_applications : int
        Products with A, all channels together.
    residual : float
        The largest relative residual of a step.
    """

    iterations: int = 0
    operator_applications: int = 0
    residual: float = 0.0

    def add(self, other: SolveReport | SolveTally) -> None:
        """Count one solve, or what an earlier part of the run did."""
        self.iterations += other.iterations
        self.operator_applications += other.operator_applications
        self.residual = max(self.residual, other.residual)


@dataclass(frozen=True, eq=False)
class ShiftedSolver:
    """Solves ``(M + factor A) u = right_side``.

    Attributes
    ----------
    problem : SemiDiscrete
        With A and M.
    context : SolveContext
        With the solver and its tolerance.
    tally : SolveTally
        Counts what was done.
    """

    problem: SemiDiscrete
    context: SolveContext
    tally: SolveTally = field(default_factory=SolveTally)

    def solve(self, factor: float, right_side: Floats, guess: Floats) -> Floats:
        """Return u (n, channels).

        Raises
        ------
        ConvergenceError
            If the solver does not reach the tolerance.
        """
        terms, form = self.context.scene.problem.terms(), self.context.discretized
        key = ("shifted", left_side(terms), form.data_move, factor)  # a form's mass may tell whether its data move
        solver: PreparedSolver = self.context.kept.get(key, self._prepare, factor)
        u, report = solver.solve(right_side, self.context.tolerance, guess)
        self.tally.add(report)
        return u

    def _prepare(self, factor: float) -> PreparedSolver:
        return self.context.prepare(self.problem.stiffness.shifted(factor, self.problem.form.mass))
