"""How large the error of a solution is, from independent solutions of the same scene at larger spacings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Unpack, cast

import numpy as np

from cpmkit.accuracy.companions import expected_of, from_companions
from cpmkit.accuracy.comparison import difference
from cpmkit.accuracy.error_estimate import ErrorEstimate
from cpmkit.accuracy.facets import floor_by_facets
from cpmkit.dispatch import solve_scene
from cpmkit.errors import InputError, ResolutionError
from cpmkit.families.eigen.resonance import resolves_waves
from cpmkit.families.keywords import PreparingKeywords
from cpmkit.forms.choice import FORMS
from cpmkit.forms.contract import Discretized
from cpmkit.forms.options import Options, lattice_options
from cpmkit.linear.solver_options import SolverOptions
from cpmkit.protocols import Floats
from cpmkit.runtime.messages import collected_warnings, warn_each
from cpmkit.runtime.options import document_options
from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.equations_in_time import FIRST_ORDER_SCHEMES, Evolution
from cpmkit.scene.scene import Scene
from cpmkit.solution.modes import with_further_modes
from cpmkit.solution.record import SolutionRecord

#: Spacings of the solutions that one is held against, over its own.
RATIOS = {False: (2.0,), True: (math.sqrt(2), 2.0)}
#: By what part of a spacing the coarser lattices are shifted: nodes at the same places make the same errors there.
SHIFT = (0.37, 0.59, 0.43)

#: A floor of a mesh below this share of the error is not looked at more closely.
FLOOR_SHARE = 0.5

#: Solves a scene at a spacing, with the lattice's origin and all other options as they were.
SolveAt = Callable[[Scene, float], SolutionRecord]


def estimated(solution: SolutionRecord, solve_at: SolveAt, tight: bool = False) -> ErrorEstimate:
    """Solve coarser companions of a solution, and estimate its error from the differences.

    Parameters
    ----------
    solution : Solution
        Whose error is estimated.
    solve_at : callable
        Solves a scene at a spacing.
    tight : bool
        Whether it is held against solutions at the root of two and at two times the spacing, or at two times alone.

    Raises
    ------
    ResolutionError
        If the scene has no solution at these spacings, nor at the root of two.
    CpmkitError
        As ``solve`` does at the larger spacings.
    """
    scene = coarser_scene(solution.scene)
    companions = _coarser_solutions(scene, solution, solve_at, RATIOS[tight])
    in_time = error_in_time(companions[-1], solve_at)
    found = from_companions(solution, companions, in_time, alone=expected_of(solution))
    coarse, enough = companions[-1], FLOOR_SHARE * found.of("rms")
    left = floor_by_facets(coarse, lambda scene: solve_at(scene, coarse.spacing), enough)
    return replace(found, floor=np.full(len(found.unit), left))


def _coarser_solutions(
    scene: Scene, solution: SolutionRecord, solve_at: SolveAt, ratios: Sequence[float]
) -> list[SolutionRecord]:
    """Return solutions at ``ratios`` times the spacing, at the smallest ratio alone where others are too coarse.

    So they are where they leave unresolved what the solution resolves: bends of the manifold, or waves.

    Raises
    ------
    ResolutionError
        If that one is too coarse as well; the message names the spacing that the user gave.
    """
    spacing, ratio = solution.spacing, min(RATIOS[True])
    try:
        found = [solve_at(scene, factor * spacing) for factor in ratios]
    except ResolutionError:
        found = []
    if found and (_is_unresolved(solution) or not _is_unresolved(found[-1])):
        return found
    if len(found) > 1:
        return found[:1]
    try:
        return [solve_at(scene, ratio * spacing)]
    except ResolutionError as error:
        raise ResolutionError(
            f"The error at spacing={spacing:g} is estimated by solving on coarser lattices, the finest at "
            f"{ratio * spacing:.3g}, which does not work: {error} Use spacing={spacing / 2:.3g} or less, or "
            "estimate=False."
        ) from error


def _is_unresolved(solution: SolutionRecord) -> bool:
    form, problem = solution.discretized, solution.scene.problem
    return form.diagnosis().unresolved or (problem.family == "steady" and not resolves_waves(form, problem.terms()))


def coarser_scene(scene: Scene) -> Scene:
    """Return the scene that companions are solved of: modes may come in another order there, and further ones help."""
    return with_further_modes(scene) if isinstance(scene.problem, Eigen) else scene


def error_in_time(solution: SolutionRecord, solve_at: SolveAt) -> float:
    """Return what steps in time add to a solution's error, as a share of its range: solved again with twice the step.

    It depends little on the spacing, and is looked at where that is cheap.
    """
    problem = solution.scene.problem
    if not isinstance(problem, Evolution) or 2 * problem.step > problem.duration:
        return 0.0
    longer: Any = replace(cast("Any", problem), step=2 * problem.step)
    other = solve_at(replace(solution.scene, problem=longer), solution.spacing)
    return float(difference(solution, other).largest.max() / (2 ** order_in_time(problem) - 1))


def order_in_time(problem: Evolution) -> int:
    """Return the order of a problem's scheme; 1 where something is done after each step."""
    return 1 if problem.scheme in FIRST_ORDER_SCHEMES or problem.after_step is not None else 2


