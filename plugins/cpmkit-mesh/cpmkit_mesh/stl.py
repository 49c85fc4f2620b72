"""STL files, binary and text."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, InputError
from cpmkit_mesh.polygons import Polygons
from cpmkit_mesh.text import floats_of, lines_of

#: One triangle of a binary file, behind 80 bytes of anything and their count.
STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
STL_HEAD_BYTES = 84
#: How the lines of a triangle begin.
FACET_WORDS = ("facet", "outer", "vertex", "vertex", "vertex", "endloop", "endfacet")


def read_stl(data: bytes) -> tuple[Floats, Polygons]:
    """Return the corners (n, 3) of an STL file, three a triangle, and the triangles.

    Raises
    ------
    InputError
        If it is none, is cut off, or a line is damaged.
    """
    claimed = int.from_bytes(data[80:STL_HEAD_BYTES], "little") if len(data) >= STL_HEAD_BYTES else -1
    if claimed >= 0 and len(data) == STL_HEAD_BYTES + claimed * STL_RECORD.itemsize:
        corners = np.frombuffer(data, STL_RECORD, offset=STL_HEAD_BYTES)["corners"].reshape(-1, 3).astype(np.float64)
    elif data.lstrip()[:5].lower() == b"solid":
        corners = _read_text(data)
    elif claimed >= 0:
        whole = (len(data) - STL_HEAD_BYTES) / STL_RECORD.itemsize
        raise InputError(f"it says {claimed} triangles, and is as long as one of {whole:.6g}.")
    else:
        raise InputError("it is neither a binary STL file nor one that begins with solid.")
    return corners, Polygons(np.full(len(corners) // 3, 3), np.arange(len(corners)))


def _read_text(data: bytes) -> Floats:
    rows = [(number, words) for number, line in enumerate(lines_of(data), 1) if (words := line.split())]
    first = [words[0].lower() for _, words in rows]
    if first[-1] != "endsolid" and first[-2:] != ["end", "solid"]:
        raise InputError("its last line is no endsolid: it is cut off.")
    kept = [(row, word) for row, word in zip(rows, first, strict=True) if word not in ("solid", "endsolid")]
    for place, ((number, _), word) in enumerate(kept):
        if word != FACET_WORDS[place % len(FACET_WORDS)]:
            raise InputError(f"line {number} begins otherwise than with {FACET_WORDS[place % len(FACET_WORDS)]}.")
    if len(kept) % len(FACET_WORDS):
        raise InputError(
            f"its last triangle, which begins in line {kept[-(len(kept) % len(FACET_WORDS))][0][0]}, is cut off."
        )
    corners = [row for row, word in kept if word == "vertex"]
    for number, words in corners:
        if len(words) != 4:
            raise InputError(f"line {number} holds no vertex of three coordinates.")
    return floats_of([word for _, words in corners for word in words[1:]], 3, [number for number, _ in corners])
