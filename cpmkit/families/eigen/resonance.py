"""Whether the spacing resolves standing waves, -Lap u - k^2 u = f, and whether an eigenvalue is near to zero."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.errors import ConvergenceError, ResolutionError
from cpmkit.families.context import SolveContext
from cpmkit.forms.contract import Discretized, surely_positive
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.preconditioned import stop_by_preconditioned_residual
from cpmkit.linear.protocols import PreparedSolver
from cpmkit.linear.solve_report import SolveReport
from cpmkit.scene.diffusivities import StateDiffusivity, mean_diffusivity
from cpmkit.scene.equations import Terms
from cpmkit.scene.laws import Nonlinear
from cpmkit.solution.modes import Resonance
from cpmkit.types import Floats

#: Relative residual to which the distance to an eigenvalue is computed.
ROUGH_RESIDUAL = 1e-3
#: Steps of inverse iteration towards the nearest eigenvalue, from so many plane waves: each mode of about their length
#: has a part in these, and after three steps the nearest mode's is the largest where it is near enough to be told.
INVERSE_STEPS, PLANE_WAVES = 3, 6
#: Points at which the wavenumber of a mode is measured, and the diffusivity.
MODE_POINTS = 500


def square_of_wavenumber(terms: Terms) -> float:
    """Return k^2 of a problem that is one of standing waves, else 0."""
    varies = (
        callable(terms.c) or callable(terms.diffusivity) or not isinstance(terms.diffusivity, (int, float, np.number))
    )
    if varies or terms.velocity is not None:
        return 0.0
    return max(-float(terms.c) / float(terms.diffusivity), 0.0)


def resolves_waves(form: Discretized, terms: Terms) -> bool:
    """Tell whether the spacing resolves the standing waves of a problem well, if it is one of these."""
    return float(np.sqrt(square_of_wavenumber(terms))) * form.spacing <= form.traits.dispersion.resolved


def unresolved_waves(form: Discretized, terms: Terms) -> list[str]:
    """Return a sentence where the spacing resolves the waves poorly.

    Raises
    ------
    ResolutionError
        If there are too few nodes a wavelength to tell one eigenvalue from the next.
    """
    if resolves_waves(form, terms):
        return []
    k, spacing, carried = float(np.sqrt(square_of_wavenumber(terms))), form.spacing, form.traits.dispersion
    sentence = (
        f"spacing={spacing:g} gives {2 * np.pi / (k * spacing):.2g} nodes a wavelength of {2 * np.pi / k:.3g}, and "
        f"{2 * np.pi / carried.resolved:.2g} are needed to keep eigenvalues to 1 percent; use "
        f"{carried.resolved / k:.2g} or less."
    )
    if k * spacing > carried.coarsest:
        raise ResolutionError(sentence)
    return [sentence]


def solved_or_resonant(
    context: SolveContext, prepared: PreparedSolver, constants: ConstantFunctions, b: Floats
) -> tuple[Floats, SolveReport]:
    """Return the solution of a steady problem's system, and the report.

    Raises
    ------
    ConvergenceError
        If the solver does not reach the tolerance; of standing waves it says whether an eigenvalue is why.
    """
    by_error = stop_by_preconditioned_residual(prepared) if context.by_default else None
    solver, tolerance = (prepared, context.tolerance) if by_error is None else by_error
    try:
        return constants.solve(solver, b, tolerance, context.guess, context.progress)
    except ConvergenceError as error:
        square = square_of_wavenumber(context.scene.problem.terms())
        if not square:
            raise
        try:
            why, _ = near_resonance(context, prepared, constants.solve(prepared, b, ROUGH_RESIDUAL)[0])
        except ConvergenceError:
            why = [
                f"It may be that k^2={square:.6g} is an eigenvalue on this lattice, to rounding, and that there is no "
                "solution; use a smaller spacing or another wavenumber."
            ]
        raise ConvergenceError(" ".join([str(error), *why]), error.report) from error


def may_resonate(form: Discretized) -> bool:
    """Tell whether a steady problem's operator may have an eigenvalue near zero: c or a condition takes from it."""
    terms = form.scene.problem.terms()
    linear = not any(isinstance(condition.law, Nonlinear) for condition in form.scene.conditions)
    linear = linear and not isinstance(terms.diffusivity, StateDiffusivity)
    return form.scene.problem.family == "steady" and terms.velocity is None and linear and not surely_positive(form)


