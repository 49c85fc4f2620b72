"""Standing waves, -Lap u - k^2 u = f: whether the spacing resolves the wavelength, and whether k^2 is an eigenvalue."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import ConvergenceError, ResolutionError
from cpmkit.families.context import SolveContext
from cpmkit.forms.contract import Discretized
from cpmkit.linear.constants import Constants
from cpmkit.linear.preconditioned import followed_by_error
from cpmkit.linear.report import SolveReport
from cpmkit.protocols import Floats, PreparedSolver
from cpmkit.scene.equations import Terms

#: An eigenvalue nearer to k^2 than so many times that may lie on its other side.
NEAR_RESONANCE_ERRORS = 2.0
#: Relative residual to which the distance to an eigenvalue is computed.
ROUGH_RESIDUAL = 1e-3


def square_of_wavenumber(terms: Terms) -> float:
    """Return k^2 of a problem that is one of standing waves, else 0."""
    varies = (
        callable(terms.c) or callable(terms.diffusivity) or not isinstance(terms.diffusivity, (int, float, np.number))
    )
    if varies or terms.velocity is not None:
        return 0.0
    return max(-float(terms.c) / float(terms.diffusivity), 0.0)


def unresolved_waves(form: Discretized, terms: Terms) -> list[str]:
    """Return a sentence where the spacing resolves the waves poorly.

    Raises
    ------
    ResolutionError
        If there are too few nodes a wavelength to tell one eigenvalue from the next.
    """
    k, spacing, carried = float(np.sqrt(square_of_wavenumber(terms))), form.spacing, form.dispersion
    if k * spacing <= carried.resolved:
        return []
    sentence = (
        f"spacing={spacing:g} gives {2 * np.pi / (k * spacing):.2g} nodes a wavelength of {2 * np.pi / k:.3g}, and "
        f"{2 * np.pi / carried.resolved:.2g} are needed to keep eigenvalues to 1 percent; use "
        f"{carried.resolved / k:.2g} or less."
    )
    if k * spacing > carried.coarsest:
        raise ResolutionError(sentence)
    return [sentence]


def solved_or_resonant(
    context: SolveContext, prepared: PreparedSolver, constants: Constants, b: Floats
) -> tuple[Floats, SolveReport]:
    """Return the solution of a steady problem's system, and the report.

    Raises
    ------
    ConvergenceError
        If the solver does not reach the tolerance; of standing waves it says whether an eigenvalue is why.
    """
    by_error = followed_by_error(prepared) if context.by_default else None
    solver, tolerance = (prepared, context.tolerance) if by_error is None else by_error
    try:
        return constants.solve(solver, b, tolerance, context.guess, context.progress)
    except ConvergenceError as error:
        square = square_of_wavenumber(context.scene.problem.terms())
        if not square:
            raise
        try:
            why = near_resonance(context, prepared, constants.solve(prepared, b, ROUGH_RESIDUAL)[0])
        except ConvergenceError:
            why = [
                f"It may be that k^2={square:.6g} is an eigenvalue on this lattice, to rounding, and that there is no "
                "solution; use a smaller spacing or another wavenumber."
            ]
        raise ConvergenceError(" ".join([str(error), *why]), error.report) from error


def near_resonance(context: SolveContext, prepared: PreparedSolver, u: Floats) -> list[str]:
    """Return a sentence where an eigenvalue lies so near to k^2 that the scheme's error decides what the solution is.

    One step of inverse iteration from the solution u tells the distance of the eigenvalue whose mode dominates u: only
    resonances that are felt are told.
    """
    terms = context.scene.problem.terms()
    square = square_of_wavenumber(terms)
    if not square:
        return []
    size = np.linalg.norm(u, axis=0)
    if not size.all():
        return []
    mass = context.discretized.mass
    try:
        step, _ = prepared.solve(u if mass is None else mass.apply(u), max(context.tolerance, ROUGH_RESIDUAL))
    except ConvergenceError:
        return [
            f"Whether an eigenvalue lies near k^2={square:.6g} could not be told: the solver did not converge on it."
        ]
    gap = float(np.min(size / np.linalg.norm(step, axis=0))) / float(terms.diffusivity)
    bounds = np.asarray(context.scene.surface.bounds, dtype=np.float64)
    radius = 0.5 * float((bounds[1] - bounds[0]).max())
    spacing = context.discretized.spacing
    error = context.discretized.dispersion.error(square, spacing, radius)
    if gap > NEAR_RESONANCE_ERRORS * error:
        return []
    return [
        f"An eigenvalue lies within {gap:.2g} of k^2={square:.6g}, and at spacing={spacing:g} eigenvalues are off by "
        f"about {error:.2g}: the size of the solution, and its sign, are not determined; use a smaller spacing or "
        "another wavenumber."
    ]
