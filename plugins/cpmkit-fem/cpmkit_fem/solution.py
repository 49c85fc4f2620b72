"""A solution on a triangulation: read it anywhere, save it, draw it, as any other."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.arrays import as_points
from cpmkit.errors import InputError
from cpmkit.protocols import Floats, Ints, Side
from cpmkit.scene import Scene
from cpmkit.solvers.report import SolveReport
from cpmkit_fem.location import nearest_on_triangles

if TYPE_CHECKING:
    from cpmkit.surface_mesh import DisplayMesh
    from cpmkit.view import Picture


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
class FemSolution:
    """The solution of a scene by linear finite elements.

    Attributes
    ----------
    scene : Scene
        What was solved.
    vertices : (v, d) float64
        Of the triangulation, in the scene's coordinates.
    faces : (m, 3) int64
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
    """

    scene: Scene
    vertices: Floats
    faces: Ints
    values: Floats
    report: SolveReport
    work: FemWork
    seconds: Mapping[str, float]
    warnings: tuple[str, ...] = ()

    @property
    def spacing(self) -> float:
        """The mean length of a triangle's side."""
        corners = self.vertices[self.faces]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())

    @property
    def channels(self) -> int:
        """Number of right-hand sides that were solved together."""
        return int(self.values.shape[1])

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

    def save(self, path: str | Path) -> None:
        """Write the solution to ``path``; the suffix decides: .vtp, .ply, .npz, or .json for the summary."""
        from cpmkit.export import save

        save(self, path)  # type: ignore[arg-type]  # it offers all of a Solution that files need

    def picture(self, path: str | Path, **options: Any) -> Picture:
        """Draw the solution into the PNG ``path``; see :func:`cpmkit.view.picture`."""
        from cpmkit.view import picture

        return picture(self, path, **options)  # type: ignore[arg-type]  # likewise

    def display_mesh(self) -> DisplayMesh:
        """Return the triangulation with the solution at its vertices."""
        from cpmkit.surface_mesh import DisplayMesh, vertex_normals

        normals = vertex_normals(self.vertices, self.faces) if self.scene.surface.dim == 3 else None
        return DisplayMesh(self.vertices, self.faces, self.values, normals, len(self.vertices))

    def arrays(self) -> dict[str, Any]:
        """Return the arrays that belong to a lattice: none."""
        return {}

    def summary(self) -> dict[str, Any]:
        """Return what was solved, what it cost and what it reached, as plain values."""
        surface, problem = self.scene.surface, self.scene.problem
        return {
            "scene": {
                "surface": type(surface).__name__,
                "dim": surface.dim,
                "manifold_dim": surface.manifold_dim,
                "problem": {"kind": problem.kind, "c": problem.c},
                "boundaries": [{"name": boundary.name} for boundary in self.scene.boundaries],
            },
            "discretization": {"backend": "fem", "spacing": self.spacing, "degree": 1, "channels": self.channels},
            "report": self.report.as_dict(),
            "work": self.work.as_dict(),
            "seconds": dict(self.seconds),
            "warnings": list(self.warnings),
            "versions": {
                "python": platform.python_version(),
                **{name: version(name) for name in ("cpmkit", "cpmkit-fem", "scikit-fem", "numpy", "scipy")},
            },
        }

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
