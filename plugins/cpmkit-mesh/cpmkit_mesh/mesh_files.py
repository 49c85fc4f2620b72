"""Triangle meshes from files and arrays: read, checked, and welded where corners were split."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints, check_size, existing_file, read_bytes, shown
from cpmkit_mesh.polygons import Polygons, as_polygons, triangulate

MESH_SUFFIXES = (".obj", ".ply", ".stl", ".off")


def read_mesh(path: str | Path) -> tuple[Floats, Ints]:
    """Read a triangle mesh and weld vertices that lie at exactly the same place.

    Vertices keep the order of the file. Readers that split corners by their texture coordinates or
    normals, and formats that store triangles one by one, would otherwise leave every edge open. A file is read as it
    is written, or refused: every vertex, every face, and nothing from other files that it names.

    Parameters
    ----------
    path : str or Path
        An OBJ, PLY, STL or OFF file; polygons are cut into triangles.

    Returns
    -------
    vertices : (n, 3) float64
        Distinct positions.
    faces : (m, 3) int64
        The vertices of each triangle.

    Raises
    ------
    InputError
        If the file is missing, is of another format, is damaged or cut off, holds no face, does not fit into memory, or
        has a polygon that crosses itself or a face with a vertex that is not finite or too large.
    """
    file = existing_file(path)
    if file.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(
            f"{shown(file.name)} is not a mesh file that can be read; accepted are {', '.join(MESH_SUFFIXES)}."
        )
    vertices, polygons = _read_polygons(file)
    if not len(vertices) or not len(polygons.counts):
        raise InputError(
            f"{shown(file.name)} holds {len(vertices)} vertices and {len(polygons.counts)} faces; a surface needs some."
        )
    try:
        vertices, faces = as_mesh(vertices, triangulate(vertices, polygons))
    except InputError as error:
        raise InputError(f"{shown(file.name)}: {error}") from error
    first, place = group_equal_rows(vertices)
    return vertices[first], place[faces]


def _read_polygons(file: Path) -> tuple[Floats, Polygons]:
    """Return the vertices (n, 3) and the polygons of ``file`` as they are stored, unchecked.

    Raise InputError if it cannot be read, does not parse by its suffix, or does not fit into memory.
    """
    from cpmkit_mesh.mesh_formats import read_off, read_ply_mesh, read_stl
    from cpmkit_mesh.obj import read_obj

    suffix = file.suffix.lower()
    reader = {".obj": read_obj, ".ply": read_ply_mesh, ".stl": read_stl, ".off": read_off}[suffix]
    try:
        return reader(read_bytes(file))
    except OSError as error:
        raise InputError(f"{shown(file.name)} cannot be read: {error.strerror or error}.") from error
    except MemoryError as error:
        raise InputError(f"{shown(file.name)} does not fit into the memory that is left.") from error
    except InputError as error:
        raise InputError(f"{shown(file.name)} does not parse as {suffix[1:].upper()}: {error}") from error


def as_mesh(vertices: Any, faces: Any) -> tuple[Floats, Ints]:
    """Return vertices (n, 3) and triangles (m, 3) of a mesh given by ``vertices`` (n, 3) or (n, 2), then z = 0.

    ``faces`` are (m, c) or sequences of vertex numbers; faces of more than three corners are cut into triangles. Raise
    InputError if a shape or type is wrong, there are no vertices or no faces, a face has a vertex number out of range,
    crosses itself, or uses a vertex that is not finite or too large.
    """
    points = as_numbers(vertices, "vertices")
    if points.ndim != 2 or points.shape[1] not in (2, 3) or not len(points):
        raise InputError(f"vertices must have shape (n, 3) or (n, 2) with n > 0, got {points.shape}.")
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    polygons = as_polygons(faces)
    low, high = int(polygons.corners.min()), int(polygons.corners.max())
    if low < 0 or high >= len(points):
        raise InputError(f"faces must name vertices from 0 to {len(points) - 1}, got indices from {low} to {high}.")
    points = np.ascontiguousarray(points, dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    bad = bad[np.isin(bad, polygons.corners)]
    if len(bad):
        raise InputError(
            f"vertices must be finite: {len(bad)} of {len(points)} that faces use hold NaN or infinity, first {bad[0]}."
        )
    check_size(points[polygons.corners], "vertices")
    return points, triangulate(points, polygons)


def as_numbers(values: Any, name: str) -> np.ndarray:
    """Return ``values`` as an array of whole or floating numbers; raise InputError naming the key ``name`` if not."""
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InputError(f"{name} must be an array of numbers in rows of equal length.") from error
    if array.dtype.kind not in "iuf":
        raise InputError(f"{name} must be an array of numbers, got {array.dtype}.")
    return array


def group_equal_rows(points: Floats | Ints) -> tuple[Ints, Ints]:
    """Find groups of equal rows among ``points`` (n, d).

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


def distinct_faces(faces: Ints) -> Ints:
    """Return (k,) ascending row numbers of ``faces`` (m, 3): three different vertices, not those of an earlier face."""
    proper = np.flatnonzero((faces != np.roll(faces, 1, axis=1)).all(axis=1))
    return proper[group_equal_rows(np.sort(faces[proper], axis=1))[0]] if len(proper) else proper
