"""Walking along a surface: to the foot of a point on the sheet that one stands on."""

from __future__ import annotations

import numpy as np

from cpmkit.boundary.tangent_space import normals
from cpmkit.localized import Localized
from cpmkit.protocols import ClosestPoints, Floats, Ints

#: The way to a foot on a sheet is walked in steps of this many spacings: no farther than the next sheet is.
STRIDE = 0.5
#: At most so many steps; a node is within a stencil's reach of the foot that it is looked for from.
STRIDES = 60
#: A walk that moves less than this many spacings has arrived.
ARRIVED = 1e-7


def walk(source: Localized, goal: Floats, start: ClosestPoints, spacing: float) -> ClosestPoints:
    """Return the feet reached from ``start`` by walking along the surface until ``goal`` (n, d) lies straight above.

    A leap to the foot of the goal's projection could land on another sheet, and past an end of the surface it would.
    """
    feet, walking = start, np.arange(len(goal))
    for _ in range(STRIDES):
        here = feet.take(walking)
        n = normals(source, here, 0.5 * spacing)
        away = goal[walking] - here.points
        ahead = away - np.sum(away * n, axis=1, keepdims=True) * n
        length = np.linalg.norm(ahead, axis=1, keepdims=True)
        step = np.minimum(1.0, STRIDE * spacing / np.maximum(length, ARRIVED * spacing)) * ahead
        reached = source.closest_point(here.points + step)
        moved = np.linalg.norm(reached.points - here.points, axis=1) > ARRIVED * spacing
        feet = _replaced(feet, walking, reached)
        walking = walking[moved]
        if not len(walking):
            break
    return feet


def _replaced(feet: ClosestPoints, rows: Ints, new: ClosestPoints) -> ClosestPoints:
    """Return the records with those of ``rows`` replaced."""
    order = np.arange(len(feet))
    order[rows] = len(feet) + np.arange(len(rows))
    return ClosestPoints.join([feet, new]).take(order)
