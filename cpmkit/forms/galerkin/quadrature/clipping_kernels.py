"""Compiled: samples of triangles, flat or quadratic: three each, or three and more a piece between knot planes."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.quadrature.polygon_rules import MOST_CORNERS, MOST_PLACES, fanned, rule
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Bools, Floats

#: A piece that is past a knot plane by less than this, in spacings, is not split there.
ON_PLANE_SPACINGS = 1e-3
#: A sample that is past a plane of its piece's cell by less than this, in spacings, is put back into the cell.
PUT_BACK_SPACINGS = 2e-2
#: How far inside, in spacings: more than rounding makes of a multiple of the spacing.
INSIDE_SPACINGS = 1e-9
#: Pieces with no more than this of the triangle's area in its own coordinates, 1/2, are left out.
LEAST_AREA = 1e-14
#: A cross product shorter than this share of the squared length of what it is made of tells no direction.
NO_DIRECTION_SHARE = 1e-14
#: A piece whose area times the cube of its length, in spacings, is less than this has three samples, others four: 19 an
#: unknown in place of 22. With three everywhere, of degree 2, gradients on a sphere are a quarter worse at h = .05.
THREE_SAMPLES_MOMENT = 2e-3
#: Of flat triangles the same bound grows so many times as fast as that of pieces with one sample: to three for all.
THREE_OVER_ONE = 1e3
#: A triangle is split so often and no more: corners that a curved edge puts beyond a plane again need not end.
MOST_SPLITS = 100_000
#: Newton's steps from the chord to the place where an edge crosses a knot plane.
CROSSING_STEPS = 3


@compiled
def position(nodes: Floats, curved: bool, r: float, s: float, point: Floats) -> None:
    """Fill ``point`` (3,) with the place of a triangle at (r, s), the shares of its first two corners."""
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
def slopes(nodes: Floats, curved: bool, r: float, s: float, first: Floats, second: Floats) -> None:
    """Fill ``first`` and ``second`` (3,) with the derivatives by r and by s."""
    t = 1.0 - r - s
    for i in range(3):
        if curved:
            last = (4 * t - 1) * nodes[2, i]
            first[i] = (4 * r - 1) * nodes[0, i] - last + 4 * (s * (nodes[5, i] - nodes[3, i]) + (t - r) * nodes[4, i])
            second[i] = (4 * s - 1) * nodes[1, i] - last + 4 * (r * (nodes[5, i] - nodes[4, i]) + (t - s) * nodes[3, i])
        else:
            first[i], second[i] = nodes[0, i] - nodes[2, i], nodes[1, i] - nodes[2, i]


@compiled
def crossing(nodes: Floats, curved: bool, one: Floats, two: Floats, axis: int, plane: float, corner: Floats) -> None:
    """Fill ``corner`` (5,) with the place between two corners of a piece where they cross a plane.

    Corners are (r, s, x, y, z). The coordinate is quadratic along the way, with the value at the middle read.
    """
    way = (plane - one[2 + axis]) / (two[2 + axis] - one[2 + axis])
    if curved:
        r, s = 0.5 * (one[0] + two[0]), 0.5 * (one[1] + two[1])
        position(nodes, curved, r, s, corner[2:])
        bulge = 4 * (corner[2 + axis] - 0.5 * (one[2 + axis] + two[2 + axis]))
        slope = two[2 + axis] - one[2 + axis]
        for _ in range(CROSSING_STEPS):
            missed = plane - one[2 + axis] - way * (slope + bulge * (1 - way))
            steep = slope + bulge * (1 - 2 * way)
            if steep * slope > 0:
                way = min(max(way + missed / steep, 0.0), 1.0)
    corner[0] = one[0] + way * (two[0] - one[0])
    corner[1] = one[1] + way * (two[1] - one[1])
    position(nodes, curved, corner[0], corner[1], corner[2:])
    corner[2 + axis] = plane


@compiled
def first_plane(piece: Floats, count: int) -> tuple[int, float]:
    """Return the axis and the place of the lowest knot plane that has corners of the piece on both sides, or -1."""
    for axis in range(3):
        low, high = np.inf, -np.inf
        for k in range(count):
            low, high = min(low, piece[k, 2 + axis]), max(high, piece[k, 2 + axis])
        plane = np.floor(low + ON_PLANE_SPACINGS + 0.5) + 0.5
        if high - plane > ON_PLANE_SPACINGS:
            return axis, plane
    return -1, 0.0


@compiled
def split(
    nodes: Floats, curved: bool, piece: Floats, count: int, axis: int, plane: float, below: Floats, above: Floats
) -> tuple[int, int]:
    """Fill ``below`` and ``above`` with the parts of a piece beside a plane; returns how many corners each has.

    No corner belongs to both but where the edges cross: a piece that lies nearly in the plane would count twice. Edges
    cross the plane twice, see :func:`crosses_twice`: then both parts of a convex piece are convex, with its area.
    """
    lower = upper = 0
    for k in range(count):
        following = k + 1 if k + 1 < count else 0
        here, there = piece[k, 2 + axis] - plane, piece[following, 2 + axis] - plane
        if here < 0:
            below[lower] = piece[k]
            lower += 1
        else:
            above[upper] = piece[k]
            upper += 1
        if (here < 0) != (there < 0):
            crossing(nodes, curved, piece[k], piece[following], axis, plane, below[lower])
            above[upper] = below[lower]
            lower, upper = lower + 1, upper + 1
    return lower, upper


@compiled
def crosses_twice(piece: Floats, count: int, axis: int, plane: float) -> bool:
    """Return whether a piece's edges cross a plane twice, and not oftener, as those of curved triangles may."""
    crossings, before = 0, piece[count - 1, 2 + axis] < plane
    for k in range(count):
        here = piece[k, 2 + axis] < plane
        crossings += here != before
        before = here
    return crossings == 2


