"""Texture coordinates of OBJ files: what the corners of faces have beside their vertices."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints, existing_file, read_bytes, shown
from cpmkit_mesh.obj import from_zero, read_obj, split_lines
from cpmkit_mesh.polygons import Polygons, as_triangles
from cpmkit_mesh.text import floats_of, ints_of


def read_texture_coordinates(path: str | Path) -> tuple[Floats, Ints]:
    """Read the texture coordinates of an OBJ file, for the faces that :func:`read_mesh` returns.

    Parameters
    ----------
    path : str or Path
        An OBJ file whose faces have a texture vertex at each corner: ``f v/vt`` or ``f v/vt/vn``.

    Returns
    -------
    coordinates : (k, 2) float64
        u to the right and v upwards, as the file has them; a third coordinate is left out.
    corners : (m, 3) int64
        Those of the corners of each triangle, in the order of the triangles and corners of :func:`read_mesh`.

    Raises
    ------
    InputError
        If the file is none, is damaged, or a corner has no texture coordinates.
    """
    file = existing_file(path)
    if file.suffix.lower() != ".obj":
        raise InputError(f"texture coordinates are read from .obj files, got {shown(file.name)}.")
    try:
        data = read_bytes(file)
        vertices, polygons = read_obj(data)
        coordinates, of_corner = _texture(data)
        slots = Polygons(polygons.counts, np.arange(len(polygons.corners)))
        return coordinates, of_corner[as_triangles(vertices[polygons.corners], slots)]
    except OSError as error:
        raise InputError(f"{shown(file.name)} cannot be read: {error.strerror or error}.") from error
    except InputError as error:
        raise InputError(f"texture coordinates of {shown(file.name)}: {error}") from error


def _texture(data: bytes) -> tuple[Floats, Ints]:
    """Return the texture coordinates (k, 2) of a file, and which of them each corner of its faces has."""
    words_of, lines, corners, corner_lines, before = [], [], [], [], []
    for number, words in split_lines(data):
        if words[0] == "vt":
            if len(words) not in (3, 4):
                raise InputError(f"line {number} holds no texture vertex of two coordinates.")
            words_of += words[1:3]
            lines.append(number)
        elif words[0] in ("f", "fo"):
            for corner in words[1:]:
                parts = corner.split("/")
                if len(parts) < 2 or not parts[1]:
                    raise InputError(f"line {number} holds a face with a corner that has none; unwrap the whole mesh.")
                corners.append(parts[1])
                corner_lines.append(number)
                before.append(len(lines))
    at = np.array(corner_lines, dtype=np.int64)
    index = from_zero(ints_of(corners, at), np.array(before, dtype=np.int64), len(lines), at)
    return floats_of(words_of, 2, lines), index
