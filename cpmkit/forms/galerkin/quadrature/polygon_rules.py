"""Compiled: quadrature rules for convex pieces of triangles, of one, three and four points, and of degree 4."""

from __future__ import annotations

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats

#: Pieces have no more corners than this; a triangle has 3, and each plane adds one.
MOST_CORNERS = 32
#: Places of the rule of degree 4 for a triangle: how far from two corners each is, and its share (Strang and Fix 1973).
NEAR, NEAR_SHARE = 0.091576213509770743, 0.109951743655321868
MIDDLE, MIDDLE_SHARE = 0.445948490915964886, 0.223381589678011466
#: No piece has more places than this: six for each triangle of it.
MOST_PLACES = 6 * MOST_CORNERS
#: Directions among which that of the largest third moment is looked for, and Newton's steps from there.
DIRECTIONS = np.stack([np.cos(np.arange(12) * np.pi / 12), np.sin(np.arange(12) * np.pi / 12)], axis=1)
TURNS = 4
#: Third moments that differ by less than this share count as the same: rounding shall not choose among them.
SAME_MOMENT = 1e-6
#: A third moment that changes less than this with the direction is as good anywhere.
LEAST_BEND = 1e-12


@compiled
def whitened(piece: Floats, count: int, frame: Floats, corners: Floats) -> float:
    """Fill ``frame`` with x, y of a piece's centroid and the root of its covariance, (x, y, wide, skew, high).

    And ``corners`` (count, 2) with its corners where the centroid is 0 and the covariance 1; returns its area.
    """
    area = x = y = xx = xy = yy = 0.0
    r, s = piece[0, 0], piece[0, 1]
    for k in range(1, count - 1):
        a, b = piece[k, 0] - r, piece[k, 1] - s
        c, d = piece[k + 1, 0] - r, piece[k + 1, 1] - s
        own = 0.5 * (a * d - b * c)
        area += own
        x += own * (a + c) / 3
        y += own * (b + d) / 3
        xx += own * (a * a + a * c + c * c) / 6
        xy += own * (2 * a * b + a * d + b * c + 2 * c * d) / 12
        yy += own * (b * b + b * d + d * d) / 6
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
def skewness(corners: Floats, count: int, thirds: Floats) -> None:
    """Fill ``thirds`` (4,) with the means of e^3, e^2 f, e f^2 and f^3 over a piece with ``corners`` (e, f)."""
    area = 0.0
    thirds[:] = 0.0
    for k in range(1, count - 1):
        a, b = corners[k, 0] - corners[0, 0], corners[k, 1] - corners[0, 1]
        c, d = corners[k + 1, 0] - corners[0, 0], corners[k + 1, 1] - corners[0, 1]
        own = 0.5 * (a * d - b * c)
        area += own
        e = f = ee = ef = ff = eee = eef = eff = fff = 0.0
        for j in (0, k, k + 1):
            p, q = corners[j, 0], corners[j, 1]
            e, f, ee, ef, ff = e + p, f + q, ee + p * p, ef + p * q, ff + q * q
            eee, eef, eff, fff = eee + p * p * p, eef + p * p * q, eff + p * q * q, fff + q * q * q
        thirds[0] += own * (e * e * e + 3 * e * ee + 2 * eee) / 60
        thirds[1] += own * (e * e * f + f * ee + 2 * e * ef + 2 * eef) / 60
        thirds[2] += own * (f * f * e + e * ff + 2 * f * ef + 2 * eff) / 60
        thirds[3] += own * (f * f * f + 3 * f * ff + 2 * fff) / 60
    if area > 0:
        thirds /= area


@compiled
def most_skew(thirds: Floats) -> tuple[float, float]:
    """Return the direction (c, s) in which the third moment is largest: there that of c^2 across vanishes."""
    most, c, s = 0.0, 1.0, 0.0
    for k in range(len(DIRECTIONS)):
        p, q = DIRECTIONS[k]
        here = abs(p * p * (p * thirds[0] + 3 * q * thirds[1]) + q * q * (3 * p * thirds[2] + q * thirds[3]))
        if here > (1 + SAME_MOMENT) * most:
            most, c, s = here, p, q
    for _ in range(TURNS):
        along = c * c * (c * thirds[0] + 3 * s * thirds[1]) + s * s * (3 * c * thirds[2] + s * thirds[3])
        slope = c * c * (c * thirds[1] - s * thirds[0]) + 2 * c * s * (c * thirds[2] - s * thirds[1])
        slope += s * s * (c * thirds[3] - s * thirds[2])
        bend = 2 * across(thirds, c, s) - along
        if abs(bend) > LEAST_BEND:
            turn = -slope / bend
            c, s = c - turn * s, s + turn * c
            size = np.sqrt(c * c + s * s)
            c, s = c / size, s / size
    return c, s


@compiled
def across(thirds: Floats, c: float, s: float) -> float:
    """Return the mean of e f^2 in axes turned by (c, s)."""
    first = s * s * thirds[0] - 2 * c * s * thirds[1] + c * c * thirds[2]
    return float(c * first + s * (s * s * thirds[1] - 2 * c * s * thirds[2] + c * c * thirds[3]))


