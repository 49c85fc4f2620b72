"""Compiled: grouping of the crossings of a cell, removal of flaps, and filling of loops by triangles of least area."""

from __future__ import annotations

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.runtime.index_sets import find_root
from cpmkit.types import Bools, Floats, Ints


@compiled
def unite_flat(
    start: Ints, member: Ints, points: Floats, normals: Floats, sine: float, cosine: float, error: float, group: Ints
) -> None:
    """Unite crossings of one cell whose chord is flat (``dual_vertices.chord_is_flat``), in the forest ``group`` (k,).

    Entry i of ``member`` and ``group`` is a crossing of a cell; entries of cell c start at ``start[c]``, and end before
    ``start[c + 1]``. Afterwards ``group[i]`` is the root of the set of entry i. Crossings have ``points`` and
    ``normals`` (n, 3); ``sine``, ``cosine`` and ``error`` are the tolerances of a flat chord.
    """
    for cell in range(len(start) - 1):
        for i in range(start[cell], start[cell + 1]):
            for j in range(start[cell], i):
                square = along_a = along_b = normals_cosine = 0.0
                for k in range(points.shape[1]):
                    chord = points[member[i], k] - points[member[j], k]
                    square += chord * chord
                    along_a += chord * normals[member[i], k]
                    along_b += chord * normals[member[j], k]
                    normals_cosine += normals[member[i], k] * normals[member[j], k]
                reach = sine * np.sqrt(square) + error
                if 0.5 * (abs(along_a) + abs(along_b)) <= reach and abs(normals_cosine) > cosine:
                    group[find_root(group, i)] = find_root(group, j)
    for i in range(len(group)):
        group[i] = find_root(group, i)


@compiled
def unite(first: Ints, second: Ints, group: Ints) -> None:
    """Unite the sets of entries ``first[i]``, ``second[i]`` in the forest ``group`` (k,), which then has the roots."""
    for i in range(len(first)):
        group[find_root(group, first[i])] = find_root(group, second[i])
    for i in range(len(group)):
        group[i] = find_root(group, i)


@compiled
def nearest_pairs(start: Ints, member: Ints, points: Floats, group: Ints, pairs: Ints) -> int:
    """Fill ``pairs`` (p, 2) with the nearest two entries of any two groups in one cell, and return the number of pairs.

    Arguments are as in :func:`unite_flat`; ``group`` contains the roots. If ``pairs`` is (0, 2), pairs are only
    counted.
    """
    count = 0
    for cell in range(len(start) - 1):
        for a in range(start[cell], start[cell + 1]):
            if group[a] != a:
                continue
            for b in range(start[cell], a):
                if group[b] != b:
                    continue
                if len(pairs):
                    best = -1.0
                    for i in range(start[cell], start[cell + 1]):
                        for j in range(start[cell], start[cell + 1]):
                            if group[i] == a and group[j] == b:
                                square = 0.0
                                for k in range(points.shape[1]):
                                    square += (points[member[i], k] - points[member[j], k]) ** 2
                                if best < 0.0 or square < best:
                                    best = square
                                    pairs[count, 0] = i
                                    pairs[count, 1] = j
                count += 1
    return count


@compiled
def remove_flap_triangles(candidates: Ints, of: Ints, count: Ints, on_rim: Bools, alive: Bools) -> int:
    """Set ``alive`` to False for flaps among the triangles ``candidates`` (c,) until none is left; return their number.

    A flap has two open edges off rims; or an edge of three triangles or more, and one open edge off rims or two open
    edges. Flaps with most open edges go first. ``count`` (e,), the number of triangles of each edge, ``alive`` (m,) and
    ``on_rim`` (e,) are updated; ``of`` (m, 3) are the edges of triangles. Edges that become open count as on a rim.
    """
    removed = 0
    while True:
        best, most = -1, 0
        for cell in candidates:
            if not alive[cell]:
                continue
            opened = off_rim = shared = 0
            for j in range(3):
                edge = of[cell, j]
                opened += count[edge] == 1
                off_rim += count[edge] == 1 and not on_rim[edge]
                shared += count[edge] > 2
            is_ear = off_rim > 1 or (opened > 1 and shared > 0)
            if (is_ear or (off_rim > 0 and shared > 0)) and opened > most:
                best, most = cell, opened
        if best < 0:
            return removed
        alive[best] = False
        removed += 1
        for j in range(3):
            edge = of[best, j]
            count[edge] -= 1
            if count[edge] == 1:
                on_rim[edge] = True  # unknown as yet: the next round looks


@compiled
def _area(points: Floats, i: int, j: int, k: int) -> float:
    """Return the area of the triangle of the rows i, j and k of ``points`` (n, 3)."""
    ax, ay, az = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    bx, by, bz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
    area: float = 0.5 * np.sqrt((ay * bz - az * by) ** 2 + (az * bx - ax * bz) ** 2 + (ax * by - ay * bx) ** 2)
    return area


@compiled
def least_area_triangles(points: Floats) -> Ints:
    """Return the triangulation (n - 2, 3) of a hole with border ``points`` (n, 3) that has the least total area.

    Triangles are rows of ``points``, which go around the hole, n >= 3, and have the orientation of their order.
    Barequet and Sharir, Filling gaps in the boundary of a polyhedron (1995).
    """
    n = len(points)
    cost, via = np.zeros((n, n)), np.zeros((n, n), dtype=np.int64)
    for width in range(2, n):
        for i in range(n - width):
            j = i + width
            cost[i, j] = np.inf
            for k in range(i + 1, j):
                total = cost[i, k] + cost[k, j] + _area(points, i, k, j)
                if total < cost[i, j]:
                    cost[i, j], via[i, j] = total, k
    triangles = np.empty((n - 2, 3), dtype=np.int64)
    stack = np.empty((n, 2), dtype=np.int64)
    stack[0, 0], stack[0, 1] = 0, n - 1
    depth, made = 1, 0
    while depth > 0:
        depth -= 1
        i, j = stack[depth, 0], stack[depth, 1]
        if j - i < 2:
            continue
        k = via[i, j]
        triangles[made, 0], triangles[made, 1], triangles[made, 2] = i, k, j
        made += 1
        stack[depth, 0], stack[depth, 1] = i, k
        stack[depth + 1, 0], stack[depth + 1, 1] = k, j
        depth += 2
    return triangles
