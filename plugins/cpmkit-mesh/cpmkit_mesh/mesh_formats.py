"""OFF, PLY and STL files: vertices and faces."""

from __future__ import annotations

import re

import numpy as np

from cpmkit.plugin import Floats, InputError
from cpmkit_mesh.ply_files import PlyLists, ply_vertices, read_ply
from cpmkit_mesh.polygons import Polygons
from cpmkit_mesh.text import parse_floats, parse_ints, text_lines

#: First words of OFF files whose vertices begin with x, y and z; texture, colours and normals follow. The number of
#: vertices may follow without a space.
FIRST_WORD = re.compile(r"((?:ST)?C?N?OFF)(\d*)", re.IGNORECASE)


def read_off(data: bytes) -> tuple[Floats, Polygons]:
    """Return the vertices (n, 3) and the polygons in the bytes ``data`` of a text OFF file.

    Raise InputError if it is no OFF file, or a line is damaged, missing or superfluous.
    """
    rows = [(number, words) for number, line in enumerate(text_lines(data), 1) if (words := line.split())]
    first = FIRST_WORD.fullmatch(rows[0][1][0]) if rows else None
    if not first or rows[0][1][1:2] == ["BINARY"]:
        raise InputError("it does not begin with OFF, of which the text form is read.")
    rest = [*filter(None, first.groups()[1:]), *rows[0][1][1:]]
    rows = [(rows[0][0], rest), *rows[1:]] if rest else rows[1:]
    sizes = parse_ints(rows[0][1], np.full(len(rows[0][1]), rows[0][0])) if rows else np.zeros(0, dtype=np.int64)
    if len(sizes) not in (2, 3) or sizes.min() < 0:
        raise InputError("it does not say how many vertices and faces there are.")
    count, faces = int(sizes[0]), int(sizes[1])
    if len(rows) - 1 != count + faces:
        raise InputError(f"it says {count} vertices and {faces} faces, and has {len(rows) - 1} lines for them.")
    return _parse_vertices(rows[1 : count + 1]), _parse_polygons(rows[count + 1 :], count)


def _parse_vertices(rows: list[tuple[int, list[str]]]) -> Floats:
    """Return vertices (n, 3) in ``rows``, the line number and words of each; raise InputError for a damaged line."""
    for number, words in rows:
        if len(words) < 3:
            raise InputError(f"line {number} holds no vertex of three coordinates.")
    return parse_floats([word for _, words in rows for word in words[:3]], 3, [number for number, _ in rows])


def _parse_polygons(rows: list[tuple[int, list[str]]], vertices: int) -> Polygons:
    """Return the faces in ``rows``, the line number and words of each line; ``vertices`` is the number of vertices.

    Raise InputError if a line is damaged, has too few corners, or a vertex number out of range.
    """
    lines = np.array([number for number, _ in rows], dtype=np.int64)
    counts = parse_ints([words[0] for _, words in rows], lines)
    for count, (number, words) in zip(counts, rows, strict=True):
        if not 3 <= count < len(words):
            raise InputError(f"line {number} says {count} corners and has {len(words) - 1}; three are needed.")
    corners = [word for count, (_, words) in zip(counts, rows, strict=True) for word in words[1 : count + 1]]
    lines = np.repeat(lines, counts)
    index = parse_ints(corners, lines)
    bad = np.flatnonzero((index < 0) | (index >= vertices))
    if len(bad):
        raise InputError(f"line {lines[bad[0]]} names vertex {index[bad[0]]}, and they go from 0 to {vertices - 1}.")
    return Polygons(counts, index)


#: Names of the list of a face's vertices in PLY files.
VERTEX_LIST_NAMES = ("vertex_indices", "vertex_index")


