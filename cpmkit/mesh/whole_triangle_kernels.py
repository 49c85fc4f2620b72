"""Compiled: samples of whole triangles with a single point, and the angles between neighbouring flat triangles.

On lattices far coarser than a mesh nearly all triangles need a single point and are not clipped.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.mesh.clipping_kernels import (
    ON_PLANE_SPACINGS,
    clamp_to_cell,
    position,
    slopes,
    unit_normal,
)
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Bools, Floats, Ints

#: Barycentric coordinates of the centroid, with the same rounding as by `centroid` on a whole triangle.
FIRST_SHARE, SECOND_SHARE = 1.0 - (1.0 / 3.0) / 0.5, (0.5 / 3.0) / 0.5


@compiled
def gather_nodes(vertices: Floats, cells: Ints, midpoints: Floats) -> Floats:
    """Return the nodes (m, 3 or 6, 3) of triangles: corners of ``cells`` (m, 3), then ``midpoints`` (m, 0 or 3, 3)."""
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
def needs_one_point(corners: Floats, clipped: bool, single: float, cell: Floats) -> bool:
    """Return whether a triangle gets a single point and is not clipped.

    If so ``cell`` (3,) is filled with the lattice cell of the middle of its bounding box. ``corners`` (3, 3) are in
    spacings; ``clipped`` and ``single`` are the triangle's entries of those arguments of `triangle_samples`.
    """
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
def one_point_samples(
    vertices: Floats,
    cells: Ints,
    midpoints: Floats,
    spacing: float,
    clipped: Bools,
    single: Floats,
    samples: tuple[Floats, Floats, Floats, Any],
    remaining: Ints,
) -> tuple[int, int]:
    """Fill ``samples`` with the quadrature points of triangles that get a single point.

    ``remaining`` is filled with the numbers of all other triangles. Returns how many triangles get a single point, and
    how many remain.

    Parameters
    ----------
    vertices, cells, midpoints
        As of :func:`gather_nodes`.
    spacing, clipped, single
        As of ``triangle_samples``, which gives the same samples.
    samples : (m, 3), (m,), (m, 1, 3) float64, (m,) int32
        Arrays for points, weights, normals and triangle numbers.
    remaining : (m,) int64
        Array for triangle numbers.
    """
    points, weights, normals, triangle = samples
    curved = midpoints.shape[1] == 3
    nodes, cell, point = np.empty((3 + midpoints.shape[1], 3)), np.empty(3), np.empty(3)
    first, second, normal = np.empty(3), np.empty(3), np.empty(3)
    used = others = 0
    for m in range(len(cells)):
        for k in range(3):
            for i in range(3):
                nodes[k, i] = vertices[cells[m, k], i] / spacing
        if not needs_one_point(nodes, clipped[m], single[m], cell):
            remaining[others] = m
            others += 1
            continue
        for k in range(3, len(nodes)):
            for i in range(3):
                nodes[k, i] = midpoints[m, k - 3, i] / spacing
        position(nodes, curved, FIRST_SHARE, SECOND_SHARE, point)
        slopes(nodes, curved, FIRST_SHARE, SECOND_SHARE, first, second)
        across = unit_normal(first, second, normal)
        weights[used] = 0.5 * across * spacing**2
        for i in range(3):
            normals[used, 0, i] = normal[i]
            points[used, i] = spacing * (clamp_to_cell(point[i], cell[i]) if clipped[m] else point[i])
        triangle[used] = m
        used += 1
    return used, others


@compiled
def area_vector(vertices: Floats, cell: Ints, normal: Floats) -> float:
    """Fill ``normal`` (3,) with the normal of a triangle whose length is twice the area, and return this length."""
    total = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        first = (vertices[cell[1], j] - vertices[cell[0], j]) * (vertices[cell[2], k] - vertices[cell[0], k])
        second = (vertices[cell[1], k] - vertices[cell[0], k]) * (vertices[cell[2], j] - vertices[cell[0], j])
        normal[i] = first - second
        total += normal[i] * normal[i]
    return float(np.sqrt(total))


@compiled
def least_turning_sine(vertices: Floats, cells: Ints, of_cells: Ints) -> Floats:
    """Return for each triangle the least sine (m,) of the angles between its plane and those of its neighbours.

    ``of_cells`` (m, 3) are the edges of the triangles. Orientations do not matter. The sine is 0 if an edge belongs to
    one triangle or more than two, or if a triangle has no area.
    """
    normals, sizes = np.empty((len(cells), 3)), np.empty(len(cells))
    for cell in range(len(cells)):
        sizes[cell] = area_vector(vertices, cells[cell], normals[cell])
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
def mark_small_triangles(vertices: Floats, cells: Ints, spacing: float, most: float, limits: Floats) -> None:
    """Set ``limits`` (m,) to ``most`` where a triangle's area times its squared length, in spacings, is smaller."""
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
            limits[cell] = most
