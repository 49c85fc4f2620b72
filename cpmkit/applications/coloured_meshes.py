"""Display meshes of applications: a solution's mesh with other colours, and arrows on it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.facade import Solution
from cpmkit.plugin import ClosestPointSource
from cpmkit.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class ColouredSolution(Solution):
    """A solution that is drawn with other colours.

    Attributes
    ----------
    mesh : DisplayMesh
        The display mesh with the colours as values.
    """

    mesh: Any = field(kw_only=True)

    def display_mesh(self) -> Any:
        """Return the display mesh with the colours as values."""
        return self.mesh


def with_colours(solution: Solution, colours: Floats) -> ColouredSolution:
    """Return ``solution`` with ``colours`` (v,) or (v, channels) at the vertices of its display mesh."""
    attributes = {entry.name: getattr(solution, entry.name) for entry in fields(Solution)}
    values = np.asarray(colours, dtype=np.float64).reshape(len(colours), -1)
    return ColouredSolution(**attributes, mesh=replace(solution.display_mesh(), values=values))


def with_triangles(
    solution: ColouredSolution, points: Floats, triangles: Ints, normals: Floats, colour: Any
) -> ColouredSolution:
    """Return ``solution`` with ``triangles`` (t, 3) of ``points`` (v, 3) added to its display mesh.

    They have one colour (3,) and are shaded by ``normals`` (v, 3).
    """
    mesh = solution.mesh
    count, corners = len(mesh.points), max(mesh.cells.shape[1], 3)
    cells = np.full((len(mesh.cells) + len(triangles), corners), -1)
    cells[: len(mesh.cells), : mesh.cells.shape[1]] = mesh.cells
    cells[len(mesh.cells) :, :3] = triangles + count
    more = replace(
        mesh,
        points=np.concatenate([mesh.points, points]),
        cells=cells,
        values=np.concatenate([mesh.values, np.broadcast_to(colour, (len(points), mesh.values.shape[1]))]),
        normals=np.concatenate([mesh.normals, normals]),
        sides=None,
    )
    return replace(solution, mesh=more)


#: Corners of an arrow of length one about its centre: coordinates along it and across.
OUTLINE = np.array(
    [[-0.5, -0.05], [0.0, -0.05], [0.15, -0.05], [0.15, -0.18], [0.5, 0.0], [0.15, 0.18], [0.15, 0.05], [0.0, 0.05]]
    + [[-0.5, 0.05]]
)
TRIANGLES = np.array([[0, 1, 8], [8, 1, 7], [1, 2, 7], [7, 2, 6], [3, 4, 5]])
#: Height of arrows above the surface, over their length.
LIFT_SHARE = 0.08
#: Least distance of the centres of arrows, over their length.
APART_LENGTHS = 0.95


def spread_points(points: Floats, distance: float) -> Ints:
    """Return the indices of randomly chosen points, no two of which are nearer to each other than ``distance``."""
    from scipy.spatial import cKDTree

    neighbours = cKDTree(points).query_ball_point(points, distance)
    free, chosen = np.ones(len(points), dtype=bool), []
    for number in np.random.default_rng(0).permutation(len(points)):
        if free[number]:
            chosen.append(number)
            free[neighbours[number]] = False
    return np.array(chosen, dtype=np.int64)


def arrow_triangles(
    surface: ClosestPointSource, centres: Floats, directions: Floats, length: float
) -> tuple[Floats, Ints, Floats]:
    """Return vertices (v, 3), triangles (t, 3) and normals (v, 3) of arrows along a surface, on both its sides.

    Each corner is projected on the surface and then moved off it along the normal.
    """
    normals = ck.normals_at(surface, centres)
    across = np.cross(normals, directions)
    corners = centres[:, None] + length * (OUTLINE[:, :1] * directions[:, None] + OUTLINE[:, 1:] * across[:, None])
    on = surface.closest_point(corners.reshape(-1, 3)).points
    corner_normals = ck.normals_at(surface, on).reshape(corners.shape)
    corner_normals *= np.where(np.einsum("mcd,md->mc", corner_normals, normals) < 0, -1.0, 1.0)[:, :, None]
    lift = LIFT_SHARE * length * corner_normals.reshape(-1, 3)
    faces = (len(OUTLINE) * np.arange(len(centres))[:, None, None] + TRIANGLES).reshape(-1, 3)
    facing = corner_normals.reshape(-1, 3)
    both = np.concatenate([on + lift, on - lift])
    return both, np.concatenate([faces, faces[:, ::-1] + len(on)]), np.concatenate([facing, -facing])
