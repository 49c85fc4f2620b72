"""OBJ files: vertices and faces, and no other file that they name."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints
from cpmkit_mesh.polygons import Polygons
from cpmkit_mesh.text import floats_of, ints_of, lines_of

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
    """Return the vertices (n, 3) and the faces of an OBJ file.

    Raises
    ------
    InputError
        If a line is damaged, or says what is not read.
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
            if len(words) not in VERTEX_LINE_WORDS or (len(words) in (5, 8) and not _is_one(words[4])):
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
    index = from_zero(ints_of(corners, lines), np.repeat(before, size), len(vertex_lines), lines)
    return floats_of(coordinates, 3, vertex_lines), Polygons(size, index)


def split_lines(data: bytes) -> list[tuple[int, list[str]]]:
    """Return the number of each line that is not empty, and its words; a backslash joins a line to the next."""
    found, joined = [], ""
    for number, line in enumerate(lines_of(data), 1):
        if line.endswith("\\"):
            joined += line[:-1] + " "
            continue
        words = (joined + line).split() if joined else line.split()
        joined = ""
        if words:
            found.append((number, words))
    return [*found, (0, joined.split())] if joined.strip() else found


def _is_one(word: str) -> bool:
    try:
        return float(word) == 1.0
    except ValueError:
        return False


def from_zero(index: Ints, before: Ints, count: int, lines: Ints) -> Ints:
    """Return numbers of vertices from zero; OBJ counts from one, and negative ones back from the last so far."""
    zero = np.flatnonzero(index == 0)
    if len(zero):
        raise InputError(f"line {lines[zero[0]]} names vertex 0, and OBJ counts vertices from 1.")
    named = np.where(index > 0, index - 1, before + index)
    bad = np.flatnonzero((named < 0) | (named >= count))
    if len(bad):
        raise InputError(f"line {lines[bad[0]]} names vertex {index[bad[0]]}, and there are {count}.")
    return np.asarray(named, dtype=np.int64)
