"""Reference values of a study at sample points: from a formula, or from the solution of another back end."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.facade import Solution
from cpmkit.manifold.abilities import HasMesh
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.mesh.mixed_cells import mesh_of, refine_mixed_cells
from cpmkit.runtime.messages import collected_warnings
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.scene import Scene
from cpmkit.solving import for_any_backend, solve
from cpmkit.studies.checking import check_comparable, end_of
from cpmkit.studies.studyfile import VERTICES_WORD, Study
from cpmkit.types import Floats, Ints, Progress, no_progress

SAMPLING_SEED = 7
#: Points nearer to a boundary than this share of the surface's size are left out, since data may jump there.
CLEAR_OF_BOUNDARIES_SHARE = 1e-6
#: The box of random points exceeds the surface's bounds by this share of its size on each side.
BOX_MARGIN_SHARE = 0.1


def sample_points(scene: Scene, wanted: int | str) -> Floats:
    """Return sample points (n, d) of the surface, off all boundaries, the same at every call.

    Parameters
    ----------
    scene : Scene
    wanted : int or "vertices"
        Number of random points in a box around the surface, whose closest points are the samples; or the vertices of
        a surface that is a mesh.

    Raises
    ------
    SceneError
        If vertices are requested of a surface that is no mesh.
    """
    surface = scene.surface
    bounds = np.asarray(surface.bounds, dtype=np.float64)
    size = float((bounds[1] - bounds[0]).max())
    if isinstance(wanted, str):
        points = _vertices(surface, size)
    else:
        lower, upper = bounds[0] - BOX_MARGIN_SHARE * size, bounds[1] + BOX_MARGIN_SHARE * size
        queries = np.random.default_rng(SAMPLING_SEED).uniform(lower, upper, (wanted, surface.dim))
        points = surface.closest_point(queries).points
    for boundary in scene.boundaries:
        points = points[boundary.source.closest_point(points).distance > CLEAR_OF_BOUNDARIES_SHARE * size]
    return np.ascontiguousarray(points)


def _vertices(surface: ClosestPointSource, size: float) -> Floats:
    """Return the vertices (n, d) of a surface whose mesh is the same at every spacing; raise SceneError for others."""
    if isinstance(surface, HasMesh):
        (vertices, _), (finer, _) = surface.mesh(size / 4), surface.mesh(size / 8)
        if np.array_equal(vertices, finer):
            return vertices
    raise SceneError(
        f"points = {VERTICES_WORD!r} of [exact] needs a surface that is a mesh, such as mesh.triangles, got "
        f"{type(surface).__name__}; give a number of points."
    )


@dataclass(frozen=True, eq=False)
class Reference:
    """Reference values of the runs of a study.

    Attributes
    ----------
    points : (n, d) float64
        Points of the surface, none on a boundary.
    values : (n,) float64
        The solution there, at the final time of problems in time.
    """

    points: Floats
    values: Floats

    @property
    def half_range(self) -> float:
        """Half the difference of the largest and the smallest value."""
        return float(np.ptp(self.values) / 2)


def reference_of(study: Study) -> Reference:
    """Return the reference values of a study, from its formula or from one solution of another back end.

    Raises
    ------
    SceneError
        If the scene has several channels or eigenvalues, or vertices are requested of a surface that is no mesh.
    CpmkitError
        If the formula has no value somewhere, or the reference cannot solve the scene.
    """
    scene = study.scene
    check_comparable(scene)
    points = sample_points(scene, study.exact.points)
    if not len(points):
        raise SceneError(
            f"none of the points of [exact], {study.exact.points!r}, lies off the boundaries; ask for more."
        )
    if study.solution is not None:
        return Reference(points, evaluate_data(study.solution, points, 1, "u of [exact]", end_of(scene))[:, 0])
    assert study.exact.reference is not None
    with collected_warnings():
        solution = solve(scene, backend=study.exact.reference, **for_any_backend(study.options))
    return Reference(points, solution.evaluate(points))


@dataclass(frozen=True, eq=False)
class RefinedMesh:
    """A surface with a mesh that is refined until no edge is longer than the spacing.

    New vertices are closest points. If the surface is itself a mesh, they lie on its flat triangles, whose distance
    from a smooth surface remains.

    Attributes
    ----------
    of : ClosestPointSource
        A surface with a mesh.
    """

    of: ClosestPointSource

    def __reduce__(self) -> Any:
        return refined_mesh, (self.of,)

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices (v, d) and cells (m, k) of the surface's mesh with no edge longer than ``spacing``.

        The mesh's own vertices come first, then the added vertices, moved to their closest points.
        """
        points, cells = mesh_of(self.of)(spacing)
        refined, cells = refine_mixed_cells(points, cells, points.shape[1], spacing)
        refined[len(points) :] = self.of.closest_point(refined[len(points) :]).points
        return refined, cells


def refined_mesh(of: ClosestPointSource) -> RefinedMesh:
    """Return a surface with a refined mesh, and with all further attributes and methods of ``of``."""
    return _class_for(type(of))(of)


@cache
def _class_for(kind: type) -> type[RefinedMesh]:
    """Return a subclass of RefinedMesh with the public attributes of class ``kind``, each read from the surface.

    Which abilities a source has is judged by the attributes of its class.
    """
    names = {*dir(kind), *getattr(kind, "__dataclass_fields__", ())} - {*dir(RefinedMesh), "of"}
    passed = {name: _forwarding_property(name) for name in names if not name.startswith("_")}
    return type(RefinedMesh.__name__, (RefinedMesh,), passed)


def _forwarding_property(name: str) -> property:
    """Return a property that reads the attribute ``name`` of the surface."""
    return property(lambda self: getattr(self.of, name))


def solve_on_refined_mesh(
    scene: Scene, spacing: float, *, progress: Progress = no_progress, **options: Any
) -> Solution:
    """Solve a scene by finite elements on its surface's mesh, refined until no edge is longer than ``spacing``.

    Raises
    ------
    CpmkitError
        If the back end ``fem`` raises it, or the surface has no mesh.
    """
    surface: Any = refined_mesh(scene.surface)
    refined = replace(scene, surface=surface)
    return solve(refined, spacing, backend="fem", progress=progress, **for_any_backend(options))
