"""What flows out of a side of a boundary: the conormal derivative, and its integral."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit.manifold.tangent_space import outward_conormals
from cpmkit.protocols import Floats, Side
from cpmkit.solution.boundary_rules import boundary_rule, rim_rule

if TYPE_CHECKING:
    from cpmkit.solution.solution import Solution

#: The word that stands for the edge of the manifold.
EDGE = "edge"


def flux_density(solution: Solution, boundary: str, side: Side | None, points: Any) -> Floats:
    """Return du/db (n,) or (n, channels); see :meth:`Solution.flux_density`."""
    density = _density(solution, _one_side(solution, boundary, side), solution.localized(points))
    return density[:, 0] if solution.channels == 1 else density


def flux(solution: Solution, boundary: str | int, side: Side | None) -> float | Floats:
    """Return the integral of du/db; see :meth:`Solution.flux`."""
    names = [one.name for one in solution.scene.boundaries]
    if boundary not in names and (boundary == EDGE or isinstance(boundary, int)):
        total = _through_edge(solution, None if boundary == EDGE else int(boundary), side)
    else:
        one = _one_side(solution, str(boundary), side)
        rule = boundary_rule(solution.scene.boundaries[one[0]].source, solution.scene.surface, solution.spacing)
        local = solution.tables.layout.lattice.to_local(rule.points)
        total = rule.weights @ _density(solution, one, local)
    return float(total[0]) if solution.channels == 1 else total


def _one_side(solution: Solution, boundary: str, side: Side | None) -> tuple[int, Side]:
    if side is None:
        raise InputError(f"side of {boundary!r} must be 'left' or 'right': a flux is that out of one side, got None.")
    ((index, one),) = solution.sides({boundary: side}).items()
    return index, one


def _density(solution: Solution, one_side: tuple[int, Side], local: Floats) -> Floats:
    """Return du/db (n, channels) at points near a boundary, b out of the side: -v on the left, +v on the right."""
    from cpmkit.forms.collocation.reading.gradients import surface_gradient

    index, side = one_side
    on = solution.tables.layout.sight.sighted[index].source.closest_point(local).points
    feet = solution.project(on)
    seen = solution.boundary_frames(feet.points, {index: side})[index]
    gradient = surface_gradient(solution, feet.points, {index: side})
    along_left = np.einsum("ncd,nd->nc", gradient, seen.left)
    return np.asarray(-along_left if side == "left" else along_left)


def _through_edge(solution: Solution, loop: int | None, side: Side | None) -> Floats:
    from cpmkit.forms.collocation.reading.gradients import surface_gradient

    if side is not None:
        raise InputError(f"the edge has one side only; leave side out, got {side!r}.")
    feet, weights = rim_rule(solution.scene.surface, solution.spacing, loop)
    layout = solution.tables.layout
    local = layout.lattice.to_local(feet.points)
    # Conormals are those of feet that the localized surface found on its edge itself.
    at_origin = layout.surface.closest_point(local)
    outward = outward_conormals(layout.surface, at_origin, 0.5 * solution.spacing)
    gradient = surface_gradient(solution, local, {})
    return np.asarray(weights @ np.einsum("ncd,nd->nc", gradient, outward))
