"""Compiled: quadrature rules on convex polygons, with one, three and four points, and of degree 4.

A polygon is the first ``count`` rows of an array ``piece``, whose first two columns are coordinates. A rule consists of
points ``places`` (k, 2) and weights ``shares`` (k,) with sum 1.
"""

from __future__ import annotations

import numpy as np

from cpmkit.mesh.cell_quadrature import TRIANGLE_RULE
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats

#: Largest number of corners of a polygon; a triangle has 3, and each knot plane adds one.
MOST_CORNERS = 32
#: Largest number of points of a polygon: six for each triangle of its fan.
MOST_POINTS = 6 * MOST_CORNERS
#: Directions among which the search for the largest third moment starts.
DIRECTIONS = np.stack([np.cos(np.arange(12) * np.pi / 12), np.sin(np.arange(12) * np.pi / 12)], axis=1)
#: Third moments that differ by less than this share count as equal, so that the choice does not depend on rounding.
SAME_MOMENT = 1e-6
#: Second derivative of the third moment below which Newton's method is skipped: the moment is nearly constant.
LEAST_SECOND_DERIVATIVE = 1e-12


@compiled
def whiten(piece: Floats, count: int, frame: Floats, corners: Floats) -> float:
    """Fill ``corners`` (count, 2) with a polygon at centroid 0 and unit covariance; return its original area.

    ``piece`` (count, 2 or more): the corners, counterclockwise. ``frame`` (5,) is filled with the centroid (x, y) and
    the Cholesky factor (wide, skew, high) of the covariance. Nothing is filled if the area is not positive.
    """
    area = x = y = xx = xy = yy = 0.0
    r, s = piece[0, 0], piece[0, 1]
    for k in range(1, count - 1):
        a, b = piece[k, 0] - r, piece[k, 1] - s
        c, d = piece[k + 1, 0] - r, piece[k + 1, 1] - s
        part = 0.5 * (a * d - b * c)
        area += part
        x += part * (a + c) / 3
        y += part * (b + d) / 3
        xx += part * (a * a + a * c + c * c) / 6
        xy += part * (2 * a * b + a * d + b * c + 2 * c * d) / 12
        yy += part * (b * b + b * d + d * d) / 6
    if area <= 0:
        return area
    x, y = x / area, y / area
    xx, xy, yy = xx / area - x * x, xy / area - x * y, yy / area - y * y
    wide = np.sqrt(max(xx, 0.0))
    skew = xy / wide if wide > 0 else 0.0
    high = np.sqrt(max(yy - skew * skew, 0.0))
    frame[0], frame[1], frame[2], frame[3], frame[4] = r + x, s + y, wide, skew, high
    for k in range(count):
        e = (piece[k, 0] - frame[0]) / wide if wide > 0 else 0.0
        corners[k, 0] = e
        corners[k, 1] = (piece[k, 1] - frame[1] - skew * e) / high if high > 0 else 0.0
    return area


@compiled
def third_moments(corners: Floats, count: int, thirds: Floats) -> None:
    """Fill ``thirds`` (4,) with the means of e^3, e^2 f, e f^2, f^3 over a polygon; ``corners`` (count, 2): (e, f)."""
    area = 0.0
    thirds[:] = 0.0
    for k in range(1, count - 1):
        a, b = corners[k, 0] - corners[0, 0], corners[k, 1] - corners[0, 1]
        c, d = corners[k + 1, 0] - corners[0, 0], corners[k + 1, 1] - corners[0, 1]
        part = 0.5 * (a * d - b * c)
        area += part
        e = f = ee = ef = ff = eee = eef = eff = fff = 0.0
        for j in (0, k, k + 1):
            p, q = corners[j, 0], corners[j, 1]
            e, f, ee, ef, ff = e + p, f + q, ee + p * p, ef + p * q, ff + q * q
            eee, eef, eff, fff = eee + p * p * p, eef + p * p * q, eff + p * q * q, fff + q * q * q
        thirds[0] += part * (e * e * e + 3 * e * ee + 2 * eee) / 60
        thirds[1] += part * (e * e * f + f * ee + 2 * e * ef + 2 * eef) / 60
        thirds[2] += part * (f * f * e + e * ff + 2 * f * ef + 2 * eff) / 60
        thirds[3] += part * (f * f * f + 3 * f * ff + 2 * fff) / 60
    if area > 0:
        for i in range(4):
            thirds[i] /= area


