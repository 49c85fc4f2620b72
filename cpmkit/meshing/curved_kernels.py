"""Compiled: where a surface known by its normals stands above the middles of edges."""

from __future__ import annotations

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.types import Bools, Floats, Ints


@compiled
def hermite_midpoints(
    vertices: Floats, ends: Ints, normals: Floats, straight: Bools, kept: Floats, creased_share: float
) -> Floats:
    """Return (e, d) points above edges (e, 2), across whose ends the ``normals`` (v, d) stand.

    At the share ``kept`` (e,) of the height of the middles of Hermite's cubics. Where one of these is higher than
    ``creased_share`` of its edge, or that is ``straight`` (e,), the middle of the edge.
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
        flat = straight[edge] or np.sqrt(above) > creased_share * length
        for i in range(d):
            middle = 0.5 * (vertices[ends[edge, 0], i] + vertices[ends[edge, 1], i])
            found[edge, i] = middle + (0.0 if flat else kept[edge] * height[i])
    return found


@compiled
def midpoints_by_heights(vertices: Floats, ends: Ints, heights: Floats, of_cells: Ints) -> Floats:
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
def gather_by_cell(points: Floats, of_cells: Ints) -> Floats:
    """Return (m, k, d) the ``points`` (e, d) of the edges ``of_cells`` (m, k)."""
    m, k = of_cells.shape
    found = np.empty((m, k, points.shape[1]))
    for cell in range(m):
        for j in range(k):
            for i in range(points.shape[1]):
                found[cell, j, i] = points[of_cells[cell, j], i]
    return found
