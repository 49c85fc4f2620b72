"""Steady problems whose diffusivity depends on u, by Newton's method or with the diffusivity of the last iterate.

The last step is always a linear steady problem with the diffusivity at the solution: it leaves the solution unchanged,
and provides the warnings of linear problems.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import ConvergenceError, SceneError
from cpmkit.families.context import OperatorCache, SolveContext
from cpmkit.families.quasilinear_steps import State, Steps
from cpmkit.families.steady import solve_steady
from cpmkit.forms.contract import integrals, require
from cpmkit.linear.solve_report import SolveReport
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.equations import Equation, Terms
from cpmkit.scene.nonlinear_equations import QuasilinearEquation
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats

#: The largest number of steps of each method.
MOST_STEPS = {"newton": 60, "lagged": 500}
#: A method has converged when a step changes u by at most this share of its range; lagged steps converge slowly.
CONVERGED_CHANGE_SHARE = {"newton": 1e-8, "lagged": 1e-6}
#: The same share for the equations of a continuation, before the equation itself.
APPROACHED_CHANGE_SHARE = 1e-2
#: Share of the largest value that is added to the range, because of the rounding of solutions far from zero.
ROUNDING_SHARE = 1e-5


@dataclass(frozen=True)
class StepRecord:
    """One step of the iteration.

    Attributes
    ----------
    change : float
        The largest change of u in the step, over the range of u.
    energy : float or None
        The energy that the solution minimises, where it is known.
    """

    change: float
    energy: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class QuasilinearRecord(SolutionRecord):
    """The solution of an equation whose diffusivity depends on u.

    Attributes
    ----------
    history : tuple of StepRecord
        The steps of the nonlinear iteration.
    """

    history: tuple[StepRecord, ...] = ()


@dataclass(frozen=True, eq=False)
class _FrozenEquation(Equation):
    """A linear equation with the diffusivity of a quasilinear equation at one iterate."""

    frozen_terms: Terms
    kind: ClassVar[str] = "frozen"

    def terms(self) -> Terms:
        return self.frozen_terms


@dataclass(frozen=True, eq=False)
class _StepCount:
    """Counts of linear iterations and operator products in all steps so far, and the records of the steps."""

    iterations: int = 0
    products: int = 0
    records: tuple[StepRecord, ...] = ()

    def plus(self, report: SolveReport, record: StepRecord) -> _StepCount:
        """Return the counts and records after one more step."""
        return _StepCount(
            self.iterations + report.iterations,
            self.products + report.operator_applications,
            (*self.records, record),
        )


def solve_quasilinear(context: SolveContext) -> QuasilinearRecord:
    """Solve a steady problem whose diffusivity depends on u, and return the solution with the history of the steps.

    Raises
    ------
    SceneError
        If the form does not have such diffusivities, or the scene has several channels.
    InputError
        If the diffusivity is not above zero.
    ConvergenceError
        If the steps do not converge.
    """
    form, problem = context.discretized, context.scene.problem
    assert isinstance(problem, QuasilinearEquation)
    require(form, "diffusivity that depends on u")
    if context.scene.channels > 1:
        raise SceneError(f"a diffusivity that depends on u takes one channel, the scene has {context.scene.channels}.")
    form.check(context.solver_name)
    terms = replace(problem.terms(), f=_CachedData(problem.terms().f))
    u = _first_iterate(context, problem, terms)
    penalty_scale = _mean_diffusivity(context, problem, u) if problem.uniform_penalty else None
    steps = Steps(context, terms, problem.diffusivity_of_u, form.load(terms.f), penalty_scale)
    u, count = _continued_iterate(steps, problem, u) if context.guess is None else (u, _StepCount())
    u, count = _converge(steps, problem, u, count)
    last = _solve_linear(context, steps.frozen_terms(u), u)
    name = "Newton's method" if problem.method == "newton" else "The lagged diffusivity"
    report = replace(
        last.report,
        iterations=count.iterations + last.report.iterations,
        operator_applications=count.products + last.report.operator_applications,
        reason=f"{last.report.reason}; {name} converged in {len(count.records)} steps",
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
        history=count.records,
    )


@dataclass(frozen=True, eq=False)
class _CachedData:
    """Data that every step evaluates at the same points; the values at the last points are cached."""

    data: Data
    cache: list[tuple[Floats, Floats]] = field(default_factory=list)
    takes_time: ClassVar[bool] = False

    def __call__(self, points: Floats) -> Floats:
        if not self.cache or not np.array_equal(self.cache[0][0], points):
            self.cache[:] = [(points, evaluate_data(self.data, points, None, "the right-hand side f"))]
        return self.cache[0][1]


def _first_iterate(context: SolveContext, problem: QuasilinearEquation, terms: Terms) -> Floats:
    """Return the first iterate (n, 1): the guess, the equation's initial guess, or the solution with diffusivity 1."""
    form, data = context.discretized, problem.initial_guess
    if context.guess is not None:
        return context.guess
    if data is not None:
        return form.interpolate(data, "the data")
    return _solve_linear(context, replace(terms, diffusivity=1.0)).values


