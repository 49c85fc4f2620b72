"""What flows out of a side of a boundary: the conormal derivative, and its integral."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.protocols import Floats, Side
from cpmkit.solution.boundary_rules import boundary_rule, rim_rule

if TYPE_CHECKING:
    from cpmkit.solution.solution import Solution

#: The word that stands for the edge of the manifold.
EDGE_WORD = "edge"


def flux_density(solution: Solution, boundary: str, side: Side | None, points: Any) -> Floats:
    """Return du/db (n,) or (n, channels); see :meth:`Solution.flux_density`."""
    density = solution.discretized.conormal_derivative(solution.values, points, boundary, _one_side(boundary, side))
    return density[:, 0] if solution.channels == 1 else density


def flux(solution: Solution, boundary: str | int, side: Side | None) -> float | Floats:
    """Return the integral of du/db; see :meth:`Solution.flux`."""
    scene, form = solution.scene, solution.discretized
    names = [boundary.name for boundary in scene.boundaries]
    if boundary not in names and (boundary == EDGE_WORD or isinstance(boundary, int)):
        if side is not None:
            raise InputError(f"the edge has one side only; leave side out, got {shown(side)}.")
        feet, weights = rim_rule(scene.surface, solution.spacing, None if boundary == EDGE_WORD else int(boundary))
        total = form.flux(solution.values, boundary, None, solution.data_time)
        if total is None:
            total = weights @ form.conormal_derivative(solution.values, feet.points)
    else:
        one, name = _one_side(str(boundary), side), str(boundary)
        total = form.flux(solution.values, name, one, solution.data_time)
        if total is None:
            rule = boundary_rule(scene.boundaries[names.index(name)].source, scene.surface, solution.spacing)
            total = rule.weights @ form.conormal_derivative(solution.values, rule.points, name, one)
    return float(total[0]) if solution.channels == 1 else np.asarray(total)


def _one_side(boundary: str, side: Side | None) -> Side:
    if side is None:
        raise InputError(f"side of {boundary!r} must be 'left' or 'right': a flux is that out of one side, got None.")
    return side
