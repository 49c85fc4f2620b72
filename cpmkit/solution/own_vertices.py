"""A solution at the vertices of the mesh, polyline or cloud that the surface was made from, as somebody gave it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import InputError
from cpmkit.protocols import ClosestPointSource, Floats, HasGivenMesh, Ints, Sides

if TYPE_CHECKING:
    from cpmkit.solution.solution import Solution

#: In spacings: a vertex that is farther from the surface, as one in no face may be, has no value.
FARTHEST_SPACINGS = 0.5


def given_mesh_of(surface: ClosestPointSource) -> tuple[Floats, Ints]:
    """Return the vertices (n, d) and cells (m, k) that ``surface`` was made from, in their order.

    Raises
    ------
    InputError
        If it was made from none.
    """
    if isinstance(surface, HasGivenMesh):
        return surface.given_mesh
    raise InputError(
        f"The surface {type(surface).__name__} was not made from vertices of yours; solution.evaluate(points) "
        "reads any points, and solution.display_mesh() is the mesh that pictures show."
    )


def at_vertices(solution: Solution, side: Sides) -> Floats:
    """Return the solution (n,) or (n, channels) at the given vertices; see :meth:`Solution.at_vertices`."""
    surface = solution.scene.surface
    vertices, _ = given_mesh_of(surface)
    near = np.flatnonzero(np.isfinite(vertices).all(axis=1))
    distance = surface.closest_point(np.ascontiguousarray(vertices[near])).distance
    near = near[distance <= FARTHEST_SPACINGS * solution.spacing]
    read = solution.evaluate(np.ascontiguousarray(vertices[near]), side)
    values = np.full((len(vertices), *read.shape[1:]), np.nan)
    values[near] = read
    return values
