"""Meshes and point clouds of other libraries as surfaces, recognised by attributes without importing the library."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.plugins import source
from cpmkit.runtime.arrays import as_points
from cpmkit.scene.data import is_sequence


@runtime_checkable
class HasFaces(Protocol):
    """A mesh with vertices and faces, such as ``trimesh.Trimesh``."""

    @property
    def vertices(self) -> Any:
        """Coordinates (n, 3) of the vertices."""

    @property
    def faces(self) -> Any:
        """Numbers (m, 3) of the vertices of each face."""


#: Values that a scene accepts as its surface.
Surface = ClosestPointSource | HasFaces | tuple[Any, Any]


def as_source(mesh: Any) -> Any:
    """Return the closest-point source of a mesh or point cloud of another library, or of a pair (vertices, faces).

    Accepted are meshes of trimesh, pyvista, open3d, meshio and scikit-fem, and objects with a pair of attributes for
    vertices (n, 3) and faces (m, 3), as in LaPy, psbody, code for libigl, nilearn and SciPy's Delaunay. Any other value
    is returned unchanged.

    Raises
    ------
    InputError
        If a mesh has solids or other cells that are not accepted, such as a PolyData with lines, or no faces, or its
        faces name vertices wrongly.
    """
    if callable(getattr(mesh, "closest_point", None)):
        return mesh
    if is_sequence(mesh) and len(mesh) == 2:
        return _mesh_source(*mesh)
    if hasattr(mesh, "vertex") and hasattr(mesh, "triangle"):  # tensor meshes of open3d
        return _mesh_source(mesh.vertex.positions.numpy(), mesh.triangle.indices.numpy())
    if hasattr(mesh, "n_points") and hasattr(mesh, "n_lines"):  # surfaces of pyvista
        return _poly_data_source(mesh)
    if hasattr(mesh, "n_points") and (hasattr(mesh, "celltypes") or hasattr(mesh, "dimensions")):  # grids of pyvista
        return _mesh_source(np.asarray(mesh.points), faces_of_grid(mesh))
    if hasattr(mesh, "points") and hasattr(mesh, "cells_dict"):  # meshio
        return _mesh_source(mesh.points, faces_of_cells([(block.type, block.data) for block in mesh.cells]))
    if hasattr(mesh, "p") and hasattr(mesh, "t"):  # scikit-fem
        return _mesh_source(np.transpose(mesh.p), _triangles(mesh, np.transpose(mesh.t)))
    pairs = ("vertices faces", "vertices triangles", "v t", "v f", "V F", "coordinates faces", "points simplices")
    for vertices, faces in map(str.split, pairs):
        if hasattr(mesh, vertices) and hasattr(mesh, faces):
            cells = np.asarray(getattr(mesh, faces))
            return _mesh_source(getattr(mesh, vertices), cells if vertices == "vertices" else _triangles(mesh, cells))
    if hasattr(mesh, "vertices") or hasattr(mesh, "points"):  # clouds of trimesh and open3d
        points = mesh.vertices if hasattr(mesh, "vertices") else mesh.points
        return _cloud_source(np.asarray(points), getattr(mesh, "normals", None))
    return mesh


def _triangles(mesh: Any, cells: Any) -> Any:
    """Return ``cells`` unchanged if they are triangles (m, 3); ``mesh``, which contains them, is for messages.

    Raises SceneError if the cells do not have three corners, so that they may be solids.
    """
    if cells.ndim != 2 or cells.shape[1] != 3:
        raise SceneError(
            f"the surface is a {type(mesh).__name__} with cells of shape {cells.shape}, and triangles (m, 3) are "
            "accepted; give the vertices and faces of a surface as a pair of arrays."
        )
    return cells


def _poly_data_source(mesh: Any) -> ClosestPointSource:
    """Return the source of a pyvista PolyData: of its polygons, or of its points as a cloud if it has no polygons.

    Raises SceneError if it has lines.
    """
    if int(mesh.n_lines):
        raise SceneError(
            "the surface is a PolyData with lines; give its points to ck.source('mesh.polyline', points=...)."
        )
    flat = np.asarray(mesh.triangulate().faces)
    if len(flat):
        return _mesh_source(np.asarray(mesh.points), flat.reshape(-1, 4)[:, 1:])
    return _cloud_source(np.asarray(mesh.points), mesh.point_data.get("Normals"))


def _mesh_source(vertices: Any, faces: Any) -> ClosestPointSource:
    """Return the source of a mesh with ``vertices`` (n, 3); ``faces`` (m, k), or lists, are numbers of vertices."""
    return source("mesh.triangles", vertices=as_points(vertices, 3, "vertices"), faces=faces)


def _cloud_source(points: Any, normals: Any) -> ClosestPointSource:
    """Return the source of a point cloud (n, 3), with ``normals`` if they are an array of the same shape."""
    vectors = None if normals is None else np.asarray(normals, dtype=np.float64)
    keywords = {} if vectors is None or vectors.shape != np.shape(points) else {"normals": vectors}
    return source("pointcloud.points", points=np.asarray(points, dtype=np.float64), **keywords)


def faces_of_cells(blocks: Sequence[tuple[str, Any]]) -> Any:
    """Return the faces, by vertex numbers, in blocks (kind, cells (m, k)) of meshio.

    The result is an array (faces, k) if all faces have k corners, else a list of lists. Kinds of lower dimension, which
    mark parts of meshes, are ignored. Raises SceneError if a block has solids or curved cells, or none has faces.
    """
    faces = [np.asarray(cells) for kind, cells in blocks if kind in ("triangle", "quad", "polygon") and len(cells)]
    accepted = {"triangle", "quad", "polygon", "vertex", "line", "line3", "polyline"}
    _check_faces(sorted({kind for kind, _ in blocks} - accepted), bool(faces))
    if len({cells.shape[1:] for cells in faces}) == 1:
        return np.concatenate(faces)
    return [face for cells in faces for face in cells.tolist()]


def faces_of_grid(grid: Any) -> Any:
    """Return the cells of a two-dimensional pyvista grid as faces, by point numbers.

    The result is an array (m, k) if all faces have k corners, else a list of lists. Raises SceneError if the grid has
    solids or curved cells, or no faces.
    """
    if not hasattr(grid, "celltypes"):  # a structured grid
        grid = grid.cast_to_unstructured_grid()
    kinds = np.asarray(grid.celltypes)
    start = np.asarray(grid.cell_offsets if hasattr(grid, "cell_offsets") else grid.offset)  # in older versions
    corners = np.array(grid.cell_connectivity)
    pixel = 8  # of VTK: a quad with its last two corners exchanged
    rows = np.flatnonzero(np.isin(kinds, (5, 7, 9, pixel)))  # triangles, polygons, quads
    others = np.unique(kinds[~np.isin(kinds, (5, 7, 9, pixel, 1, 2, 3, 4))])  # vertices and lines are ignored
    _check_faces([f"number {kind} of VTK" for kind in others], len(rows) > 0)
    third = start[:-1][kinds == pixel] + 2
    corners[third], corners[third + 1] = corners[third + 1], corners[third]
    counts = np.diff(start)[rows]
    if (counts == counts[0]).all():
        return corners[start[rows, None] + np.arange(counts[0])]
    cells = np.split(corners, start[1:-1])
    return [cells[row].tolist() for row in rows]


def _check_faces(others: Sequence[str], any_faces: bool) -> None:
    """Raise SceneError unless ``any_faces`` is True and ``others``, the kinds of cells but faces, is empty."""
    if others or not any_faces:
        raise SceneError(
            f"the surface is a mesh with {'cells of the kinds ' + ', '.join(others) if others else 'no faces'}; "
            "accepted are triangles, quads and polygons; give the vertices and faces of its surface as a pair of "
            "arrays."
        )
