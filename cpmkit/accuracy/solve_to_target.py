"""Solving to a given error, within a time or within a memory; returns the solution with the history of the solves."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, TypeVar, cast

import numpy as np

from cpmkit.accuracy.adaptive_run import AdaptiveRun, SolveStep, TimedSolve
from cpmkit.accuracy.error_estimate import ErrorEstimate, estimate_alone, estimate_from
from cpmkit.accuracy.estimate import check_estimable, shifted_origin
from cpmkit.accuracy.spacing_search import (
    CUBIC_ERROR,
    Status,
    answers_used_up,
    errors_stagnate,
    predicted_bytes,
    search_spacing,
)
from cpmkit.dispatch import solve_scene
from cpmkit.errors import InputError
from cpmkit.families.context import Checkpointing
from cpmkit.forms.choice import choose_form
from cpmkit.forms.form_records import LARGE_ERRORS
from cpmkit.forms.options import AccuracyTarget
from cpmkit.manifold.abilities import advice_of
from cpmkit.manifold.mixed_dimension import mixed_joint_warnings
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.runtime.messages import collected_warnings, warn_each
from cpmkit.runtime.options import declared_options, document_options, split_options
from cpmkit.scene.equations_in_time import Wave
from cpmkit.scene.scene import Scene
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Progress, no_progress


@dataclass(frozen=True)
class SolveHistory:
    """The solves by which a target (error, time or memory) was met."""

    target: AccuracyTarget  #: The target.
    status: Status  #: ``reached``, ``floor``, ``within`` or ``not reached``.
    error: float  #: The estimate of the solution's error in the norm of the target.
    predicted_bytes: float  #: Predicted peak of memory of the last solve.
    seconds: float  #: Duration of all solves together.
    steps: tuple[SolveStep, ...]  #: All solves, in order.
    summary: str  #: The result, in a sentence.
    chosen: str = ""  #: Options that were chosen in addition to the spacing, with the reason; empty without any.

    told = DeprecatedMember("summary")
    asked = DeprecatedMember("target")

    @property
    def cost_over_last_solve(self) -> float:
        """Ratio of the seconds of all solves and estimates to the seconds of the last solve."""
        return self.seconds / self.steps[-1].seconds

    def as_dict(self) -> dict[str, Any]:
        """Return the record as a dictionary of plain values."""
        return {**asdict(self), "cost_over_last_solve": self.cost_over_last_solve}

    def __str__(self) -> str:
        """Return a line for each solve, then the options chosen and the result."""
        lines = [
            f"{step.purpose:<10} spacing {step.spacing:<8.3g} {step.unknowns:>9,} unknowns  {step.seconds:7.2f} s  "
            f"{'error not yet known' if step.error != step.error else f'error about {100 * step.error:.2g} percent'}"
            for step in self.steps
        ]
        return "\n".join([*lines, *([self.chosen] if self.chosen else []), self.summary])


#: The class of the solutions that a recipe returns.
Made = TypeVar("Made", bound=SolutionRecord)
#: Returns a solution at a spacing, on a lattice with a node at the given origin, or anywhere if that is None.
Recipe = Callable[[float, Any], SolutionRecord]


def solve_to_target(
    scene: Scene, target: AccuracyTarget, progress: Progress, options: Mapping[str, Any]
) -> SolutionRecord:
    """Solve at several spacings until the target is met or cannot be met, and return the solution.

    The solution is that of :func:`search_solution`. ``options`` are those of ``solve``. Raises InputError if an option
    or the scene needs a given spacing. Raises CpmkitError as ``solve`` does, if the scene is solved at no spacing.
    """
    _check_target_options(scene, options)
    given = {name: value for name, value in options.items() if name != "origin"}
    if target.tolerance is not None:
        # the error that it causes is below 1/20 of the tolerance (measured: tests/accuracy/test_tolerance.py)
        given = {"solver_tolerance": min(max(1e-3 * target.tolerance, 1e-10), 1e-6), **given}

    def solve(scene: Scene, spacing: float, **further: Any) -> SolutionRecord:
        with collected_warnings():
            return solve_scene(scene, spacing, **{**given, **further})

    return search_solution(AdaptiveRun(scene, solve, target, progress, options))


@document_options(AccuracyTarget)
def solve_by(
    recipe: Callable[[float, Any], Made],
    scene: Scene,
    *,
    order: float | None = None,
    progress: Progress = no_progress,
    **target: Any,
) -> Made:
    """Return a recipe's solution at a spacing chosen for an error, a time or a memory, as :func:`cpmkit.solve` does.

    Parameters
    ----------
    recipe : callable
        ``recipe(spacing, origin)`` returns the solution at a spacing; ``origin`` is to be passed on to
        :func:`cpmkit.prepare` or :func:`cpmkit.solve`.
    scene : Scene
        A scene on the manifold of the solution.
    order : float, optional
        The order at which errors are assumed to fall; by default that of the form.
    progress : callable, optional
        ``progress(stage, fraction)``.
    **target
        At least one of ``tolerance``, ``seconds`` and ``memory``, as for :func:`cpmkit.solve`, and ``norm``.

    Returns
    -------
    Solution
        With its estimate, its history, and a warning where the target was not reached: then the solution with the
        smallest estimated error is returned.

    Raises
    ------
    InputError
        If there is no target, it is not accepted, or a further keyword is given.
    CpmkitError
        As the recipe does, where no spacing serves.

    Examples
    --------
    >>> import cpmkit as ck
    >>> circle = ck.source("analytic.circle")
    >>> scene = ck.Scene(circle, ck.ScreenedPoisson(lambda points: 2 * points[:, 0]))
    >>> found = ck.solve_by(lambda spacing, origin: ck.solve(scene, spacing, origin=origin), scene, tolerance=1e-3)
    >>> found.solve_history.status
    'reached'
    """
    goal, others = split_options(AccuracyTarget, target)
    if others or not goal.given_targets:
        raise InputError(
            "solve_by needs a tolerance, seconds or a memory"
            + (f", and takes no {next(iter(others))!r}." if others else ", none of which was given.")
        )

    def solve(_: Scene, spacing: float, progress: Progress = no_progress, origin: Any = None) -> SolutionRecord:
        progress("solve", 0.0)
        with collected_warnings():
            return recipe(spacing, origin)

    solution = search_solution(AdaptiveRun(scene, solve, goal, progress, is_recipe=True, order=order))
    warn_each(solution.warnings)
    return cast("Made", solution)


def estimate_error_by(recipe: Recipe, solution: SolutionRecord, *, order: float | None = None) -> ErrorEstimate:
    """Return the estimated error of a recipe's solution, from the recipe's solution at twice the spacing.

    Parameters
    ----------
    recipe, order
        As for :func:`solve_by`.
    solution : SolutionRecord
        The solution whose error is estimated.

    Raises
    ------
    CpmkitError
        As the recipe does at twice the spacing; InputError where differences of solutions do not measure their errors.
    """
    check_estimable(solution.discretized)
    spacing = 2.0 * solution.spacing
    with collected_warnings():
        coarse = recipe(spacing, shifted_origin(solution.scene, spacing))
    return estimate_from(solution, [coarse], order=order, alone=estimate_alone(solution) if order is None else None)


def search_solution(run: AdaptiveRun) -> SolutionRecord:
    """Search for the spacing at which the target of ``run`` is met, and return a solution with estimate and history.

    The last solution is returned if the tolerance, or the source's own error, is reached, else the solution with the
    smallest estimated error. It has a warning if the tolerance is not reached, limits are exceeded, or a solve failed.
    Its ``estimated`` is None without a coarser solution to compare with. Raises CpmkitError as `search_spacing` does.
    """
    status, aim = search_spacing(run)
    best = run.last if status in ("reached", "floor") else run.best
    answer = run.with_scene_modes(best.solution)
    if status == "reached":  # the estimate then shows that errors are not large
        answer = replace(answer, warnings=tuple(text for text in answer.warnings if not text.startswith(LARGE_ERRORS)))
    if best.estimate is not None and run.measured_floor is not None:
        floor = np.full(len(best.estimate.unit), run.measured_floor)
        best = replace(best, estimate=replace(best.estimate, floor=floor))
    history = SolveHistory(
        run.target,
        status,
        best.error,
        predicted_bytes(run, best.unknowns),
        run.elapsed,
        tuple(SolveStep(*(getattr(solve, entry.name) for entry in fields(SolveStep))) for solve in run.solves),
        _result_sentence(run, best, status, aim),
        _degree_sentence(run, best),
    )
    warnings = (history.summary,) if status in ("floor", "not reached") or run.failure is not None else ()
    return replace(answer, estimated=best.estimate, solve_history=history, warnings=(*answer.warnings, *warnings))


def _check_target_options(scene: Scene, options: Mapping[str, Any]) -> None:
    """Raise InputError for options and scenes that need a spacing to be given."""
    given = [name for name in declared_options(Checkpointing) if name in options]
    given += ["backend"] if options["backend"] != "cpm" else []
    if given:
        raise InputError(
            f"{given[0]}={options[given[0]]!r} goes with one solve at one spacing, and a tolerance, seconds or memory "
            "may take several; give a spacing."
        )
    joints = mixed_joint_warnings(scene.surface) if choose_form(scene, options)[0] == "collocation" else []
    if joints:
        raise InputError(
            "A tolerance, seconds or memory goes by estimates of the error, of which there is none here; give a "
            f"spacing. {joints[0]}"
        )
    if isinstance(scene.problem, Wave) and scene.problem.scheme == "leapfrog":
        raise InputError(
            "scheme 'leapfrog' ties its step to the spacing, which is not known where a tolerance, seconds or memory "
            "is given; use scheme='newmark', or give a spacing."
        )


def _result_sentence(run: AdaptiveRun, best: TimedSolve, status: Status, aim: float) -> str:
    """Return the result of the search in a sentence; ``best`` is the solve whose solution is returned.

    ``aim`` is the tolerance aimed at, or the error due to the source if that is larger; 0 without a tolerance.
    """
    target, estimate = run.target, best.estimate
    where = f"at spacing {best.spacing:.3g} with {best.unknowns:,} unknowns"
    size, norm = best.error, {"rms": "root mean square", "max": "largest error"}[target.norm]
    norm, unit = ("error", "each eigenvalue") if best.solution.has_modes else (norm, "the range")
    about = "not known" if math.isnan(size) else f"about {100 * size:.2g} percent of {unit}"
    error = f"{norm} {about} {where}"
    slow = f"; {estimate.slow}" if estimate is not None and estimate.slow else ""
    if estimate is not None and status != "floor":
        error += estimate.floor_in_words
    if run.failure is not None:
        why = str(run.failure) or f"memory ran out ({type(run.failure).__name__})."
        return f"{target.target} not reached: {error}{slow}; a further solve was refused: {why}"
    finest = f"no finer solve fits into {_limits_in_words(run)}"
    if answers_used_up(run):
        finest = f"the search ends here; spacing={run.last.spacing / 2:.2g} is the next to try"
    if errors_stagnate(run):
        finest = "smaller spacings gave no less: rounding, noise or the residuals of linear solves leave that much"
    if status == "within":
        return f"{error}; {finest}{slow}."
    if status == "reached":
        return f"tolerance {target.tolerance:g} reached: {error}."
    if status == "floor":
        causes = " ".join(advice_of(run.scene.surface, best.spacing).warnings)
        about = "at most" if estimate is not None and estimate.floor_is_bound else "about"
        return (
            f"tolerance {target.tolerance:g} is below what the surface's representation alone may leave, {about} "
            f"{100 * aim:.1g} percent of the range at any spacing: {error}{slow}; give a more accurate surface, or "
            "a spacing in place of the tolerance."
            f"{' ' if causes else ''}{causes}"
        )
    if target.tolerance is None:
        return f"{target.seconds:g} seconds were not enough, it took {run.elapsed:.2g}: {error}{slow}."
    doubt = "; errors do not fall yet as they should" if size <= target.tolerance else ""
    return f"tolerance {target.tolerance:g} not reached: {error}; {finest}{doubt}{slow}."


def _degree_sentence(run: AdaptiveRun, best: TimedSolve) -> str:
    """Return a sentence on the chosen degree; "" if none was, or the best solve has other options than the last."""
    if not run.chosen_options or not run.has_same_options(best.solution):  # the last solve has the chosen degree
        return ""
    return (
        f"degree {run.chosen_options['degree']} was chosen: on smooth surfaces that are known exactly it reaches "
        f"errors below {CUBIC_ERROR:.1g} sooner than degree 2 does; degree=2 takes less memory per unknown."
    )


def _limits_in_words(run: AdaptiveRun) -> str:
    """Return the limits of time and memory in words."""
    target = run.target
    limits = [] if target.seconds is None else [f"{target.seconds:g} seconds"]
    limits.append(
        "the memory of this machine" if target.memory is None else f"{target.memory / 2**20:.4g} MiB of memory"
    )
    return " and ".join(limits)
