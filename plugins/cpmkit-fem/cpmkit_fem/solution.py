"""A solution on a triangulation: read it anywhere, save it, draw it, as any other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints, Side, Solution, as_points
from cpmkit_fem.location import nearest_on_triangles

if TYPE_CHECKING:
    from cpmkit.plugin import DisplayMesh


@dataclass(frozen=True)
class FemWork:
    """Machine-independent measures of a solve.

    Attributes
    ----------
    unknowns : int
        Vertices that nothing pins.
    vertices, faces : int
        Of the triangulation.
    nonzeros : int
        Stored entries of the reduced matrix.
    operator_applications : int
        Products with it.
    """

    unknowns: int
    vertices: int
    faces: int
    nonzeros: int
    operator_applications: int

    def as_dict(self) -> dict[str, Any]:
        """Return the measures as plain values."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class FemSolution(Solution):
    """The solution of a scene by linear finite elements.

    Attributes
    ----------
    scene : Scene
        What was solved.
    values : (v, channels) float64
        The solution at the vertices.
    report : SolveReport
        What the solver reached.
    work : FemWork
        What it cost.
    seconds : mapping
        Seconds of each stage; of this machine, on this day.
    warnings : tuple of str
        What a reader of the solution should know.
    vertices : (v, d) float64
        Of the triangulation, in the scene's coordinates.
    faces : (m, 3) int64
    """

    work: FemWork
    vertices: Floats
    faces: Ints

    libraries: ClassVar[tuple[str, ...]] = ("cpmkit", "cpmkit-fem", "scikit-fem", "numpy", "scipy")

    @property
    def spacing(self) -> float:
        """The mean length of a triangle's side."""
        corners = self.vertices[self.faces]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())

    def evaluate(self, points: Any, side: Side | Mapping[str, Side] | None = None) -> Floats:
        """Return the solution, linear on each triangle, at the points of the triangulation nearest to ``points``.

        Parameters
        ----------
        points : (n, d) array
            In the scene's coordinates; at any distance, and the nearest point is exact.
        side : "left", "right" or {boundary name: side}, optional
            Accepted as by other back ends; both sides hold the same value.

        Returns
        -------
        (n,) or (n, channels) float64

        Raises
        ------
        InputError
            If a point is not finite, or a side is neither left nor right of a boundary of the scene.
        """
        self._check_side(side)
        queries = as_points(points, self.scene.surface.dim)
        face, local = nearest_on_triangles(self.vertices, self.faces, queries)
        values: Floats = np.einsum("nc,nck->nk", local, self.values[self.faces[face]])
        return values[:, 0] if self.channels == 1 else values

    def discretization(self) -> dict[str, Any]:
        """Return how the scene was discretised, as plain values."""
        return {"backend": "fem", "degree": 1}

    def make_display_mesh(self) -> DisplayMesh:
        """Return the triangulation with the solution at its vertices."""
        from cpmkit.plugin import DisplayMesh, vertex_normals

        normals = vertex_normals(self.vertices, self.faces) if self.scene.surface.dim == 3 else None
        return DisplayMesh(self.vertices, self.faces, self.values, normals, len(self.vertices))

    def __repr__(self) -> str:
        return (
            f"FemSolution of {self.scene.problem.kind} on {len(self.vertices)} vertices and {len(self.faces)} faces, "
            f"channels {self.channels}; {self.report.solver}: {self.report.reason}; {len(self.warnings)} warnings"
        )

    def _check_side(self, side: Side | Mapping[str, Side] | None) -> None:
        names = [boundary.name for boundary in self.scene.boundaries]
        wanted = side if isinstance(side, Mapping) else {name: side for name in names if side is not None}
        for name, one in wanted.items():
            if name not in names or one not in ("left", "right"):
                raise InputError(
                    f"side must be 'left' or 'right' of one of the boundaries {names}, got {one!r} of {name!r}."
                )
