"""The angle by which a mesh turns from vertex to vertex, and the error that this leaves in a solution."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, Ints, dots, norms
from cpmkit_mesh.directions import doubled_areas
from cpmkit_mesh.folds import Folds

#: Largest error of a solution as a share of its range, over the turning angle's square (smooth) and over itself
#: (faceted). u = z on spheres of 66 to 4,098 vertices at spacings 0.1 to 0.03: 0.07 to 0.08; 0.06 to 0.22.
SMOOTH_ERROR_PER_RADIAN_SQUARED, FACETED_ERROR_PER_RADIAN = 0.075, 0.13
#: The same by the form ``galerkin``, over the angle's square, smooth, on these spheres: 0.00012 to 0.0004 at spacings
#: 0.05 and 0.03.
SMOOTH_INTEGRAL_ERROR = 0.00025
#: Radians up to which triangles that meet at an edge lie in one plane: files keep a few digits alone.
FLAT_ANGLE = 1e-3


def is_meant_flat(folds: Folds, crease_angle: float) -> bool:
    """Return whether a mesh is a body with flat sides: flat or, by more than ``crease_angle`` degrees, sharp at edges.

    Its triangles then stand for no smooth surface, and are right as they are. A few triangles all of which meet in
    sharp edges, as those of an icosahedron, may stand for a ball, and are not told apart from the body that they are.
    """
    return bool(np.all((folds.angle < FLAT_ANGLE) | (folds.angle > np.deg2rad(crease_angle))))


def turning_angle(vertices: Floats, faces: Ints, normals_at_corners: Floats) -> float:
    """Return the angle in radians between the normals at both ends of an edge, root mean square over the area."""
    area = doubled_areas(vertices, faces)
    beside = np.roll(normals_at_corners, 1, axis=1)
    angle = np.arctan2(norms(np.cross(normals_at_corners, beside)), dots(normals_at_corners, beside))
    return float(np.sqrt(np.average((angle**2).mean(axis=1), weights=area))) if area.any() else 0.0


def mesh_floor(turning_angle: float, smooth: bool) -> float:
    """Return the error that a mesh leaves in a solution by ``collocation`` at any spacing, as a share of its range."""
    return min(
        1.0, SMOOTH_ERROR_PER_RADIAN_SQUARED * turning_angle**2 if smooth else FACETED_ERROR_PER_RADIAN * turning_angle
    )


def integral_floor(turning_angle: float, smooth: bool) -> float:
    """Return the same by the form ``galerkin``, to which triangles that are read as they are are the surface itself."""
    return min(1.0, SMOOTH_INTEGRAL_ERROR * turning_angle**2) if smooth else 0.0
