"""Pictures of what is made of a solution: its mesh with other colours, and more triangles on it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from cpmkit.facade import Solution
from cpmkit.protocols import Floats, Ints


@dataclass(frozen=True, eq=False)
class Painted(Solution):
    """A solution that is drawn with other colours.

    Attributes
    ----------
    mesh : DisplayMesh
        With the colours for values.
    """

    mesh: Any = field(kw_only=True)

    def display_mesh(self) -> Any:
        """Return the mesh with the colours."""
        return self.mesh


def painted(solution: Solution, colours: Floats) -> Painted:
    """Return ``solution`` with ``colours`` (v,) or (v, channels) at the vertices of its display mesh."""
    own = {one.name: getattr(solution, one.name) for one in fields(Solution)}
    values = np.asarray(colours, dtype=np.float64).reshape(len(colours), -1)
    return Painted(**own, mesh=replace(solution.display_mesh(), values=values))


def with_triangles(one: Painted, points: Floats, triangles: Ints, normals: Floats, colour: Any) -> Painted:
    """Return a picture with further ``triangles`` (t, 3) of ``points`` (v, 3) in one colour, lit by ``normals``."""
    mesh = one.mesh
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
    return replace(one, mesh=more)
