"""Compiled: polygons in a plane cut into triangles by clipping ears (Meisters 1975).

Arguments have no type annotations: numba infers the types.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import compiled

#: A corner whose triangle has less than this share of the polygon's area lies on a line.
STRAIGHT_AREA_SHARE = 1e-12


@compiled
def clip_ears(points, ears, good):
    """Cut the polygons with corners at ``points`` (m, c, 2), wound counter-clockwise, into triangles wound alike.

    Written are ``ears`` (m, c - 2, 3), the numbers of the corners, and ``good`` (m,), whether the polygon was cut. It
    is not where no corner is an ear, as in a polygon that crosses itself, or is wound clockwise; its ears are undefined
    then. Corners at one place, as where a hole is connected to the outline, are allowed.
    """
    count = points.shape[1]
    ring = np.empty(count, dtype=np.int64)
    for row in range(len(points)):
        p = points[row]
        for k in range(count):
            ring[k] = k
        area = 0.0
        for k in range(count):
            area += _double_area(p[0], p[k], p[(k + 1) % count])
        least = STRAIGHT_AREA_SHARE * area
        left = count
        good[row] = area > 0.0
        while left > 3 and good[row]:
            best = -1
            for k in range(left):
                before, after = ring[(k - 1) % left], ring[(k + 1) % left]
                if _double_area(p[before], p[ring[k]], p[after]) > least and _is_empty_ear(p, ring, left, k, least):
                    best = k
                    break
            if best < 0:  # the remaining corners may lie on a line
                for k in range(left):
                    if abs(_double_area(p[ring[(k - 1) % left]], p[ring[k]], p[ring[(k + 1) % left]])) <= least:
                        best = k
                        break
            if best < 0:
                good[row] = False
                break
            ears[row, count - left, 0] = ring[(best - 1) % left]
            ears[row, count - left, 1] = ring[best]
            ears[row, count - left, 2] = ring[(best + 1) % left]
            for k in range(best, left - 1):
                ring[k] = ring[k + 1]
            left -= 1
        good[row] = good[row] and _double_area(p[ring[0]], p[ring[1]], p[ring[2]]) >= -least
        for k in range(3):
            ears[row, count - 3, k] = ring[k]


@compiled
def _is_empty_ear(p, ring, left, k, least):
    """Return whether the ear at position ``k`` of ``ring`` contains no other of the ``left`` remaining corners.

    The first ``left`` entries of ``ring`` are the numbers of the remaining corners of the polygon ``p`` (c, 2),
    ``least`` is the rounding of areas; corners at the position of one of the ear's are ignored.
    """
    a, b, c = p[ring[(k - 1) % left]], p[ring[k]], p[ring[(k + 1) % left]]
    for other in range(left):
        if other == k or other == (k - 1) % left or other == (k + 1) % left:
            continue
        q = p[ring[other]]
        if _same_point(q, a) or _same_point(q, b) or _same_point(q, c):
            continue
        if _double_area(a, b, q) >= -least and _double_area(b, c, q) >= -least and _double_area(c, a, q) >= -least:
            return False
    return True


@compiled
def _double_area(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@compiled
def _same_point(a, b):
    return a[0] == b[0] and a[1] == b[1]
