"""Shortest paths by descent of a distance, on any manifold that has closest points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import ResolutionError, place
from cpmkit.plugin import unit
from cpmkit.protocols import Floats

if TYPE_CHECKING:
    from cpmkit.applications.geodesics import Distance

#: Length of a step over the spacing, and the distance, in spacings, from which the rest of the way is straight.
STEP_SPACINGS, ARRIVED_SPACINGS = 0.5, 1.0
#: Steps over those that a straight descent takes.
STEPS_OVER_LEAST = 4.0


def descend(distance: Distance, start: Floats) -> list[Floats]:
    """Return for each of ``start`` (k, d) the path (m, d) down to the origins, all followed together."""
    surface, h = distance.solution.scene.surface, distance.solution.spacing
    at = surface.closest_point(start).points
    ways, step = [[one.copy()] for one in at], STEP_SPACINGS * h
    left = distance.evaluate(at) if len(at) else np.zeros(0)
    if not np.isfinite(left).all():
        lost = place(start[int(np.argmin(np.isfinite(left)))])
        raise ResolutionError(f"no path leads from {lost} to an origin: its piece of the manifold has none.")
    going = np.flatnonzero(left > ARRIVED_SPACINGS * h)
    most = int(STEPS_OVER_LEAST * (left.max(initial=0.0) / step + 10))
    for _ in range(most):
        if not len(going):
            break
        here = at[going]
        middle = surface.closest_point(here - 0.5 * step * _downhill(distance, here)).points
        at[going] = surface.closest_point(here - step * _downhill(distance, middle)).points
        for one in going:
            ways[one].append(at[one].copy())
        going = going[distance.evaluate(at[going]) > ARRIVED_SPACINGS * h]
    if len(going):
        raise ResolutionError(
            f"{len(going)} of {len(start)} paths did not arrive within {most} steps, the first from {start[going[0]]}; "
            "they are caught at a barrier, or at an end of the distance's resolution: use a smaller spacing."
        )
    ends = distance.origins.closest(at)[1]
    return [np.array([*way, end]) for way, end in zip(ways, ends, strict=True)]


def _downhill(distance: Distance, points: Floats) -> Floats:
    """Return the gradient (k, d) of the distance at length one."""
    return unit(distance.gradient(points))