@compiled
def skewest_direction(thirds: Floats) -> tuple[float, float]:
    """Return the unit vector (c, s) in whose direction the third moment of a polygon is largest in modulus.

    ``thirds`` (4,) are its moments from :func:`third_moments`; if all vanish, the vector is (1, 0). In axes rotated by
    (c, s) the mean of e^2 f vanishes.
    """
    most, c, s = 0.0, 1.0, 0.0
    for k in range(len(DIRECTIONS)):
        p, q = DIRECTIONS[k]
        here = abs(p * p * (p * thirds[0] + 3 * q * thirds[1]) + q * q * (3 * p * thirds[2] + q * thirds[3]))
        if here > (1 + SAME_MOMENT) * most:
            most, c, s = here, p, q
    for _ in range(4):  # steps of Newton's method
        along = c * c * (c * thirds[0] + 3 * s * thirds[1]) + s * s * (3 * c * thirds[2] + s * thirds[3])
        slope = c * c * (c * thirds[1] - s * thirds[0]) + 2 * c * s * (c * thirds[2] - s * thirds[1])
        slope += s * s * (c * thirds[3] - s * thirds[2])
        bend = 2 * mixed_third_moment(thirds, c, s) - along
        if abs(bend) > LEAST_SECOND_DERIVATIVE:
            turn = -slope / bend
            c, s = c - turn * s, s + turn * c
            size = np.sqrt(c * c + s * s)
            c, s = c / size, s / size
    return c, s


@compiled
def mixed_third_moment(thirds: Floats, c: float, s: float) -> float:
    """Return the mean of e f^2 in axes rotated by (c, s), from ``thirds`` (4,), see :func:`third_moments`."""
    first = s * s * thirds[0] - 2 * c * s * thirds[1] + c * c * thirds[2]
    return float(c * first + s * (s * s * thirds[1] - 2 * c * s * thirds[2] + c * c * thirds[3]))


@compiled
def unwhiten(frame: Floats, e: float, f: float, place: Floats) -> None:
    """Fill ``place`` (2,) with the original coordinates of (e, f), with ``frame`` (5,) as in :func:`whiten`."""
    place[0] = frame[0] + frame[2] * e
    place[1] = frame[1] + frame[3] * e + frame[4] * f


@compiled
def triangle_rule(piece: Floats, places: Floats, shares: Floats) -> float:
    """Fill the first three ``places`` and ``shares`` with the rule of degree 2 on a triangle; return its signed area.

    ``piece`` (3, 2 or more): the corners. ``places`` (k, 2) are points, ``shares`` (k,) weights with sum 1.
    """
    for i in range(2):
        third = (piece[0, i] + piece[1, i] + piece[2, i]) / 6
        for k in range(3):
            places[k, i] = third + 0.5 * piece[k, i]
    shares[:3] = 1 / 3
    a, b = piece[1, 0] - piece[0, 0], piece[1, 1] - piece[0, 1]
    return float(0.5 * (a * (piece[2, 1] - piece[0, 1]) - b * (piece[2, 0] - piece[0, 0])))


