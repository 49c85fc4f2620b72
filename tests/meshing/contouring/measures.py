"""What tests of triangulations measure: areas, lengths, pieces and borders, by means of their own."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

#: A rule of degree 4 on the triangle (Dunavant 1985): barycentric coordinates and weights.
_A, _B = 0.445948490915965, 0.091576213509771
POINTS = np.array([np.roll([1 - 2 * c, c, c], k) for c in (_A, _B) for k in range(3)])
WEIGHTS = np.repeat([0.223381589678011, 0.109951743655322], 3)


def area(mesh):
    """Return the area of quadratic triangles, or of flat ones."""
    corners = mesh.vertices[mesh.cells]
    if mesh.midpoints is None:
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        return 0.5 * np.linalg.norm(np.cross(a, b), axis=1).sum()
    total = 0.0
    for place, weight in zip(POINTS, WEIGHTS, strict=True):
        a, b = (_slope(corners, mesh.midpoints, place, np.array(step)) for step in ([1, 0, -1], [0, 1, -1]))
        total += 0.5 * weight * np.linalg.norm(np.cross(a, b), axis=1).sum()
    return total


def _slope(corners, midpoints, place, step):
    """Return the derivative of a quadratic triangle's map along a step in barycentric coordinates."""
    slope = sum((4 * place[i] - 1) * step[i] * corners[:, i] for i in range(3))
    for j in range(3):
        p, q = (j + 1) % 3, (j + 2) % 3
        slope = slope + 4 * (place[p] * step[q] + place[q] * step[p]) * midpoints[:, j]
    return slope


def pieces(pairs):
    """Return how many pieces the graph of ``pairs`` (k, 2) has."""
    if not len(pairs):
        return 0
    names, pairs = np.unique(pairs, return_inverse=True)
    pairs = pairs.reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(len(names), len(names)))
    return connected_components(graph, directed=False)[0]


def topology(mesh):
    """Return how many components and pieces of the border a triangulation has, and its Euler characteristic."""
    edges, count = np.unique(np.sort(mesh.facets.reshape(-1, 2), axis=1), axis=0, return_counts=True)
    euler = len(np.unique(mesh.cells)) - len(edges) + len(mesh.cells)
    return pieces(edges), pieces(edges[count == 1]), euler


def length(mesh):
    """Return the length of quadratic segments."""
    places, weights = np.polynomial.legendre.leggauss(4)
    a, b = mesh.vertices[mesh.cells].transpose(1, 0, 2)
    c = mesh.midpoints[:, 0]
    slopes = [(2 * t - 1) * a + (2 * t + 1) * b - 4 * t * c for t in places]
    return sum(0.5 * w * np.linalg.norm(slope, axis=1).sum() for w, slope in zip(weights, slopes, strict=True))
