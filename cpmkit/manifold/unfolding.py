"""Points of a surface found by unfolding it: as far from a place as a node is, in the same direction, along the sheet.

Where a surface bends more sharply than a stencil is wide, nodes of the stencil have no foot on the sheet nearby, or one
that lies past the bend's centre of curvature, on its far side. The differences there are those of a flat surface, so
each node is given the point that it has when the surface is rolled out flat on its tangent plane (the exponential map).
"""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.localized import Localized
from cpmkit.manifold.tangent_space import normals
from cpmkit.protocols import ClosestPoints, Floats

#: The way is gone in steps of this many spacings, which follow bends of about that radius.
STRIDE = 0.5
#: At most so many steps: a stencil's reach, and as much again.
STRIDES = 40
#: What is left of a way is nothing below this many spacings.
ARRIVED = 1e-6
#: A step that leads less far than this share of its length has met a crease or an end.
STUCK = 0.3
#: A direction that is turned into the new tangent plane and keeps less of its length is not turned.
STEEP = 0.05
#: Opposite normals (cosine) do not tell how to turn.
OPPOSITE = -0.98


def unfold(
    source: Localized, start: ClosestPoints, normal: Floats, goal: Floats, spacing: float, signed: bool
) -> ClosestPoints:
    """Return the points reached from ``start`` by going along the surface as far as ``goal`` (n, d) is.

    Parameters
    ----------
    source : Localized
        The surface.
    start : ClosestPoints
        Where the way begins, n of its points.
    normal : (n, d) float64
        There; the way to the goal, less its part along this, is the direction and the length of the way.
    goal : (n, d) float64
        Nodes.
    spacing : float
        Of the lattice.
    signed : bool
        True where the surface's normals have a sign of their own.
    """
    away = goal - start.points
    ahead = away - np.sum(away * normal, axis=1, keepdims=True) * normal
    left = np.linalg.norm(ahead, axis=1)
    ahead /= np.maximum(left, ARRIVED * spacing)[:, None]
    feet, normal, going = start, normal.copy(), np.flatnonzero(left > ARRIVED * spacing)
    for _ in range(STRIDES):
        if not len(going):
            break
        step = np.minimum(left[going], STRIDE * spacing)
        here = feet.points[going]
        reached = source.closest_point(here + step[:, None] * ahead[going])
        moved = np.linalg.norm(reached.points - here, axis=1)
        there = normals(source, reached, 0.5 * spacing)
        if not signed:
            there = np.where(np.sum(normal[going] * there, axis=1, keepdims=True) < 0, -there, there)
        ahead[going], normal[going] = _turned(ahead[going], normal[going], there)
        feet = feet.replaced(going, reached)
        left[going] -= np.where(moved > STUCK * step, np.minimum(moved, step) + ARRIVED * spacing, step)
        going = going[left[going] > ARRIVED * spacing]
    return feet


def _turned(ahead: Floats, normal: Floats, reached: Floats) -> tuple[Floats, Floats]:
    """Return directions and normals turned by the smallest rotation that takes these to the normals ``reached``."""
    along = np.sum(normal * reached, axis=1, keepdims=True)
    lean = np.sum(reached * ahead, axis=1, keepdims=True) / np.maximum(1 + along, 1 + OPPOSITE)
    turned = ahead - (normal + reached) * lean
    turned -= np.sum(turned * reached, axis=1, keepdims=True) * reached
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    sound = (length > STEEP) & (along > OPPOSITE)
    return np.where(sound, turned / np.maximum(length, STEEP), ahead), np.where(sound, reached, normal)
