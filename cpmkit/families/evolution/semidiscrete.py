"""A problem in time, discretised in space, and the linear systems of its implicit steps.

M u' = -A u + r(u) + b(t), or M u'' for waves. Steps solve with ``M + factor A``, for a few factors in all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.families.context import SolveContext, operator_key
from cpmkit.families.evolution.schedule import Moment
from cpmkit.forms.contract import Discretized, conditions_depend_on_time
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.protocols import PreparedSolver, Stiffness
from cpmkit.linear.solve_report import SolveReport
from cpmkit.scene.data import Data, takes_time
from cpmkit.scene.equations import Terms
from cpmkit.scene.pointwise import Reaction, reaction_rates
from cpmkit.types import Floats


@dataclass(frozen=True, eq=False)
class ChannelGroup:
    """The channels that share an operator.

    Attributes
    ----------
    channels : tuple of int
        Their numbers.
    terms : Terms
        Of the equation's spatial part.
    stiffness : Stiffness
        A.
    """

    channels: tuple[int, ...]
    terms: Terms
    stiffness: Stiffness


@dataclass(frozen=True, eq=False)
class SemiDiscrete:
    """A of each group of channels, M, r(u) and b(t).

    Attributes
    ----------
    form : Discretized
        The scene, with M.
    groups : tuple of ChannelGroup
        Every channel is in one of them.
    f : Data
        Right-hand side.
    reaction : callable, optional
        Of values of u, points and the time.
    """

    form: Discretized
    groups: tuple[ChannelGroup, ...]
    f: Data
    reaction: Reaction | None = None

    @property
    def stiffness(self) -> Stiffness:
        """A of the first channel."""
        return self.groups[0].stiffness

    def by_group(self, columns_of: Callable[[ChannelGroup], Floats]) -> Floats:
        """Return the columns that ``columns_of`` computes for each group, as one array (n, channels)."""
        if len(self.groups) == 1:
            return columns_of(self.groups[0])
        values = np.empty((self.form.size, self.form.scene.channels))
        for group in self.groups:
            values[:, group.channels] = columns_of(group)
        return values

    def columns(self, group: ChannelGroup, values: Floats) -> Floats:
        """Return the columns of a group in ``values`` (n, channels)."""
        return values if len(self.groups) == 1 else np.ascontiguousarray(values[:, group.channels])

    @property
    def depends_on_time(self) -> bool:
        """Whether b depends on the time."""
        return takes_time(self.f) or conditions_depend_on_time(self.form.scene)

    @cached_property
    def _load(self) -> Floats:
        return self.form.load(self.f, 0.0)

    @cached_property
    def steady_forcing(self) -> Floats:
        """The forcing b (n, channels) at time 0."""
        return self._load + self._condition_load(0.0)

    def forcing(self, time: float) -> Floats:
        """Return b(time), (n, channels); data that do not depend on the time are read once."""
        if not self.depends_on_time:
            return self.steady_forcing
        load = self.form.load(self.f, time) if takes_time(self.f) else self._load
        return load + self._condition_load(time)

    def _condition_load(self, time: float) -> Floats:
        return self.by_group(lambda group: self.columns(group, self.form.condition_load(group.stiffness, time)))

    def reacting(self, moment: Moment) -> Floats:
        """Return r(u) at a moment, (n, channels); those of the last moments are cached."""
        for u, load in self._reactions:
            if u is moment.u:
                return load
        reaction, start = self.reaction, self.form.scene.problem.start_time or 0.0
        assert reaction is not None
        load = self.form.reaction_load(
            lambda values, points: reaction_rates(reaction, values, points, moment.time, start), moment.u
        )
        self._reactions[:] = [*self._reactions[-1:], (moment.u, load)]
        return load

    @cached_property
    def _reactions(self) -> list[tuple[Floats, Floats]]:
        return []

    def times_mass(self, u: Floats) -> Floats:
        """Return M u."""
        mass = self.form.mass_in_time
        return u if mass is None else mass.apply(u)

    def rate(self, u: Floats, time: float) -> Floats:
        """Return M u' = -A u + b(time)."""
        applied = self.by_group(lambda group: group.stiffness.apply(self.columns(group, u)))
        return np.asarray(self.forcing(time) - applied)


def largest_eigenvalue(problem: SemiDiscrete, speed: float) -> float:
    """Return the largest eigenvalue of ``-speed^2 Lap`` by differences of second order on the nodes of a lattice."""
    return float(4 * problem.form.scene.surface.dim * speed**2 / problem.form.spacing**2)


@dataclass
class SolveTally:
    """Counts of the linear solves of a run.

    Attributes
    ----------
    iterations : int
        Of all steps.
    operator_applications : int
        Products with A, all channels counted.
    residual : float
        The largest relative residual of a step.
    solver : str
        Name of the last step's solver; empty before the first.
    """

    iterations: int = 0
    operator_applications: int = 0
    residual: float = 0.0
    solver: str = ""

    def add(self, other: SolveReport | SolveTally) -> None:
        """Add one solve, or the counts of an earlier part of the run."""
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
        Counts of the solves.
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
        return self.problem.by_group(
            lambda group: self._solve(group, factor, columns(group, right_side), columns(group, guess))
        )

    def _solve(self, group: ChannelGroup, factor: float, right_side: Floats, guess: Floats) -> Floats:
        depends_on_time = conditions_depend_on_time(self.problem.form.scene)  # so may the mass matrix
        key = ("shifted", operator_key(group.terms), depends_on_time, factor)
        prepared: tuple[PreparedSolver, ConstantFunctions] = self.context.cache.get(key, self._prepare, group, factor)
        solver, constants = prepared
        u, report = constants.solve(solver, right_side, self.context.tolerance, guess)
        self.tally.add(report)
        return self._with_exact_totals(group, right_side, u)

    def _with_exact_totals(self, group: ChannelGroup, right_side: Floats, u: Floats) -> Floats:
        """Return u plus a constant on each piece that nothing flows out of, so that heat is conserved there.

        With B the pieces' indicators and ``A B = 0``, A symmetric, the exact solution has ``B' M u = B' right_side``:
        the correction is that of a coarse level, and leaves the rest of u at the solver's tolerance.
        """
        closed = self._closed_pieces[self.problem.groups.index(group)]
        if closed is None:
            return u
        indicator, masses = closed
        excess = indicator.T @ (right_side - self.problem.times_mass(u))
        return np.asarray(u + indicator @ np.linalg.solve(masses, excess))

    @cached_property
    def _closed_pieces(self) -> list[tuple[Any, Floats] | None]:
        """For each group the pieces on which a constant is free; None where A is not symmetric or there are none."""
        return [self._closed_pieces_of(group.stiffness) for group in self.problem.groups]

    def _closed_pieces_of(self, stiffness: Stiffness) -> tuple[Any, Floats] | None:
        """Return the pieces on which a constant is free, as columns B, and B' M B."""
        free = self.problem.form.free_constants(stiffness) if stiffness.symmetric else None
        if free is None:
            return None
        return free.indicator, np.asarray(free.indicator.T @ self.problem.times_mass(free.indicator.toarray()))

    def _prepare(self, group: ChannelGroup, factor: float) -> tuple[PreparedSolver, ConstantFunctions]:
        operator = group.stiffness.scaled_plus_mass(factor, self.problem.form.mass_in_time)
        return self.context.prepare(operator), self.context.constants(operator)
