"""Meshes of the unit sphere."""

import numpy as np
import pytest

CORNERS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)
FACES = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])


def subdivided(vertices, faces):
    pairs = np.sort(np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    edges, place = np.unique(pairs, axis=0, return_inverse=True)
    ab, bc, ca = place.reshape(3, -1) + len(vertices)
    middles = vertices[edges].sum(axis=1)
    a, b, c = faces.T
    parts = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    points = np.concatenate([vertices, middles / np.linalg.norm(middles, axis=1, keepdims=True)])
    return points, np.concatenate([np.stack(part, axis=1) for part in parts])


@pytest.fixture(scope="session")
def octahedron():
    """Return a function: an octahedron, divided so many times, its vertices on the unit sphere."""

    def divided(times):
        mesh = CORNERS, FACES
        for _ in range(times):
            mesh = subdivided(*mesh)
        return mesh

    return divided
