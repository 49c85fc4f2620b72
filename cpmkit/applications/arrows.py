"""Flat arrows that lie on a surface, for pictures of tangential vectors."""

from __future__ import annotations

import numpy as np

import cpmkit as ck
from cpmkit.protocols import ClosestPointSource, Floats, Ints

#: Corners of an arrow of length one about its middle: along it, and across.
OUTLINE = np.array(
    [[-0.5, -0.05], [0.0, -0.05], [0.15, -0.05], [0.15, -0.18], [0.5, 0.0], [0.15, 0.18], [0.15, 0.05], [0.0, 0.05]]
    + [[-0.5, 0.05]]
)
TRIANGLES = np.array([[0, 1, 8], [8, 1, 7], [1, 2, 7], [7, 2, 6], [3, 4, 5]])
#: How far above the surface arrows lie, over their length.
LIFT_SHARE = 0.08
#: Distance of their middles over their length.
APART_LENGTHS = 0.95


def spread(points: Floats, apart: float) -> Ints:
    """Return the numbers of points of which no two are nearer than ``apart``."""
    from scipy.spatial import cKDTree

    near = cKDTree(points).query_ball_point(points, apart)
    free, chosen = np.ones(len(points), dtype=bool), []
    for number in np.random.default_rng(0).permutation(len(points)):
        if free[number]:
            chosen.append(number)
            free[near[number]] = False
    return np.array(chosen, dtype=np.int64)


def arrows(
    surface: ClosestPointSource, middles: Floats, directions: Floats, length: float
) -> tuple[Floats, Ints, Floats]:
    """Return vertices (v, 3), triangles (t, 3) and normals (v, 3) of arrows bent to a surface, on both its sides.

    Each corner is put on the surface's closest point, and then lifted off it.
    """
    normals = ck.normals_at(surface, middles)
    across = np.cross(normals, directions)
    corners = middles[:, None] + length * (OUTLINE[:, :1] * directions[:, None] + OUTLINE[:, 1:] * across[:, None])
    on = surface.closest_point(corners.reshape(-1, 3)).points
    there = ck.normals_at(surface, on).reshape(corners.shape)
    there *= np.where(np.einsum("mcd,md->mc", there, normals) < 0, -1.0, 1.0)[:, :, None]
    lift = LIFT_SHARE * length * there.reshape(-1, 3)
    faces = (len(OUTLINE) * np.arange(len(middles))[:, None, None] + TRIANGLES).reshape(-1, 3)
    facing = there.reshape(-1, 3)
    both = np.concatenate([on + lift, on - lift])
    return both, np.concatenate([faces, faces[:, ::-1] + len(on)]), np.concatenate([facing, -facing])