def error_of(solution: SolutionRecord, tight: bool = False) -> ErrorEstimate:
    """Estimate the error of a solution from what it tells of how it was discretised.

    Raises
    ------
    InputError
        If it was not solved on a lattice.
    """
    form = solution.discretized
    options = lattice_options(form)
    if solution.estimated is False:
        raise InputError("the error of this solution was not to be estimated, estimate=False; leave that out.")
    if options is None:
        raise InputError(
            f"the error of a solution by {form.form!r} is estimated on a coarser lattice, and it has none; solve with "
            "backend='cpm', or on a finer mesh and compare."
        )
    check_estimable(form)
    return estimated(solution, companion_solver({**options.as_dict(), "form": form.form}), tight)


def check_estimable(form: Discretized) -> None:
    """Refuse to estimate an error of which differences of solutions say nothing.

    Raises
    ------
    InputError
        With the reason.
    """
    reason = form.diagnosis().no_estimate
    if reason:
        raise InputError(f"The error of this solution has no estimate. {reason}")


def with_estimate(solution: SolutionRecord, how: bool | str | None, options: Mapping[str, Any]) -> SolutionRecord:
    """Return a solution with its estimate made, ``True`` or ``"tight"``, refused, ``False``, or left for later."""
    if how is None:
        return solution
    if how is False:
        return replace(solution, estimated=False)
    if solution.discretized.diagnosis().no_estimate:  # which its warnings say; what was solved is not lost
        return solution
    return replace(solution, estimated=estimated(solution, companion_solver(options), how == "tight"))


def companion_solver(options: Mapping[str, Any]) -> SolveAt:
    """Return what solves companions with the options of ``solve``, on lattices whose nodes lie elsewhere."""
    kept = {name: value for name, value in options.items() if name not in ("spacing", "origin")}

    def solve_at(scene: Scene, spacing: float) -> SolutionRecord:
        with collected_warnings():
            return solve_scene(scene, spacing, origin=shifted_origin(scene, spacing), **kept)

    return solve_at


def shifted_origin(scene: Scene, spacing: float, number: int = 1) -> Floats:
    """Return where the lattice of companion ``number`` has a node: no two at the same place of theirs."""
    shift = number * np.array(SHIFT)[: scene.surface.dim] % 1.0
    return np.asarray(np.asarray(scene.surface.bounds).mean(axis=0) + spacing * shift)


@document_options(Options, *FORMS.values(), SolverOptions)
def estimate_error(
    scene: Scene, spacing: float, *, tight: bool = False, **options: Unpack[PreparingKeywords]
) -> ErrorEstimate:
    """Solve a scene at ``spacing`` and at twice it, and estimate the error of the finer solution.

    On a single position of the lattice the estimate is within a factor of two or three of the true error; where the
    coarse grid does not see the scene (thin parts, boundaries near each other) it is larger than that. Eigenvalues are
    matched by their functions, multiplets as a whole.

    Parameters
    ----------
    scene : Scene
        What is solved.
    spacing : float
        Of the finer solution.
    tight : bool
        Whether a third solution, at the root of two times the spacing, is taken into account: half as dear again, and
        nearer to the truth.
    **options
        As for :func:`cpmkit.solve`. The error is taken to fall with the power ``order`` of the spacing, 3 counting as
        2.

    Returns
    -------
    ErrorEstimate

    Raises
    ------
    CpmkitError
        As ``solve`` does, at either spacing.

    Examples
    --------
    >>> import cpmkit as ck
    >>> f = ck.ScreenedPoisson(lambda points: 2 * points[:, 0], c=1.0)  # u = x
    >>> circle = ck.source("analytic.circle")
    >>> estimate = ck.estimate_error(ck.Scene(circle, f), spacing=0.05)
    >>> points = circle.mesh(0.01)[0]
    >>> bool(0.7 < estimate.error[0] / abs(estimate.solution.evaluate(points) - points[:, 0]).max() < 2)
    True
    """
    with collected_warnings():
        solution = solve_scene(scene, spacing, **options)
        check_estimable(solution.discretized)
        estimate = estimated(solution, companion_solver(options), tight)
    warn_each(solution.warnings)
    return estimate
