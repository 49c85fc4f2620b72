"""Compiled: the triangles into which triangles with halved edges are split, and needles are cut across."""

from __future__ import annotations

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats, Ints

#: Squared diagonals count as equal up to this factor, so that rounding does not decide which is shorter.
SAME_DIAGONAL = 1.0 + 1e-9


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
    at = 0
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
    """Return the triangles (k, 3) into which needles are cut across, between the vertices on their two long edges.

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
    at = 0
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
