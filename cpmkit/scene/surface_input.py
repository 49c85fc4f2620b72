"""Meshes and clouds of other libraries in place of sources: told by what they have, and none of them imported."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.plugins import source
from cpmkit.protocols import ClosestPointSource, Ints

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


#: Kinds of cells that are faces, and those of lower dimension, which mark parts of meshes and are passed over.
FACE_KINDS = frozenset(("triangle", "quad", "polygon"))
PASSED_KINDS = frozenset(("vertex", "line", "line3", "polyline"))
#: The same by VTK's numbers: triangle, polygon, quad; vertices and lines.
FACE_NUMBERS = (5, 7, 9)
PASSED_NUMBERS = (1, 2, 3, 4)
#: VTK's pixel, a quad whose last corners stand the other way round.
PIXEL_NUMBER = 8


def faces_of_cells(blocks: Sequence[tuple[str, Any]]) -> Any:
    """Return the faces of blocks of cells, each with meshio's name of its kind.

    Raises
    ------
    SceneError
        If a block holds solids or curved cells, or none holds faces.
    """
    others = sorted({kind for kind, _ in blocks} - FACE_KINDS - PASSED_KINDS)
    _check_faces(others, any(kind in FACE_KINDS and len(cells) for kind, cells in blocks))
    faces = [np.asarray(cells) for kind, cells in blocks if kind in FACE_KINDS and len(cells)]
    if len({cells.shape[1:] for cells in faces}) == 1:
        return np.concatenate(faces)
    return [face for cells in faces for face in cells.tolist()]


def faces_of_grid(grid: Any) -> Any:
    """Return the faces of a pyvista grid of two dimensions: its own cells, between its own points in their order.

    Raises
    ------
    SceneError
        If it has solids or curved cells, or no faces.
    """
    if not hasattr(grid, "celltypes"):
        return _structured_faces(grid)
    kinds = np.asarray(grid.celltypes)
    start = np.asarray(grid.cell_offsets if hasattr(grid, "cell_offsets") else grid.offset)  # by its former name
    corners = np.array(grid.cell_connectivity)
    rows = np.flatnonzero(np.isin(kinds, (*FACE_NUMBERS, PIXEL_NUMBER)))
    others = np.unique(kinds[~np.isin(kinds, (*FACE_NUMBERS, PIXEL_NUMBER, *PASSED_NUMBERS))])
    _check_faces([f"number {kind} of VTK" for kind in others], len(rows) > 0)
    third = start[:-1][kinds == PIXEL_NUMBER] + 2
    corners[third], corners[third + 1] = corners[third + 1], corners[third]
    counts = np.diff(start)[rows]
    if (counts == counts[0]).all():
        return corners[start[rows, None] + np.arange(counts[0])]
    cells = np.split(corners, start[1:-1])
    return [cells[row].tolist() for row in rows]


def _structured_faces(grid: Any) -> Ints:
    """Return the quads (m, 4) of a grid whose points are numbered along its first dimension first."""
    sizes = [int(size) for size in grid.dimensions if size > 1]
    if len(sizes) != 2:
        raise SceneError(
            f"the surface is a {type(grid).__name__} of {shown(tuple(grid.dimensions))} points, and one with two "
            "dimensions is accepted; give its surface, vertices and faces."
        )
    first = np.arange(sizes[0] - 1) + sizes[0] * np.arange(sizes[1] - 1)[:, None]
    corner = first.ravel()
    return np.stack([corner, corner + 1, corner + 1 + sizes[0], corner + sizes[0]], axis=1)


def _check_faces(others: Sequence[str], any_faces: bool) -> None:
    if others or not any_faces:
        raise SceneError(
            f"the surface is a mesh with {'cells of the kinds ' + ', '.join(others) if others else 'no faces'}; "
            "accepted are triangles, quads and polygons; give the vertices and faces of its surface as a pair of "
            "arrays."
        )
