"""Directions and areas of triangles."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, Ints, unit


def face_normals(vertices: Floats, faces: Ints) -> Floats:
    """Return (m, 3) unit normals by the winding of the faces; zero where a face has no area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return unit(np.cross(b - a, c - a))


def doubled_areas(vertices: Floats, faces: Ints) -> Floats:
    """Return (m,) twice the area of each face."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1)
