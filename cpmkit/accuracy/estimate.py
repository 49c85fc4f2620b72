"""Estimates of the error of a solution by solving the same scene at larger spacings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Unpack

import numpy as np

from cpmkit.accuracy.error_estimate import ErrorEstimate, difference, estimate_alone, estimate_from
from cpmkit.dispatch import solve_scene
from cpmkit.errors import InputError, ResolutionError, SceneError
from cpmkit.families.context import PreparingKeywords
from cpmkit.families.steady import resolves_waves
from cpmkit.forms.choice import FORMS
from cpmkit.forms.contract import Discretized
from cpmkit.forms.options import Options, lattice_options
from cpmkit.linear.solver_options import SolverOptions
from cpmkit.manifold.abilities import HasFacets
from cpmkit.runtime.messages import collected_warnings, warn_each
from cpmkit.runtime.options import document_options
from cpmkit.scene.equations_in_time import FIRST_ORDER_SCHEMES, Evolution
from cpmkit.scene.scene import Scene
from cpmkit.solution.frames import EvolvedRecord
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats

#: Ratios of the coarser spacings to the spacing of the solution; ``True`` for a tight estimate.
RATIOS = {False: (2.0,), True: (math.sqrt(2), 2.0)}
#: Shift of coarser lattices, in units of their spacing: the same nodes would have the same errors.
SHIFT = (0.37, 0.59, 0.43)

#: Solves a scene at a spacing, on a shifted lattice, with all other options unchanged.
SolveAt = Callable[[Scene, float], SolutionRecord]


def estimate_by_solving(solution: SolutionRecord, solve_at: SolveAt, tight: bool = False) -> ErrorEstimate:
    """Return the error of a solution, estimated from differences to solutions of its scene at larger spacings.

    The larger spacing is 2 times that of the solution, or the root of 2 times if that is too coarse; both if ``tight``.
    The estimate includes the error of steps in time, and its ``floor`` is the error due to the source. Raises
    ResolutionError if both are too coarse, InputError for a frame at the start, and CpmkitError as ``solve_at`` does.
    """
    scene = with_further_modes(_scene_until(solution))
    coarse_solutions = _coarser_solutions(scene, solution, solve_at, RATIOS[tight])
    coarsest = coarse_solutions[-1]
    in_time = error_in_time(coarsest, solve_at)
    estimate = estimate_from(solution, coarse_solutions, in_time, alone=estimate_alone(solution))
    if not isinstance(scene.surface, HasFacets):
        return estimate
    negligible = 0.5 * estimate.of("rms")
    floor = measured_source_error(coarsest, lambda scene: solve_at(scene, coarsest.spacing), negligible)
    return replace(estimate, floor=np.full(len(estimate.unit), floor))


def _scene_until(solution: SolutionRecord) -> Scene:
    """Return the scene of a solution, for a frame with the frame's time as its end; InputError if that is the start."""
    problem: Any = solution.scene.problem
    if not isinstance(solution, EvolvedRecord) or solution.time >= problem.until:
        return solution.scene
    if solution.time <= problem.t0:
        raise InputError("the error of the frame at the start is that of its initial data; take a later frame.")
    return replace(solution.scene, problem=replace(problem, until=solution.time, frames=0))


