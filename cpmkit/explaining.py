"""What a solve will build and cost, and, where that is asked for, how long it will take on this machine."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Unpack

from cpmkit.dispatch import solve_scene
from cpmkit.errors import ResolutionError, SceneError
from cpmkit.families.keywords import PreparingKeywords
from cpmkit.forecast.explanation import explain as explain_counts
from cpmkit.forecast.growth import line_through
from cpmkit.forecast.parts import Explanation
from cpmkit.forms.choice import FORMS
from cpmkit.forms.options import Options
from cpmkit.linear.solver_options import SolverOptions
from cpmkit.manifold.local_source import largest_dim
from cpmkit.protocols import Progress
from cpmkit.runtime.messages import collected_warnings
from cpmkit.runtime.options import document_options
from cpmkit.runtime.progress import ShownProgress, shown_progress
from cpmkit.scene.scene import Scene
from cpmkit.solution.record import SolutionRecord

#: Unknowns of the finer rehearsal, about, and the least ratio of its spacing to that which is asked for.
REHEARSED_UNKNOWNS, LEAST_RATIO = 8_000, 2.0
#: Spacings of the two rehearsals.
REHEARSALS_RATIO = 2.0

#: Solves at a spacing, and returns the solution with what it cost.
Rehearse = Callable[[float], tuple[SolutionRecord, float]]


@document_options(Options, *FORMS.values(), SolverOptions)
def explain(
    scene: Scene,
    spacing: float | None = None,
    *,
    rehearse: bool = False,
    seconds: bool = False,
    progress: ShownProgress = None,
    **options: Unpack[PreparingKeywords],
) -> Explanation:
    """Say what :func:`cpmkit.solve` with the same arguments will build, why, and at what cost.

    By default an estimate from the size of the surface and its boundaries, in a second, right within a factor of 2.

    Parameters
    ----------
    scene, spacing, progress
        As for :func:`cpmkit.solve`.
    rehearse : bool
        Whether the scene is laid out on coarse lattices, up to three of them, so that counts are right to 10 percent,
        and what may spoil the solution (creases, sheets that are too near, boundaries that meet) is told. Small scenes
        are laid out as they are. It takes up to as long as a solve.
    seconds : bool
        Whether, beside that, the scene is solved on two coarse lattices, to see how fast this machine is: then
        ``seconds`` of the explanation are how long a solve will take, to about a factor of two.
    **options
        As for :func:`cpmkit.solve`.

    Raises
    ------
    InputError, SceneError, ResolutionError
        As ``solve`` would: without a rehearsal what can be seen before anything is laid out.
    """
    with shown_progress(progress) as shown:
        explained = explain_counts(scene, spacing, rehearse=rehearse or seconds, progress=shown, **options)
        return _with_seconds(explained, scene, spacing, shown, dict(options)) if seconds else explained


def _with_seconds(
    explained: Explanation, scene: Scene, spacing: float | None, progress: Progress, options: dict[str, Any]
) -> Explanation:
    """Return an explanation with the seconds that a solve will take."""
    assert spacing is not None  # it was refused above
    rehearsed = {**options, "solver": explained.solver}

    def on_a_coarse_lattice(coarse: float) -> tuple[SolutionRecord, float]:
        with collected_warnings():
            started = time.perf_counter()
            solution = solve_scene(scene, coarse, progress=progress, **rehearsed)
            return solution, time.perf_counter() - started

    return replace(
        explained, seconds=foretold(on_a_coarse_lattice, spacing, explained.unknowns, largest_dim(scene.surface))
    )


def foretold(rehearse: Rehearse, spacing: float, unknowns: int, m: int) -> float | None:
    """Return what a solve of so many unknowns costs: a line in unknowns through two rehearsals.

    None where the scene cannot be solved on lattices so coarse. The coarser one is made twice, for what is compiled and
    read at first is no cost of the solve.
    """
    fine = spacing * max((unknowns / REHEARSED_UNKNOWNS) ** (1 / max(m, 1)), LEAST_RATIO)
    try:
        rehearse(REHEARSALS_RATIO * fine)
        found = [rehearse(one) for one in (REHEARSALS_RATIO * fine, fine)]
    except (ResolutionError, SceneError):
        return None
    coarse, finer = ((float(solution.discretized.size), cost) for solution, cost in found)
    start, each = line_through(coarse, finer)
    return start + each * unknowns
