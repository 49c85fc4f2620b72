"""What a mesh that is read as smooth leaves of an error, by a solution on its flat triangles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from cpmkit.accuracy.comparison import difference
from cpmkit.protocols import ReadsAsTriangles
from cpmkit.solution.modes import EigenRecord
from cpmkit.solution.record import SolutionRecord


def floor_by_facets(solution: SolutionRecord, solve_at: Callable[..., SolutionRecord], enough: float) -> float:
    """Return the floor of a solution's source, as a share of the solution's range; of eigenvalues 0, it is not known.

    Where it is above ``enough`` by the areas alone, and the source is a mesh that can be read as its triangles, the
    scene is solved on these: solutions differ by less than areas do.

    Parameters
    ----------
    solution : Solution
        A coarse one, for what a solve on the triangles costs.
    solve_at : callable
        Solves a scene on the lattice of the solution.
    enough : float
        A floor below this matters to nobody.
    """
    if isinstance(solution, EigenRecord):
        return 0.0
    form, surface = solution.discretized, solution.scene.surface
    by_areas = form.source_error()
    if by_areas <= max(enough, form.source_error(0.0)) or not isinstance(surface, ReadsAsTriangles):
        return by_areas
    flat = solve_at(replace(solution.scene, surface=surface.faceted()))
    return form.source_error(float(difference(solution, flat).rms.max()))
