"""The functions that discretise and solve a scene, and that explain the size and cost of a solve."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Unpack, cast, overload

from cpmkit.accuracy.estimate import estimate_error as estimate_error
from cpmkit.accuracy.estimate import with_estimate
from cpmkit.accuracy.solve_to_target import solve_to_target
from cpmkit.dispatch import solve_scene
from cpmkit.errors import InputError, ResolutionError, SceneError
from cpmkit.facade import EigenSolution, EvolvedSolution, Solution
from cpmkit.families.context import Checkpointing, DiscretizingKeywords, PreparingKeywords, SolvingKeywords
from cpmkit.forms.choice import FORMS, cost_model, every_option, explain_memory_error, module_of, options_of
from cpmkit.forms.contract import Discretized
from cpmkit.forms.cost_model import CostModel, Explanation, Part, fit_linear_cost, sides_in_words, solver_part
from cpmkit.forms.options import AccuracyTarget, Options
from cpmkit.grid.lattice import check_numbered, lattice_of
from cpmkit.linear.solver_options import SolverOptions
from cpmkit.manifold.abilities import warnings_of
from cpmkit.manifold.local_source import largest_dim, localize
from cpmkit.manifold.mixed_dimension import mixed_joint_warnings
from cpmkit.plugins import call_factory, factory, takes_key
from cpmkit.runtime.deprecation import deprecated_keywords
from cpmkit.runtime.messages import collected_warnings, did_you_mean, warn_each
from cpmkit.runtime.options import document_options, split_options
from cpmkit.runtime.progress import ShownProgress, shown_progress
from cpmkit.scene.equations import EigenFamily, TimeFamily
from cpmkit.scene.junction import junctions_in_words
from cpmkit.scene.scene import Scene
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Progress

#: Shows nothing unless the caller configures logging.
logger = logging.getLogger("cpmkit")
#: Ratio of the spacings of the two timed solves, and least ratio of the finer of these spacings to the requested one.
TIMED_RATIO = 2.0


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


@deprecated_keywords(rehearse="dry_run")
@document_options(Options, *FORMS.values(), SolverOptions)
def explain(
    scene: Scene,
    spacing: float | None = None,
    *,
    dry_run: bool = False,
    seconds: bool = False,
    progress: ShownProgress = None,
    **options: Unpack[PreparingKeywords],
) -> Explanation:
    """Return what :func:`cpmkit.solve` with the same arguments would build, for which reasons, and at what cost.

    By default these are estimates from the size of the surface and its boundaries, made in a second and correct
    within a factor of 2.

    Parameters
    ----------
    scene, spacing, progress
        As for :func:`cpmkit.solve`.
    dry_run : bool
        Whether the scene is discretised on up to three coarse lattices, so that counts are correct to 10 percent, and
        warnings (creases, sheets that are too near) are found. Small scenes are discretised at
        the spacing itself. It takes up to as long as a solve.
    seconds : bool
        Whether, after a dry run, the scene is also solved on two coarse lattices to time this machine: ``seconds`` of
        the explanation are then the duration of a solve, to about a factor of two.
    **options
        As for :func:`cpmkit.solve`.

    Raises
    ------
    InputError, SceneError, ResolutionError
        As ``solve`` would; without a dry run only what can be found before anything is built.
    """
    with shown_progress(progress) as shown:
        target, rest = options_of(scene, spacing, options)
        solver = SolverOptions.from_keywords(rest, every_option()).solver
        module_of(target.form).check(scene, target)
        model = cost_model(scene, target)
        with explain_memory_error(scene, target, solver):
            explained = model.explain(solver, shown) if dry_run or seconds else quick_estimate(model, solver)
        warnings = [*warnings_of(scene.surface, target.spacing)]
        if target.form == "collocation":
            warnings += module_of(target.form).form_choice_warnings(scene, target)
            warnings += mixed_joint_warnings(scene.surface, target.spacing)
        explained = replace(explained, warnings=(*dict.fromkeys((*warnings, *explained.warnings)),))
        return _add_seconds(explained, scene, target.spacing, shown, dict(options)) if seconds else explained


def quick_estimate(model: CostModel[Any], solver: str) -> Explanation:
    """Return the size and cost of a solve of ``model.scene``, estimated from cells around manifold and boundaries.

    Nothing is discretised; ``solver`` is the name of the linear solver, or auto. Raises ResolutionError if memory would
    not suffice. Counts are right within a factor of 2.
    """
    scene, options = model.scene, model.options
    origin = lattice_of(scene.surface, options.spacing, options.origin, model.coarsest_share).origin
    surface = localize(scene.surface, origin)
    check_numbered(surface.bounds, options.spacing)
    at_surface = model.band_unknowns(surface)
    sources = [localize(boundary.source, origin) for boundary in scene.boundaries]
    at_boundaries = [model.boundary_shares[one.largest_dim > 0] * model.band_unknowns(one) for one in sources]
    unknowns = at_surface + sum(at_boundaries)
    chosen = model.choose_solver(solver, unknowns)
    model.check_fits(unknowns, chosen)
    parts = [Part("unknowns of the manifold", _rounded_count(at_surface), f"form {options.form!r}: {options.reason}")]
    if options.form == "galerkin":
        parts += [Part(*words) for words in junctions_in_words(scene.surface, scene.junctions)]
    for boundary, count in zip(scene.boundaries, at_boundaries, strict=True):
        why = f"each side has its own: {sides_in_words(boundary)}"
        parts.append(Part(f"unknowns at {boundary.name!r}", _rounded_count(count), why))
    return Explanation(
        parts=(*parts, solver_part(scene, chosen, solver)),
        left_out=(),
        unknowns=round(unknowns),
        closest_point_queries=None,
        bytes=round(model.peak_bytes(unknowns, chosen)),
        floor=model.source_error(),
        solver=chosen,
        exact=False,
        off_by=2.0,  # measured on ten scenes
    )


def _rounded_count(count: float) -> str:
    """Return the text "about" with a count rounded to two digits, or below ten to one."""
    return f"about {float(f'{count:.1g}' if count < 10 else f'{count:.2g}'):,.0f}"


def _add_seconds(
    explained: Explanation, scene: Scene, spacing: float, progress: Progress, options: dict[str, Any]
) -> Explanation:
    """Return ``explained`` with the seconds of a solve at ``spacing``, by timed coarse solves; None if these fail."""
    given = {**options, "solver": explained.solver}

    def solve_timed(coarse: float) -> tuple[SolutionRecord, float]:
        """Return the solution at the spacing ``coarse``, and the wall-clock seconds of its solve."""
        with collected_warnings():
            started = time.perf_counter()
            solution = solve_scene(scene, coarse, progress=progress, **given)
            return solution, time.perf_counter() - started

    seconds = extrapolated_cost(solve_timed, spacing, explained.unknowns, largest_dim(scene.surface))
    return replace(explained, seconds=seconds)


def extrapolated_cost(
    solve: Callable[[float], tuple[SolutionRecord, float]], spacing: float, unknowns: int, m: int
) -> float | None:
    """Return the cost of a solve with ``unknowns`` at ``spacing``, extrapolated linearly from two coarse solves.

    None if the coarse solves raise ResolutionError or SceneError. The coarser solve is repeated, since the first one
    includes the cost of compiling and reading. ``solve`` returns the solution at a spacing and its cost, such as
    seconds; ``m`` is the dimension of the manifold. The finer solve has at most about 8000 unknowns.
    """
    fine = spacing * max((unknowns / 8_000) ** (1 / max(m, 1)), TIMED_RATIO)
    try:
        solve(TIMED_RATIO * fine)
        pairs = [solve(width) for width in (TIMED_RATIO * fine, fine)]
    except (ResolutionError, SceneError):
        return None
    coarse, finer = ((float(solution.discretized.size), cost) for solution, cost in pairs)
    start, slope = fit_linear_cost(coarse, finer)
    return start + slope * unknowns
