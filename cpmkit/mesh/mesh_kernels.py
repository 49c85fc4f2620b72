"""Compiled: edges, orientation, welding, support and angles of edges, and subdivision of meshes, without sorting."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.runtime.index_sets import find_root, label_sets, unite
from cpmkit.types import Bools, Floats, Ints

#: Where the sum of the weights of edges beyond an end is below this, the surface ends there: on rims.
LEAST_WEIGHT = 1e-3
#: Upper bound of the curvature along an edge over that beyond its end: beyond it, nothing distinguishes an ellipsoid's
#: ends from a fillet.
MOST_CURVATURE_RATIO = 4.0
#: Squared diagonals count as equal up to this factor, so that rounding does not decide which is shorter.
SAME_DIAGONAL = 1.0 + 1e-9


@compiled
def number_triangle_edges(cells: Ints, count: int) -> tuple[Ints, Ints]:
    """Return the edges (e, 2) of triangles among ``count`` vertices, and the edge (m, 3) opposite to each corner.

    Edges have the lower vertex first, and the order of their first occurrence in ``cells`` (m, 3).
    """
    head, following = np.empty(count, np.int64), np.empty(3 * len(cells), np.int64)
    head[:] = -1
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
    parent, first = np.empty(3 * len(cells), np.int64), np.empty(len(barred), np.int64)
    first[:] = -1
    for place in range(3 * len(cells)):
        parent[place] = place
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
    return label_sets(parent)[1].reshape(cells.shape)


@compiled
def propagate_orientation(cells: Ints, facets: Ints, count: int) -> Any:
    """Return the factor (m,) int8, 1 or -1, that orients each cell like its neighbours, 0 if this is impossible.

    Cells connected over facets form sets (union-find); each cell stores its orientation relative to its parent. The
    factor is 0 beside facets of exactly two cells that stay oriented differently. ``facets`` (m, k) are the numbers,
    below ``count``, of the facets opposite to each corner of ``cells`` (m, k).
    """
    m, k = facets.shape
    first, times, total = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count, np.int64)
    first[:], times[:], total[:] = -1, 0, 0
    parent, sign, orientation = np.empty(m, np.int64), np.empty(m, np.int8), np.empty(m, np.int8)
    for cell in range(m):
        parent[cell], sign[cell] = cell, 1
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

    Two cells that share a facet and are oriented alike traverse it in opposite directions.
    """
    k = cells.shape[1]
    if k == 2:
        return 1 - 2 * j
    return 1 if cells[cell, (j + 1) % 3] < cells[cell, (j + 2) % 3] else -1