def near_resonance(context: SolveContext, prepared: PreparedSolver, u: Floats) -> tuple[list[str], Resonance | None]:
    """Return the eigenvalue nearest to zero, and a sentence where the scheme's error may decide what the solution is.

    By inverse iteration from plane waves; one step of it from u (n, channels) tells how much of u lies in its modes.
    """
    form = context.discretized
    terms, mass = context.scene.problem.terms(), form.mass
    square = square_of_wavenumber(terms)
    if not may_resonate(form) or (not square and "gradients" in form.cannot):
        return [], None
    tolerance = max(context.tolerance, ROUGH_RESIDUAL)

    def weighed(values: Floats) -> Floats:
        return values if mass is None else mass.apply(values)

    try:
        b, gap, mode = form.load(_plane_waves(form))[:, :1], np.inf, u[:, :1]
        for _ in range(INVERSE_STEPS):
            mode, _ = prepared.solve(b, tolerance)
            size = float(np.sum(mode * weighed(mode)))
            gap = float(np.sum(mode * b)) / size
            b = weighed(mode) / np.sqrt(size)
        step, _ = prepared.solve(weighed(u), tolerance)
    except ConvergenceError:
        return [
            "Whether an eigenvalue of the operator lies near zero, as at a resonance, could not be told: the solver "
            "did not converge on it."
        ], None
    a = mean_diffusivity(terms.diffusivity, form.some_points(MODE_POINTS)[1])
    found = _resonance(form, gap / a, square or _square_of_mode(form, mode), gap * step, u)
    if not found.undetermined:
        return [], found
    where = f"k^2={square:.6g}" if square else "zero, to which conditions or c bring it,"
    cure = "another wavenumber" if square else "other coefficients"
    return [
        f"An eigenvalue lies within {abs(found.gap):.2g} of {where} and at spacing={form.spacing:g} eigenvalues are "
        f"off by about {found.error:.2g}: the size of the solution, and its sign, are not determined; use a smaller "
        f"spacing or {cure}."
    ], found


def _resonance(form: Discretized, gap: float, square: float, part: Floats, u: Floats) -> Resonance:
    bounds = np.asarray(form.scene.surface.bounds, dtype=np.float64)
    error = form.traits.dispersion.error(square, form.spacing, 0.5 * float((bounds[1] - bounds[0]).max()))
    values, whole = form.at_points(part), form.at_points(u)
    unit = np.ptp(whole, axis=0)
    unit = np.where(unit > 0, unit, 1.0)
    rms = np.sqrt(np.mean(values**2, axis=0)) / unit
    return Resonance(gap, error, float(rms.max()), float((np.abs(values).max(axis=0) / unit).max()))


def _plane_waves(form: Discretized) -> Callable[[Floats], Floats]:
    """Return a sum of plane waves in all directions, as long as the waves of the equation or the whole manifold."""
    bounds = np.asarray(form.scene.surface.bounds, dtype=np.float64)
    k = max(
        float(np.sqrt(square_of_wavenumber(form.scene.problem.terms()))), np.pi / float(np.ptp(bounds, axis=0).max())
    )
    rng = np.random.default_rng(0)
    directions, phases = rng.normal(size=(PLANE_WAVES, bounds.shape[1])), rng.uniform(0, 2 * np.pi, PLANE_WAVES)
    directions *= k / np.linalg.norm(directions, axis=1)[:, None]

    def waves(points: Floats) -> Floats:
        summed = np.cos(points @ directions.T + phases).sum(axis=1)
        return np.repeat(summed[:, None], form.channels, axis=1)

    return waves


def _square_of_mode(form: Discretized, mode: Floats) -> float:
    """Return the mean of |grad u|^2 over that of u^2."""
    rows, points = form.some_points(MODE_POINTS)
    values, slopes = form.at_points(mode, rows), form.gradient(mode, points)
    return float(np.sum(slopes**2) / np.sum(values**2))
