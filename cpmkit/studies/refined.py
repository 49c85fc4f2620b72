"""Finite elements on a refined mesh, for studies to compare with: edges are halved, feet of new vertices taken."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from cpmkit.facade import Solution
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.mesh.mixed_cells import mesh_of, refine_mixed_cells
from cpmkit.scene.scene import Scene
from cpmkit.solving import for_any_backend, solve
from cpmkit.types import Floats, Ints, Progress, no_progress


@dataclass(frozen=True, eq=False)
class RefinedMesh:
    """A surface whose mesh has no edge longer than the spacing; in all else the surface ``of``.

    New vertices are closest points: of a surface that is itself a mesh they lie on its flat triangles, so that what its
    flatness leaves of an error is left.

    Attributes
    ----------
    of : ClosestPointSource
        With a mesh of its own.
    """

    of: ClosestPointSource

    def __reduce__(self) -> Any:
        return refined_mesh, (self.of,)

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices (v, d), those that were added being closest points, and triangles (m, 3)."""
        points, cells = mesh_of(self.of)(spacing)
        refined, cells = refine_mixed_cells(points, cells, points.shape[1], spacing)
        refined[len(points) :] = self.of.closest_point(refined[len(points) :]).points
        return refined, cells


def refined_mesh(of: ClosestPointSource) -> RefinedMesh:
    """Return a surface with its mesh refined, which can do all that ``of`` can."""
    return _class_for(type(of))(of)


@cache
def _class_for(kind: type) -> type[RefinedMesh]:
    """Return the class with the public names of another one: what a source can do is told by its class."""
    names = {*dir(kind), *getattr(kind, "__dataclass_fields__", ())} - {*dir(RefinedMesh), "of"}
    passed = {name: _passed_on(name) for name in names if not name.startswith("_")}
    return type(RefinedMesh.__name__, (RefinedMesh,), passed)


def _passed_on(name: str) -> property:
    return property(lambda self: getattr(self.of, name))


def solve_on_refined_mesh(
    scene: Scene, spacing: float, *, progress: Progress = no_progress, **options: Any
) -> Solution:
    """Solve a scene by finite elements on its surface's mesh, refined until no edge is longer than ``spacing``.

    Raises
    ------
    CpmkitError
        As the back end ``fem`` does, and if the surface has no mesh.
    """
    surface: Any = refined_mesh(scene.surface)
    refined = replace(scene, surface=surface)
    return solve(refined, spacing, backend="fem", progress=progress, **for_any_backend(options))