def read_ply_mesh(data: bytes) -> tuple[Floats, Polygons]:
    """Return the vertices (n, 3) and the polygons in the bytes ``data`` of a PLY file.

    There are no polygons if no element ``face`` has a property of :data:`VERTEX_LIST_NAMES`. Raise InputError if it is
    no PLY file, is damaged, holds strips, a face of less than three corners, or a vertex number out of range.
    """
    tables = read_ply(data)
    vertices, faces = ply_vertices(tables), tables.get("face", {})
    if "tristrips" in tables:
        raise InputError("it holds strips of triangles, which are not read; save it with faces.")
    lists = next((faces[name] for name in VERTEX_LIST_NAMES if name in faces), None)
    if lists is None:
        return vertices, Polygons(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    if not isinstance(lists, PlyLists):
        raise InputError("the vertices of its faces are no lists.")
    if len(lists.counts) and lists.counts.min() < 3:
        raise InputError(f"face {int(np.argmin(lists.counts)) + 1} has {lists.counts.min()} corners, three are needed.")
    corners = lists.entries
    good = (corners >= 0) & (corners < len(vertices)) & (corners == np.floor(corners))
    if not good.all():
        face = np.searchsorted(np.cumsum(lists.counts), np.argmin(good), side="right")
        raise InputError(f"face {face + 1} names a vertex that is not one of 0 to {len(vertices) - 1}.")
    return vertices, Polygons(lists.counts, corners.astype(np.int64))


#: One triangle of a binary file, behind 80 bytes of anything and their count.
STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
STL_HEAD_BYTES = 84
#: The first words of the lines of a triangle.
FACET_WORDS = ("facet", "outer", "vertex", "vertex", "vertex", "endloop", "endfacet")


def read_stl(data: bytes) -> tuple[Floats, Polygons]:
    """Return corners (3 m, 3) and the m triangles between them in the bytes ``data`` of an STL file, text or binary.

    Raise InputError if it is no STL file, is cut off, or a line is damaged.
    """
    claimed = int.from_bytes(data[80:STL_HEAD_BYTES], "little") if len(data) >= STL_HEAD_BYTES else -1
    if claimed >= 0 and len(data) == STL_HEAD_BYTES + claimed * STL_RECORD.itemsize:
        corners = np.frombuffer(data, STL_RECORD, offset=STL_HEAD_BYTES)["corners"].reshape(-1, 3).astype(np.float64)
    elif data.lstrip()[:5].lower() == b"solid":
        corners = _read_text_stl(data)
    elif claimed >= 0:
        whole = (len(data) - STL_HEAD_BYTES) / STL_RECORD.itemsize
        raise InputError(f"it says {claimed} triangles, and is as long as one of {whole:.6g}.")
    else:
        raise InputError("it is neither a binary STL file nor one that begins with solid.")
    return corners, Polygons(np.full(len(corners) // 3, 3), np.arange(len(corners)))


def _read_text_stl(data: bytes) -> Floats:
    """Return the corners (3 m, 3) of the m triangles in the bytes ``data`` of a text STL file, unwelded.

    Raise InputError if it is cut off, or a line is out of order or damaged.
    """
    rows = [(number, words) for number, line in enumerate(text_lines(data), 1) if (words := line.split())]
    first = [words[0].lower() for _, words in rows]
    if first[-1] != "endsolid" and first[-2:] != ["end", "solid"]:
        raise InputError("its last line is no endsolid: it is cut off.")
    facets = [(row, word) for row, word in zip(rows, first, strict=True) if word not in ("solid", "endsolid")]
    for place, ((number, _), word) in enumerate(facets):
        if word != FACET_WORDS[place % len(FACET_WORDS)]:
            raise InputError(f"line {number} begins otherwise than with {FACET_WORDS[place % len(FACET_WORDS)]}.")
    if len(facets) % len(FACET_WORDS):
        raise InputError(
            f"its last triangle, which begins in line {facets[-(len(facets) % len(FACET_WORDS))][0][0]}, is cut off."
        )
    corners = [row for row, word in facets if word == "vertex"]
    for number, words in corners:
        if len(words) != 4:
            raise InputError(f"line {number} holds no vertex of three coordinates.")
    return parse_floats([word for _, words in corners for word in words[1:]], 3, [number for number, _ in corners])
