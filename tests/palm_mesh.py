"""A mesh with limbs: a flat ellipsoid with four fingers."""

import numpy as np
import pytest

FINGER_RADIUS = 0.035


def capsule(x, start, end, radius):
    """Return distances from a segment with round ends."""
    start, way = np.array(start), np.subtract(end, start)
    along = np.clip((x - start) @ way / (way @ way), 0, 1)
    return np.linalg.norm(x - start - along[..., None] * way, axis=-1) - radius


def palm():
    """Return the mesh of a flat ellipsoid with four fingers, joined smoothly."""
    pyvista = pytest.importorskip("pyvista")
    cell, sharpness, low = 0.0125, 60.0, -0.1
    axes = [np.arange(low, high, cell) for high in (0.8, 1.1, 0.3)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    parts = [np.linalg.norm((x - [0.35, 0.25, 0.1]) / [0.3, 0.25, 0.09], axis=-1) * 0.09 - 0.09]
    for i in range(4):
        tip = [0.1 + 0.165 * i, 0.95 - 0.05 * (i % 2), 0.1 + 0.03 * (i % 3)]
        parts.append(capsule(x, [0.17 + 0.12 * i, 0.35, 0.1], tip, FINGER_RADIUS))
    height = -np.log(sum(np.exp(-sharpness * part) for part in parts)) / sharpness
    grid = pyvista.ImageData(dimensions=height.shape, spacing=(cell,) * 3, origin=(low,) * 3)
    grid["height"] = height.ravel(order="F")
    mesh = grid.contour([0.0], "height").triangulate().clean()
    return np.asarray(mesh.points, dtype=float), mesh.regular_faces.astype(np.int64)
