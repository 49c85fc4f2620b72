"""Elliptical arcs as cubics."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats

#: The angle of one cubic at most: an eighth of a turn is off by 4e-6 of the radius.
LARGEST_ANGLE = np.pi / 4
#: The smaller radius over the larger one, up to which an ellipse is a line.
FLATTEST = 1e-9
#: The smaller radius over the distance between the ends, from which on the shorter arc is a line.
STRAIGHTEST = 1e8
#: The larger radius over that distance: below the first the radii are scaled up in any case, and above the second the
#: centre is lost to rounding.
RADIUS_OVER_CHORD = (1e-3, 1e10)


def arc_cubics(start: Floats, radii: Floats, rotation: float, large: bool, sweep: bool, end: Floats) -> list[Floats]:
    """Return the cubics (4, 2), their control points, of an arc from ``start`` (2,) to ``end`` (2,), in its direction.

    ``radii`` (2,) and ``rotation``, in degrees from the x axis to the first of them, define the ellipse; ``large``
    chooses an arc of more than half a turn, ``sweep`` one along which the angle grows. By the formulas of SVG 1.1,
    appendix F.6.5 and F.6.6: radii that are too small are scaled up. Where one is zero to rounding, or both are so
    large that the shorter arc is straight to rounding, the list is one line; it is empty if both ends are one point.
    Each cubic spans an eighth of a turn at most, and is off by 4e-6 of the radius.
    """
    radii, chord = np.abs(radii), float(np.linalg.norm(end - start))
    if chord == 0:
        return []
    largest = radii.max()
    if radii.min() <= FLATTEST * largest or (not large and radii.min() > STRAIGHTEST * chord):
        return [np.linspace(start, end, 4)]
    radii *= np.clip(largest / chord, *RADIUS_OVER_CHORD) / (largest / chord)
    angle = np.radians(rotation)
    axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    half = axes @ (start - end) / 2 / radii  # in the frame where the ellipse is a unit circle
    size = float(half @ half)
    if size > 1:
        radii, half, size = radii * np.sqrt(size), half / np.sqrt(size), 1.0
    side = -1.0 if large == sweep else 1.0
    middle = side * np.sqrt(max(1 / size - 1, 0.0)) * np.array([half[1], -half[0]])
    first, last = (np.arctan2(*(point - middle)[::-1]) for point in (half, -half))
    turn = (last - first) % (2 * np.pi) - (0 if sweep else 2 * np.pi)
    centre = (start + end) / 2 + axes.T @ (radii * middle)
    knots = first + np.linspace(0, turn, int(np.ceil(abs(turn) / LARGEST_ANGLE - 1e-9)) + 1)
    arm = 4 / 3 * np.tan(np.diff(knots)[:1] / 4)
    on = np.stack([np.cos(knots), np.sin(knots)], axis=1)
    along = np.stack([-on[:, 1], on[:, 0]], axis=1)
    circle = np.stack([on[:-1], on[:-1] + arm * along[:-1], on[1:] - arm * along[1:], on[1:]], axis=1)
    cubics = centre + (circle * radii) @ axes
    cubics[0, 0], cubics[-1, 3] = start, end
    return list(cubics)
