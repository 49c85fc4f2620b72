"""Faces of meshes that mix kinds of cells: of meshio, and of pyvista's structured and unstructured grids."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.protocols import Ints

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
