"""Polylines in files: arrays, rows of numbers, and the line of an OBJ file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from cpmkit.plugin import Floats, InputError, existing_file, read_array, read_bytes, shown
from cpmkit_mesh.obj import VERTEX_LINE_WORDS, split_lines, zero_based_numbers
from cpmkit_mesh.text import parse_floats, parse_ints, text_lines


def read_polyline(path: str | Path) -> np.ndarray:
    """Return the points (n, d) of the polyline in a file, in their order; of a NumPy file the array as it stands.

    In an OBJ file they are those of its line ``l``, or of several lines each of which begins where the last ended. A
    line that ends at its first vertex gives that point twice. Raise InputError if the file is missing, does not parse,
    or holds no line or several that do not meet.
    """
    file = existing_file(path)
    read = READERS.get(file.suffix.lower())
    if read is None:
        return read_array(file, "an array of points")
    try:
        return read(read_bytes(file))
    except InputError as error:
        raise InputError(f"{shown(file.name)} is no polyline: {error}") from error
    except OSError as error:
        raise InputError(f"{shown(file.name)} cannot be read: {error.strerror or error}.") from error


def _parse_rows(data: bytes) -> Floats:
    """Return the numbers (n, d) of a text with one point in each line, separated by commas or blanks.

    Raise InputError if it is empty, a word is no number, or lines differ in length.
    """
    rows = [(number, line.replace(",", " ").split()) for number, line in enumerate(text_lines(data), 1)]
    rows = [(number, words) for number, words in rows if words]
    if not rows:
        raise InputError("it holds no point.")
    columns = len(rows[0][1])
    for number, words in rows:
        if len(words) != columns:
            raise InputError(f"line {number} holds {len(words)} numbers, and the first point has {columns}.")
    return parse_floats([word for _, words in rows for word in words], columns, [number for number, _ in rows])


def _parse_obj_line(data: bytes) -> Floats:
    """Return the points (n, 3) of the line ``l`` in the bytes of an OBJ file, in order; consecutive lines are joined.

    Raise InputError if there is none, a line does not start where the last ended, or a row is damaged.
    """
    coordinates: list[str] = []
    vertex_lines: list[int] = []
    chain: list[int] = []
    for number, words in split_lines(data):
        if words[0] == "v":
            if len(words) not in VERTEX_LINE_WORDS:
                raise InputError(f"line {number} holds no vertex of three coordinates.")
            coordinates += words[1:4]
            vertex_lines.append(number)
        elif words[0] == "l":
            lines, count = np.full(len(words) - 1, number), len(vertex_lines)
            numbers = parse_ints([word.partition("/")[0] for word in words[1:]], lines)
            vertices = zero_based_numbers(numbers, np.full(len(numbers), count), count, lines).tolist()
            if chain and vertices and vertices[0] != chain[-1]:
                raise InputError(f"line {number} begins a second line, which does not go on where the first ended.")
            chain += vertices[1:] if chain else vertices
    if not chain:
        raise InputError("it holds no line, which begins with l; points alone are read from a .csv file.")
    return parse_floats(coordinates, 3, vertex_lines)[chain]


#: By suffix; other files are read as those of NumPy.
READERS: dict[str, Callable[[bytes], Floats]] = {
    ".csv": _parse_rows,
    ".txt": _parse_rows,
    ".xyz": _parse_rows,
    ".obj": _parse_obj_line,
}
