"""Directions and areas of triangles."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, Ints, norms, unit


def face_normals(vertices: Floats, faces: Ints) -> Floats:
    """Return (m, 3) unit normals by the winding of the faces; zero where a face has no area."""
    return unit(across(vertices, faces))


def doubled_areas(vertices: Floats, faces: Ints) -> Floats:
    """Return (m,) twice the area of each face."""
    return norms(across(vertices, faces))


def across(vertices: Floats, faces: Ints) -> Floats:
    """Return (m, 3) vectors across the faces by their winding, twice as long as each has area."""
    a, b, c = (vertices[faces[:, k]].T for k in range(3))
    (u, v, w), (x, y, z) = b - a, c - a
    return np.stack([v * z - w * y, w * x - u * z, u * y - v * x], axis=1)
