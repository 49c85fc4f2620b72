"""The error that a mesh leaves in a solution at any spacing, from the angle by which it turns between vertices."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, Ints, dots, norms
from cpmkit_mesh.face_geometry import InnerEdges, double_areas

#: The largest error of a solution, relative to its range, over the square of the turning angle (smooth) and over the
#: angle itself (faceted). u = z on spheres of 66 to 4,098 vertices at spacings 0.1 to 0.03: 0.07 to 0.08; 0.06 to 0.22.
SMOOTH_ERROR_PER_RADIAN_SQUARED, FACETED_ERROR_PER_RADIAN = 0.075, 0.13
#: The same for the form ``galerkin`` and a smooth mesh, over the square of the angle. On these spheres 0.00012 to
#: 0.0004 at spacings 0.05 and 0.03.
SMOOTH_INTEGRAL_ERROR = 0.00025
#: The angle in radians up to which two triangles lie in one plane: files store only a few digits.
FLAT_ANGLE = 1e-3


def is_flat_sided(edges: InnerEdges, crease_angle: float) -> bool:
    """Return whether a mesh is a body with flat sides: each inner edge is flat or turns by over the crease angle.

    ``crease_angle`` is in degrees. The triangles then sample no smooth surface, and are exact as they are. A coarse
    ball whose edges are all sharp, such as an icosahedron, cannot be distinguished from such a body.
    """
    return bool(np.all((edges.angle < FLAT_ANGLE) | (edges.angle > np.deg2rad(crease_angle))))


def rms_turning_angle(vertices: Floats, faces: Ints, normals_at_corners: Floats) -> float:
    """Return the root mean square angle, in radians, between the normals at both ends of edges, weighted by area.

    ``normals_at_corners`` (m, 3, 3) are those of ``faces`` (m, 3) between ``vertices`` (k, 3). Without area it is 0.
    """
    area = double_areas(vertices, faces)
    following = np.roll(normals_at_corners, 1, axis=1)
    angle = np.arctan2(norms(np.cross(normals_at_corners, following)), dots(normals_at_corners, following))
    return float(np.sqrt(np.average((angle**2).mean(axis=1), weights=area))) if area.any() else 0.0


def solution_error_floor(turning_angle: float, smooth: bool) -> float:
    """Return the error that a mesh causes in solutions by ``collocation``, relative to their range, at most 1.

    ``turning_angle`` is in radians; ``smooth`` says whether closest points follow interpolated normals.
    """
    return min(
        1.0, SMOOTH_ERROR_PER_RADIAN_SQUARED * turning_angle**2 if smooth else FACETED_ERROR_PER_RADIAN * turning_angle
    )


def integral_floor(turning_angle: float, smooth: bool) -> float:
    """Return the error that a mesh causes in solutions by ``galerkin``, relative to their range; 0 for a faceted mesh.

    ``turning_angle`` is in radians. A faceted mesh is the exact surface in that form.
    """
    return min(1.0, SMOOTH_INTEGRAL_ERROR * turning_angle**2) if smooth else 0.0
