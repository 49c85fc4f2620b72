"""The size and cost of a solve: an estimate in a second, counts by a dry run, and the seconds on this machine."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Unpack

from cpmkit.dispatch import solve_scene
from cpmkit.errors import ResolutionError, SceneError
from cpmkit.families.context import PreparingKeywords
from cpmkit.forms.choice import FORMS, cost_model, every_option, explain_memory_error, module_of, options_of
from cpmkit.forms.cost_model import CostModel, Explanation, Part, line_through, sides_in_words, solver_part
from cpmkit.forms.options import Options
from cpmkit.grid.lattice import check_numbered, lattice_of
from cpmkit.linear.solver_options import SolverOptions
from cpmkit.manifold.local_source import largest_dim, localize
from cpmkit.manifold.mixed_dimension import mixed_joint_warnings
from cpmkit.runtime.deprecation import deprecated_keywords
from cpmkit.runtime.messages import collected_warnings
from cpmkit.runtime.options import document_options
from cpmkit.runtime.progress import ShownProgress, shown_progress
from cpmkit.scene.scene import Scene
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Progress

#: Ratio of the spacings of the two timed solves, and least ratio of the finer of them to the given one.
TIMED_RATIO = 2.0


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
        warnings (creases, sheets that are too near, boundaries that meet) are found. Small scenes are discretised at
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
        warnings = (*mixed_joint_warnings(scene.surface, target.spacing), *explained.warnings)
        explained = replace(explained, warnings=warnings)
        return _with_seconds(explained, scene, target.spacing, shown, dict(options)) if seconds else explained


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
    at_boundaries = [
        model.boundary_share * model.band_unknowns(localize(boundary.source, origin)) for boundary in scene.boundaries
    ]
    unknowns = at_surface + sum(at_boundaries)
    chosen = model.choose_solver(solver, unknowns)
    model.check_fits(unknowns, chosen)
    parts = [Part("unknowns of the surface", _rounded_count(at_surface), f"form {options.form!r}: {options.reason}")]
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


def _with_seconds(
    explained: Explanation, scene: Scene, spacing: float, progress: Progress, options: dict[str, Any]
) -> Explanation:
    """Return ``explained`` with the seconds of a solve at ``spacing``, predicted from timed coarse solves, or None."""
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

    None if the coarse solves raise ResolutionError or SceneError. The coarser is made twice, as the first includes the
    cost of compiling and reading. ``solve`` returns the solution at a spacing and its cost, such as seconds; ``m`` is
    the dimension of the manifold. The finer solve has at most about 8000 unknowns.
    """
    fine = spacing * max((unknowns / 8_000) ** (1 / max(m, 1)), TIMED_RATIO)
    try:
        solve(TIMED_RATIO * fine)
        pairs = [solve(width) for width in (TIMED_RATIO * fine, fine)]
    except (ResolutionError, SceneError):
        return None
    coarse, finer = ((float(solution.discretized.size), cost) for solution, cost in pairs)
    start, slope = line_through(coarse, finer)
    return start + slope * unknowns
