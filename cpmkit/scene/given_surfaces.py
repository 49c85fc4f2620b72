"""Meshes and clouds of other libraries in place of sources: told by what they have, and none of them imported."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.plugins import source
from cpmkit.protocols import ClosestPointSource
from cpmkit.scene.given_cells import faces_of_cells, faces_of_grid

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


#: Under which names objects of other libraries hold vertices (n, 3) and faces (m, 3): trimesh, open3d, LaPy, psbody,
#: libigl's habit, nilearn and SciPy's Delaunay.
NAMES_OF_ARRAYS = (
    ("vertices", "faces"),
    ("vertices", "triangles"),
    ("v", "t"),
    ("v", "f"),
    ("V", "F"),
    ("coordinates", "faces"),
    ("points", "simplices"),
)
#: What a scene takes for its surface.
Surface = ClosestPointSource | HasFaces | tuple[Any, Any]


def as_source(given: Any) -> Any:
    """Return the source of a mesh or cloud of another library, or of (vertices, faces).

    Accepted are meshes of trimesh, pyvista, open3d and meshio, objects that hold vertices and faces by one of the pairs
    of names in ``NAMES_OF_ARRAYS``, and those of scikit-fem, whose arrays are transposed. Anything else is returned as
    it is.

    Raises
    ------
    SceneError
        If it is such a mesh, and has neither faces nor points alone, or has cells that are no faces.
    """
    if callable(getattr(given, "closest_point", None)):
        return given
    if isinstance(given, (tuple, list)) and len(given) == 2:
        return _mesh(*given)
    if hasattr(given, "vertex") and hasattr(given, "triangle"):  # open3d's tensors
        return _mesh(given.vertex.positions.numpy(), given.triangle.indices.numpy())
    if hasattr(given, "n_points") and hasattr(given, "n_lines"):  # pyvista's surfaces
        return _poly_data(given)
    if hasattr(given, "n_points") and (hasattr(given, "celltypes") or hasattr(given, "dimensions")):  # its grids
        return _mesh(np.asarray(given.points), faces_of_grid(given))
    if hasattr(given, "points") and hasattr(given, "cells_dict"):  # meshio
        return _mesh(given.points, faces_of_cells([(block.type, block.data) for block in given.cells]))
    if hasattr(given, "p") and hasattr(given, "t"):  # scikit-fem
        return _mesh(np.transpose(given.p), _triangles_of(given, np.transpose(given.t)))
    for vertices, faces in NAMES_OF_ARRAYS:
        if hasattr(given, vertices) and hasattr(given, faces):
            cells = np.asarray(getattr(given, faces))
            return _mesh(getattr(given, vertices), cells if vertices == "vertices" else _triangles_of(given, cells))
    if hasattr(given, "vertices") or hasattr(given, "points"):  # clouds of trimesh and open3d
        points = given.vertices if hasattr(given, "vertices") else given.points
        return _cloud(np.asarray(points), getattr(given, "normals", None))
    return given


def _triangles_of(given: Any, cells: Any) -> Any:
    """Return the cells if they are triangles.

    Raises
    ------
    SceneError
        If they have other than three corners: they may be solids.
    """
    if cells.ndim != 2 or cells.shape[1] != 3:
        raise SceneError(
            f"the surface is a {type(given).__name__} with cells of shape {cells.shape}, and triangles (m, 3) are "
            "accepted; give the vertices and faces of a surface as a pair of arrays."
        )
    return cells


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
    return source(MESH_KIND, vertices=np.asarray(vertices, dtype=np.float64), faces=faces)


def _cloud(points: Any, normals: Any) -> ClosestPointSource:
    given = None if normals is None else np.asarray(normals, dtype=np.float64)
    known = {} if given is None or given.shape != np.shape(points) else {"normals": given}
    return source(CLOUD_KIND, points=np.asarray(points, dtype=np.float64), **known)