def _coarser_solutions(
    scene: Scene, solution: SolutionRecord, solve_at: SolveAt, ratios: Sequence[float]
) -> list[SolutionRecord]:
    """Return solutions at ``ratios`` times the spacing, or at the root of two times it if these are too coarse.

    A lattice is too coarse if the scene is refused there, or if it does not resolve bends of the manifold or waves that
    the solution's lattice resolves. Raises ResolutionError, which names the user's spacing, if root two times the
    spacing is refused as well.
    """
    spacing, ratio = solution.spacing, min(RATIOS[True])
    try:
        coarse_solutions = [solve_at(scene, factor * spacing) for factor in ratios]
    except (ResolutionError, SceneError):  # a scene may be refused at a coarse spacing, where parts of it come near
        coarse_solutions = []
    if coarse_solutions and (_is_unresolved(solution) or not _is_unresolved(coarse_solutions[-1])):
        return coarse_solutions
    if len(coarse_solutions) > 1:
        return coarse_solutions[:1]
    try:
        return [solve_at(scene, ratio * spacing)]
    except (ResolutionError, SceneError) as error:
        shorter = "a shorter step, " if scene.problem.family == "time" else ""
        raise ResolutionError(
            f"The error at spacing={spacing:g} is estimated by solving on coarser lattices, the finest at "
            f"{ratio * spacing:.3g}, which does not work: {error} Use {shorter}spacing={spacing / 2:.3g} or less, or "
            "estimate=False."
        ) from error


def _is_unresolved(solution: SolutionRecord) -> bool:
    """Return True if the lattice of a solution does not resolve the manifold or the standing waves."""
    form, problem = solution.discretized, solution.scene.problem
    return form.diagnosis().unresolved or (problem.family == "steady" and not resolves_waves(form, problem.terms()))


def error_in_time(solution: SolutionRecord, solve_at: SolveAt) -> Floats:
    """Return the error of the steps in time from a further solve with twice the step.

    The result (2,) is the root mean square and the largest error, shares of the range; 0 for equations without time,
    and if twice the step exceeds the duration. ``solve_at`` makes the further solve, on the lattice of ``solution``,
    which may be coarse if it resolves what the velocity moves. Raises ResolutionError, which says that the user's own
    run is unaffected, if the run with twice the step is refused.
    """
    problem: Any = solution.scene.problem
    if problem.family != "time" or 2 * problem.step > problem.duration:
        return np.zeros(2)
    longer: Any = replace(problem, step=2 * problem.step)
    try:
        other = solve_at(replace(solution.scene, problem=longer), solution.spacing)
    except ResolutionError as error:
        why = str(error).partition(":")[0].partition(";")[0].rstrip(".")
        raise ResolutionError(
            f"The error of the steps in time is estimated by a run with twice the step, {longer.step:.3g}, and that "
            f"run failed ({why}). Your own run with step={problem.step:.3g} is unaffected; to have its error, halve "
            "the step."
        ) from error
    return np.asarray(difference(solution, other).sizes.max(axis=1) / (2 ** order_in_time(problem) - 1))


def order_in_time(problem: Evolution) -> int:
    """Return the order of accuracy of the time stepping scheme: 1 or 2; 1 if a function is called after each step."""
    return 1 if problem.scheme in FIRST_ORDER_SCHEMES or problem.after_step is not None else 2


def measured_source_error(
    solution: SolutionRecord, solve: Callable[[Scene], SolutionRecord], negligible: float
) -> float:
    """Return the error due to the source of the manifold, as a share of the solution's range; 0 for eigenvalues.

    The form estimates the error, for a mesh from areas. If the estimate is above ``negligible`` and the source is a
    mesh read as smooth, the scene is also solved on the flat triangles, since solutions differ by less than areas do.
    The ``solution`` should be coarse, as the further solve costs as much; ``solve`` solves a scene on its lattice.
    """
    if solution.has_modes:
        return 0.0
    form, surface = solution.discretized, solution.scene.surface
    by_areas = form.source_error()
    if by_areas <= max(negligible, form.source_error(0.0)) or not isinstance(surface, HasFacets):
        return by_areas
    flat = solve(replace(solution.scene, surface=surface.read_as_facets()))
    return form.source_error(float(difference(solution, flat).sizes[0].max()))


