"""Equations in time discretised in space: the linear systems of implicit steps, and a run of steps and moments.

The equations are M u' = -A u + r(u) + b(t), or M u'' = -A u + b(t) for waves. Implicit steps solve systems with
``M + factor A``, for few different factors in a run. Steps are equal, except for a shorter step before a frame and
before the end where the step does not fit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.families.context import PreparedSystem, SolveContext, operator_key
from cpmkit.forms.contract import Discretized
from cpmkit.linear.operators import Stiffness
from cpmkit.linear.residuals import SolveReport
from cpmkit.scene.data import Data, Reaction, call_pointwise, takes_time
from cpmkit.scene.equations import Terms
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.scene.member_data import ReactionAt
from cpmkit.scene.scene import conditions_depend_on_time
from cpmkit.types import Floats

#: A rest of time up to this share of a step is rounding, for which no step is made.
ROUNDED_STEP_SHARE = 1e-9
REMEMBERED_MOMENTS = 3  #: Number of moments that schemes read.


@dataclass(frozen=True)
class Step:
    """One step in time."""

    #: start, end: Times at the ends of the step.
    start: float
    end: float
    length: float  #: ``end - start`` up to rounding; equal steps have equal lengths.
    is_frame: bool  #: Whether the solution at the end is stored.


@dataclass(frozen=True, eq=False)
class Moment:
    """The unknowns at one time."""

    u: Floats  #: (n, channels): values of the unknowns.
    rate: Floats | None  #: (n, channels): for a wave the derivative of u in time; for leapfrog that half a step before.
    length: float  #: Length of the step that ends at this time; zero at the start.
    acceleration: Floats | None = None  #: (n, channels): for leapfrog the second derivatives at the start of that step.
    time: float = 0.0  #: The time, as the schedule has it.


History = Sequence[Moment]


def schedule(until: float, step: float, frames: Sequence[float], start: float = 0.0) -> list[Step]:
    """Return steps of length ``step`` or less from ``start`` to ``until``, one ending at each later time of ``frames``.

    Examples
    --------
    >>> [(each.end, each.length) for each in schedule(1.0, 0.4, ())]
    [(0.4, 0.4), (0.8, 0.4), (1.0, 0.2)]
    """
    steps: list[Step] = []
    begin = start
    for stop in sorted({*(time for time in frames if time > start), until}):
        steps += _steps_between(begin, stop, step, stop in frames)
        begin = stop
    return steps


def _steps_between(start: float, stop: float, step: float, is_frame: bool) -> Iterator[Step]:
    """Yield equal steps from ``start`` to ``stop``; the last is shorter if they do not fit, a frame if ``is_frame``."""
    ratio = (stop - start) / step
    whole = int(ratio + ROUNDED_STEP_SHARE)
    rest = round(ratio - whole, 9)  # equal steps share a system
    lengths = [step] * whole + ([rest * step] if rest > ROUNDED_STEP_SHARE else []) or [stop - start]
    times = [start, *(start + number * step for number in range(1, len(lengths))), stop]
    for number, length in enumerate(lengths):
        yield Step(times[number], times[number + 1], length, is_frame and number == len(lengths) - 1)


@dataclass(frozen=True, eq=False)
class RunPlan:
    """The definition of a run."""

    problem: SemiDiscrete  #: The equation discretised in space.
    evolution: Evolution  #: The equation, its scheme and its step.
    steps: Sequence[Step]  #: All steps from the start to the end.
    start: Moment  #: The unknowns at the start.


@dataclass(frozen=True, eq=False)
class RunState:
    """The state of a run after some of its steps."""

    done: int  #: Number of steps taken.
    history: tuple[Moment, ...]  #: The last moments, the latest last.
    frames: tuple[Floats, ...] = ()  #: tuple of (n, channels) float64: values of the unknowns at the frames so far.
    energies: tuple[Floats, ...] = ()  #: tuple of (channels,): the energy of a wave at each frame, if it has one.

    def with_frame(self, u: Floats, energy: Floats | None) -> RunState:
        """Return the state with one more frame u (n, channels) and, for a wave, its energy (channels,)."""
        energies = self.energies if energy is None else (*self.energies, energy)
        return replace(self, frames=(*self.frames, u), energies=energies)


def apply_after_step(form: Discretized, evolution: Evolution, moment: Moment) -> Moment:
    """Return ``moment`` with u projected after ``evolution.after_step`` changed its values at the form's points.

    Without such a function or a change, ``moment`` itself is returned.
    """
    if evolution.after_step is None:
        return moment
    values = form.at_points(moment.u)
    arrays = form.points.copy(), values.copy()
    changed = call_pointwise(evolution.after_step, arrays, values.shape, "after_step", moment.time, least=2)
    if np.array_equal(changed, values):
        return moment
    return replace(moment, u=form.project(changed, moment.u, moment.time))


def rate_of_change(form: Discretized, start: Moment, history: History) -> float:
    """Return the relative change of u in the last step, per unit of time; infinite before the first step.

    The change is a root mean square over the manifold, summed over the channels, relative to the size of u at ``start``
    or now (the last of ``history``), whichever is larger; zero if both are zero.
    """
    if len(history) < 2 or history[-1].length == 0:
        return float("inf")
    now = history[-1].u
    size = max(_rms(form, start.u), _rms(form, now))
    return _rms(form, now - history[-2].u) / (history[-1].length * size) if size > 0 else 0.0


def _rms(form: Discretized, u: Floats) -> float:
    """Return the root mean square of u (n, channels) over the manifold, with the channels' squares summed."""
    return float(np.sqrt(max(np.trace(form.inner(u, u)), 0.0)))


