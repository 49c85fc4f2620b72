"""Compiled: quadrature points of flat or quadratic triangles, whole or clipped at the knot planes of the lattice.

A piece is a convex part of a triangle: a polygon with ``count`` corners, the rows (r, s, x, y, z) of ``piece``. r and s
are barycentric coordinates in the triangle, and (x, y, z) is the position in spacings.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.mesh.polygon_rules import MOST_CORNERS, MOST_POINTS, fan_rule, polygon_rule
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Bools, Floats

#: A piece that extends beyond a knot plane by less than this, in spacings, is not split there.
ON_PLANE_SPACINGS = 1e-3
#: A sample outside the lattice cell of its piece by less than this, in spacings, is moved into the cell,
CLAMPED_SPACINGS = 2e-2
#: to this distance from its faces, in spacings: more than the rounding of a multiple of the spacing.
INSIDE_SPACINGS = 1e-9
#: Pieces with an area of no more than this in the barycentric coordinates of the triangle are omitted, and a cross
#: product of two vectors below this share of the squared length of the longer one has no reliable direction.
LEAST_AREA = 1e-14
#: A piece whose area times its cubed length, in spacings, is below this gets three points, others four: 19 samples an
#: unknown instead of 22. With three points everywhere gradients on a sphere are a quarter worse at h = .05.
THREE_SAMPLES_MOMENT = 2e-3
#: For flat triangles the limit for three points is increased by so many times the limit for one point.
THREE_OVER_ONE = 1e3
#: Upper bound of the splits of a triangle: a curved edge may cross a plane again after each split.
MOST_SPLITS = 100_000


@compiled
def evaluate_position(nodes: Floats, curved: bool, r: float, s: float, point: Floats) -> None:
    """Fill ``point`` (3,) with the position at barycentric coordinates (r, s, 1 - r - s) of a triangle.

    ``nodes`` (3 or 6, 3): the corners; if ``curved``, then the midpoints of the edges opposite to them.
    """
    t = 1.0 - r - s
    if curved:
        a, b, c = r * (2 * r - 1), s * (2 * s - 1), t * (2 * t - 1)
        d, e, f = 4 * s * t, 4 * t * r, 4 * r * s
        for i in range(3):
            point[i] = a * nodes[0, i] + b * nodes[1, i] + c * nodes[2, i]
            point[i] += d * nodes[3, i] + e * nodes[4, i] + f * nodes[5, i]
    else:
        for i in range(3):
            point[i] = r * nodes[0, i] + s * nodes[1, i] + t * nodes[2, i]


@compiled
def evaluate_tangents(nodes: Floats, curved: bool, r: float, s: float, first: Floats, second: Floats) -> None:
    """Fill ``first`` and ``second`` (3,) with the derivatives of :func:`evaluate_position` by r and s."""
    t = 1.0 - r - s
    for i in range(3):
        if curved:
            last = (4 * t - 1) * nodes[2, i]
            first[i] = (4 * r - 1) * nodes[0, i] - last + 4 * (s * (nodes[5, i] - nodes[3, i]) + (t - r) * nodes[4, i])
            second[i] = (4 * s - 1) * nodes[1, i] - last + 4 * (r * (nodes[5, i] - nodes[4, i]) + (t - s) * nodes[3, i])
        else:
            first[i], second[i] = nodes[0, i] - nodes[2, i], nodes[1, i] - nodes[2, i]


@compiled
def cross_plane(
    nodes: Floats, curved: bool, start: Floats, end: Floats, axis: int, plane: float, corner: Floats
) -> None:
    """Fill ``corner`` (5,) with the point where the edge of a piece from ``start`` to ``end`` (5,) crosses a plane.

    The plane is where coordinate ``axis`` equals ``plane``. Along a curved edge this coordinate is interpolated
    quadratically between its values at the ends and the middle. ``nodes``, ``curved`` as in :func:`evaluate_position`.
    """
    share = (plane - start[2 + axis]) / (end[2 + axis] - start[2 + axis])
    if curved:
        r, s = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])
        evaluate_position(nodes, curved, r, s, corner[2:])
        bulge = 4 * (corner[2 + axis] - 0.5 * (start[2 + axis] + end[2 + axis]))
        slope = end[2 + axis] - start[2 + axis]
        for _ in range(3):  # steps of Newton's method
            error = plane - start[2 + axis] - share * (slope + bulge * (1 - share))
            derivative = slope + bulge * (1 - 2 * share)
            if derivative * slope > 0:
                share = min(max(share + error / derivative, 0.0), 1.0)
    corner[0] = start[0] + share * (end[0] - start[0])
    corner[1] = start[1] + share * (end[1] - start[1])
    evaluate_position(nodes, curved, corner[0], corner[1], corner[2:])
    corner[2 + axis] = plane


@compiled
def copy_corner(corners: Floats, start: int, copies: Floats, end: int) -> None:
    """Copy row ``start`` of ``corners`` (k, 5) to row ``end`` of ``copies`` (k, 5)."""
    for i in range(5):
        copies[end, i] = corners[start, i]


@compiled
def find_splitting_plane(piece: Floats, count: int) -> tuple[int, float]:
    """Return the axis and the coordinate of a knot plane that splits a ``piece`` (count, 5), or axis -1 for none.

    A plane splits a piece that has corners farther than ``ON_PLANE_SPACINGS`` on both sides. Of several planes the
    lowest along the first axis is returned.
    """
    for axis in range(3):
        low, high = np.inf, -np.inf
        for k in range(count):
            low, high = min(low, piece[k, 2 + axis]), max(high, piece[k, 2 + axis])
        plane = np.floor(low + ON_PLANE_SPACINGS + 0.5) + 0.5
        if high - plane > ON_PLANE_SPACINGS:
            return axis, plane
    return -1, 0.0


@compiled
def split_at_plane(
    nodes: Floats, curved: bool, piece: Floats, count: int, axis: int, plane: float, below: Floats, above: Floats
) -> tuple[int, int]:
    """Fill ``below`` and ``above`` (k, 5) with the parts of a piece on each side of a plane; return the corner counts.

    Only the crossing points are corners of both parts; otherwise a piece nearly in the plane would count twice. The
    edges of ``piece`` (count, 5) must cross the plane, where coordinate ``axis`` equals ``plane``, exactly twice, see
    :func:`crosses_twice`; convex pieces have convex parts then. ``nodes``, ``curved`` as in :func:`evaluate_position`.
    """
    lower: Any = np.int64(0)
    upper: Any = np.int64(0)
    for k in range(count):
        following = k + 1 if k + 1 < count else 0
        here, there = piece[k, 2 + axis] - plane, piece[following, 2 + axis] - plane
        if here < 0:
            copy_corner(piece, k, below, lower)
            lower += 1
        else:
            copy_corner(piece, k, above, upper)
            upper += 1
        if (here < 0) != (there < 0):
            cross_plane(nodes, curved, piece[k], piece[following], axis, plane, below[lower])
            copy_corner(below, lower, above, upper)
            lower, upper = lower + 1, upper + 1
    return lower, upper


@compiled
def crosses_twice(piece: Floats, count: int, axis: int, plane: float) -> bool:
    """Return whether the chords around a ``piece`` (count, 5) cross the plane ``axis`` = ``plane`` exactly twice."""
    crossings, before = 0, piece[count - 1, 2 + axis] < plane
    for k in range(count):
        here = piece[k, 2 + axis] < plane
        crossings += here != before
        before = here
    return crossings == 2


@compiled
def split_at_chord(piece: Floats, count: int, below: Floats, above: Floats) -> tuple[int, int]:
    """Fill ``below`` and ``above`` (k, 5) with the parts of a piece on each side of a chord; return the corner counts.

    The chord connects corners 0 and ``count // 2`` of ``piece`` (count, 5). If the piece has more than three corners,
    both parts have fewer; the edges of a piece with three corners cross any plane at most twice.
    """
    half = count // 2
    for k in range(half + 1):
        copy_corner(piece, k, below, k)
    for k in range(half, count + 1):
        copy_corner(piece, k % count, above, k - half)
    return half + 1, count - half + 1


@compiled
def unit_normal(first: Floats, second: Floats, normal: Floats) -> float:
    """Fill ``normal`` (3,) with the unit normal of two tangents (3,), and return the area of their parallelogram.

    It has the side of ``first`` x ``second``; if they are nearly parallel, it is perpendicular to the longer tangent.
    """
    a = first[1] * second[2] - first[2] * second[1]
    b = first[2] * second[0] - first[0] * second[2]
    c = first[0] * second[1] - first[1] * second[0]
    area = size = np.sqrt(a * a + b * b + c * c)
    first_square = first[0] * first[0] + first[1] * first[1] + first[2] * first[2]
    second_square = second[0] * second[0] + second[1] * second[1] + second[2] * second[2]
    if area <= LEAST_AREA * max(first_square, second_square):
        # The weight is zero: take any vector perpendicular to the longer tangent.
        u, v = (first[0], first[1]) if first_square >= second_square else (second[0], second[1])
        a, b, c = (1.0, 0.0, 0.0) if u == 0 and v == 0 else (-v, u, 0.0)
        size = np.sqrt(a * a + b * b + c * c)
    normal[0], normal[1], normal[2] = a / size, b / size, c / size
    return float(area)


@compiled
def points_needed(piece: Floats, count: int, curved: bool, single: float) -> int:
    """Return the number of quadrature points that a ``piece`` (count, 5) needs: 1, 3 or 4.

    The error of one point is proportional to the area times the squared length, which must stay below ``single``; that
    of three points to the area times the cubed length, with a larger limit on flat triangles, not ``curved``.
    """
    length = 0.0
    for i in range(3):
        low, high = np.inf, -np.inf
        for k in range(count):
            low, high = min(low, piece[k, 2 + i]), max(high, piece[k, 2 + i])
        length += (high - low) ** 2
    x, y, z = 0.0, 0.0, 0.0
    for k in range(1, count - 1):
        a, b, c = piece[k, 2] - piece[0, 2], piece[k, 3] - piece[0, 3], piece[k, 4] - piece[0, 4]
        d, e, f = piece[k + 1, 2] - piece[0, 2], piece[k + 1, 3] - piece[0, 3], piece[k + 1, 4] - piece[0, 4]
        x, y, z = x + (b * f - c * e), y + (c * d - a * f), z + (a * e - b * d)
    area = 0.5 * np.sqrt(x * x + y * y + z * z)
    if area * length < single:
        return 1
    most = THREE_SAMPLES_MOMENT + (0.0 if curved else THREE_OVER_ONE * single)
    return 3 if area * length * np.sqrt(length) < most else 4


@compiled
def lattice_cell(piece: Floats, count: int, cell: Floats) -> None:
    """Fill ``cell`` (3,) with the lattice node whose cell contains the middle of the box of a ``piece`` (count, 5)."""
    for i in range(3):
        low, high = np.inf, -np.inf
        for k in range(count):
            low, high = min(low, piece[k, 2 + i]), max(high, piece[k, 2 + i])
        cell[i] = np.floor(0.5 * (low + high) + 0.5)


@compiled
def clamp_to_cell(place: float, cell: float) -> float:
    """Return the coordinate ``place``, moved into [cell - 1/2, cell + 1/2] if within ``CLAMPED_SPACINGS`` of that."""
    past = abs(place - cell) - 0.5 + INSIDE_SPACINGS
    if 0 < past < CLAMPED_SPACINGS:
        return place - past if place > cell else place + past
    return place


@compiled
def fill_samples(
    nodes: Floats,
    spacing: float,
    clipped: Bools,
    single: Floats,
    fine: bool,
    points: Floats,
    weights: Floats,
    normals: Floats,
    triangle: Any,
    stack: Floats,
) -> tuple[int, int]:
    """Fill in the quadrature points of the first triangles for which there is room; return the numbers of both.

    ``nodes`` (m, 3 or 6, 3): corners of the triangles, then the midpoints of curved ones, each opposite to a corner.
    ``spacing``: h: knot planes lie at (k + 1/2) h.
    ``clipped`` (m,): whether each triangle is clipped there; others get three points with barycentric coordinates (2/3,
        1/6, 1/6), or their centroid.
    ``single`` (m,): pieces, or whole triangles, get one point if area times squared length, in spacings, is below this.
    ``fine``: whether all pieces get a rule of degree 4 with six points on each triangle of their fan.
    ``points``, ``weights``, ``normals``, ``triangle`` (q, 3), (q,), (q, 1, 3), (q,): filled in; unit normals, and the
        numbers of triangles.
    ``stack`` (s, `MOST_CORNERS` + 2, 5): work space for the pieces of a triangle that may be split further.
    """
    curved = nodes.shape[1] == 6
    sizes, piece = np.empty(len(stack), dtype=np.int64), np.empty((MOST_CORNERS + 2, 5))
    corners, shares = np.empty((MOST_CORNERS + 2, 2)), np.empty(MOST_POINTS)
    places, first, second, point = np.empty((MOST_POINTS, 2)), np.empty(3), np.empty(3), np.empty(3)
    scaled, cell = np.empty(nodes.shape[1:]), np.empty(3)
    frame, thirds, normal, across = np.empty(5), np.empty(4), np.empty(3), 0.0
    used = 0
    for m in range(len(nodes)):
        before = used
        for k in range(len(scaled)):
            for i in range(3):
                scaled[k, i] = nodes[m, k, i] / spacing
        if not curved:  # one normal for all samples
            evaluate_tangents(scaled, curved, 1.0, 0.0, first, second)
            across = unit_normal(first, second, normal)
        sizes[0] = 3
        for k in range(3):
            stack[0, k, 0], stack[0, k, 1] = 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0
            for i in range(3):
                stack[0, k, 2 + i] = scaled[k, i]
        waiting, splits = 1, 0
        while waiting:
            waiting -= 1
            count = sizes[waiting]
            for k in range(count):
                copy_corner(stack[waiting], k, piece, k)
            axis, plane = find_splitting_plane(piece, count)
            if clipped[m] and axis >= 0 and count < MOST_CORNERS and splits < MOST_SPLITS:
                splits += 1
                if waiting + 2 > len(sizes):
                    return before, m
                below, above = stack[waiting], stack[waiting + 1]
                if crosses_twice(piece, count, axis, plane):
                    lower, upper = split_at_plane(scaled, curved, piece, count, axis, plane, below, above)
                else:
                    lower, upper = split_at_chord(piece, count, below, above)
                sizes[waiting], sizes[waiting + 1] = lower, upper
                waiting += 2
                continue
            if clipped[m] and fine:
                taken, area = 6 * (count - 2), fan_rule(piece, count, places, shares)
            else:
                taken = points_needed(piece, count, curved, single[m])
                taken = taken if clipped[m] else min(taken, 3)
                area = polygon_rule(piece, count, taken, frame, thirds, corners, places, shares)
            if area <= LEAST_AREA:
                continue
            lattice_cell(piece, count, cell)
            if used + taken > len(weights):
                return before, m
            for k in range(taken):
                evaluate_position(scaled, curved, places[k, 0], places[k, 1], point)
                if curved:
                    evaluate_tangents(scaled, curved, places[k, 0], places[k, 1], first, second)
                    across = unit_normal(first, second, normal)
                weights[used] = area * shares[k] * across * spacing**2
                for i in range(3):
                    normals[used, 0, i] = normal[i]
                    points[used, i] = spacing * (clamp_to_cell(point[i], cell[i]) if clipped[m] else point[i])
                triangle[used] = m
                used += 1
    return used, len(nodes)
