"""Triangle meshes from files and arrays: read, checked, and welded where corners were split."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit.protocols import Floats, Ints

FORMATS = (".obj", ".ply", ".stl", ".off")


def existing_file(path: str | Path) -> Path:
    """Return ``path`` if it is a file.

    Raises
    ------
    InputError
        If it is not.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError(f"There is no file {str(file)!r}; give the path of an existing one.")
    return file


def read_mesh(path: str | Path) -> tuple[Floats, Ints]:
    """Read a triangle mesh and weld vertices that lie at exactly the same place.

    Vertices keep the order of the file. Readers that split corners by their texture coordinates or
    normals, and formats that store triangles one by one, would otherwise leave every edge open.

    Parameters
    ----------
    path : str or Path
        An OBJ, PLY, STL or OFF file; polygons are cut into triangles.

    Returns
    -------
    vertices : (n, 3) float64
    faces : (m, 3) int64

    Raises
    ------
    InputError
        If the file is missing, is of another format, does not parse, or holds no triangle.
    """
    file = existing_file(path)
    if file.suffix.lower() not in FORMATS:
        raise InputError(f"{file.name!r} is not a mesh file that can be read; accepted are {', '.join(FORMATS)}.")
    import trimesh

    try:
        mesh = trimesh.load_mesh(file, process=False, maintain_order=True)
        vertices = np.array(mesh.vertices, dtype=np.float64)
        faces = np.array(mesh.faces, dtype=np.int64)
    except Exception as error:
        raise InputError(f"{file.name!r} does not parse as {file.suffix[1:].upper()}: {error}") from error
    if not len(vertices) or not len(faces):
        raise InputError(f"{file.name!r} holds {len(vertices)} vertices and {len(faces)} faces; a surface needs some.")
    vertices, faces = as_mesh(vertices, faces)
    first, place = weld(vertices)
    return vertices[first], place[faces]


def as_mesh(vertices: Any, faces: Any) -> tuple[Floats, Ints]:
    """Return vertices (n, 3) and faces (m, 3) if they describe triangles in space.

    Raises
    ------
    InputError
        If a shape or type is wrong, there is none of either, or a face names a vertex that is
        not there or not finite.
    """
    points = as_numbers(vertices, "vertices")
    triangles = as_numbers(faces, "faces")
    if points.ndim != 2 or points.shape[1:] != (3,) or not len(points):
        raise InputError(f"vertices must have shape (n, 3) with n > 0, got {points.shape}.")
    if triangles.ndim != 2 or triangles.shape[1:] != (3,) or not len(triangles):
        raise InputError(
            f"faces must have shape (m, 3) with m > 0, got {triangles.shape}; cut polygons into triangles."
        )
    if not np.array_equal(triangles, np.floor(triangles)):
        raise InputError(f"faces must be whole numbers, indices of vertices, got {triangles.dtype}.")
    triangles = np.ascontiguousarray(triangles, dtype=np.int64)
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise InputError(
            f"faces must name vertices from 0 to {len(points) - 1}, "
            f"got indices from {triangles.min()} to {triangles.max()}."
        )
    points = np.ascontiguousarray(points, dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    bad = bad[np.isin(bad, triangles)]
    if len(bad):
        raise InputError(
            f"vertices must be finite: {len(bad)} of {len(points)} that faces use hold NaN or infinity, first {bad[0]}."
        )
    return points, triangles


def as_numbers(values: Any, what: str) -> np.ndarray:
    """Return ``values`` as an array of numbers.

    Raises
    ------
    InputError
        If they are anything else.
    """
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InputError(f"{what} must be an array of numbers in rows of equal length.") from error
    if array.dtype.kind not in "iuf":
        raise InputError(f"{what} must be an array of numbers, got {array.dtype}.")
    return array


def weld(points: Floats | Ints) -> tuple[Ints, Ints]:
    """Find points at exactly the same place.

    Returns
    -------
    first : (k,) int64
        The first point at each distinct place, in increasing order.
    place : (n,) int64
        For each point its place: ``points[first][place]`` equals ``points``.
    """
    order = np.lexsort(points.T)
    new = np.ones(len(points), dtype=bool)
    new[1:] = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    group = np.cumsum(new) - 1
    starts = np.flatnonzero(new)
    leader = np.minimum.reduceat(order, starts)
    rank = np.empty(len(starts), dtype=np.int64)
    rank[np.argsort(leader)] = np.arange(len(starts))
    place = np.empty(len(points), dtype=np.int64)
    place[order] = rank[group]
    return np.sort(leader), place
