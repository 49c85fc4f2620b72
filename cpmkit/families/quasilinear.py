"""Steady problems whose diffusivity or fluxes depend on u, as a sequence of linear problems on the same tables.

A diffusivity that depends on u is that of the last iterate, or linearised (Newton's method). A Newton tangent is
symmetric except for the derivative of the diffusivity with respect to u: systems with the symmetric part are solved by
the linear solver, systems with the whole tangent by GMRES, preconditioned with the symmetric part. The last step is
always a linear steady problem with the diffusivity at the solution: it leaves the solution unchanged, and provides the
warnings of linear problems. A flux ``du/db = j(u)`` is linearised at the last solution v:
``du/db = j(v) + j'(v) (u - v)`` is a Robin condition.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, cast

import numpy as np

from cpmkit.errors import ConvergenceError, InputError, SceneError, place
from cpmkit.families.context import OperatorCache, SolveContext
from cpmkit.families.steady import solve_steady
from cpmkit.forms.contract import integrals, require_ability
from cpmkit.forms.form_records import StateDependentCoefficient
from cpmkit.linear.operators import Border, Bordered, Operator, Stiffness
from cpmkit.linear.residuals import SolveReport
from cpmkit.scene.diffusivities import StateDiffusivity, zero_derivative
from cpmkit.scene.equations import Equation, Terms
from cpmkit.scene.nonlinear_equations import QuasilinearEquation
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats

MOST_STEPS = {"newton": 60, "lagged": 500}  #: The largest number of steps of each method.


@dataclass(frozen=True, eq=False)
class State:
    """An iterate u, and the residual of A(u) u = b(u) there."""

    u: Floats  #: (n, 1): the unknowns.
    stiffness: Stiffness  #: The operator A(u).
    b: Floats  #: (n, 1): the right-hand side b(u).
    residual: Floats  #: (n, 1): b - A u, balanced on pieces where a constant is free.
    border: Border | None  #: The pieces where no condition or term fixes a constant; None without any.


@dataclass(frozen=True, eq=False)
class Steps:
    """Steps of an iteration for an equation whose diffusivity depends on u, on a form."""

    context: SolveContext  #: The form, and the solver of linear systems.
    terms: Terms  #: Terms of the equation.
    law: StateDiffusivity  #: The diffusivity of the equation.
    loads: Floats  #: (n, 1): the load vector of f.
    #: The diffusivity by which penalties and stabilisation are scaled; by default the diffusivity of the equation.
    penalty_scale: float | None = None

    def frozen_terms(self, u: Floats) -> Terms:
        """Return the terms with the diffusivity evaluated at u (n, 1), independent of the solution."""
        scale = None if self.penalty_scale is None else self._uniform_scale
        return replace(self.terms, diffusivity=StateDependentCoefficient(self.law.evaluate, u, scale))

    def _uniform_scale(self, u: Floats, slopes: Floats, points: Floats) -> Floats:
        """Return the penalty scale (k,) at k points; u (k,) gives k, and ``slopes`` and ``points`` are not used."""
        del slopes, points
        assert self.penalty_scale is not None
        return np.full(len(u), self.penalty_scale)

    def state(self, u: Floats) -> State:
        """Return the state at u (n, 1), with the operator, the right-hand side and the residual there."""
        form = self.context.discretized
        stiffness = form.stiffness(self.frozen_terms(u))
        b = self.loads + form.condition_load(stiffness)
        residual = b - stiffness.apply(u)
        border = form.free_constants(stiffness)
        if border is not None:
            residual, _ = border.balance(residual)
        return State(u, stiffness, b, residual, border)

    def lagged_step(self, state: State) -> tuple[State, SolveReport]:
        """Return the state after a linear solve with the diffusivity at ``state``, and the report of this solve."""
        change, report = self._solve(state.stiffness, state)
        return self.state(state.u + change), report

    def newton_step(self, state: State) -> tuple[State, SolveReport]:
        """Return the state after a step of Newton's method with a line search, and the report of its linear solve.

        Raises ConvergenceError if no step length reduces the residual enough, or a linear solve fails.
        """
        form = self.context.discretized
        scale = self.law.evaluate if self.penalty_scale is None else self._uniform_scale
        coefficient = StateDependentCoefficient(self.law.flux_derivative_by_gradient, state.u, scale)
        tangent = form.stiffness(replace(self.terms, diffusivity=coefficient))
        drift = None
        if self.law.by_value is not zero_derivative:
            drift = form.advection(StateDependentCoefficient(self.law.flux_derivative_by_value, state.u))
        change, report = self._solve(tangent, state, drift)
        weights = 1 / np.abs(tangent.diagonal)
        before, length = _weighted_norm(state.residual, weights), 1.0
        refusal: InputError | None = None
        while length >= 2.0**-12:  # it is halved until the residual falls by at least a tenth of that share
            try:
                trial = self.state(state.u + length * change)
            except InputError as error:  # the diffusivity is not positive there
                refusal, length = error, length / 2
                continue
            falls = _weighted_norm(trial.residual, weights) <= (1 - 0.1 * length) * before
            if falls or float(np.abs(change).max()) <= 1e-11 * float(np.abs(state.u).max()):  # rounding
                return trial, report
            length /= 2
        raise ConvergenceError(
            "Newton's method found no step that lessens the residual of the equation"
            + (f", and of longer ones {refusal}" if refusal else "")
            + "; use method='lagged', another start (guess), a larger regularization or a smaller spacing.",
            report,
        ) from refusal

    def _solve(self, tangent: Stiffness, state: State, drift: Operator | None = None) -> tuple[Floats, SolveReport]:
        """Return the change (n, 1) of u in a step, and the report of the linear solve with ``tangent`` alone.

        The system has the matrix ``tangent + drift`` (None: 0), and as right-hand side the residual of ``state``. The
        change has mean zero where no condition fixes a constant. If GMRES does not converge, ``drift`` is left out.
        Raises ConvergenceError if the solve with ``tangent`` fails.
        """
        context, border = self.context, state.border
        operator: Operator = tangent if border is None else Bordered(tangent, border)
        prepared = context.prepare(operator)
        tolerance = max(context.tolerance, 1e-6)  # the next step corrects the error

        def without_means(u: Floats) -> Floats:
            return u if border is None else border.remove_means(u)[0]

        start, report = prepared.solve(state.residual, tolerance, progress=context.progress)
        start = without_means(start)
        if drift is None:
            return start, report
        from scipy.sparse.linalg import LinearOperator, gmres

        advection = drift

        def product(v: Any) -> Any:
            image = np.asarray(advection.apply(v.reshape(-1, 1)))
            return v.ravel() + without_means(prepared.solve(image, tolerance)[0]).ravel()

        n = len(start)
        solution, failed = gmres(
            LinearOperator((n, n), matvec=product), start.ravel(), rtol=100 * tolerance, restart=40, maxiter=2
        )
        return (start if failed else solution.reshape(-1, 1)), report


def _weighted_norm(residual: Floats, weights: Any) -> float:
    """Return the Euclidean norm of a residual (n, 1) whose squares are multiplied by ``weights`` (n, 1)."""
    return float(np.sqrt(np.sum(weights * residual**2)))


@dataclass(frozen=True)
class StepRecord:
    """One step of the iteration."""

    change: float  #: The largest change of u in the step, over the range of u.
    energy: float | None = None  #: The energy that the solution minimises, where it is known.


@dataclass(frozen=True, eq=False, repr=False)
class QuasilinearRecord(SolutionRecord):
    """The solution of an equation whose diffusivity depends on u."""

    history: tuple[StepRecord, ...] = ()  #: The steps of the nonlinear iteration.


@dataclass(frozen=True, eq=False)
class _FrozenEquation(Equation):
    """A linear equation with the diffusivity of a quasilinear equation at one iterate."""

    frozen_terms: Terms
    kind: ClassVar[str] = "frozen"

    def terms(self) -> Terms:
        return self.frozen_terms


#: The steps of an iteration so far, with the reports of their linear solves.
_Steps = list[tuple[StepRecord, SolveReport]]


def solve_quasilinear(context: SolveContext) -> QuasilinearRecord:
    """Solve a steady problem whose diffusivity depends on u, and return the solution with the history of the steps.

    Raises SceneError if the form does not have such diffusivities, or the scene has several channels. Raises InputError
    if the diffusivity is not above zero. Raises ConvergenceError if the steps do not converge.
    """
    form, problem = context.discretized, cast("QuasilinearEquation", context.scene.problem)
    require_ability(form, "diffusivity that depends on u")
    if context.scene.channels > 1:
        raise SceneError(f"a diffusivity that depends on u takes one channel, the scene has {context.scene.channels}.")
    form.check(context.solver_name)
    terms = problem.terms()
    u = context.guess
    if u is None and problem.initial_guess is not None:
        u = form.interpolate(problem.initial_guess, "the data")
    if u is None:
        u = _solve_linear(context, replace(terms, diffusivity=1.0)).values
    penalty_scale = None
    if problem.uniform_penalty:  # the geometric mean of the diffusivity
        a = problem.diffusivity_of_u.evaluate(form.at_points(u)[:, 0], form.gradient(u)[:, 0], form.points.copy())
        penalty_scale = float(np.exp(np.log(a).mean()))
    steps = Steps(context, terms, problem.diffusivity_of_u, form.load(terms.f), penalty_scale)
    taken: _Steps = []
    for nearer in problem.continuation if context.guess is None else ():
        law = nearer.diffusivity_of_u
        nearer_steps = replace(steps, terms=replace(terms, diffusivity=law), law=law)
        u = _solve_to_convergence(nearer_steps, nearer, u, taken, 1e-2)
    u = _solve_to_convergence(steps, problem, u, taken, 1e-8 if problem.method == "newton" else 1e-6)
    last = _solve_linear(context, steps.frozen_terms(u), u)
    name = "Newton's method" if problem.method == "newton" else "The lagged diffusivity"
    total = _with_total_counts(context, last, [*(report for _, report in taken), last.report], name, len(taken))
    values = {member.name: getattr(total, member.name) for member in fields(total)}
    return QuasilinearRecord(**values, history=tuple(record for record, _ in taken))


def _with_total_counts(
    context: SolveContext, last: SolutionRecord, reports: Sequence[SolveReport], name: str, steps: int
) -> SolutionRecord:
    """Return the ``last`` solution of an iteration with the counts of all linear solves, and the seconds of all steps.

    ``reports`` are those of the linear solves; ``name`` and the number of ``steps`` are added to the reason.
    """
    report = replace(
        last.report,
        iterations=sum(each.iterations for each in reports),
        operator_applications=sum(each.operator_applications for each in reports),
        reason=f"{last.report.reason}; {name} converged in {steps} steps",
    )
    work: Any = last.work
    work = replace(work, operator_applications=report.operator_applications)
    seconds = {**last.seconds, "solve": time.perf_counter() - context.started - last.seconds["build"]}
    return replace(last, discretized=context.discretized, report=report, work=work, seconds=seconds)


def _solve_linear(context: SolveContext, terms: Terms, guess: Floats | None = None) -> SolutionRecord:
    """Return the steady solution of the scene with linear ``terms``; iterations start at ``guess`` (n, 1), None: 0."""
    scene = replace(context.scene, problem=_FrozenEquation(terms))
    form = context.discretized.with_scene(scene)
    return solve_steady(replace(context, discretized=form, guess=guess, cache=OperatorCache()))


def _solve_to_convergence(steps: Steps, problem: QuasilinearEquation, u: Floats, taken: _Steps, share: float) -> Floats:
    """Take steps from u (n, 1) until one changes u by at most a ``share`` of its range, and return u (n, 1).

    The steps are appended in place to the list ``taken``. Raises ConvergenceError if none of the :data:`MOST_STEPS` of
    the method changes u so little, or a step fails.
    """
    method, state, form = problem.method, steps.state(u), steps.context.discretized
    step = steps.newton_step if method == "newton" else steps.lagged_step
    for _ in range(MOST_STEPS[method]):
        old = form.at_points(state.u)
        state, report = step(state)
        new = form.at_points(state.u)
        size = float(np.ptp(new) + 1e-5 * np.abs(new).max(initial=0.0)) or 1.0
        record = StepRecord(float(np.abs(new - old).max(initial=0.0)) / size, _minimised_energy(steps, problem, state))
        taken.append((record, report))
        if record.change <= share:
            return state.u
    other = "lagged" if method == "newton" else "newton"
    raise ConvergenceError(
        f"{problem.kind!r} did not converge in {MOST_STEPS[method]} steps of method={method!r}: u still changes by "
        f"{record.change:.2g} of its range; use method={other!r}, a larger regularization, or start from the solution "
        "of a problem that is nearer to a linear one (guess of Prepared.solve).",
        report,
    )


def _minimised_energy(steps: Steps, problem: QuasilinearEquation, state: State) -> float | None:
    """Return the energy, at ``state``, that the solution minimises; None without a known density or a quadrature.

    The energy is ``u . A u / 2 - u . b`` with its density in place of ``a |grad u|^2 / 2``.
    """
    form, u = steps.context.discretized, state.u
    slopes = form.gradient(u)[:, 0]
    density = problem.energy(slopes)
    if density is None:
        return None
    a = steps.law.evaluate(form.at_points(u)[:, 0], slopes, form.points.copy())
    total = integrals(form, form.project((density - 0.5 * a * np.sum(slopes**2, axis=1))[:, None]))
    rest = np.sum(u * (0.5 * state.stiffness.apply(u) - state.b))
    return None if total is None else float(total[0] + rest)


def solve_nonlinear(context: SolveContext, solve_linear: Callable[[SolveContext], SolutionRecord]) -> SolutionRecord:
    """Solve a steady scene with fluxes that depend on u by Newton's method, and return the solution.

    ``solve_linear`` is the solver of the equation's family, for linear conditions. Raises SceneError if the scene has
    several channels, or the fluxes do not fix a constant. Raises ResolutionError if a flux grows with u faster than the
    spacing resolves. Raises ConvergenceError if Newton's method does not converge in 30 steps.
    """
    scene, form = context.scene, context.discretized
    if scene.channels > 1:
        raise SceneError(f"a nonlinear flux takes one channel, the scene has {scene.channels}; solve them one by one.")
    fluxes = form.state_fluxes
    boundary_values = [np.full(len(flux.points), flux.guess) for flux in fluxes]
    reports = []
    for step in range(1, 31):
        tangent = form.linearise(boundary_values)
        solution = solve_linear(replace(context, discretized=tangent, cache=OperatorCache(), default_tolerance=False))
        if not all(flux.grows(v) for flux, v in zip(fluxes, boundary_values, strict=True)):
            _check_balance(solution)
        reports.append(solution.report)
        before, boundary_values = boundary_values, [flux.read(solution.values) for flux in fluxes]
        now, then = (np.concatenate([np.zeros(0), *values]) for values in (boundary_values, before))
        change, size = (float(np.abs(values).max(initial=0.0)) for values in (now - then, now))
        # errors of linear solves with the default tolerance are about as large
        if step > 1 and change <= 1e-8 * size + np.finfo(float).tiny:
            return _with_total_counts(context, solution, reports, "Newton's method", step)
    raise ConvergenceError(
        f"Newton's method did not converge in {step} steps: u still changes by {change:.2g} on the "
        "boundaries; give a guess nearer to the solution, or check that the flux does not grow with u.",
        solution.report,
    )


def _check_balance(solution: SolutionRecord) -> None:
    """Raise SceneError if data are unbalanced, by more than the spacing explains, where fluxes fix no constant."""
    for defect in solution.imbalances:
        if defect.of == "data" and defect.relative > defect.explained:
            near = place(defect.near)
            raise SceneError(
                f"Nothing fixes the solution near {near}: the nonlinear flux does not change with u at the values "
                "that Newton's method has, and the data do not balance without it; give another guess, or use Neumann."
            )