def _solve_linear(context: SolveContext, terms: Terms, guess: Floats | None = None) -> SolutionRecord:
    """Return the solution of the linear steady problem with ``terms``, from the initial guess ``guess`` (n, 1)."""
    scene = replace(context.scene, problem=_FrozenEquation(terms))
    form = context.discretized.with_scene(scene)
    return solve_steady(replace(context, discretized=form, guess=guess, cache=OperatorCache()))


def _continued_iterate(steps: Steps, problem: QuasilinearEquation, u: Floats) -> tuple[Floats, _StepCount]:
    """Solve the equations of the continuation in turn, each from the solution of the one before.

    Return the last solution (n, 1), from which the problem itself starts, and the count of the steps taken.

    Raises
    ------
    ConvergenceError
        If the steps of one equation do not converge.
    """
    count = _StepCount()
    for nearer in problem.continuation:
        law = nearer.diffusivity_of_u
        nearer_steps = replace(steps, terms=replace(steps.terms, diffusivity=law), law=law)
        u, count = _converge(nearer_steps, nearer, u, count, APPROACHED_CHANGE_SHARE)
    return u, count


def _converge(
    steps: Steps, problem: QuasilinearEquation, u: Floats, count: _StepCount, share: float | None = None
) -> tuple[Floats, _StepCount]:
    """Step from u (n, 1) until a step changes u by at most a ``share`` of its range.

    Return u (n, 1) after that step, and ``count`` with the steps taken added.

    Raises
    ------
    ConvergenceError
        If no step up to the largest number of steps changes u so little.
    """
    method, state = problem.method, steps.state(u)
    share = CONVERGED_CHANGE_SHARE[method] if share is None else share
    step = steps.newton_step if method == "newton" else steps.lagged_step
    for _ in range(MOST_STEPS[method]):
        before = state.u
        state, report = step(state)
        count = count.plus(report, _step_record(steps, problem, before, state))
        change = count.records[-1].change
        if change <= share:
            return state.u, count
    other = "lagged" if method == "newton" else "newton"
    raise ConvergenceError(
        f"{problem.kind!r} did not converge in {MOST_STEPS[method]} steps of method={method!r}: u still changes by "
        f"{change:.2g} of its range; use method={other!r}, a larger regularization, or start from the solution "
        "of a problem that is nearer to a linear one (guess of Prepared.solve).",
        report,
    )


def _step_record(steps: Steps, problem: QuasilinearEquation, before: Floats, state: State) -> StepRecord:
    """Return the record of the step from the iterate ``before`` (n, 1) to ``state``."""
    form = steps.context.discretized
    old, new = form.at_points(before), form.at_points(state.u)
    size = float(np.ptp(new) + ROUNDING_SHARE * np.abs(new).max(initial=0.0)) or 1.0
    return StepRecord(float(np.abs(new - old).max(initial=0.0)) / size, _energy(steps, problem, state))


def _energy(steps: Steps, problem: QuasilinearEquation, state: State) -> float | None:
    """Return the energy that the solution minimises: the integral of its density, and terms quadratic and linear in u.

    ``u . A u / 2`` contains half of ``a |grad u|^2``, which is replaced by the density. None if no density is known.
    """
    form, u = steps.context.discretized, state.u
    slopes = form.gradient(u)[:, 0]
    density = problem.energy(slopes)
    if density is None:
        return None
    a = steps.law.at(form.at_points(u)[:, 0], slopes, form.points.copy())
    total = integrals(form, form.project((density - 0.5 * a * np.sum(slopes**2, axis=1))[:, None]))
    rest = np.sum(u * (0.5 * state.stiffness.apply(u) - state.b))
    return None if total is None else float(total[0] + rest)


def _mean_diffusivity(context: SolveContext, problem: QuasilinearEquation, u: Floats) -> float:
    """Return the geometric mean of the diffusivity over the form's points, at the iterate u (n, 1)."""
    form = context.discretized
    a = problem.diffusivity_of_u.at(form.at_points(u)[:, 0], form.gradient(u)[:, 0], form.points.copy())
    return float(np.exp(np.log(a).mean()))
