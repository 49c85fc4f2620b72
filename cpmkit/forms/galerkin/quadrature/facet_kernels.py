"""Compiled: by how much flat triangles turn against their neighbours."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled


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
