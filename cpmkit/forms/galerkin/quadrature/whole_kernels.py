"""Compiled: the samples of triangles that lie between knot planes and need one alone.

On lattices far coarser than a mesh these are all but a few, and nothing needs to be cut.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.quadrature.clipping_kernels import (
    ON_PLANE_SPACINGS,
    directed,
    position,
    project,
    slopes,
)
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Bools, Floats, Ints

#: The centroid: shares of the first two corners, as the rule of one place makes them of a whole triangle.
FIRST_SHARE, SECOND_SHARE = 1.0 - (1.0 / 3.0) / 0.5, (0.5 / 3.0) / 0.5


@compiled
def nodes_of(vertices: Floats, cells: Ints, midpoints: Floats) -> Floats:
    """Return (m, 3 or 6, 3) the corners of ``cells`` (m, 3), then their ``midpoints`` (m, 0 or 3, 3)."""
    m, more = midpoints.shape[:2]
    nodes = np.empty((m, 3 + more, 3))
    for cell in range(m):
        for i in range(3):
            for k in range(3):
                nodes[cell, k, i] = vertices[cells[cell, k], i]
            for k in range(more):
                nodes[cell, 3 + k, i] = midpoints[cell, k, i]
    return nodes


@compiled
def is_single(corners: Floats, clipped: bool, single: float, cell: Floats) -> bool:
    """Tell whether a triangle has one sample and is not cut; fills ``cell`` (3,) with the lattice cell it lies in."""
    if single <= 0:
        return False
    length = 0.0
    for i in range(3):
        low = min(min(corners[0, i], corners[1, i]), corners[2, i])
        high = max(max(corners[0, i], corners[1, i]), corners[2, i])
        if clipped and high - (np.floor(low + ON_PLANE_SPACINGS + 0.5) + 0.5) > ON_PLANE_SPACINGS:
            return False
        length += (high - low) ** 2
        cell[i] = np.floor(0.5 * (low + high) + 0.5)
    a, b, c = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1], corners[1, 2] - corners[0, 2]
    d, e, f = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1], corners[2, 2] - corners[0, 2]
    x, y, z = b * f - c * e, c * d - a * f, a * e - b * d
    return bool(0.5 * np.sqrt(x * x + y * y + z * z) * length < single)


@compiled
def single_samples(
    vertices: Floats,
    cells: Ints,
    midpoints: Floats,
    spacing: float,
    clipped: Bools,
    single: Floats,
    found: tuple[Floats, Floats, Floats, Any],
    left: Ints,
) -> tuple[int, int]:
    """Fill ``found`` with the points, weights, normals and triangles of the samples of those that need one alone.

    And ``left`` (m,) with the numbers of all others; returns how many of both there are.

    Parameters
    ----------
    vertices, cells, midpoints
        As of :func:`nodes_of`.
    spacing, clipped, single
        As of ``triangle_samples``, whose samples these are.
    found : (m, 3), (m,), (m, 1, 3) float64, (m,) int32
    left : (m,) int64
    """
    points, weights, normals, triangle = found
    curved = midpoints.shape[1] == 3
    own, cell, point = np.empty((3 + midpoints.shape[1], 3)), np.empty(3), np.empty(3)
    first, second, normal = np.empty(3), np.empty(3), np.empty(3)
    used = others = 0
    for m in range(len(cells)):
        for k in range(3):
            for i in range(3):
                own[k, i] = vertices[cells[m, k], i] / spacing
        if not is_single(own, clipped[m], single[m], cell):
            left[others] = m
            others += 1
            continue
        for k in range(3, len(own)):
            for i in range(3):
                own[k, i] = midpoints[m, k - 3, i] / spacing
        position(own, curved, FIRST_SHARE, SECOND_SHARE, point)
        slopes(own, curved, FIRST_SHARE, SECOND_SHARE, first, second)
        across = directed(first, second, normal)
        weights[used] = 0.5 * across * spacing**2
        for i in range(3):
            normals[used, 0, i] = normal[i]
            points[used, i] = spacing * (project(point[i], cell[i]) if clipped[m] else point[i])
        triangle[used] = m
        used += 1
    return used, others


@compiled
def normal_of(vertices: Floats, cell: Ints, normal: Floats) -> float:
    """Fill ``normal`` (3,) with the vector across a triangle, and return its length, twice the area."""
    total = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        one = (vertices[cell[1], j] - vertices[cell[0], j]) * (vertices[cell[2], k] - vertices[cell[0], k])
        two = (vertices[cell[1], k] - vertices[cell[0], k]) * (vertices[cell[2], j] - vertices[cell[0], j])
        normal[i] = one - two
        total += normal[i] * normal[i]
    return float(np.sqrt(total))


@compiled
def least_turn(vertices: Floats, cells: Ints, of_cells: Ints) -> Floats:
    """Return (m,) the least sine of the angles to a neighbour over the edges ``of_cells`` (m, 3) of each triangle.

    Whichever way they are wound. 0 where an edge has one triangle or more than two, or a triangle no area.
    """
    normals, sizes = np.empty((len(cells), 3)), np.empty(len(cells))
    for cell in range(len(cells)):
        sizes[cell] = normal_of(vertices, cells[cell], normals[cell])
    edges = int(of_cells.max()) + 1 if len(cells) else 0
    first, sine = np.full(edges, -1, np.int64), np.zeros(edges)
    for cell in range(len(cells)):
        for edge in of_cells[cell]:
            if first[edge] == -1:
                first[edge] = cell
            elif first[edge] == -2:
                sine[edge] = 0.0
            else:
                other, total = first[edge], 0.0
                for i in range(3):
                    j, k = (i + 1) % 3, (i + 2) % 3
                    across = normals[cell, j] * normals[other, k] - normals[cell, k] * normals[other, j]
                    total += across * across
                both = sizes[cell] * sizes[other]
                sine[edge] = np.sqrt(total) / both if both > 0 else 0.0
                first[edge] = -2
    least = np.ones(len(cells))
    for cell in range(len(cells)):
        for edge in of_cells[cell]:
            least[cell] = min(least[cell], sine[edge])
    return least


@compiled
def mark_small(vertices: Floats, cells: Ints, spacing: float, most: float, found: Floats) -> None:
    """Put ``most`` into ``found`` (m,) where a triangle's area times the square of its length, in spacings, is less."""
    a, b, c = np.empty(3), np.empty(3), np.empty(3)
    for cell in range(len(cells)):
        squared = 0.0
        for i in range(3):
            a[i] = vertices[cells[cell, 0], i] / spacing
            b[i] = vertices[cells[cell, 1], i] / spacing
            c[i] = vertices[cells[cell, 2], i] / spacing
            extent = max(max(a[i], b[i]), c[i]) - min(min(a[i], b[i]), c[i])
            squared += extent * extent
        total = 0.0
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            normal = (b[j] - a[j]) * (c[k] - a[k]) - (b[k] - a[k]) * (c[j] - a[j])
            total += normal * normal
        if 0.5 * np.sqrt(total) * squared < most:
            found[cell] = most
