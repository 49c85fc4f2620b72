"""Samples of triangles: points, weights and normals, flat or quadratic."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled

#: A cross product shorter than this share of the squared length of what it is made of tells no direction.
NO_DIRECTION_SHARE = 1e-14


@compiled
def triangle_samples(
    vertices: Floats, cells: Ints, midpoints: Floats, shares: Floats, slopes: Floats, weights: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return points (m q, 3), weights (m q,) and unit normals (m q, 1, 3) of triangles.

    Parameters
    ----------
    vertices : (v, 3) float64
    cells : (m, 3) int64
    midpoints : (m, 3, 3) float64
        Or (0, 3, 3) where cells are flat.
    shares : (q, n) float64
        Of each node, 3 or 6, in each point of the rule.
    slopes : (2, q, n) float64
        Derivatives of the shares along two edges.
    weights : (q,) float64
    """
    rule, nodes = shares.shape
    count = rule * len(cells)
    points, measure, normals = np.zeros((count, 3)), np.empty(count), np.empty((count, 1, 3))
    node = np.empty((nodes, 3))
    for cell in range(len(cells)):
        for k in range(3):
            for i in range(3):
                node[k, i] = vertices[cells[cell, k], i]
                if nodes == 6:
                    node[3 + k, i] = midpoints[cell, k, i]
        for q in range(rule):
            at = rule * cell + q
            u = v = w = x = y = z = 0.0
            for k in range(nodes):
                for i in range(3):
                    points[at, i] += shares[q, k] * node[k, i]
                u += slopes[0, q, k] * node[k, 0]
                v += slopes[0, q, k] * node[k, 1]
                w += slopes[0, q, k] * node[k, 2]
                x += slopes[1, q, k] * node[k, 0]
                y += slopes[1, q, k] * node[k, 1]
                z += slopes[1, q, k] * node[k, 2]
            a, b, c = v * z - w * y, w * x - u * z, u * y - v * x
            area = np.sqrt(a * a + b * b + c * c)
            measure[at] = weights[q] * area
            first, second = u * u + v * v + w * w, x * x + y * y + z * z
            if area <= NO_DIRECTION_SHARE * max(first, second):
                # No area, so that the normal counts for nothing: any across the longer edge.
                if second > first:
                    u, v, w = x, y, z
                if u == 0 and v == 0:
                    a, b, c = 1.0, 0.0, 0.0
                else:
                    a, b, c = -v, u, 0.0
                area = np.sqrt(a * a + b * b + c * c)
            normals[at, 0, 0], normals[at, 0, 1], normals[at, 0, 2] = a / area, b / area, c / area
    return points, measure, normals
