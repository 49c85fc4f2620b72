"""The functions that discretise and solve a scene."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any, Unpack, cast, overload

from cpmkit.accuracy.estimate import estimate_error as estimate_error
from cpmkit.accuracy.estimate import with_estimate
from cpmkit.accuracy.solve_to_target import solve_to_target
from cpmkit.dispatch import solve_scene
from cpmkit.errors import InputError
from cpmkit.facade import EigenSolution, EvolvedSolution, Solution
from cpmkit.families.context import Checkpointing, DiscretizingKeywords, SolvingKeywords
from cpmkit.forms.choice import FORMS, module_of, options_of
from cpmkit.forms.contract import Discretized
from cpmkit.forms.options import AccuracyTarget, Options
from cpmkit.linear.solver_options import SolverOptions
from cpmkit.plugins import call_factory, factory, takes_key
from cpmkit.runtime.messages import did_you_mean, warn_each
from cpmkit.runtime.options import document_options, split_options
from cpmkit.runtime.progress import ShownProgress, shown_progress
from cpmkit.scene.equations import EigenFamily, TimeFamily
from cpmkit.scene.scene import Scene

#: Shows nothing unless the caller configures logging.
logger = logging.getLogger("cpmkit")


@overload
def solve(
    scene: Scene[EigenFamily], spacing: float | None = None, *, backend: str = "cpm", **options: Unpack[SolvingKeywords]
) -> EigenSolution: ...
@overload
def solve(
    scene: Scene[TimeFamily], spacing: float | None = None, *, backend: str = "cpm", **options: Unpack[SolvingKeywords]
) -> EvolvedSolution: ...
@overload
def solve(
    scene: Scene[Any], spacing: float | None = None, *, backend: str = "cpm", **options: Unpack[SolvingKeywords]
) -> Solution: ...
@overload
def solve(scene: Scene[Any], spacing: float | None = None, *, backend: str, **options: Any) -> Solution: ...
@document_options(AccuracyTarget, Options, *FORMS.values(), SolverOptions, Checkpointing)
def solve(
    scene: Scene, spacing: float | None = None, *, backend: str = "cpm", progress: ShownProgress = None, **options: Any
) -> Solution:
    """Solve a scene on a lattice, or with another back end.

    Parameters
    ----------
    scene : Scene
        The scene.
    spacing : float
        Spacing of the lattice, in the scene's unit of length; or ``tolerance``, ``seconds`` or ``memory`` in its
        place. There is no default; without any of them, the error suggests a spacing. Another back end may not need
        one: ``fem`` solves on a mesh's own triangles.
    backend : str
        ``cpm``, or the name of a form of a plugin, such as ``fem``. That form may have options of its own; the options
        below that describe a lattice are those of ``cpm``. Equations, solvers, checkpoints and solutions are the same.
    progress : callable or bool, optional
        ``progress(stage, fraction)``. By default a bar is shown on a terminal and in notebooks for a solve that takes
        longer than two seconds; ``False`` shows none, ``True`` shows it at once.
    **options
        Further options of the solver, such as ``max_iterations`` of ``reference``, or of a plugin's form.

    Returns
    -------
    Solution

    Raises
    ------
    CpmkitError
        One sentence: the value that was given, the values that are accepted, and a remedy.

    Warns
    -----
    CpmkitWarning
        Each of the solution's ``warnings``, once.

    Examples
    --------
    A circle, cut at one point. Left is where the curve comes from, so that a quarter turn after the cut u has risen by
    a quarter.

    >>> import cpmkit as ck
    >>> cut = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), left=ck.Dirichlet(1), right=ck.Dirichlet(0))
    >>> scene = ck.Scene(ck.source("analytic.circle"), ck.Laplace(), [cut])
    >>> ck.solve(scene, spacing=0.05).evaluate([[0, 1], [-1, 0]]).round(3)
    array([0.25, 0.5 ])
    """
    target, rest = split_options(AccuracyTarget, options)
    target.check_spacing(spacing)
    with shown_progress(progress) as shown:
        if target.given_targets:
            solution = solve_to_target(scene, target, shown, {"backend": backend, **rest})
        else:
            solution = solve_scene(scene, spacing, backend=backend, progress=shown, **rest)
            solution = with_estimate(solution, target.estimate, {"backend": backend, **rest})
    figures = scene.problem.kind, len(solution.values), solution.report.solver, sum(solution.seconds.values())
    logger.info("Solved %s: %d unknowns by %s in %.1f s.", *figures)
    warn_each(solution.warnings)
    return cast("Solution", solution)  # records are constructed as instances of this class


def backend_independent_options(options: Mapping[str, Any], backend: str = "") -> dict[str, Any]:
    """Return the options of a scene file or study that apply to every back end, not only to a lattice or its solver.

    These are ``solver_tolerance``, and ``degree`` if the named ``backend`` takes it.
    """
    make = call_factory(factory(backend, "cpmkit_backends"), backend, {}).discretize if backend else None
    shared = ("solver_tolerance", *(("degree",) if make and takes_key(make, "degree") else ()))
    return {name: value for name, value in options.items() if name in shared}


@document_options(Options, *FORMS.values())
def discretize(
    scene: Scene, spacing: float, *, progress: ShownProgress = None, **options: Unpack[DiscretizingKeywords]
) -> Discretized:
    """Return ``scene`` discretised at ``spacing``.

    Parameters
    ----------
    scene : Scene
        Surface, boundaries, edge, problem.
    spacing : float
        Spacing of the lattice, in the scene's unit of length.
    progress : callable or bool, optional
        As for :func:`cpmkit.solve`.
    **options
        Other options are refused.

    Raises
    ------
    InputError, SceneError, ResolutionError
        If an argument, a boundary or the spacing is not accepted.
    """
    target, others = options_of(scene, spacing, options)
    if others:
        near = did_you_mean(next(iter(others)), target.as_dict())
        raise InputError(
            f"discretize has no option {next(iter(others))!r}{near}; accepted are {', '.join(target.as_dict())}."
        )
    with shown_progress(progress) as shown:
        made: Discretized = module_of(target.form).discretize(scene, target, shown)
    return made
