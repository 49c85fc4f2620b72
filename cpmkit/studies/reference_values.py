"""Reference values of a study at sample points: from a formula, or from the solution of another back end."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
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
from cpmkit.studies.studyfile import Study
from cpmkit.types import Floats, Ints, Progress, no_progress


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
        meshes = [surface.mesh(size / edges)[0] for edges in (4, 8)] if isinstance(surface, HasMesh) else []
        if not meshes or not np.array_equal(meshes[0], meshes[1]):  # a mesh is the same at every spacing
            raise SceneError(
                "points = 'vertices' of [exact] needs a surface that is a mesh, such as mesh.triangles, got "
                f"{type(surface).__name__}; give a number of points."
            )
        points = meshes[0]
    else:
        lower, upper = bounds[0] - 0.1 * size, bounds[1] + 0.1 * size
        queries = np.random.default_rng(7).uniform(lower, upper, (wanted, surface.dim))
        points = surface.closest_point(queries).points
    for boundary in scene.boundaries:  # where data may jump
        points = points[boundary.source.closest_point(points).distance > 1e-6 * size]
    return np.ascontiguousarray(points)


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


def refined_mesh(surface: ClosestPointSource) -> ClosestPointSource:
    """Return a surface with a mesh that is refined until no edge is longer than the spacing, else equal to ``surface``.

    The mesh's own vertices come first. New vertices are closest points: if the surface is itself a mesh, they lie on
    its flat triangles, whose distance from a smooth surface remains.
    """
    make_mesh = mesh_of(surface)

    def mesh(self: Any, spacing: float) -> tuple[Floats, Ints]:
        points, cells = make_mesh(spacing)
        refined, cells = refine_mixed_cells(points, cells, points.shape[1], spacing)
        refined[len(points) :] = self.closest_point(refined[len(points) :]).points
        return refined, cells

    refined: ClosestPointSource = copy(surface)
    methods = {"mesh": mesh, "__reduce__": lambda _: (refined_mesh, (surface,))}
    object.__setattr__(refined, "__class__", type("RefinedMesh", (type(surface),), methods))
    return refined


def solve_on_refined_mesh(
    scene: Scene, spacing: float, *, progress: Progress = no_progress, **options: Any
) -> Solution:
    """Solve a scene by finite elements on its surface's mesh, refined until no edge is longer than ``spacing``.

    Raises
    ------
    CpmkitError
        If the back end ``fem`` raises it, or the surface has no mesh.
    """
    refined = replace(scene, surface=refined_mesh(scene.surface))
    return solve(refined, spacing, backend="fem", progress=progress, **for_any_backend(options))


def check_comparable(scene: Scene) -> None:
    """Raise if the solution of a scene is not a single function with one channel.

    Raises
    ------
    SceneError
        If the scene has several channels, or its solution is eigenfunctions, whose factors are arbitrary.
    """
    if scene.problem.family == "eigen":
        raise SceneError("a study compares one function, and an eigenvalue problem has many; solve it without [exact].")
    if scene.channels != 1:
        raise SceneError(f"a study compares one channel, and the scene has {scene.channels}; make a study of each.")


def end_of(scene: Scene) -> float | None:
    """Return the final time of the scene's problem, None if it has no time."""
    return getattr(scene.problem, "until", None)
