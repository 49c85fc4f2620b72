"""Solving the linear systems of implicit steps: I + factor A, a few factors in all, one for nearly every step."""

from __future__ import annotations

from dataclasses import dataclass, field

from cpmkit.linear.operators import LinearSystem, Operator
from cpmkit.linear.report import SolveReport
from cpmkit.protocols import Floats, LinearSolver, nothing

#: Factorisations that are kept: steps, the shortened ones before frames, and those that follow.
KEPT = 3


@dataclass
class Tally:
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

    def add(self, other: SolveReport | Tally) -> None:
        """Count one solve, or what an earlier part of the run did."""
        self.iterations += other.iterations
        self.operator_applications += other.operator_applications
        self.residual = max(self.residual, other.residual)


@dataclass(frozen=True, eq=False)
class ShiftedSolver:
    """Solves ``(I + factor A) u = right_side``.

    Attributes
    ----------
    operator : Operator
        A.
    solver : LinearSolver
        Solves each system.
    tolerance : float
        Relative residual of each.
    tally : Tally
        Counts what was done.
    shifted : dict
        The systems used last, by factor, with what the solver has cached on them.
    """

    operator: Operator
    solver: LinearSolver
    tolerance: float
    tally: Tally = field(default_factory=Tally)
    shifted: dict[float, Operator] = field(default_factory=dict)

    def solve(self, factor: float, right_side: Floats, guess: Floats) -> Floats:
        """Return u (n, channels).

        Raises
        ------
        ConvergenceError
            If the solver does not reach the tolerance.
        """
        system = self.shifted.pop(factor, None) or self.operator.shifted(factor)
        self.shifted[factor] = system
        while len(self.shifted) > KEPT:
            del self.shifted[next(iter(self.shifted))]
        u, report = self.solver(LinearSystem(system, right_side, guess), self.tolerance, nothing)
        self.tally.add(report)
        return u