def error_of(solution: SolutionRecord, tight: bool = False) -> ErrorEstimate:
    """Return the estimated error of a solution, from coarser solutions with the options of its discretisation.

    With ``tight`` there are two coarser solutions. Raises InputError if the solution was made with ``estimate=False``,
    it has no lattice, or its form no estimate; ResolutionError or CpmkitError as :func:`estimate_by_solving` does.
    """
    form = solution.discretized
    options = lattice_options(form)
    if solution.estimated is False:
        raise InputError(
            "this solution has no estimate, since it was made with estimate=False or is a part of one on a union; "
            "leave that out, or read the error of the whole."
        )
    if options is None:
        raise InputError(
            f"the error of a solution by {form.form!r} is estimated on a coarser lattice, and it has none; solve with "
            "backend='cpm', or on a finer mesh and compare."
        )
    check_estimable(form)
    return estimate_by_solving(solution, coarse_solver({**options.as_dict(), "form": form.form}), tight)


def check_estimable(form: Discretized) -> None:
    """Raise InputError, with the reason, if differences between solutions of this form do not measure their errors."""
    reason = form.diagnosis().no_estimate
    if reason:
        raise InputError(f"The error of this solution has no estimate. {reason}")


def with_estimate(solution: SolutionRecord, how: bool | str | None, options: Mapping[str, Any]) -> SolutionRecord:
    """Return a solution with its error estimated now (``how`` True or "tight"), never (False) or at first use (None).

    ``options`` are those of ``solve``. If the form says that it has no estimate, the solution is returned as it is.
    Raises ResolutionError or CpmkitError as :func:`estimate_by_solving` does.
    """
    if how is None:
        return solution
    if how is False:
        return replace(solution, estimated=False)
    if solution.discretized.diagnosis().no_estimate:  # the warnings say so; the solution is returned
        return solution
    return replace(solution, estimated=estimate_by_solving(solution, coarse_solver(options), how == "tight"))


def coarse_solver(options: Mapping[str, Any]) -> SolveAt:
    """Return a function that solves a scene at a spacing, on a shifted lattice, with ``options``, without warnings."""
    given = {name: value for name, value in options.items() if name not in ("spacing", "origin")}

    def solve_at(scene: Scene, spacing: float) -> SolutionRecord:
        with collected_warnings():
            return solve_scene(scene, spacing, origin=shifted_origin(scene, spacing), **given)

    return solve_at


def with_further_modes(scene: Scene) -> Scene:
    """Return the scene to be solved at other spacings for comparison: an eigenvalue problem asks for 6 further modes.

    Close modes may have another order at another spacing. A scene with any other problem is unchanged.
    """
    problem: Any = scene.problem
    if problem.family != "eigen":
        return scene
    return replace(scene, problem=replace(problem, count=problem.count + 6))


def shifted_origin(scene: Scene, spacing: float, number: int = 1) -> Floats:
    """Return a node (d,) of the lattice of coarse solution ``number``, shifted so that lattices do not share nodes."""
    shift = number * np.array(SHIFT)[: scene.surface.dim] % 1.0
    return np.asarray(np.asarray(scene.surface.bounds).mean(axis=0) + spacing * shift)


@document_options(Options, *FORMS.values(), SolverOptions)
def estimate_error(
    scene: Scene, spacing: float, *, tight: bool = False, **options: Unpack[PreparingKeywords]
) -> ErrorEstimate:
    """Solve a scene at ``spacing`` and at 2 times it (root 2 times if that is too coarse); estimate the finer error.

    For one position of the lattice the estimate is within a factor of two or three of the true error; where the coarse
    lattice does not resolve the scene (thin parts, boundaries near each other) it is larger. Eigenvalues are matched by
    their functions, multiplets as a whole.

    Parameters
    ----------
    scene : Scene
        The scene.
    spacing : float
        Spacing of the finer solution.
    tight : bool
        Whether a third solution, at the root of two times the spacing, is used: it increases the cost by half, and the
        estimate is nearer to the true error.
    **options
        As for :func:`cpmkit.solve`.

    Returns
    -------
    ErrorEstimate

    Raises
    ------
    CpmkitError
        As ``solve`` does, at either spacing; InputError where differences of solutions do not measure their errors.

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
        estimate = estimate_by_solving(solution, coarse_solver(options), tight)
    warn_each(solution.warnings)
    return estimate