@dataclass(frozen=True, eq=False)
class ChannelGroup:
    """The channels that have the same operator A."""

    channels: tuple[int, ...]  #: Numbers of the channels.
    terms: Terms  #: Terms of the equation's spatial part.
    stiffness: Stiffness  #: The operator A.


@dataclass(frozen=True, eq=False)
class SemiDiscrete:
    """The operator A of each group of channels, the mass matrix M, the reaction r(u) and the forcing b(t)."""

    form: Discretized  #: The discretised scene, with M.
    groups: tuple[ChannelGroup, ...]  #: The groups; each channel belongs to one.
    f: Data  #: Right-hand side.
    reaction: Reaction | None = None  #: Reaction, a function of values of u, points and the time.
    #: The cached loads of the reaction, each after the values u of its moment.
    _reactions: list[tuple[Floats, Floats]] = field(default_factory=list)

    @property
    def stiffness(self) -> Stiffness:
        """The operator A of the first channel."""
        return self.groups[0].stiffness

    def compute_by_group(self, columns_of: Callable[[ChannelGroup], Floats]) -> Floats:
        """Return the array (n, channels) whose columns ``columns_of`` computes group by group."""
        if len(self.groups) == 1:
            return columns_of(self.groups[0])
        values = np.empty((self.form.size, self.form.scene.channels))
        for group in self.groups:
            values[:, group.channels] = columns_of(group)
        return values

    def columns(self, group: ChannelGroup, values: Floats) -> Floats:
        """Return the columns of ``values`` (n, channels) that belong to the channels of a group."""
        return values if len(self.groups) == 1 else np.ascontiguousarray(values[:, group.channels])

    @property
    def depends_on_time(self) -> bool:
        """Whether the forcing b depends on the time."""
        return takes_time(self.f) or conditions_depend_on_time(self.form.scene)

    @cached_property
    def _load(self) -> Floats:
        """The load (n, channels) of f at time 0."""
        return self.form.load(self.f, 0.0)

    @cached_property
    def steady_forcing(self) -> Floats:
        """The forcing b (n, channels) at time 0."""
        return self._load + self._condition_load(0.0)

    def forcing(self, time: float) -> Floats:
        """Return the forcing b (n, channels) at a time: cached if no data depend on it, the load of f if f does not."""
        if not self.depends_on_time:
            return self.steady_forcing
        load = self.form.load(self.f, time) if takes_time(self.f) else self._load
        return load + self._condition_load(time)

    def _condition_load(self, time: float) -> Floats:
        """Return the part (n, channels) of the forcing b that comes from boundary and edge conditions, at a time."""
        return self.compute_by_group(lambda group: self.columns(group, self.form.condition_load(group.stiffness, time)))

    def reaction_load(self, moment: Moment) -> Floats:
        """Return the load r(u) (n, channels) of the reaction at a moment.

        The last two loads are cached by the identity of the array ``u``, whatever the time: to get the load of the same
        values at another time, pass a moment with a copy of ``u``.
        """
        for u, load in self._reactions:
            if u is moment.u:
                return load
        reaction, start = self.reaction, self.form.scene.problem.start_time or 0.0
        assert reaction is not None
        load = self.form.reaction_load(ReactionAt(reaction, moment.time, start), moment.u)
        self._reactions[:] = [*self._reactions[-1:], (moment.u, load)]
        return load

    def apply_mass(self, u: Floats) -> Floats:
        """Return M u (n, k) for u (n, k) and the form's ``mass_in_time`` M; u itself if there is none."""
        mass = self.form.mass_in_time
        return u if mass is None else mass.apply(u)

    def net_forcing(self, u: Floats, time: float) -> Floats:
        """Return -A u + b(time), which is M u' or M u'' without a reaction, (n, channels)."""
        applied = self.compute_by_group(lambda group: group.stiffness.apply(self.columns(group, u)))
        return np.asarray(self.forcing(time) - applied)


