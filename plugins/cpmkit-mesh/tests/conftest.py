"""Meshes that the tests ask for, made by code."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

Mesh = tuple[np.ndarray, np.ndarray]


def _sphere(level: int) -> Mesh:
    """Return the unit sphere as an octahedron whose triangles were quartered ``level`` times."""
    points = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)
    faces = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
    for _ in range(level):
        edges = np.sort(faces[:, [1, 2, 2, 0, 0, 1]].reshape(-1, 2), axis=1)
        ends, middle = np.unique(edges, axis=0, return_inverse=True)
        middle = middle.reshape(-1, 3) + len(points)
        points = np.concatenate([points, points[ends].sum(axis=1)])
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        (a, b, c), (p, q, r) = faces.T, middle.T
        faces = np.concatenate([np.stack(t, axis=1) for t in ((a, r, q), (r, b, p), (q, p, c), (p, q, r))])
    return points, faces


def _cap(level: int) -> Mesh:
    """Return the upper half of the unit sphere, open along the equator."""
    points, faces = _sphere(level)
    return points, faces[(points[faces, 2] >= 0).all(axis=1)]


def _troublesome() -> Mesh:
    """Return an open bowl and a closed ball, 500 across and far from zero, all corners split."""
    bowl, ball = _cap(3), _sphere(2)
    points = np.concatenate([bowl[0] * 250, ball[0] * 40 - [0, 0, 100]]) + np.array([1000.0, 300.0, 0.0])
    faces = np.concatenate([bowl[1], ball[1] + len(bowl[0])])
    points = points.astype(np.float32).astype(float)  # what every format can hold
    return points[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)


@pytest.fixture
def sphere() -> Callable[[int], Mesh]:
    return _sphere


@pytest.fixture
def cap() -> Callable[[int], Mesh]:
    return _cap


@pytest.fixture
def troublesome() -> Mesh:
    return _troublesome()
