"""Steady problems, A u = b: one linear system, with checks for unresolved waves and eigenvalues near zero."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from cpmkit.errors import ConvergenceError, InputError, ResolutionError
from cpmkit.families.context import PreparedSystem, SolveContext, apply_mass, is_nonnegative, operator_key, with_border
from cpmkit.forms.contract import Discretized
from cpmkit.linear.operators import LinearSystem, PreparedSolver, Stiffness
from cpmkit.linear.preconditioned import stop_by_preconditioned_residual
from cpmkit.linear.residuals import SolveReport
from cpmkit.scene.diffusivities import mean_diffusivity
from cpmkit.scene.equations import Terms
from cpmkit.scene.laws import Nonlinear
from cpmkit.solution.modes import Resonance
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats

ROUGH_RESIDUAL = 1e-3  #: Relative residual of the solves that find the distance to an eigenvalue.


def assemble(form: Discretized) -> LinearSystem:
    """Return the linear system A u = b of a steady problem, bordered on pieces where a constant is free.

    Parameters
    ----------
    form : Discretized
        The discretised scene.

    Raises
    ------
    InputError
        If the equation of the scene is not steady, or a coefficient or datum is not accepted.
    ResolutionError
        If the spacing is too coarse for the velocity.

    Notes
    -----
    A = -div(a grad) + c with the conditions. Rows are integrals in the Galerkin form and values at nodes in the
    collocation form.
    """
    problem = form.scene.problem
    if problem.family != "steady":
        raise InputError(
            f"assemble takes the scene of a steady equation, such as Poisson or Elliptic, got {problem.kind!r}; "
            "assemble its steady part, or use solve."
        )
    stiffness = form.stiffness(problem.terms())
    b = form.load(problem.terms().f) + form.condition_load(stiffness)
    return LinearSystem(with_border(form, stiffness), b)


def _prepare_system(context: SolveContext) -> tuple[Stiffness, PreparedSystem]:
    """Return the operator A of a steady problem, and its prepared system, bordered where a constant is free."""
    form = context.discretized
    stiffness = form.stiffness(form.scene.problem.terms())
    return stiffness, context.prepare_system(with_border(form, stiffness))


def solve_steady(context: SolveContext) -> SolutionRecord:
    """Assemble and solve the linear system of a steady problem, and return the solution.

    Raises ResolutionError if the spacing is too coarse for waves or a velocity, SceneError if the system is singular,
    ConvergenceError if the solver does not reach the tolerance.
    """
    form, terms = context.discretized, context.scene.problem.terms()
    coarse_waves = unresolved_wave_warnings(form, terms)
    form.check(context.solver_name)
    load = form.load(terms.f)
    stiffness, system = context.cache.get(("steady", operator_key(terms)), _prepare_system, context)
    b = load + form.condition_load(stiffness)
    built = time.perf_counter()
    values, report = _solve_system(context, system, b)
    u, imbalances = form.remove_constants(system.operator, b, values)
    resonant, resonance = nearest_resonance(context, system.solver, u)
    small_c = system.constants.cancellation_warnings(b, values) if system.operator is stiffness else ()
    unbalanced = [text for defect in imbalances for text in (*defect.warnings, *defect.nothing_given)]
    return SolutionRecord(
        values=u,
        warnings=(*form.warnings(), *coarse_waves, *resonant, *small_c, *unbalanced),
        imbalances=imbalances,
        resonance=resonance,
        **context.common_fields(system.operator, report, built),
    )


def _solve_system(context: SolveContext, system: PreparedSystem, b: Floats) -> tuple[Floats, SolveReport]:
    """Return the solution (n, channels) of the system with right-hand side b (n, channels), and the report.

    Raises ConvergenceError if the solver does not reach the tolerance; for standing waves the message says if an
    eigenvalue is the cause.
    """
    by_error = stop_by_preconditioned_residual(system.solver) if context.default_tolerance else None
    solver, tolerance = (system.solver, context.tolerance) if by_error is None else by_error
    try:
        return system.constants.solve(solver, b, tolerance, context.guess, context.progress)
    except ConvergenceError as error:
        square = squared_wavenumber(context.scene.problem.terms())
        if not square:
            raise
        try:
            rough = system.solve(b, ROUGH_RESIDUAL)[0]
            causes, _ = nearest_resonance(context, system.solver, rough)
        except ConvergenceError:
            causes = [
                f"It may be that k^2={square:.6g} is an eigenvalue on this lattice, to rounding, and that there is no "
                "solution; use a smaller spacing or another wavenumber."
            ]
        raise ConvergenceError(" ".join([str(error), *causes]), error.report) from error


def squared_wavenumber(terms: Terms) -> float:
    """Return k^2 of an equation -a (Lap u + k^2 u) = f of standing waves with constant a; 0 for other equations."""
    varies = (
        callable(terms.c) or callable(terms.diffusivity) or not isinstance(terms.diffusivity, (int, float, np.number))
    )
    if varies or terms.velocity is not None:
        return 0.0
    return max(-float(terms.c) / float(terms.diffusivity), 0.0)


def resolves_waves(form: Discretized, terms: Terms) -> bool:
    """Return True if the spacing resolves the standing waves of an equation, or it has none."""
    return float(np.sqrt(squared_wavenumber(terms))) * form.spacing <= form.traits.dispersion.resolved


def unresolved_wave_warnings(form: Discretized, terms: Terms) -> list[str]:
    """Return a warning in a list if the spacing resolves standing waves poorly; else an empty list.

    Raises ResolutionError if there are too few nodes per wavelength to distinguish eigenvalues.
    """
    if resolves_waves(form, terms):
        return []
    k, spacing, dispersion = float(np.sqrt(squared_wavenumber(terms))), form.spacing, form.traits.dispersion
    sentence = (
        f"spacing={spacing:g} gives {2 * np.pi / (k * spacing):.2g} nodes a wavelength of {2 * np.pi / k:.3g}, and "
        f"{2 * np.pi / dispersion.resolved:.2g} are needed to keep eigenvalues to 1 percent; use "
        f"{dispersion.resolved / k:.2g} or less."
    )
    if k * spacing > dispersion.coarsest:
        raise ResolutionError(sentence)
    return [sentence]


def nearest_resonance(context: SolveContext, solver: PreparedSolver, u: Floats) -> tuple[list[str], Resonance | None]:
    """Return a list of warnings, and the record of the eigenvalue nearest to zero, None if it is not computed.

    There is a warning if the eigenvalue is so near to zero that its error leaves the size and sign of the solution u
    (n, channels) undetermined, or if ``solver``, which solves the equation, does not converge. Inverse iteration from
    plane waves gives the eigenvalue; one more step, from u, gives the part of u in the modes of the eigenvalue. The
    eigenvalue is computed only for linear steady problems without a velocity whose c or conditions may make the energy
    negative, and, if the equation has no standing waves, only in forms with gradients.
    """
    form = context.discretized
    terms = context.scene.problem.terms()
    square = squared_wavenumber(terms)
    linear = not any(isinstance(condition.law, Nonlinear) for condition in form.scene.conditions)
    linear = linear and not getattr(terms.diffusivity, "needs_state", False)
    steady = linear and form.scene.problem.family == "steady" and terms.velocity is None
    if not steady or is_nonnegative(form) or (not square and "gradients" in form.cannot):
        return [], None
    tolerance = max(context.tolerance, ROUGH_RESIDUAL)
    try:
        b, gap, mode = form.load(_plane_waves(form))[:, :1], np.inf, u[:, :1]
        for _ in range(3):  # then the nearest mode is the largest part where it matters
            mode, _ = solver.solve(b, tolerance)
            size = float(np.sum(mode * apply_mass(form, mode)))
            gap = float(np.sum(mode * b)) / size
            b = apply_mass(form, mode) / np.sqrt(size)
        step, _ = solver.solve(apply_mass(form, u), tolerance)
    except ConvergenceError:
        return [
            "Whether an eigenvalue of the operator lies near zero, as at a resonance, could not be determined: the "
            "solver did not converge on it."
        ], None
    rows, points = form.some_points(500)
    a = mean_diffusivity(terms.diffusivity, points)
    if not square:  # that of the mode: the mean of |grad u|^2 over the mean of u^2
        square_of_mode = float(np.sum(form.gradient(mode, points) ** 2) / np.sum(form.at_points(mode, rows) ** 2))
    resonance = _resonance(form, gap / a, square or square_of_mode, gap * step, u)
    if not resonance.is_undetermined:
        return [], resonance
    where = f"k^2={square:.6g}" if square else "zero, to which conditions or c bring it,"
    cure = "another wavenumber" if square else "other coefficients"
    return [
        f"An eigenvalue lies within {abs(resonance.gap):.2g} of {where} and at spacing={form.spacing:g} eigenvalues "
        f"are off by about {resonance.error:.2g}: the size of the solution, and its sign, are not determined; use a "
        f"smaller spacing or {cure}."
    ], resonance


def _resonance(form: Discretized, gap: float, square: float, part: Floats, u: Floats) -> Resonance:
    """Return the record of the eigenvalue nearest to zero, with its estimated error.

    ``gap`` is that eigenvalue over the diffusivity, ``square`` the k^2 of the equation or of the mode, and ``part`` (n,
    channels) the part of u (n, channels) in its modes.
    """
    bounds = np.asarray(form.scene.surface.bounds, dtype=np.float64)
    error = form.traits.dispersion.error(square, form.spacing, 0.5 * float((bounds[1] - bounds[0]).max()))
    values, whole = form.at_points(part), form.at_points(u)
    unit = np.ptp(whole, axis=0)
    unit = np.where(unit > 0, unit, 1.0)
    rms = np.sqrt(np.mean(values**2, axis=0)) / unit
    return Resonance(gap, error, float(rms.max()), float((np.abs(values).max(axis=0) / unit).max()))


def _plane_waves(form: Discretized) -> Callable[[Floats], Any]:
    """Return a sum of six plane waves in random directions, as a function of points (n, d) to (n, channels).

    Their wavelength is that of the equation, but at most twice the size of the manifold.
    """
    bounds = np.asarray(form.scene.surface.bounds, dtype=np.float64)
    own = float(np.sqrt(squared_wavenumber(form.scene.problem.terms())))
    k = max(own, np.pi / float(np.ptp(bounds, axis=0).max()))
    rng = np.random.default_rng(0)
    directions, phases = rng.normal(size=(6, bounds.shape[1])), rng.uniform(0, 2 * np.pi, 6)
    directions *= k / np.linalg.norm(directions, axis=1)[:, None]

    def waves(points: Floats) -> Floats:
        summed = np.cos(points @ directions.T + phases).sum(axis=1)
        return np.repeat(summed[:, None], form.scene.channels, axis=1)

    return waves
