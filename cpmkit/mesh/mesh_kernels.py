"""The edges of triangles, how long they are, and the corners that hang together over them, without sorting."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.runtime.disjoint_sets import find_root, unite
from cpmkit.types import Bools, Floats, Ints


@compiled
def number_edges(cells: Ints, count: int) -> tuple[Ints, Ints]:
    """Return the (e, 2) edges among ``count`` vertices, and (m, 3) the number of the edge opposite to each corner.

    Every vertex keeps a list of the edges that lead to vertices of larger number.
    """
    head = np.full(count, -1, np.int64)
    following = np.empty(3 * len(cells), np.int64)
    ends = np.empty((3 * len(cells), 2), np.int64)
    of_cells = np.empty((len(cells), 3), np.int64)
    found = 0
    for cell in range(len(cells)):
        for corner in range(3):
            low, high = cells[cell, (corner + 1) % 3], cells[cell, (corner + 2) % 3]
            if low > high:
                low, high = high, low
            edge = head[low]
            while edge >= 0 and ends[edge, 1] != high:
                edge = following[edge]
            if edge < 0:
                edge = found
                found += 1
                ends[edge, 0], ends[edge, 1] = low, high
                following[edge], head[low] = head[low], edge
            of_cells[cell, corner] = edge
    return ends[:found].copy(), of_cells


@compiled
def lengths(ends: Ints, vertices: Floats) -> Floats:
    """Return (e,) the lengths of edges (e, 2)."""
    found = np.empty(len(ends))
    for edge in range(len(ends)):
        squared = 0.0
        for k in range(vertices.shape[1]):
            squared += (vertices[ends[edge, 1], k] - vertices[ends[edge, 0], k]) ** 2
        found[edge] = np.sqrt(squared)
    return found


@compiled
def join_corners(cells: Ints, of_cells: Ints, barred: Bools) -> Ints:
    """Return (m, 3) the component of each corner, numbered as they occur; corners join over edges not ``barred``."""
    parent = np.arange(3 * len(cells))
    first = np.full(len(barred), -1, np.int64)
    for place in range(3 * len(cells)):
        cell, corner = place // 3, place % 3
        edge = of_cells[cell, corner]
        if barred[edge]:
            continue
        if first[edge] < 0:
            first[edge] = place
            continue
        other, facing = first[edge] // 3, first[edge] % 3
        a, b = (corner + 1) % 3, (corner + 2) % 3
        p, q = (facing + 1) % 3, (facing + 2) % 3
        if cells[cell, a] != cells[other, p]:
            p, q = q, p
        unite(parent, 3 * cell + a, 3 * other + p)
        unite(parent, 3 * cell + b, 3 * other + q)
    number = np.empty((len(cells), 3), np.int64)
    found = 0
    for place in range(3 * len(cells)):
        root = find_root(parent, place)
        if root == place:
            number[place // 3, place % 3] = found
            found += 1
        else:  # the root of a component is its first corner
            number[place // 3, place % 3] = number[root // 3, root % 3]
    return number


@compiled
def wound_alike(cells: Ints, facets: Ints, count: int) -> Any:
    """Return (m,) int8: 1 or -1 for each of the ``cells`` (m, k), and 0 beside a place where they are not alike.

    ``facets`` (m, k): the numbers, below ``count``, of those opposite to each corner.
    """
    m, k = facets.shape
    first, times, wound = np.full(count, -1), np.zeros(count, np.int32), np.zeros(count, np.int32)
    parent, sign = np.arange(m), np.ones(m, np.int8)
    for cell in range(m):
        for j in range(k):
            facet = facets[cell, j]
            other = first[facet]
            if other < 0:
                first[facet] = cell * k + j
                continue
            relative = -_sense(cells, cell, j) * _sense(cells, other // k, other % k)
            a, a_sign = _root(parent, sign, cell)
            b, b_sign = _root(parent, sign, other // k)
            if a != b:
                parent[a] = b
                sign[a] = a_sign * b_sign * relative
    found = np.empty(m, np.int8)
    for cell in range(m):
        found[cell] = _root(parent, sign, cell)[1]
        for j in range(k):
            times[facets[cell, j]] += 1
            wound[facets[cell, j]] += found[cell] * _sense(cells, cell, j)
    for cell in range(m):
        for j in range(k):
            facet = facets[cell, j]
            if times[facet] == 2 and wound[facet] != 0:  # two that are wound alike cancel
                found[cell] = 0
    return found


@compiled
def _sense(cells: Ints, cell: int, j: int) -> int:
    """Return 1 or -1, unlike for two cells on the two sides of a facet that are wound alike."""
    k = cells.shape[1]
    if k == 2:
        return 1 - 2 * j
    return 1 if cells[cell, (j + 1) % 3] < cells[cell, (j + 2) % 3] else -1


@compiled
def _root(parent: Ints, sign: Any, cell: int) -> tuple[int, int]:
    total = 1
    while parent[cell] != cell:
        above = parent[cell]
        if parent[above] != above:  # halve the path
            sign[cell] *= sign[above]
            parent[cell] = parent[above]
        total *= sign[cell]
        cell = parent[cell]
    return cell, total


@compiled
def places(vertices: Floats, along: Floats, order: Ints, tolerance: float) -> Ints:
    """Return (v,) the first vertex that each hangs together with over steps of at most ``tolerance``.

    Parameters
    ----------
    vertices : (v, d) float64
    along : (v,) float64
        Their coordinates along some direction of unit length: those farther apart in it are not near.
    order : (v,) int64
        By which those ascend.
    """
    first = np.arange(len(vertices))
    for i in range(len(order)):
        vertex = order[i]
        for j in range(i + 1, len(order)):
            other = order[j]
            if along[other] - along[vertex] > tolerance:
                break
            squared = 0.0
            for k in range(vertices.shape[1]):
                squared += (vertices[vertex, k] - vertices[other, k]) ** 2
            if squared <= tolerance * tolerance:
                a, b = vertex, other
                while first[a] != a:
                    a = first[a]
                while first[b] != b:
                    b = first[b]
                first[max(a, b)] = min(a, b)
    for vertex in range(len(first)):  # what a vertex leads to has a smaller number, and is done
        first[vertex] = first[first[vertex]]
    return first


@compiled
def distinct(corners: Ints, count: int) -> Bools:
    """Return which cells (m,), given by their corners in ascending order, repeat neither a corner nor another cell.

    Every one of the ``count`` vertices keeps a list of the cells of which it is the lowest corner.
    """
    head, following = np.full(count, -1, np.int64), np.empty(len(corners), np.int64)
    kept = np.ones(len(corners), np.bool_)
    for cell in range(len(corners)):
        for k in range(1, corners.shape[1]):
            if corners[cell, k] == corners[cell, k - 1]:
                kept[cell] = False
        other = head[corners[cell, 0]]
        while kept[cell] and other >= 0:
            same = True
            for k in range(1, corners.shape[1]):
                same = same and corners[cell, k] == corners[other, k]
            kept[cell] = not same
            other = following[other]
        if kept[cell]:
            following[cell], head[corners[cell, 0]] = head[corners[cell, 0]], cell
    return kept


#: Below this sum of weights nothing lies beyond an end, as on rims.
LEAST_WEIGHT = 1e-3
#: Curvature along the edge over that beyond its end, at most: an ellipsoid's ends are not told from a fillet by it.
MOST_CURVATURE_RATIO = 4.0


@compiled
def supports(
    vertices: Floats, ends: Ints, normals: Floats, creased: Bools, first: Ints, around: Ints
) -> tuple[Floats, Floats]:
    """Return (e,) the support of each edge, and (e,) its height over its length by the ``normals`` (e, 2, d).

    ``around[first[v]:first[v + 1]]`` are the edges at vertex v. Vertices that are ``creased`` (v,) have no normal.
    """
    count, d = len(ends), vertices.shape[1]
    lengths, directions, slopes = np.empty(count), np.empty((count, d)), np.empty((count, 2))
    for edge in range(count):
        squared = 0.0
        for i in range(d):
            directions[edge, i] = vertices[ends[edge, 1], i] - vertices[ends[edge, 0], i]
            squared += directions[edge, i] ** 2
        lengths[edge] = np.sqrt(squared)
        slopes[edge, 0] = slopes[edge, 1] = 0.0
        for i in range(d):
            directions[edge, i] /= lengths[edge] if squared > 0 else 1.0
            for side in range(2):
                slopes[edge, side] += directions[edge, i] * normals[edge, side, i]
    found, heights = np.empty(count), np.empty(count)
    for edge in range(count):
        turning = abs(slopes[edge, 1] - slopes[edge, 0])  # curvature times length
        found[edge], heights[edge] = MOST_CURVATURE_RATIO, turning / 8
        for side in range(2):
            end = ends[edge, side]
            total = curvature = length = 0.0
            for k in range(first[end], first[end + 1]):
                other = around[k]
                if other == edge or lengths[other] == 0:
                    continue
                cosine = 0.0
                for i in range(d):
                    cosine += directions[edge, i] * directions[other, i]
                there = 0 if ends[other, 0] == end else 1
                if there != side:
                    cosine = -cosine
                if cosine < 0:
                    total += cosine * cosine
                    near, far = abs(slopes[other, there]), abs(slopes[other, 1 - there])
                    bend = 2 * near if creased[ends[other, 1 - there]] else near + far
                    # Along this edge: that of a cylinder along its diagonals is what the ring beyond has there.
                    curvature += cosine**4 * bend / lengths[other]
                    length += cosine * cosine * lengths[other]
            ratio = 1.0
            if total >= LEAST_WEIGHT and lengths[edge] > 0:
                own = turning / lengths[edge] * total
                ratio = MOST_CURVATURE_RATIO if own >= MOST_CURVATURE_RATIO * curvature else own / curvature
                ratio *= min(1.0, length / (total * lengths[edge]))
            found[edge] = min(found[edge], ratio)
    return found, heights
