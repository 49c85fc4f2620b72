"""OBJ files: vertices, faces and texture coordinates; no other file that they name is read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints, existing_file, read_bytes, shown
from cpmkit_mesh.polygons import Polygons, triangulate
from cpmkit_mesh.text import parse_floats, parse_ints, text_lines

#: Words that begin a line which says nothing about the surface: names, normals, materials, points, lines, curves.
SKIPPED_WORDS = frozenset(
    ("vt", "vn", "vp", "g", "s", "mg", "o", "l", "p", "usemtl", "mtllib", "usemap", "maplib", "bevel", "c_interp")
    + ("d_interp", "lod", "shadow_obj", "trace_obj", "ctech", "stech", "cstype", "deg", "bmat", "step", "curv", "curv2")
    + ("parm", "trim", "hole", "scrv", "sp", "end", "con")
)
#: Words whose lines would be missed.
REFUSED_WORDS = {"surf": "a free-form surface", "call": "a call of another file", "csh": "a command"}
#: Words in a line of a vertex: v x y z, and further a weight, or a colour, or both.
VERTEX_LINE_WORDS = (4, 5, 7, 8)


def read_obj(data: bytes) -> tuple[Floats, Polygons]:
    """Return the vertices (n, 3) and the polygons in the bytes ``data`` of an OBJ file.

    Raise InputError if a line is damaged, names a vertex that is not there, or is of a kind that is not read.
    """
    coordinates: list[str] = []
    vertex_lines: list[int] = []
    corners: list[str] = []
    counts: list[int] = []
    face_lines: list[int] = []
    before: list[int] = []  # vertices before each face: negative numbers count from there
    for number, words in split_lines(data):
        word = words[0]
        if word == "v":
            if len(words) not in VERTEX_LINE_WORDS or (len(words) in (5, 8) and not _is_unit(words[4])):
                raise InputError(f"line {number} holds no vertex of three coordinates.")
            coordinates += words[1:4]
            vertex_lines.append(number)
        elif word in ("f", "fo"):
            if len(words) < 4:
                raise InputError(f"line {number} holds a face of {len(words) - 1} corners, and three are needed.")
            corners += [word.partition("/")[0] for word in words[1:]]
            counts.append(len(words) - 1)
            face_lines.append(number)
            before.append(len(vertex_lines))
        elif word not in SKIPPED_WORDS:
            raise InputError(f"line {number} begins with {REFUSED_WORDS.get(word, 'no word of the format')}.")
    size = np.array(counts, dtype=np.int64)
    lines = np.repeat(np.array(face_lines, dtype=np.int64), size)
    index = zero_based_numbers(parse_ints(corners, lines), np.repeat(before, size), len(vertex_lines), lines)
    return parse_floats(coordinates, 3, vertex_lines), Polygons(size, index)


def split_lines(data: bytes) -> list[tuple[int, list[str]]]:
    """Return the line number and the words of each nonempty line of an OBJ file; a backslash at its end joins the next.

    A joined line has the number of its last part; a last line that ends with a backslash has the number 0.
    """
    rows, joined = [], ""
    for number, line in enumerate(text_lines(data), 1):
        if line.endswith("\\"):
            joined += line[:-1] + " "
            continue
        words = (joined + line).split() if joined else line.split()
        joined = ""
        if words:
            rows.append((number, words))
    return [*rows, (0, joined.split())] if joined.strip() else rows


def _is_unit(word: str) -> bool:
    """Return whether ``word`` is the number 1, as the weight of a vertex must be."""
    try:
        return float(word) == 1.0
    except ValueError:
        return False


def zero_based_numbers(index: Ints, before: Ints, count: int, lines: Ints) -> Ints:
    """Return (n,) zero-based numbers of the vertices ``index`` (n,), counted from 1, or, negative, back from the last.

    The last is that before the line: ``before`` (n,) is the number of vertices up to there, ``count`` that of all,
    ``lines`` (n,) are line numbers. Raise InputError, which names the line, for 0 and numbers out of range.
    """
    zero = np.flatnonzero(index == 0)
    if len(zero):
        raise InputError(f"line {lines[zero[0]]} names vertex 0, and OBJ counts vertices from 1.")
    named = np.where(index > 0, index - 1, before + index)
    bad = np.flatnonzero((named < 0) | (named >= count))
    if len(bad):
        raise InputError(f"line {lines[bad[0]]} names vertex {index[bad[0]]}, and there are {count}.")
    return np.asarray(named, dtype=np.int64)


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
        Row in ``coordinates`` of each corner of each triangle, in the order of the triangles and corners of
        :func:`read_mesh`.

    Raises
    ------
    InputError
        If the file is missing, is no OBJ file, is damaged, has a polygon that crosses itself, or a corner has no
        texture coordinates.
    """
    file = existing_file(path)
    if file.suffix.lower() != ".obj":
        raise InputError(f"texture coordinates are read from .obj files, got {shown(file.name)}.")
    try:
        data = read_bytes(file)
        vertices, polygons = read_obj(data)
        coordinates, of_corner = _parse_texture(data)
        slots = Polygons(polygons.counts, np.arange(len(polygons.corners)))
        return coordinates, of_corner[triangulate(vertices[polygons.corners], slots)]
    except OSError as error:
        raise InputError(f"{shown(file.name)} cannot be read: {error.strerror or error}.") from error
    except InputError as error:
        raise InputError(f"texture coordinates of {shown(file.name)}: {error}") from error


def _parse_texture(data: bytes) -> tuple[Floats, Ints]:
    """Return the texture coordinates (k, 2) in an OBJ file's bytes, and (c,) the row for each corner of its faces.

    Raise InputError if a line is damaged, or a corner has no texture coordinate.
    """
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
    index = zero_based_numbers(parse_ints(corners, at), np.array(before, dtype=np.int64), len(lines), at)
    return parse_floats(words_of, 2, lines), index
