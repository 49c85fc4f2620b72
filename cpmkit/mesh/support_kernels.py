"""Compiled: how far the surface beyond the ends of edges supports the curvature that normals claim along them."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Bools, Floats, Ints
from cpmkit.runtime.compilation import compiled

#: Below this sum of weights nothing lies beyond an end, as on rims.
LEAST_WEIGHT = 1e-3
#: Curvature along the edge over that beyond its end, at most: an ellipsoid's ends are not told from a fillet by it.
MOST_CURVATURE_RATIO = 4.0


@compiled
def supports(
    vertices: Floats, ends: Ints, normals: Floats, creased: Bools, first: Ints, around: Ints
) -> tuple[Floats, Floats]:
    """Return (e,) the support of each edge, and (e,) its height over its length by the ``normals`` (e, 2, d).

    ``around[first[v]:first[v + 1]]`` are the edges at vertex v. Vertices that are ``creased`` (v,) have no normal.
    """
    count, d = len(ends), vertices.shape[1]
    lengths, directions, slopes = np.empty(count), np.empty((count, d)), np.empty((count, 2))
    for edge in range(count):
        squared = 0.0
        for i in range(d):
            directions[edge, i] = vertices[ends[edge, 1], i] - vertices[ends[edge, 0], i]
            squared += directions[edge, i] ** 2
        lengths[edge] = np.sqrt(squared)
        slopes[edge, 0] = slopes[edge, 1] = 0.0
        for i in range(d):
            directions[edge, i] /= lengths[edge] if squared > 0 else 1.0
            for side in range(2):
                slopes[edge, side] += directions[edge, i] * normals[edge, side, i]
    found, heights = np.empty(count), np.empty(count)
    for edge in range(count):
        turning = abs(slopes[edge, 1] - slopes[edge, 0])  # curvature times length
        found[edge], heights[edge] = MOST_CURVATURE_RATIO, turning / 8
        for side in range(2):
            end = ends[edge, side]
            total = curvature = length = 0.0
            for k in range(first[end], first[end + 1]):
                other = around[k]
                if other == edge or lengths[other] == 0:
                    continue
                cosine = 0.0
                for i in range(d):
                    cosine += directions[edge, i] * directions[other, i]
                there = 0 if ends[other, 0] == end else 1
                if there != side:
                    cosine = -cosine
                if cosine < 0:
                    total += cosine * cosine
                    near, far = abs(slopes[other, there]), abs(slopes[other, 1 - there])
                    bend = 2 * near if creased[ends[other, 1 - there]] else near + far
                    # Along this edge: that of a cylinder along its diagonals is what the ring beyond has there.
                    curvature += cosine**4 * bend / lengths[other]
                    length += cosine * cosine * lengths[other]
            ratio = 1.0
            if total >= LEAST_WEIGHT and lengths[edge] > 0:
                own = turning / lengths[edge] * total
                ratio = MOST_CURVATURE_RATIO if own >= MOST_CURVATURE_RATIO * curvature else own / curvature
                ratio *= min(1.0, length / (total * lengths[edge]))
            found[edge] = min(found[edge], ratio)
    return found, heights