@compiled
def halve(piece: Floats, count: int, below: Floats, above: Floats) -> tuple[int, int]:
    """Fill ``below`` and ``above`` with the parts of a piece beside a chord of it; returns how many corners each has.

    Both have fewer corners than the piece, and what has three crosses no plane oftener than twice.
    """
    half = count // 2
    below[: half + 1] = piece[: half + 1]
    above[: count - half] = piece[half:count]
    above[count - half] = piece[0]
    return half + 1, count - half + 1


@compiled
def whole(places: Floats, shares: Floats) -> float:
    """Fill ``places`` and ``shares`` with the rule of degree 2 for a whole triangle; returns its area, 1/2."""
    places[:], shares[:] = 1 / 6, 1 / 3
    places[0, 0] = places[1, 1] = 2 / 3
    return 0.5


@compiled
def directed(first: Floats, second: Floats, normal: Floats) -> float:
    """Fill ``normal`` (3,) with the unit vector across two slopes, and return the area between them."""
    a = first[1] * second[2] - first[2] * second[1]
    b = first[2] * second[0] - first[0] * second[2]
    c = first[0] * second[1] - first[1] * second[0]
    area = size = np.sqrt(a * a + b * b + c * c)
    one = first[0] * first[0] + first[1] * first[1] + first[2] * first[2]
    two = second[0] * second[0] + second[1] * second[1] + second[2] * second[2]
    if area <= NO_DIRECTION_SHARE * max(one, two):
        # No area, so that the normal counts for nothing: any across the longer edge.
        u, v = (first[0], first[1]) if one >= two else (second[0], second[1])
        a, b, c = (1.0, 0.0, 0.0) if u == 0 and v == 0 else (-v, u, 0.0)
        size = np.sqrt(a * a + b * b + c * c)
    normal[0], normal[1], normal[2] = a / size, b / size, c / size
    return float(area)


