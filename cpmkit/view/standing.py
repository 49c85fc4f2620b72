"""Which way a model stands: upwards is y or z, and it stands on what it has lowest there."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Floats

#: What is within this share of the height from the lowest point touches the ground.
GROUND_SHARE = 0.03
#: y is up where the model stands on it by this share of its breadth, and by twice what it does on z.
LEAST_STABILITY, MORE_STABLE = 0.08, 2.0


def upward_axis(points: Floats) -> int:
    """Return 1 where points (n, 3) stand on their lowest y, and much more firmly than on their lowest z; else 2."""
    y, z = (stability(points, axis) for axis in (1, 2))
    return 1 if y > LEAST_STABILITY and y > MORE_STABLE * z else 2


def stability(points: Floats, axis: int) -> float:
    """Return how far the middle of points (n, 3) is inside of what touches the ground below, as a share of the breadth.

    Below zero, or zero, where they would fall over if ``axis`` pointed up.
    """
    from scipy.spatial import ConvexHull, QhullError

    height = points[:, axis]
    flat = np.delete(points, axis, axis=1)
    ground = flat[height <= height.min() + GROUND_SHARE * np.ptp(height)]
    breadth = float(np.linalg.norm(np.ptp(flat, axis=0)))
    if len(ground) < 3 or breadth == 0:
        return 0.0
    try:
        sides = ConvexHull(ground).equations
    except QhullError:  # the ground is a point or a line
        return 0.0
    return float(-(sides[:, :2] @ flat.mean(axis=0) + sides[:, 2]).max() / breadth)
