"""Meshes and clouds of other libraries in place of sources: told by what they have, and none of them imported."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.plugins import source
from cpmkit.protocols import ClosestPointSource

#: The kinds that are made of them.
MESH_KIND, CLOUD_KIND = "mesh.triangles", "pointcloud.points"


@runtime_checkable
class HasFaces(Protocol):
    """A mesh by its vertices and faces, such as ``trimesh.Trimesh``."""

    @property
    def vertices(self) -> Any:
        """(n, 3) coordinates."""

    @property
    def faces(self) -> Any:
        """(m, 3) numbers of vertices."""


#: What a scene takes for its surface.
Surface = ClosestPointSource | HasFaces | tuple[Any, Any]


def as_source(given: Any) -> Any:
    """Return the source of a mesh or cloud of trimesh, pyvista, open3d or meshio, or of (vertices, faces).

    Anything else is returned as it is.

    Raises
    ------
    SceneError
        If it is such a mesh, and has neither triangles nor points alone.
    """
    if callable(getattr(given, "closest_point", None)):
        return given
    if isinstance(given, (tuple, list)) and len(given) == 2:
        return _mesh(*given)
    if hasattr(given, "vertices") and hasattr(given, "faces"):  # trimesh
        return _mesh(given.vertices, given.faces)
    if hasattr(given, "vertices") and hasattr(given, "triangles"):  # open3d
        return _mesh(np.asarray(given.vertices), np.asarray(given.triangles))
    if hasattr(given, "vertex") and hasattr(given, "triangle"):  # open3d's tensors
        return _mesh(given.vertex.positions.numpy(), given.triangle.indices.numpy())
    if hasattr(given, "n_points") and hasattr(given, "triangulate"):  # pyvista
        return _poly_data(given)
    if hasattr(given, "points") and hasattr(given, "cells_dict"):  # meshio
        return _mesh(given.points, given.cells_dict.get("triangle", np.zeros((0, 3))))
    if hasattr(given, "vertices") or hasattr(given, "points"):  # clouds of trimesh and open3d
        points = given.vertices if hasattr(given, "vertices") else given.points
        return _cloud(np.asarray(points), getattr(given, "normals", None))
    return given


def _poly_data(given: Any) -> ClosestPointSource:
    """Return the source of a PolyData: a mesh where it has polygons, a cloud where it has points alone."""
    if int(given.n_lines):
        raise SceneError(
            "the surface is a PolyData with lines; give its points to ck.source('mesh.polyline', points=...)."
        )
    flat = np.asarray(given.triangulate().faces)
    if len(flat):
        return _mesh(np.asarray(given.points), flat.reshape(-1, 4)[:, 1:])
    return _cloud(np.asarray(given.points), given.point_data.get("Normals"))


def _mesh(vertices: Any, faces: Any) -> ClosestPointSource:
    return source(MESH_KIND, vertices=np.asarray(vertices, dtype=np.float64), faces=np.asarray(faces))


def _cloud(points: Any, normals: Any) -> ClosestPointSource:
    given = None if normals is None else np.asarray(normals, dtype=np.float64)
    known = {} if given is None or given.shape != np.shape(points) else {"normals": given}
    return source(CLOUD_KIND, points=np.asarray(points, dtype=np.float64), **known)
