"""Clouds on which ``cpmkit.testing`` checks the laws."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Floats
from cpmkit_pointcloud.factory import points

if TYPE_CHECKING:
    from cpmkit.plugin import ConformanceCase

Draw = Callable[[np.random.Generator, int], Floats]


def cases() -> list[ConformanceCase]:
    """Return cases of even and of random clouds, of degree 2 and 4, with normals, in the plane, and of nearest samples.

    The last number of a case is a distance up to which ``distance`` is that of the foot, below half the smallest radius
    of curvature.
    """
    from cpmkit.plugin import ConformanceCase

    ball, ring = sphere_samples(2000), torus_samples(3000)
    kind = "pointcloud.points"
    far = ball * 1e-3 + [5.0, -3.0, 1.0]
    return [
        ConformanceCase(kind, "sphere", partial(points, points=ball), None, 0.4),
        ConformanceCase(kind, "sphere with normals", partial(points, points=ball, normals=ball), None, 0.4),
        ConformanceCase(kind, "small sphere far from zero", partial(points, points=far), None, 4e-4),
        ConformanceCase(kind, "torus of degree 4", partial(points, points=ring, degree=4), None, 0.1),
        ConformanceCase(kind, "curve", partial(points, points=ellipse_samples(200)), None, 0.1),
        ConformanceCase(kind, "nearest", partial(points, points=ball, method="nearest"), _row_sampler(ball)),
    ]


def sphere_samples(count: int) -> Floats:
    """Return ``count`` points (count, 3) of the unit sphere, evenly spread along a Fibonacci spiral."""
    i = np.arange(count) + 0.5
    z, angle = 1.0 - 2.0 * i / count, np.pi * (1.0 + np.sqrt(5.0)) * i
    around = np.sqrt(1.0 - z * z)
    return np.stack([around * np.cos(angle), around * np.sin(angle), z], axis=1)


def torus_samples(count: int, seed: int = 0) -> Floats:
    """Return ``count`` random points (count, 3) of the torus of radii 1 and 0.4, uniform by area, of fixed ``seed``."""
    rng = np.random.default_rng(seed)
    u, v, keep = rng.uniform(0.0, 1.0, (3, 3 * count))
    u, v = 2 * np.pi * u, 2 * np.pi * v
    around = 1.0 + 0.4 * np.cos(v)
    kept = np.flatnonzero(1.4 * keep < around)[:count]
    return np.stack([around * np.cos(u), around * np.sin(u), 0.4 * np.sin(v)], axis=1)[kept]


def ellipse_samples(count: int) -> Floats:
    """Return ``count`` points (count, 2) of the ellipse with half axes 1 and 0.6, at equal steps of its parameter."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), 0.6 * np.sin(angle)], axis=1)


def _row_sampler(cloud: Floats) -> Draw:
    return lambda rng, n: cloud[rng.integers(0, len(cloud), n)]