@compiled
def put(frame: Floats, e: float, f: float, place: Floats) -> None:
    """Fill ``place`` (2,) with what (e, f) is in the frame of a piece."""
    place[0] = frame[0] + frame[2] * e
    place[1] = frame[1] + frame[3] * e + frame[4] * f


@compiled
def centroid(piece: Floats, count: int, place: Floats) -> float:
    """Fill ``place`` (2,) with the centroid of a convex piece; returns its area."""
    area = x = y = 0.0
    r, s = piece[0, 0], piece[0, 1]
    for k in range(1, count - 1):
        a, b = piece[k, 0] - r, piece[k, 1] - s
        c, d = piece[k + 1, 0] - r, piece[k + 1, 1] - s
        own = 0.5 * (a * d - b * c)
        area += own
        x += own * (a + c) / 3
        y += own * (b + d) / 3
    if area > 0:
        place[0], place[1] = r + x / area, s + y / area
    return area


@compiled
def on_ways_to_corners(piece: Floats, places: Floats, shares: Floats) -> float:
    """Fill three of ``places`` and ``shares`` with the rule of degree 2 for a triangle; returns its area."""
    for i in range(2):
        third = (piece[0, i] + piece[1, i] + piece[2, i]) / 6
        for k in range(3):
            places[k, i] = third + 0.5 * piece[k, i]
    shares[:3] = 1 / 3
    a, b = piece[1, 0] - piece[0, 0], piece[1, 1] - piece[0, 1]
    return float(0.5 * (a * (piece[2, 1] - piece[0, 1]) - b * (piece[2, 0] - piece[0, 0])))


@compiled
def rule(
    piece: Floats,
    count: int,
    taken: int,
    frame: Floats,
    thirds: Floats,
    corners: Floats,
    places: Floats,
    shares: Floats,
) -> float:
    """Fill ``places`` (4, 2) and ``shares`` (4,) with a rule for a convex piece; returns its area.

    In axes e, f in which the covariance is 1 and the mean of e^2 f vanishes, four places, of degree 3, are two along e
    by Gauss's rule, and two across at each; three, of degree 2, lie evenly on a circle, the first where the third
    moment is largest: in a triangle, on the ways to its corners. The weights are positive; on 5000 random polygons of 3
    to 7 corners the four places were all inside. One, of degree 1, is the centroid.

    ``taken``: one, three or four of them; ``frame`` (5,), ``thirds`` (4,) and ``corners`` (count, 2) are room for what
    this needs on the way.
    """
    if taken == 1:
        shares[0] = 1.0
        return centroid(piece, count, places[0])
    if taken == 3 and count == 3:  # the same, but for which place comes first
        return on_ways_to_corners(piece, places, shares)
    area = whitened(piece, count, frame, corners)
    if area <= 0:
        return area
    skewness(corners, count, thirds)
    c, s = most_skew(thirds)
    along = c * c * (c * thirds[0] + 3 * s * thirds[1]) + s * s * (3 * c * thirds[2] + s * thirds[3])
    if taken == 3:
        sense = 1.0 if along >= 0 else -1.0
        for k in range(3):
            x = sense * (np.sqrt(2.0) if k == 0 else -np.sqrt(0.5))
            y = (0.0, np.sqrt(1.5), -np.sqrt(1.5))[k]
            shares[k] = 1 / 3
            put(frame, c * x - s * y, s * x + c * y, places[k])
        return area
    last = -s * s * (s * thirds[0] - 3 * c * thirds[1]) + c * c * (-3 * s * thirds[2] + c * thirds[3])
    mixed, root = across(thirds, c, s), np.sqrt(along * along + 4)
    for k in range(4):
        x = 0.5 * (along + (root if k < 2 else -root))
        own = 0.5 * (1 + (-along if k < 2 else along) / root)
        spread = np.sqrt(last * last + 4 * max(1 + mixed * x, 0.0))
        sense = 1.0 if k % 2 == 0 else -1.0
        y = 0.5 * (last + sense * spread)
        shares[k] = own * 0.5 * (1 - sense * last / spread)
        put(frame, c * x - s * y, s * x + c * y, places[k])
    return area


@compiled
def fanned(piece: Floats, count: int, places: Floats, shares: Floats) -> float:
    """Fill ``places`` and ``shares`` with a rule of degree 4, six places for each triangle of a convex piece.

    Returns the area of the piece; the triangles go out from its first corner.
    """
    total = 0.0
    for k in range(1, count - 1):
        a, b = piece[k, 0] - piece[0, 0], piece[k, 1] - piece[0, 1]
        c, d = piece[k + 1, 0] - piece[0, 0], piece[k + 1, 1] - piece[0, 1]
        own = 0.5 * (a * d - b * c)
        total += own
        for j in range(6):
            away, share = (NEAR, NEAR_SHARE) if j < 3 else (MIDDLE, MIDDLE_SHARE)
            second = 1.0 - 2.0 * away if j % 3 == 1 else away
            third = 1.0 - 2.0 * away if j % 3 == 2 else away
            at = 6 * (k - 1) + j
            places[at, 0] = piece[0, 0] + second * a + third * c
            places[at, 1] = piece[0, 1] + second * b + third * d
            shares[at] = own * share
    if total > 0:
        shares[: 6 * (count - 2)] /= total
    return total
