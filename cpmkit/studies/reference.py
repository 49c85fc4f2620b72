"""What the runs of a study are measured against: a formula, or the solution of another back end, at points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.manifold.abilities import HasMesh
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.runtime.messages import collected_warnings
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.scene import Scene
from cpmkit.solving import for_any_backend, solve
from cpmkit.studies.checking import check_comparable, end_of
from cpmkit.studies.studyfile import VERTICES_WORD, Study
from cpmkit.types import Floats

SAMPLING_SEED = 7
#: Points nearer to a boundary than this share of the size are left out: data may jump there.
CLEAR_OF_BOUNDARIES_SHARE = 1e-6
#: The box from which points are projected is larger than the bounds by this share on each side.
BOX_MARGIN_SHARE = 0.1


def sample_points(scene: Scene, wanted: int | str) -> Floats:
    """Return points (n, d) of the surface, none on a boundary, the same at every call.

    Parameters
    ----------
    scene : Scene
    wanted : int or "vertices"
        Up to so many closest points of points that lie evenly in a box around the surface; or the vertices of a
        surface that is a mesh.

    Raises
    ------
    SceneError
        If vertices are wanted of a surface that is no mesh.
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
    """Return the vertices (n, d) of a surface that answers each spacing with one and the same mesh: its own."""
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
    """What every run should give.

    Attributes
    ----------
    points : (n, d) float64
        Of the surface, none on a boundary.
    values : (n,) float64
        The solution there, at the end of the time where there is one.
    """

    points: Floats
    values: Floats

    @property
    def half_range(self) -> float:
        """Half the difference between the largest and the smallest value."""
        return float(np.ptp(self.values) / 2)


def reference_of(study: Study) -> Reference:
    """Return what a study's runs are measured against; a reference is solved, once, at its own resolution.

    Raises
    ------
    SceneError
        If the scene has several channels or seeks eigenvalues, or vertices are of a surface that is no mesh.
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
