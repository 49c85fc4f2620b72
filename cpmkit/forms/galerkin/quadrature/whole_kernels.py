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
from cpmkit.protocols import Bools, Floats, Ints
from cpmkit.runtime.compilation import compiled

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
