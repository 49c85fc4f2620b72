"""Accuracies of whatever makes a solution of a spacing, though it may take many solves to make it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from cpmkit.accuracy.companions import expected_of, from_companions
from cpmkit.accuracy.error_estimate import ErrorEstimate
from cpmkit.accuracy.estimate import shifted_origin
from cpmkit.accuracy.trading import walked
from cpmkit.accuracy.way import Way
from cpmkit.errors import InputError
from cpmkit.forms.accuracy_target import AccuracyTarget
from cpmkit.protocols import Progress, no_progress
from cpmkit.runtime.messages import collected_warnings, warn_each
from cpmkit.runtime.options import document_options, split_options
from cpmkit.scene.scene import Scene
from cpmkit.solution.record import SolutionRecord

#: Makes a solution at a spacing, on a lattice that has a node at the given origin, or at one of its own choice.
Recipe = Callable[[float, Any], SolutionRecord]
#: The class of the solutions that a recipe makes.
Made = TypeVar("Made", bound=SolutionRecord)
#: Pilots that are too coarse are made finer so many times: a recipe may refuse what no spacing helps.
MOST_TRIALS = 4


@document_options(AccuracyTarget)
def solve_by(
    recipe: Callable[[float, Any], Made],
    scene: Scene,
    *,
    order: float | None = None,
    progress: Progress = no_progress,
    **target: Any,
) -> Made:
    """Find a spacing for a recipe, by an error, a time or a memory that is asked for, as :func:`cpmkit.solve` does.

    Parameters
    ----------
    recipe : callable
        ``recipe(spacing, origin)`` returns the solution at a spacing; ``origin`` is to be passed on to
        :func:`cpmkit.prepare` or :func:`cpmkit.solve`.
    scene : Scene
        With the manifold of the solution.
    order : float, optional
        At which errors are taken to fall; that of the form unless it is given.
    progress : callable, optional
        ``progress(stage, fraction)``.
    **asked
        A tolerance, seconds or a memory at least.

    Returns
    -------
    Solution
        With its estimate, its trade, and a warning where the tolerance was not reached.

    Raises
    ------
    InputError
        If nothing is asked for, or what is asked for is not accepted.
    CpmkitError
        As the recipe does, where no spacing serves.

    Examples
    --------
    >>> import cpmkit as ck
    >>> circle = ck.source("analytic.circle")
    >>> scene = ck.Scene(circle, ck.ScreenedPoisson(lambda points: 2 * points[:, 0]))
    >>> found = ck.solve_by(lambda spacing, origin: ck.solve(scene, spacing, origin=origin), scene, tolerance=1e-3)
    >>> found.trade.status
    'reached'
    """
    goal, others = split_options(AccuracyTarget, target)
    if others or not goal.given:
        raise InputError(
            "solve_by needs a tolerance, seconds or a memory"
            + (f", and takes no {next(iter(others))!r}." if others else ", none of which was given.")
        )
    # a recipe has no degree that could be chosen
    way = Way(scene, _quiet(recipe), goal, progress, order=order, trials=MOST_TRIALS, degree_given=True)
    found = walked(way)
    warn_each(found.warnings)
    return cast("Made", found)


def estimate_error_by(recipe: Recipe, solution: SolutionRecord, *, order: float | None = None) -> ErrorEstimate:
    """Estimate the error of a solution that a recipe made, by making it again at twice the spacing.

    Parameters
    ----------
    recipe, order
        As for :func:`solve_by`.
    solution : Solution
        Whose error it is.

    Raises
    ------
    CpmkitError
        As the recipe does at twice the spacing.
    """
    spacing = 2.0 * solution.spacing
    with collected_warnings():
        coarse = recipe(spacing, shifted_origin(solution.scene, spacing))
    return from_companions(solution, [coarse], order=order, alone=expected_of(solution) if order is None else None)


def _quiet(recipe: Recipe) -> Callable[..., SolutionRecord]:
    def solve(_: Scene, spacing: float, progress: Progress = no_progress, origin: Any = None) -> SolutionRecord:
        progress("solve", 0.0)
        with collected_warnings():
            return recipe(spacing, origin)

    return solve
