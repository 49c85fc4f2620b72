"""The edges of triangles, how long they are, and the corners that hang together over them, without sorting."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Bools, Floats, Ints
from cpmkit.runtime.compilation import compiled
from cpmkit.runtime.disjoint_sets import find, unite


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
        root = find(parent, place)
        if root == place:
            number[place // 3, place % 3] = found
            found += 1
        else:  # the root of a component is its first corner
            number[place // 3, place % 3] = number[root // 3, root % 3]
    return number