def largest_lattice_eigenvalue(problem: SemiDiscrete, speed: float) -> float:
    """Return the largest eigenvalue of ``-speed^2 Lap`` for second-order differences in space on the form's lattice."""
    return float(4 * problem.form.scene.surface.dim * speed**2 / problem.form.spacing**2)


@dataclass
class SolveTally:
    """Counts of the linear solves of a run."""

    iterations: int = 0  #: Iterations of all solves.
    operator_applications: int = 0  #: Products with A, one counted for each channel.
    residual: float = 0.0  #: The largest relative residual of a solve.
    solver: str = ""  #: Name of the solver of the last step; empty before the first step.

    def add(self, other: SolveReport | SolveTally) -> None:
        """Add in place the counts of ``other``, a solve or an earlier part of the run; keep the larger residual."""
        self.iterations += other.iterations
        self.operator_applications += other.operator_applications
        self.residual = max(self.residual, other.residual)
        self.solver = other.solver


@dataclass(frozen=True, eq=False)
class ShiftedSolver:
    """Solver of systems ``(M + factor A) u = right_side``."""

    problem: SemiDiscrete  #: The problem, with A and M.
    context: SolveContext  #: The context, with the linear solver and its tolerance.
    tally: SolveTally = field(default_factory=SolveTally)  #: Counts of the solves.

    def solve(self, factor: float, right_side: Floats, guess: Floats) -> Floats:
        """Return the solution u (n, channels) of ``(M + factor A) u = right_side``, from the initial guess ``guess``.

        Raises ConvergenceError if the solver does not reach the tolerance.
        """
        columns = self.problem.columns
        return self.problem.compute_by_group(
            lambda group: self._solve(group, factor, columns(group, right_side), columns(group, guess))
        )

    def _solve(self, group: ChannelGroup, factor: float, right_side: Floats, guess: Floats) -> Floats:
        """Return u (n, k) for the k channels of a group, and count the solve; the system of ``factor`` is cached."""
        depends_on_time = conditions_depend_on_time(self.problem.form.scene)  # and so may the mass matrix
        key = ("shifted", operator_key(group.terms), depends_on_time, factor)
        system: PreparedSystem = self.context.cache.get(key, self._prepare, group, factor)
        u, report = system.solve(right_side, self.context.tolerance, guess)
        self.tally.add(report)
        return self._with_exact_totals(group, right_side, u)

    def _with_exact_totals(self, group: ChannelGroup, right_side: Floats, u: Floats) -> Floats:
        """Return u (n, k) plus a constant on each piece where A fixes none, so that heat is conserved there.

        With B the indicators of the pieces and ``A B = 0``, A symmetric, the exact solution has
        ``B' M u = B' right_side``: the correction is that of a coarse level, and does not change the error of the rest
        of u.
        """
        closed = self._closed_pieces[self.problem.groups.index(group)]
        if closed is None:
            return u
        indicator, masses = closed
        excess = indicator.T @ (right_side - self.problem.apply_mass(u))
        return np.asarray(u + indicator @ np.linalg.solve(masses, excess))

    @cached_property
    def _closed_pieces(self) -> list[tuple[Any, Floats] | None]:
        """For each group, indicators B (n, pieces) of pieces where symmetric A fixes no constant, B' M B; or None."""
        pieces: list[tuple[Any, Floats] | None] = []
        for stiffness in (group.stiffness for group in self.problem.groups):
            free = self.problem.form.free_constants(stiffness) if stiffness.symmetric else None
            of_group = None
            if free is not None:
                B = free.indicator
                of_group = B, np.asarray(B.T @ self.problem.apply_mass(B.toarray()))
            pieces.append(of_group)
        return pieces

    def _prepare(self, group: ChannelGroup, factor: float) -> PreparedSystem:
        """Return the prepared system of ``M + factor A``, A being the operator of a group."""
        mass = self.problem.form.mass_in_time
        return self.context.prepare_system(group.stiffness.scaled_plus_mass(factor, mass))