@compiled
def polygon_rule(
    piece: Floats,
    count: int,
    taken: int,
    frame: Floats,
    thirds: Floats,
    corners: Floats,
    places: Floats,
    shares: Floats,
) -> float:
    """Fill ``places`` and ``shares`` with a rule of one, three or four points on a convex polygon; return its area.

    The corners are counterclockwise. If the area is not positive, ``places`` and ``shares`` have no meaning.
    Let e, f be axes in which the covariance of the polygon is 1 and the mean of e^2 f vanishes. The rule with four
    points, of degree 3, has the two positions of Gauss's rule along e, with two points along f at each. The points of
    the rule with three points, of degree 2, lie at equal angles on a circle, the first in the direction of the largest
    third moment; in a triangle they lie between the centroid and the corners. The weights are positive; on 5000 random
    polygons with 3 to 7 corners all four points were inside. The rule with one point, of degree 1, is the centroid.

    ``piece`` (count, 2 or more): corners; the first two columns are used. ``taken``: number of points: 1, 3 or 4.
    ``frame``, ``thirds``, ``corners`` (5,), (4,), (count, 2): work space, overwritten.
    ``places``, ``shares`` (taken or more, 2), (taken or more,): points, and weights with sum 1.
    """
    if taken == 3 and count == 3:  # the same points, in another order
        return triangle_rule(piece, places, shares)
    area = whiten(piece, count, frame, corners)
    if taken == 1:
        shares[0], places[0, 0], places[0, 1] = 1.0, frame[0], frame[1]
    if area <= 0 or taken == 1:
        return area
    third_moments(corners, count, thirds)
    c, s = skewest_direction(thirds)
    along = c * c * (c * thirds[0] + 3 * s * thirds[1]) + s * s * (3 * c * thirds[2] + s * thirds[3])
    if taken == 3:
        sense = 1.0 if along >= 0 else -1.0
        for k in range(3):
            x = sense * (np.sqrt(2.0) if k == 0 else -np.sqrt(0.5))
            y = (0.0, np.sqrt(1.5), -np.sqrt(1.5))[k]
            shares[k] = 1 / 3
            unwhiten(frame, c * x - s * y, s * x + c * y, places[k])
        return area
    last = -s * s * (s * thirds[0] - 3 * c * thirds[1]) + c * c * (-3 * s * thirds[2] + c * thirds[3])
    mixed, root = mixed_third_moment(thirds, c, s), np.sqrt(along * along + 4)
    for k in range(4):
        x = 0.5 * (along + (root if k < 2 else -root))
        part = 0.5 * (1 + (-along if k < 2 else along) / root)
        spread = np.sqrt(last * last + 4 * max(1 + mixed * x, 0.0))
        sense = 1.0 if k % 2 == 0 else -1.0
        y = 0.5 * (last + sense * spread)
        shares[k] = part * 0.5 * (1 - sense * last / spread)
        unwhiten(frame, c * x - s * y, s * x + c * y, places[k])
    return area


@compiled
def fan_rule(piece: Floats, count: int, places: Floats, shares: Floats) -> float:
    """Fill ``places`` and ``shares`` with a rule of degree 4 on a convex polygon; return its area.

    The polygon is divided into a fan of triangles at its first corner; each triangle has six points. ``piece`` (count,
    2 or more) are the corners, counterclockwise, ``places`` (k, 2) points, ``shares`` (k,) weights with sum 1, which
    have no meaning if the area is not positive.
    """
    total = 0.0
    for k in range(1, count - 1):
        a, b = piece[k, 0] - piece[0, 0], piece[k, 1] - piece[0, 1]
        c, d = piece[k + 1, 0] - piece[0, 0], piece[k + 1, 1] - piece[0, 1]
        part = 0.5 * (a * d - b * c)
        total += part
        for j in range(6):
            away, share = TRIANGLE_RULE[0] if j < 3 else TRIANGLE_RULE[1]
            second = 1.0 - 2.0 * away if j % 3 == 1 else away
            third = 1.0 - 2.0 * away if j % 3 == 2 else away
            at = 6 * (k - 1) + j
            places[at, 0] = piece[0, 0] + second * a + third * c
            places[at, 1] = piece[0, 1] + second * b + third * d
            shares[at] = part * share
    if total > 0:
        for at in range(6 * (count - 2)):
            shares[at] /= total
    return total