@compiled
def needed(piece: Floats, count: int, curved: bool, single: float) -> int:
    """Return how many samples a piece has.

    One misses what goes with its area and the square of its length, which is to stay below ``single``, and three what
    goes with its area and the cube of its length.
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
def cell_of(piece: Floats, count: int, cell: Floats) -> None:
    """Fill ``cell`` (3,) with the lattice cell that the corners of a piece lie in."""
    for i in range(3):
        low, high = np.inf, -np.inf
        for k in range(count):
            low, high = min(low, piece[k, 2 + i]), max(high, piece[k, 2 + i])
        cell[i] = np.floor(0.5 * (low + high) + 0.5)


@compiled
def project(place: float, cell: float) -> float:
    """Return a coordinate of a sample inside its cell, where it is hardly outside; else as it is."""
    past = abs(place - cell) - 0.5 + INSIDE_SPACINGS
    if 0 < past < PUT_BACK_SPACINGS:
        return place - past if place > cell else place + past
    return place


@compiled
def triangle_samples(
    nodes: Floats, spacing: float, clipped: Bools, single: Floats, fine: bool
) -> tuple[Floats, Floats, Floats, Any]:
    """Return points (q, 3), weights (q,), unit normals (q, 1, 3) and triangles (q,) of samples.

    Parameters
    ----------
    nodes : (m, 3 or 6, 3) float64
        Corners of the triangles, then the midpoints of curved ones, each opposite to a corner.
    spacing : float
        h: knot planes lie at (k + 1/2) h.
    clipped : (m,) bool
        Whether each triangle is clipped there; else it has the samples at (2/3, 1/6, 1/6), or its centroid.
    single : (m,) float64
        Pieces of each triangle have one sample where their area times the square of their length, in spacings, is less.
    fine : bool
        Whether pieces have the samples of a rule of degree 4, six for each triangle of them, as cubic splines need.
    """
    curved = nodes.shape[1] == 6
    points, weights, normals = np.empty((MOST_PLACES, 3)), np.empty(MOST_PLACES), np.empty((MOST_PLACES, 1, 3))
    triangle = np.empty(MOST_PLACES, dtype=np.int32)
    stack, sizes = np.empty((8, MOST_CORNERS + 2, 5)), np.empty(8, dtype=np.int64)
    piece = np.empty((MOST_CORNERS + 2, 5))
    corners, shares = np.empty((MOST_CORNERS + 2, 2)), np.empty(MOST_PLACES)
    places, first, second, point = np.empty((MOST_PLACES, 2)), np.empty(3), np.empty(3), np.empty(3)
    own, cell = np.empty(nodes.shape[1:]), np.empty(3)
    frame, thirds, normal, across = np.empty(5), np.empty(4), np.empty(3), 0.0
    used = 0
    for m in range(len(nodes)):
        for k in range(len(own)):
            for i in range(3):
                own[k, i] = nodes[m, k, i] / spacing
        if not curved:  # one normal for all samples
            slopes(own, curved, 1.0, 0.0, first, second)
            across = directed(first, second, normal)
        sizes[0] = 3
        for k in range(3):
            stack[0, k, 0], stack[0, k, 1] = 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0
            stack[0, k, 2:] = own[k]
        waiting, splits = 1, 0
        while waiting:
            waiting -= 1
            count = sizes[waiting]
            piece[:count] = stack[waiting, :count]
            axis, plane = first_plane(piece, count)
            if clipped[m] and axis >= 0 and count < MOST_CORNERS and splits < MOST_SPLITS:
                splits += 1
                if waiting + 2 > len(sizes):
                    stack, sizes = np.concatenate((stack, stack)), np.concatenate((sizes, sizes))
                below, above = stack[waiting], stack[waiting + 1]
                if crosses_twice(piece, count, axis, plane):
                    lower, upper = split(own, curved, piece, count, axis, plane, below, above)
                else:
                    lower, upper = halve(piece, count, below, above)
                sizes[waiting], sizes[waiting + 1] = lower, upper
                waiting += 2
                continue
            if clipped[m] and fine:
                taken, area = 6 * (count - 2), fanned(piece, count, places, shares)
            elif clipped[m]:
                taken = needed(piece, count, curved, single[m])
                area = rule(piece, count, taken, frame, thirds, corners, places, shares)
            elif needed(piece, count, curved, single[m]) == 1:
                taken, area = 1, rule(piece, count, 1, frame, thirds, corners, places, shares)
            else:
                taken, area = 3, whole(places, shares)
            if area <= LEAST_AREA:
                continue
            cell_of(piece, count, cell)
            if used + taken > len(weights):
                points, weights = np.concatenate((points, points)), np.concatenate((weights, weights))
                normals, triangle = np.concatenate((normals, normals)), np.concatenate((triangle, triangle))
            for k in range(taken):
                position(own, curved, places[k, 0], places[k, 1], point)
                if curved:
                    slopes(own, curved, places[k, 0], places[k, 1], first, second)
                    across = directed(first, second, normal)
                weights[used] = area * shares[k] * across * spacing**2
                for i in range(3):
                    normals[used, 0, i] = normal[i]
                    points[used, i] = spacing * (project(point[i], cell[i]) if clipped[m] else point[i])
                triangle[used] = m
                used += 1
    return points[:used].copy(), weights[:used].copy(), normals[:used].copy(), triangle[:used].copy()
