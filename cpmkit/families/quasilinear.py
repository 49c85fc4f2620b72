"""Steady problems whose diffusivity depends on u, by Newton's method or with the diffusivity of the step before.

Whatever the steps are, the last one is a linear steady problem with the diffusivity of the solution itself: it changes
nothing, and what is told of linear problems is told of it.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import ConvergenceError
from cpmkit.families.context import Kept, SolveContext
from cpmkit.families.quasilinear_steps import State, Steps
from cpmkit.families.steady import solve_steady
from cpmkit.forms.contract import require
from cpmkit.linear.solve_report import SolveReport
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.equations import Equation, Terms
from cpmkit.scene.nonlinear_equations import QuasilinearEquation, check_one_channel
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats

#: At most so many steps.
MOST_STEPS = {"newton": 60, "lagged": 500}
#: It has converged when u changes by less than this share of its range: what is lagged settles slowly.
CONVERGED_CHANGE_SHARE = {"newton": 1e-8, "lagged": 1e-6}
#: The same of equations that lead to the one that is solved.
APPROACHED_CHANGE_SHARE = 1e-2
#: To the range this share of the largest value is added, which is rounding: of a solution that is far from zero.
ROUNDING_SHARE = 1e-5


@dataclass(frozen=True)
class StepRecord:
    """One step.

    Attributes
    ----------
    change : float
        The largest change of u, over its range.
    energy : float or None
        What the solution makes least, where that is known.
    """

    change: float
    energy: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class QuasilinearRecord(SolutionRecord):
    """The solution of an equation whose diffusivity depends on it.

    Attributes
    ----------
    history : tuple of StepRecord
        The steps by which it was reached.
    """

    history: tuple[StepRecord, ...] = ()


@dataclass(frozen=True, eq=False)
class _Frozen(Equation):
    """An equation with its diffusivity at one state."""

    given: Terms
    kind: ClassVar[str] = "frozen"

    def terms(self) -> Terms:
        return self.given


@dataclass(frozen=True, eq=False)
class _Counted:
    """What the steps cost, and how they went."""

    iterations: int = 0
    products: int = 0
    records: tuple[StepRecord, ...] = ()

    def and_one(self, report: SolveReport, record: StepRecord) -> _Counted:
        return _Counted(
            self.iterations + report.iterations,
            self.products + report.operator_applications,
            (*self.records, record),
        )


def solve_quasilinear(context: SolveContext) -> QuasilinearRecord:
    """Solve a steady problem whose diffusivity depends on the solution.

    Raises
    ------
    SceneError
        If the form has no such diffusivities, or the scene several channels.
    InputError
        If the diffusivity is not above zero.
    ConvergenceError
        If the steps do not settle.
    """
    form, problem = context.discretized, context.scene.problem
    assert isinstance(problem, QuasilinearEquation)
    require(form, "diffusivity that depends on u")
    check_one_channel(context.scene.channels)
    form.check(context.solver_name)
    terms = replace(problem.terms(), f=_Remembered(problem.terms().f))
    u = _start(context, problem, terms)
    held = _mean_diffusivity(context, problem, u) if problem.uniform_penalty else None
    steps = Steps(context, terms, problem.diffusivity_of_u, form.load(terms.f), held)
    u, counted = _approached(steps, problem, u) if context.guess is None else (u, _Counted())
    u, counted = _settled(steps, problem, u, counted)
    last = _linear(context, steps.frozen(u), u)
    name = "Newton's method" if problem.method == "newton" else "The lagged diffusivity"
    report = replace(
        last.report,
        iterations=counted.iterations + last.report.iterations,
        operator_applications=counted.products + last.report.operator_applications,
        reason=f"{last.report.reason}; {name} settled in {len(counted.records)} steps",
    )
    work: Any = replace(last.work, operator_applications=report.operator_applications)  # type: ignore[type-var]
    seconds = {**last.seconds, "solve": time.perf_counter() - context.started - last.seconds["build"]}
    return QuasilinearRecord(
        form,
        last.values,
        report,
        work,
        seconds,
        warnings=last.warnings,
        imbalances=last.imbalances,
        history=counted.records,
    )


@dataclass(frozen=True, eq=False)
class _Remembered:
    """Data that are asked for at the same points in every step, and computed once."""

    given: Data
    known: list[tuple[Floats, Floats]] = field(default_factory=list)
    takes_time: ClassVar[bool] = False

    def __call__(self, points: Floats) -> Floats:
        if not self.known or not np.array_equal(self.known[0][0], points):
            self.known[:] = [(points, evaluate_data(self.given, points, None, "the right-hand side f"))]
        return self.known[0][1]


def _start(context: SolveContext, problem: QuasilinearEquation, terms: Terms) -> Floats:
    """Return where the steps begin (n, 1)."""
    form, data = context.discretized, problem.initial_guess
    if context.guess is not None:
        return context.guess
    if data is not None:
        return form.interpolate(data, "the data")
    return _linear(context, replace(terms, diffusivity=1.0)).values


def _linear(context: SolveContext, terms: Terms, guess: Floats | None = None) -> SolutionRecord:
    """Return the solution of the linear problem with ``terms``."""
    scene = replace(context.scene, problem=_Frozen(terms))
    form = context.discretized.with_scene(scene)
    return solve_steady(replace(context, discretized=form, guess=guess, kept=Kept()))


def _approached(steps: Steps, problem: QuasilinearEquation, u: Floats) -> tuple[Floats, _Counted]:
    """Return a start (n, 1): about the solution of the last equation of the approach, each solved from the one before.

    Raises
    ------
    ConvergenceError
        If one of them does not settle.
    """
    counted = _Counted()
    for nearer in problem.continuation:
        law = nearer.diffusivity_of_u
        own = replace(steps, terms=replace(steps.terms, diffusivity=law), law=law)
        u, counted = _settled(own, nearer, u, counted, APPROACHED_CHANGE_SHARE)
    return u, counted


def _settled(
    steps: Steps, problem: QuasilinearEquation, u: Floats, counted: _Counted, share: float | None = None
) -> tuple[Floats, _Counted]:
    """Return where the steps settle (n, 1): change by less than a ``share`` of u's range, that of the method.

    Raises
    ------
    ConvergenceError
        If there were too many.
    """
    method, state = problem.method, steps.state(u)
    share = CONVERGED_CHANGE_SHARE[method] if share is None else share
    step = steps.newton if method == "newton" else steps.lagged
    for _ in range(MOST_STEPS[method]):
        before = state.u
        state, report = step(state)
        counted = counted.and_one(report, _record(steps, problem, before, state))
        change = counted.records[-1].change
        if change <= share:
            return state.u, counted
    other = "lagged" if method == "newton" else "newton"
    raise ConvergenceError(
        f"{problem.kind!r} did not settle in {MOST_STEPS[method]} steps of method={method!r}: u still changes by "
        f"{change:.2g} of its range; use method={other!r}, a larger regularization, or start from the solution "
        "of a problem that is nearer to a linear one (guess of Prepared.solve).",
        report,
    )


def _record(steps: Steps, problem: QuasilinearEquation, before: Floats, state: State) -> StepRecord:
    form = steps.context.discretized
    old, new = form.at_points(before), form.at_points(state.u)
    size = float(np.ptp(new) + ROUNDING_SHARE * np.abs(new).max(initial=0.0)) or 1.0
    return StepRecord(float(np.abs(new - old).max(initial=0.0)) / size, _energy(steps, problem, state))


def _energy(steps: Steps, problem: QuasilinearEquation, state: State) -> float | None:
    """Return what the solution makes least: the integral of the density, and what is quadratic and linear in u.

    ``u . A u / 2`` holds half of ``a s^2``, in whose place the density stands.
    """
    form, u = steps.context.discretized, state.u
    slopes = form.gradient(u)[:, 0]
    density = problem.energy(slopes)
    if density is None:
        return None
    a = steps.law.at(form.at_points(u)[:, 0], slopes, form.points.copy())
    total = form.integrals(form.project((density - 0.5 * a * np.sum(slopes**2, axis=1))[:, None]))
    rest = np.sum(u * (0.5 * state.stiffness.apply(u) - state.b))
    return None if total is None else float(total[0] + rest)


def _mean_diffusivity(context: SolveContext, problem: QuasilinearEquation, u: Floats) -> float:
    """Return the geometric mean of the diffusivity at u."""
    form = context.discretized
    a = problem.diffusivity_of_u.at(form.at_points(u)[:, 0], form.gradient(u)[:, 0], form.points.copy())
    return float(np.exp(np.log(a).mean()))
