"""Compiled: points above the middles of edges of a surface that is defined by its normals."""

from __future__ import annotations

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.types import Bools, Floats, Ints


@compiled
def hermite_midpoints(
    vertices: Floats, ends: Ints, normals: Floats, straight: Bools, share: Floats, creased_share: float
) -> Floats:
    """Return points (e, d) of the smooth surface above the middles of edges, by Hermite's cubic between their ends.

    Parameters
    ----------
    vertices : (v, d) float64
    ends : (e, 2) int64
        The vertices of each edge.
    normals : (v, d) float64
        Unit normals of the surface at the vertices.
    straight : (e,) bool
        Edges that keep their middles.
    share : (e,) float64
        Share of the height of the middle of Hermite's cubic that each edge gets.
    creased_share : float
        Edges keep their middles where the height is larger than this share of the edge's length.
    """
    d = vertices.shape[1]
    points = np.empty((len(ends), d))
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
            along_normal = total = 0.0
            for i in range(d):
                along_normal += chord[i] * normals[end, i]
            for i in range(d):
                tangent[i] = chord[i] - along_normal * normals[end, i]
                total += tangent[i] * tangent[i]
            size = np.sqrt(total)
            signed_length = (length if side == 0 else -length) if size > 0 else 0.0
            for i in range(d):
                height[i] += signed_length * (tangent[i] / (size if size > 0 else 1.0))
        above = 0.0
        for i in range(d):
            height[i] /= 8
            above += height[i] * height[i]
        flat = straight[edge] or np.sqrt(above) > creased_share * length
        for i in range(d):
            middle = 0.5 * (vertices[ends[edge, 0], i] + vertices[ends[edge, 1], i])
            points[edge, i] = middle + (0.0 if flat else share[edge] * height[i])
    return points


@compiled
def midpoints_by_heights(vertices: Floats, ends: Ints, heights: Floats, of_cells: Ints) -> Floats:
    """Return the middles of the edges ``of_cells`` (m, k), displaced by ``heights`` (e, d), as (m, k, d)."""
    m, k = of_cells.shape
    by_cell = np.empty((m, k, vertices.shape[1]))
    for cell in range(m):
        for j in range(k):
            edge = of_cells[cell, j]
            for i in range(vertices.shape[1]):
                middle = 0.5 * (vertices[ends[edge, 0], i] + vertices[ends[edge, 1], i])
                by_cell[cell, j, i] = middle + heights[edge, i]
    return by_cell


@compiled
def gather_by_cell(points: Floats, of_cells: Ints) -> Floats:
    """Return the rows of ``points`` (e, d) of the edges ``of_cells`` (m, k), as (m, k, d)."""
    m, k = of_cells.shape
    by_cell = np.empty((m, k, points.shape[1]))
    for cell in range(m):
        for j in range(k):
            for i in range(points.shape[1]):
                by_cell[cell, j, i] = points[of_cells[cell, j], i]
    return by_cell
