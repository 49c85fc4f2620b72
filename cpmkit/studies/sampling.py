"""Points of any manifold at which errors are measured, without a mesh of it."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Floats
from cpmkit.scene import Scene

SEED = 7
#: Points nearer to a boundary than this share of the size are left out: data may jump there.
CLEAR = 1e-6
#: The box from which points are projected is larger than the bounds by this share on each side.
MARGIN = 0.1


def sample_points(scene: Scene, count: int) -> Floats:
    """Return up to ``count`` points (n, d) of the surface, none on a boundary, the same at every call.

    They are the closest points of points that lie evenly in a box around the surface.
    """
    bounds = np.asarray(scene.surface.bounds, dtype=np.float64)
    size = float((bounds[1] - bounds[0]).max())
    lower, upper = bounds[0] - MARGIN * size, bounds[1] + MARGIN * size
    queries = np.random.default_rng(SEED).uniform(lower, upper, (count, scene.surface.dim))
    points = scene.surface.closest_point(queries).points
    for boundary in scene.boundaries:
        points = points[boundary.source.closest_point(points).distance > CLEAR * size]
    return np.ascontiguousarray(points)
