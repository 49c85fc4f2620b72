"""Compiled: edges, orientation, welding, the support of edges and the angles at edges of meshes, without sorting."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.runtime.index_sets import find_root, unite
from cpmkit.types import Bools, Floats, Ints

#: Where the sum of the weights of edges beyond an end is below this, the surface ends there: on rims.
LEAST_WEIGHT = 1e-3
#: Upper bound of the curvature along an edge over that beyond its end: beyond it, nothing distinguishes an ellipsoid's
#: ends from a fillet.
MOST_CURVATURE_RATIO = 4.0


@compiled
def number_triangle_edges(cells: Ints, count: int) -> tuple[Ints, Ints]:
    """Return the edges (e, 2) of triangles among ``count`` vertices, and the edge (m, 3) opposite to each corner.

    Edges have the lower vertex first, and the order of their first occurrence in ``cells`` (m, 3).
    """
    head = np.full(count, -1, np.int64)
    following = np.empty(3 * len(cells), np.int64)
    ends = np.empty((3 * len(cells), 2), np.int64)
    of_cells = np.empty((len(cells), 3), np.int64)
    edge_count = 0
    for cell in range(len(cells)):
        for corner in range(3):
            low, high = cells[cell, (corner + 1) % 3], cells[cell, (corner + 2) % 3]
            if low > high:
                low, high = high, low
            edge = head[low]
            while edge >= 0 and ends[edge, 1] != high:
                edge = following[edge]
            if edge < 0:
                edge = edge_count
                edge_count += 1
                ends[edge, 0], ends[edge, 1] = low, high
                following[edge], head[low] = head[low], edge
            of_cells[cell, corner] = edge
    return ends[:edge_count].copy(), of_cells


@compiled
def join_corners(cells: Ints, of_cells: Ints, barred: Bools) -> Ints:
    """Return the number (m, 3) of the connected component of each corner, in the order of first occurrence.

    The corners at both ends of an edge are connected across it, except over edges that are ``barred`` (e,). ``cells``
    (m, 3) are triangles, ``of_cells`` (m, 3) the edges opposite to their corners.
    """
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
    components = 0
    for place in range(3 * len(cells)):
        root = find_root(parent, place)
        if root == place:
            number[place // 3, place % 3] = components
            components += 1
        else:  # the root of a component is its first corner
            number[place // 3, place % 3] = number[root // 3, root % 3]
    return number


@compiled
def propagate_orientation(cells: Ints, facets: Ints, count: int) -> Any:
    """Return the factor (m,) int8, 1 or -1, that orients each cell like its neighbours, 0 where neither does.

    Cells connected over facets form sets (union-find); each cell stores its orientation relative to its parent. The
    factor is 0 beside facets of exactly two cells that stay oriented differently.

    ``cells`` (m, k).
    ``facets`` (m, k): the numbers, below ``count``, of the facets opposite to each corner.
    """
    m, k = facets.shape
    first, times, total = np.full(count, -1), np.zeros(count, np.int32), np.zeros(count, np.int32)
    parent, sign = np.arange(m), np.ones(m, np.int8)
    for cell in range(m):
        for j in range(k):
            facet = facets[cell, j]
            other = first[facet]
            if other < 0:
                first[facet] = cell * k + j
                continue
            relative = -_facet_direction(cells, cell, j) * _facet_direction(cells, other // k, other % k)
            a, a_sign = _signed_root(parent, sign, cell)
            b, b_sign = _signed_root(parent, sign, other // k)
            if a != b:
                parent[a] = b
                sign[a] = a_sign * b_sign * relative
    orientation = np.empty(m, np.int8)
    for cell in range(m):
        orientation[cell] = _signed_root(parent, sign, cell)[1]
        for j in range(k):
            times[facets[cell, j]] += 1
            total[facets[cell, j]] += orientation[cell] * _facet_direction(cells, cell, j)
    for cell in range(m):
        for j in range(k):
            facet = facets[cell, j]
            if times[facet] == 2 and total[facet] != 0:  # the signs of two cells that agree cancel
                orientation[cell] = 0
    return orientation


@compiled
def _facet_direction(cells: Ints, cell: int, j: int) -> int:
    """Return the direction, 1 or -1, in which the cell of number ``cell`` in ``cells`` traverses its facet ``j``.

    It is different for two cells on both sides of a facet that are oriented alike.
    """
    k = cells.shape[1]
    if k == 2:
        return 1 - 2 * j
    return 1 if cells[cell, (j + 1) % 3] < cells[cell, (j + 2) % 3] else -1


@compiled
def _signed_root(parent: Ints, sign: Any, cell: int) -> tuple[int, int]:
    """Return the root of the set of ``cell``, and the orientation of the cell relative to it, 1 or -1.

    Paths to the root are halved: ``parent`` (m,) and ``sign`` (m,), the orientation relative to the parent, are
    changed.
    """
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
def merge_near_vertices(vertices: Floats, along: Floats, order: Ints, tolerance: float) -> Ints:
    """Return for each vertex (v,) the lowest number in its cluster: vertices connected by steps up to ``tolerance``.

    ``vertices`` (v, d): positions. ``order`` (v,): numbers of the vertices by ascending ``along``.
    ``along`` (v,): coordinates of the vertices along a unit vector: only vertices within ``tolerance`` in these are
        compared.
    """
    parent = np.arange(len(vertices))
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
                unite(parent, vertex, other)
    for vertex in range(len(parent)):
        parent[vertex] = find_root(parent, vertex)
    return parent


@compiled
def edge_supports(
    vertices: Floats, ends: Ints, normals: Floats, creased: Bools, first: Ints, around: Ints
) -> tuple[Floats, Floats]:
    """Return the ratio (e,) and the height (e,) of the :class:`~cpmkit.mesh.normals_of_mesh.EdgeSupport` of edges.

    ``vertices`` (v, d).
    ``ends`` (e, 2).
    ``normals`` (e, 2, d): unit normals at the ends of each edge.
    ``creased`` (v,): vertices without a normal of the surface.
    ``first``, ``around`` (v + 1,) and (2 e,): ``around[first[v]:first[v + 1]]`` are the edges at vertex v.
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
    support, heights = np.empty(count), np.empty(count)
    for edge in range(count):
        turning = abs(slopes[edge, 1] - slopes[edge, 0])  # curvature times length
        support[edge], heights[edge] = MOST_CURVATURE_RATIO, turning / 8
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
                    at_end, beyond = abs(slopes[other, there]), abs(slopes[other, 1 - there])
                    bend = 2 * at_end if creased[ends[other, 1 - there]] else at_end + beyond
                    # Projected on this edge: along its diagonals a cylinder has the curvature of the ring beyond.
                    curvature += cosine**4 * bend / lengths[other]
                    length += cosine * cosine * lengths[other]
            ratio = 1.0
            if total >= LEAST_WEIGHT and lengths[edge] > 0:
                weighted = turning / lengths[edge] * total
                ratio = MOST_CURVATURE_RATIO if weighted >= MOST_CURVATURE_RATIO * curvature else weighted / curvature
                ratio *= min(1.0, length / (total * lengths[edge]))
            support[edge] = min(support[edge], ratio)
    return support, heights
