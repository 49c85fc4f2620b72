"""Compiled: where a surface known by its normals stands above the middles of edges."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Bools, Floats, Ints
from cpmkit.runtime.compilation import compiled


@compiled
def hermite_middles(vertices: Floats, ends: Ints, normals: Floats, creased: Bools, creased_share: float) -> Floats:
    """Return (e, d) the middles of Hermite's cubics over edges (e, 2), across whose ends the ``normals`` (v, d) stand.

    Where one is higher than ``creased_share`` of its edge, or a vertex is ``creased`` (v,), the middle of the edge.
    """
    d = vertices.shape[1]
    found = np.empty((len(ends), d))
    chord, height, tangent = np.empty(d), np.empty(d), np.empty(d)
    for edge in range(len(ends)):
        squared = 0.0
        for i in range(d):
            chord[i] = vertices[ends[edge, 1], i] - vertices[ends[edge, 0], i]
            height[i] = 0.0
            squared += chord[i] * chord[i]
        length = np.sqrt(squared)
        for side in range(2):
            end = ends[edge, side]
            off = total = 0.0
            for i in range(d):
                off += chord[i] * normals[end, i]
            for i in range(d):
                tangent[i] = chord[i] - off * normals[end, i]
                total += tangent[i] * tangent[i]
            size = np.sqrt(total)
            share = (length if side == 0 else -length) if size > 0 else 0.0
            for i in range(d):
                height[i] += share * (tangent[i] / (size if size > 0 else 1.0))
        above = 0.0
        for i in range(d):
            height[i] /= 8
            above += height[i] * height[i]
        straight = np.sqrt(above) > creased_share * length or creased[ends[edge, 0]] or creased[ends[edge, 1]]
        for i in range(d):
            middle = 0.5 * (vertices[ends[edge, 0], i] + vertices[ends[edge, 1], i])
            found[edge, i] = middle + (0.0 if straight else height[i])
    return found


@compiled
def middles_above(vertices: Floats, ends: Ints, heights: Floats, of_cells: Ints) -> Floats:
    """Return (m, k, d), of the edges ``of_cells`` (m, k), their middles and the ``heights`` (e, d) on top of these."""
    m, k = of_cells.shape
    found = np.empty((m, k, vertices.shape[1]))
    for cell in range(m):
        for j in range(k):
            edge = of_cells[cell, j]
            for i in range(vertices.shape[1]):
                middle = 0.5 * (vertices[ends[edge, 0], i] + vertices[ends[edge, 1], i])
                found[cell, j, i] = middle + heights[edge, i]
    return found


@compiled
def at_edges(points: Floats, of_cells: Ints) -> Floats:
    """Return (m, k, d) the ``points`` (e, d) of the edges ``of_cells`` (m, k)."""
    m, k = of_cells.shape
    found = np.empty((m, k, points.shape[1]))
    for cell in range(m):
        for j in range(k):
            for i in range(points.shape[1]):
                found[cell, j, i] = points[of_cells[cell, j], i]
    return found


@compiled
def at_folds(vertices: Floats, cells: Ints, of_cells: Ints, edges: int, cosine: float) -> Bools:
    """Return (v,) the vertices with an edge at which triangles turn by more than the angle with this ``cosine``.

    Of triangles (m, 3) with edges ``of_cells`` (m, 3), each opposite to a corner; however they are wound.
    """
    d = vertices.shape[1]
    at = np.zeros(len(vertices), dtype=np.bool_)
    inward, seen = np.empty((edges, d)), np.zeros(edges, dtype=np.bool_)
    own = np.empty(d)
    for cell in range(len(cells)):
        for corner in range(3):
            edge, a, b = of_cells[cell, corner], cells[cell, (corner + 1) % 3], cells[cell, (corner + 2) % 3]
            along = squared = size = product = 0.0
            for i in range(d):
                chord = vertices[b, i] - vertices[a, i]
                along += chord * (vertices[cells[cell, corner], i] - vertices[a, i])
                squared += chord * chord
            for i in range(d):
                chord = vertices[b, i] - vertices[a, i]
                own[i] = vertices[cells[cell, corner], i] - vertices[a, i] - along / squared * chord
                size += own[i] * own[i]
            for i in range(d):
                own[i] /= np.sqrt(size) if size > 0 else 1.0
                product -= own[i] * inward[edge, i] if seen[edge] else 0.0
            if size > 0:
                if seen[edge] and product < cosine:
                    at[a] = at[b] = True
                inward[edge], seen[edge] = own, True
    return at