@compiled
def _signed_root(parent: Ints, sign: Any, cell: int) -> tuple[int, int]:
    """Return the root of the set of ``cell``, and the orientation of the cell relative to it, 1 or -1.

    Paths to the root are halved: ``parent`` and ``sign`` (m,), the orientation relative to the parent, are changed.
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

    ``vertices`` (v, d): positions. ``order`` (v,): numbers of the vertices by ascending ``along``. ``along`` (v,):
    coordinates of the vertices along a unit vector: only vertices within ``tolerance`` in these are compared.
    """
    parent = np.empty(len(vertices), np.int64)
    for vertex in range(len(vertices)):
        parent[vertex] = vertex
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
def curvature_supports(
    vertices: Floats, ends: Ints, normals: Floats, creased: Bools, first: Ints, around: Ints
) -> tuple[Floats, Floats]:
    """Return the ratio (e,) and the height (e,) of the :class:`~cpmkit.mesh.mesh.CurvatureSupport` of edges.

    ``vertices`` (v, d), ``ends`` (e, 2): positions, and the vertices of each edge.
    ``normals`` (e, 2, d): unit normals at the ends of each edge. ``creased`` (v,): vertices on creases.
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
    ratios, heights = np.empty(count), np.empty(count)
    for edge in range(count):
        turning = abs(slopes[edge, 1] - slopes[edge, 0])  # curvature times length
        ratios[edge], heights[edge] = MOST_CURVATURE_RATIO, turning / 8
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
                    # Its weight cos^2 times its curvature cos^2 along this edge: exact for the diagonals of a cylinder.
                    curvature += cosine**4 * bend / lengths[other]
                    length += cosine * cosine * lengths[other]
            ratio = 1.0
            if total >= LEAST_WEIGHT and lengths[edge] > 0:
                weighted = turning / lengths[edge] * total
                ratio = MOST_CURVATURE_RATIO if weighted >= MOST_CURVATURE_RATIO * curvature else weighted / curvature
                ratio *= min(1.0, length / (total * lengths[edge]))
            ratios[edge] = min(ratios[edge], ratio)
    return ratios, heights


@compiled
def split_triangles(cells: Ints, of_cells: Ints, middle: Ints, vertices: Floats) -> Ints:
    """Return the triangles (k, 3) into which triangles with halved edges are split, in their order and orientation.

    ``cells``, ``of_cells`` (m, 3): the corners, and the edges opposite to them.
    ``middle`` (e,): the vertex in the middle of each edge, -1 where the edge stays whole.
    ``vertices`` (v, d): including the middles. They decide the split of a quadrilateral: along its shorter diagonal.
    """
    pieces = len(cells)
    for cell in range(len(cells)):
        for corner in range(3):
            pieces += middle[of_cells[cell, corner]] >= 0
    result = np.empty((pieces, 3), np.int64)
    at: Any = np.int64(0)
    for cell in range(len(cells)):
        divided = np.empty(3, np.bool_)
        for corner in range(3):
            divided[corner] = middle[of_cells[cell, corner]] >= 0
        count = divided[0] + divided[1] + divided[2]
        lead = 0  # the corner across from the one edge that differs from the other two
        for corner in range(3):
            if (count == 1 and divided[corner]) or (count == 2 and not divided[corner]):
                lead = corner
        a, b, c = cells[cell, lead], cells[cell, (lead + 1) % 3], cells[cell, (lead + 2) % 3]
        across = middle[of_cells[cell, lead]]
        q, p = middle[of_cells[cell, (lead + 1) % 3]], middle[of_cells[cell, (lead + 2) % 3]]
        if count == 0:
            at = _write_triangle(result, at, a, b, c)
        elif count == 1:
            at = _write_triangle(result, at, a, b, across)
            at = _write_triangle(result, at, a, across, c)
        elif count == 2:
            at = _write_triangle(result, at, a, p, q)
            from_b = from_c = 0.0
            for k in range(vertices.shape[1]):
                from_b += (vertices[b, k] - vertices[q, k]) ** 2
                from_c += (vertices[c, k] - vertices[p, k]) ** 2
            if from_b <= SAME_DIAGONAL * from_c:
                at = _write_triangle(result, at, p, b, q)
                at = _write_triangle(result, at, b, c, q)
            else:
                at = _write_triangle(result, at, p, b, c)
                at = _write_triangle(result, at, p, c, q)
        else:
            at = _write_triangle(result, at, a, p, q)
            at = _write_triangle(result, at, p, b, across)
            at = _write_triangle(result, at, q, across, c)
            at = _write_triangle(result, at, p, across, q)
    return result


@compiled
def cut_needles(
    corners: Ints, chains: Ints, parts: Ints, ends: Ints, divided: Ints, first: Ints, vertices: Floats
) -> Ints:
    """Return the triangles (k, 3), oriented like the needles, into which needles are cut across their long edges.

    ``corners`` (m, 3): the tip first.
    ``chains``, ``parts`` (m, 2): the edges from the tip to the second and to the third corner, and the number of parts
        wanted of each.
    ``ends`` (e, 2): the vertices of each edge.
    ``divided``, ``first`` (e,): the number of parts of each edge, a multiple of the number wanted, and its inner vertex
        next to its first end; further inner vertices follow in number.
    ``vertices`` (v, d).
    """
    pieces = 0
    for cell in range(len(corners)):
        pieces += parts[cell, 0] + parts[cell, 1] - 1
    result = np.empty((pieces, 3), np.int64)
    chain = np.empty((2, np.max(parts) + 1), np.int64)
    at: Any = np.int64(0)
    for cell in range(len(corners)):
        for side in range(2):
            edge = chains[cell, side]
            step = divided[edge] // parts[cell, side]
            for place in range(parts[cell, side] + 1):
                on = step * place if ends[edge, 0] == corners[cell, 0] else divided[edge] - step * place
                inside = first[edge] + on - 1
                chain[side, place] = ends[edge, 0] if on == 0 else ends[edge, 1] if on == divided[edge] else inside
        i = j = 1
        at = _write_triangle(result, at, chain[0, 0], chain[0, 1], chain[1, 1])
        while i < parts[cell, 0] or j < parts[cell, 1]:
            p, q = chain[0, i], chain[1, j]
            further = j == parts[cell, 1]
            if i < parts[cell, 0] and not further:
                from_p = from_q = 0.0
                for k in range(vertices.shape[1]):
                    from_p += (vertices[p, k] - vertices[chain[1, j + 1], k]) ** 2
                    from_q += (vertices[q, k] - vertices[chain[0, i + 1], k]) ** 2
                further = from_q <= SAME_DIAGONAL * from_p
            if further:
                i += 1
                at = _write_triangle(result, at, p, chain[0, i], q)
            else:
                j += 1
                at = _write_triangle(result, at, p, chain[1, j], q)
    return result


@compiled
def _write_triangle(result: Ints, at: int, a: int, b: int, c: int) -> int:
    """Write the triangle a, b, c to row ``at`` of ``result``, and return the next row."""
    result[at, 0], result[at, 1], result[at, 2] = a, b, c
    return at + 1
