"""What is told where memory ran out although it seemed to fit."""

from __future__ import annotations

import traceback

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.grid.fitting import fitting_spacing, or_another_solver, rounded_up, unknowns_at_one
from cpmkit.linear.choice import choose_solver
from cpmkit.manifold.localized import localize
from cpmkit.runtime import memory
from cpmkit.scene.scene import Scene

#: Where memory ran out although a spacing seemed to fit, one this many times as large is named.
COARSER = 1.5


def memory_ran_out(
    scene: Scene, spacing: float | None, degree: int, solver: str, error: BaseException, limit: memory.Limit
) -> ResolutionError:
    """Return what to raise in place of an error: what is needed, what there was, and a spacing that would fit.

    The tables that the error's traceback holds are let go first. ``limit`` is that of before the work.
    """
    traceback.clear_frames(error.__traceback__)
    if spacing is None:
        return ResolutionError(f"Memory ran out, and {limit}; a coarser mesh, or a larger spacing, needs less.")
    try:
        needed, fits, chosen = _needed(scene, spacing, degree, solver, limit)
    except (MemoryError, ValueError, ArithmeticError):
        needed, fits, chosen = "", 0.0, solver
    fits = max(fits, rounded_up(COARSER * spacing))
    return ResolutionError(
        f"Memory ran out at spacing={spacing:g}: {needed}{limit}, libraries included; "
        f"try spacing={fits:g} or more{or_another_solver(chosen)}."
    )


def _needed(scene: Scene, spacing: float, degree: int, solver: str, limit: memory.Limit) -> tuple[str, float, str]:
    """Return what a solve needs, in words, the spacing that would fit, and the solver."""
    source = localize(scene.surface, np.zeros(scene.surface.dim))
    unknowns = unknowns_at_one(source, degree) / spacing**source.largest_dim
    chosen = choose_solver(solver, round(unknowns), source.largest_dim, scene.problem.factorise_up_to)
    needed = unknowns * memory.bytes_per_unknown(source.dim, degree, chosen)
    told = f"about {unknowns:.2g} unknowns need {needed / 2**30:.2g} GiB or more with the solver {chosen!r}, and "
    return told, fitting_spacing(source, degree, limit.bytes, chosen), chosen
