"""Points at which errors are measured: of any manifold, without a mesh of it, or the vertices of one that is a mesh."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.protocols import ClosestPointSource, Floats, HasMesh
from cpmkit.scene.scene import Scene

#: In place of a number of points: the vertices of the mesh that the surface is.
VERTICES_WORD = "vertices"
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
