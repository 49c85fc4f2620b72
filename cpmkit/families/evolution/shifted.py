"""Solving the linear systems of implicit steps: M + factor A, a few factors in all, one for nearly every step."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.families.context import SolveContext, left_side
from cpmkit.families.evolution.semidiscrete import ChannelGroup, SemiDiscrete
from cpmkit.forms.contract import conditions_depend_on_time
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.protocols import PreparedSolver, Stiffness
from cpmkit.linear.solve_report import SolveReport
from cpmkit.types import Floats


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
    solver : str
        The name of the last step's; empty before the first.
    """

    iterations: int = 0
    operator_applications: int = 0
    residual: float = 0.0
    solver: str = ""

    def add(self, other: SolveReport | SolveTally) -> None:
        """Count one solve, or what an earlier part of the run did."""
        self.iterations += other.iterations
        self.operator_applications += other.operator_applications
        self.residual = max(self.residual, other.residual)
        self.solver = other.solver


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
        columns = self.problem.columns
        return self.problem.joined(
            lambda group: self._solve(group, factor, columns(group, right_side), columns(group, guess))
        )

    def _solve(self, group: ChannelGroup, factor: float, right_side: Floats, guess: Floats) -> Floats:
        moves = conditions_depend_on_time(self.problem.form.scene)  # a form's mass may depend on it
        key = ("shifted", left_side(group.terms), moves, factor)
        prepared: tuple[PreparedSolver, ConstantFunctions] = self.context.kept.get(key, self._prepare, group, factor)
        solver, constants = prepared
        u, report = constants.solve(solver, right_side, self.context.tolerance, guess)
        self.tally.add(report)
        return self._with_totals_of(group, right_side, u)

    def _with_totals_of(self, group: ChannelGroup, right_side: Floats, u: Floats) -> Floats:
        """Return u moved by a constant on each piece that nothing flows out of, so that no heat is lost there.

        With B the pieces' indicators and ``A B = 0``, A symmetric, ``B' M u = B' right_side`` in the exact solution:
        the correction is that of a coarse level, and leaves all else of u at the solver's tolerance.
        """
        closed = self._closed[self.problem.groups.index(group)]
        if closed is None:
            return u
        indicator, masses = closed
        excess = indicator.T @ (right_side - self.problem.weighed(u))
        return np.asarray(u + indicator @ np.linalg.solve(masses, excess))

    @cached_property
    def _closed(self) -> list[tuple[Any, Floats] | None]:
        """Of each group the pieces on which a constant is free; None where A need not be symmetric."""
        return [self._closed_of(group.stiffness) for group in self.problem.groups]

    def _closed_of(self, stiffness: Stiffness) -> tuple[Any, Floats] | None:
        """Return the pieces on which a constant is free, as columns B, and B' M B."""
        free = self.problem.form.free_constants(stiffness) if stiffness.symmetric else None
        if free is None:
            return None
        indicator = free.indicator
        return indicator, np.asarray(indicator.T @ self.problem.weighed(indicator.toarray()))

    def _prepare(self, group: ChannelGroup, factor: float) -> tuple[PreparedSolver, ConstantFunctions]:
        operator = group.stiffness.scaled_plus_mass(factor, self.problem.form.mass_in_time)
        return self.context.prepare(operator), self.context.constants(operator)
