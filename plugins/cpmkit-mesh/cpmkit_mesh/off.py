"""OFF files."""

from __future__ import annotations

import re

import numpy as np

from cpmkit.plugin import Floats, InputError
from cpmkit_mesh.polygons import Polygons
from cpmkit_mesh.text import floats_of, ints_of, lines_of

#: First words of files whose vertices begin with x, y and z: texture, colours and normals follow. The number of
#: vertices may stand beside them without a space.
FIRST_WORD = re.compile(r"((?:ST)?C?N?OFF)(\d*)", re.IGNORECASE)


def read_off(data: bytes) -> tuple[Floats, Polygons]:
    """Return the vertices (n, 3) and the faces of an OFF file.

    Raises
    ------
    InputError
        If it is none, or a line is damaged, lacks or is one too many.
    """
    rows = [(number, words) for number, line in enumerate(lines_of(data), 1) if (words := line.split())]
    first = FIRST_WORD.fullmatch(rows[0][1][0]) if rows else None
    if not first or rows[0][1][1:2] == ["BINARY"]:
        raise InputError("it does not begin with OFF, of which the text form is read.")
    beside = [*filter(None, first.groups()[1:]), *rows[0][1][1:]]
    rows = [(rows[0][0], beside), *rows[1:]] if beside else rows[1:]
    sizes = ints_of(rows[0][1], np.full(len(rows[0][1]), rows[0][0])) if rows else np.zeros(0, dtype=np.int64)
    if len(sizes) not in (2, 3) or sizes.min() < 0:
        raise InputError("it does not say how many vertices and faces there are.")
    count, faces = int(sizes[0]), int(sizes[1])
    if len(rows) - 1 != count + faces:
        raise InputError(f"it says {count} vertices and {faces} faces, and has {len(rows) - 1} lines for them.")
    return _vertices(rows[1 : count + 1]), _polygons(rows[count + 1 :], count)


def _vertices(rows: list[tuple[int, list[str]]]) -> Floats:
    for number, words in rows:
        if len(words) < 3:
            raise InputError(f"line {number} holds no vertex of three coordinates.")
    return floats_of([word for _, words in rows for word in words[:3]], 3, [number for number, _ in rows])


def _polygons(rows: list[tuple[int, list[str]]], vertices: int) -> Polygons:
    lines = np.array([number for number, _ in rows], dtype=np.int64)
    counts = ints_of([words[0] for _, words in rows], lines)
    for count, (number, words) in zip(counts, rows, strict=True):
        if not 3 <= count < len(words):
            raise InputError(f"line {number} says {count} corners and has {len(words) - 1}; three are needed.")
    corners = [word for count, (_, words) in zip(counts, rows, strict=True) for word in words[1 : count + 1]]
    lines = np.repeat(lines, counts)
    index = ints_of(corners, lines)
    bad = np.flatnonzero((index < 0) | (index >= vertices))
    if len(bad):
        raise InputError(f"line {lines[bad[0]]} names vertex {index[bad[0]]}, and they go from 0 to {vertices - 1}.")
    return Polygons(counts, index)
