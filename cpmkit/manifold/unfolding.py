"""Points of a surface found by unfolding it: as far from a place as a node is, in the same direction, along the sheet.

Where a surface bends more sharply than a stencil is wide, nodes of the stencil have no foot on the sheet nearby, or one
that lies past the bend's centre of curvature, on its far side. The differences there are those of a flat surface, so
each node is given the point that it has when the surface is rolled out flat on its tangent plane (the exponential map).
"""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import normals
from cpmkit.protocols import ClosestPoints, Floats

#: The way is gone in steps of this many spacings, which follow bends of about that radius.
UNFOLDING_STRIDE_SPACINGS = 0.5
#: At most so many steps: a stencil's reach, and as much again.
MOST_UNFOLDING_STRIDES = 40
#: A remaining way below so many spacings counts as zero.
UNFOLDED_REST_SPACINGS = 1e-6
#: A step that moves the foot by less than this share of its length has met a crease or an end.
STUCK_STEP_SHARE = 0.3
#: Least length of a unit direction after it is rotated into the new tangent plane; below it the old direction is kept.
LEAST_TURNED_LENGTH = 0.05
#: Below this cosine normals are opposite, and the rotation between them is undefined.
OPPOSITE_NORMALS_COSINE = -0.98


def unfold(
    source: LocalSource, start: ClosestPoints, normal: Floats, goal: Floats, spacing: float, signed: bool
) -> ClosestPoints:
    """Return the points reached from ``start`` by going along the surface as far as ``goal`` (n, d) is.

    Parameters
    ----------
    source : LocalSource
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
    rest = np.linalg.norm(ahead, axis=1)
    ahead /= np.maximum(rest, UNFOLDED_REST_SPACINGS * spacing)[:, None]
    feet, normal, going = start, normal.copy(), np.flatnonzero(rest > UNFOLDED_REST_SPACINGS * spacing)
    for _ in range(MOST_UNFOLDING_STRIDES):
        if not len(going):
            break
        step = np.minimum(rest[going], UNFOLDING_STRIDE_SPACINGS * spacing)
        position = feet.points[going]
        reached = source.closest_point(position + step[:, None] * ahead[going])
        moved = np.linalg.norm(reached.points - position, axis=1)
        reached_normal = normals(source, reached, 0.5 * spacing)
        if not signed:
            against = np.sum(normal[going] * reached_normal, axis=1, keepdims=True) < 0
            reached_normal = np.where(against, -reached_normal, reached_normal)
        ahead[going], normal[going] = _rotated_by_normals(ahead[going], normal[going], reached_normal)
        feet = feet.replaced(going, reached)
        gone = np.minimum(moved, step) + UNFOLDED_REST_SPACINGS * spacing
        rest[going] -= np.where(moved > STUCK_STEP_SHARE * step, gone, step)
        going = going[rest[going] > UNFOLDED_REST_SPACINGS * spacing]
    return feet


def _rotated_by_normals(ahead: Floats, normal: Floats, reached: Floats) -> tuple[Floats, Floats]:
    """Return directions and normals turned by the smallest rotation that takes these to the normals ``reached``."""
    along = np.sum(normal * reached, axis=1, keepdims=True)
    lean = np.sum(reached * ahead, axis=1, keepdims=True) / np.maximum(1 + along, 1 + OPPOSITE_NORMALS_COSINE)
    turned = ahead - (normal + reached) * lean
    turned -= np.sum(turned * reached, axis=1, keepdims=True) * reached
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    sound = (length > LEAST_TURNED_LENGTH) & (along > OPPOSITE_NORMALS_COSINE)
    return np.where(sound, turned / np.maximum(length, LEAST_TURNED_LENGTH), ahead), np.where(sound, reached, normal)
