"""PLY files: sizes in their headers are compared with their data, and no file that they name is opened."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints, shown

#: Types of properties, as NumPy names them.
PLY_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
PLY_ENCODINGS = ("ascii", "binary_little_endian", "binary_big_endian")
#: Most entries of a list.
MOST_LIST_ENTRIES = 1 << 40
#: The error about a file that is too short.
CUT_OFF_SENTENCE = "it says that it has {count} rows of {name}, and ends before: it is cut off or damaged."
#: Bytes in which a header must end.
MOST_HEADER_BYTES = 1 << 20


@dataclass(frozen=True)
class Property:
    """A property of an element: a number, or a list of numbers.

    ``type`` is the NumPy name of the numbers' type, ``length`` that of a list's length, None for a number.
    """

    name: str
    type: str
    length: str | None = None


@dataclass(frozen=True)
class Element:
    """An element of a PLY file: ``count`` rows with the same properties."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class PlyLists:
    """The lists of a property: the length (n,) of each row's list, and the entries of all lists, row after row."""

    counts: Ints
    entries: np.ndarray


#: The rows of an element: a column (n,) for each property.
Table = dict[str, Any]


def read_ply(data: bytes) -> dict[str, Table]:
    """Return the tables of a PLY file's bytes ``data``, text or binary, by the names of its elements.

    A table maps each property to its column: an array (n,), or ``PlyLists``. Raise InputError if the data are no PLY
    file, are cut off, go on after the end, or are not numbers.
    """
    form, elements, body = _parse_header(data)
    if form == "ascii":  # the same rows in binary, every number in eight bytes
        body = _parse_numbers(body).tobytes()
        elements = [_with_double_types(element) for element in elements]
    stream = _Stream(body, ">" if form == "binary_big_endian" else "<")
    tables = {element.name: stream.read_table(element) for element in elements}
    if stream.bytes_left:
        raise InputError("it goes on after the last row that it announces.")
    return tables


def read_ply_points(data: bytes) -> Floats:
    """Return vertices (n, 3) in the bytes of a PLY file; raise InputError if it does not parse or lacks x, y or z."""
    return ply_vertices(read_ply(data))


def ply_vertices(tables: dict[str, Table]) -> Floats:
    """Return vertices (n, 3) in the ``tables`` of :func:`read_ply`; raise InputError without properties x, y and z."""
    columns = [tables.get("vertex", {}).get(axis) for axis in "xyz"]
    if any(not isinstance(column, np.ndarray) for column in columns):
        raise InputError("it has no element vertex with the properties x, y and z.")
    return np.stack(columns, axis=1).astype(np.float64)  # type: ignore[arg-type]


def _parse_header(data: bytes) -> tuple[str, list[Element], bytes]:
    """Return the encoding, the elements, and the bytes after the header of a PLY file's ``data``.

    The encoding is one of :data:`PLY_ENCODINGS`. Raise InputError if a line is damaged, ``ply``, ``end_header`` or the
    format is missing, or two elements have one name.
    """
    if not data.removeprefix(b"\xef\xbb\xbf").startswith(b"ply"):
        raise InputError("it does not begin with ply.")
    end = data.find(b"end_header", 0, MOST_HEADER_BYTES)
    if end < 0:
        raise InputError("its header has no end_header.")
    form, elements = "", []
    for line in data[:end].decode("ascii", errors="replace").splitlines()[1:]:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3 and words[1] in PLY_ENCODINGS:
            form = words[1]
        elif words[0] == "element" and len(words) == 3 and words[2].isdecimal() and len(words[2]) < 16:
            elements.append(Element(words[1], int(words[2])))
        elif words[0] == "property" and elements and (found := _parse_property(words)) is not None:
            elements[-1].properties.append(found)
        else:
            raise InputError(f"line {data[: data.find(line.encode())].count(10) + 1} of its header is damaged.")
    if not form:
        raise InputError("its header names no format.")
    if len({element.name for element in elements}) < len(elements):
        raise InputError("its header names an element twice.")
    after = end + len(b"end_header")
    after += 2 if data[after : after + 2] == b"\r\n" else 1
    return form, elements, data[after:]


def _parse_property(words: list[str]) -> Property | None:
    """Return the property in the ``words`` of a line of the header; None if the line is damaged."""
    if len(words) == 3 and words[1] in PLY_TYPES:
        return Property(words[2], PLY_TYPES[words[1]])
    if len(words) == 5 and words[1] == "list" and words[2] in PLY_TYPES and words[3] in PLY_TYPES:
        return Property(words[4], PLY_TYPES[words[3]], PLY_TYPES[words[2]])
    return None


def _parse_numbers(body: bytes) -> Floats:
    """Return numbers (n,) in the text ``body``, separated by blanks, as float64; raise InputError for other words."""
    words = body.split()
    try:
        if b"_" not in body:
            return np.array([float(word) for word in words], dtype="<f8")
    except ValueError:
        pass
    raise InputError("it holds something else than numbers after its header.")


def _with_double_types(element: Element) -> Element:
    """Return the element with the types of all its numbers and list lengths replaced by float64."""
    doubles = [Property(item.name, "f8", item.length and "f8") for item in element.properties]
    return Element(element.name, element.count, doubles)


def _join_rows(element: Element, rows: list[list[np.ndarray]]) -> Table:
    """Return the table of an element whose ``rows`` were read singly; each row has an array for each property."""
    table: Table = {}
    for place, one in enumerate(element.properties):
        parts = [row[place] for row in rows]
        entries = np.concatenate(parts) if parts else np.zeros(0)
        counts = np.array([len(part) for part in parts], dtype=np.int64)
        table[one.name] = PlyLists(counts, entries) if one.length else entries
    return table


def _checked_length(value: Any) -> int:
    """Return ``value`` as an int; raise InputError unless it is whole and from 0 to :data:`MOST_LIST_ENTRIES`."""
    if not 0 <= value <= MOST_LIST_ENTRIES or value != int(value):
        raise InputError("it holds a list whose length is no whole number.")
    return int(value)


class _Stream:
    """A reader of elements' rows in binary ``data``, in order; ``place`` is its position, ``order`` the byte order."""

    def __init__(self, data: bytes, order: str) -> None:
        self.data, self.order, self.place = data, order, 0

    @property
    def bytes_left(self) -> int:
        """Number of bytes not yet read."""
        return len(self.data) - self.place

    def read_table(self, element: Element) -> Table:
        """Return the table of the next element and move past it.

        Raise InputError if the data end before its last row, or a list's length is no whole number. An element without
        properties has an empty table.
        """
        if not element.properties:
            return {}
        if element.count > self.bytes_left:
            raise InputError(CUT_OFF_SENTENCE.format(count=element.count, name=shown(element.name)))
        if element.count and (table := self._read_equal_rows(element)) is not None:
            return table
        return _join_rows(element, [self._read_row(element) for _ in range(element.count)])

    def _read_equal_rows(self, element: Element) -> Table | None:
        """Return the next element's table and move past it, if each list has one length in all rows; else return None.

        None is returned too if the data are too short for that; the position then stays. Raise InputError if the data
        end in the first row, or a list's length there is damaged.
        """
        start = self.place
        first = self._read_row(element)
        self.place = start
        record = self._row_type(element, first)
        if element.count * record.itemsize > self.bytes_left:
            return None
        rows = np.frombuffer(self.data, record, element.count, start)
        table: Table = {}
        for place, (one, part) in enumerate(zip(element.properties, first, strict=True)):
            if one.length and (rows[f"{place}#"] != len(part)).any():
                return None
            entries = rows[str(place)].astype(one.type)
            table[one.name] = (
                PlyLists(np.full(element.count, len(part)), entries.reshape(-1)) if one.length else entries
            )
        self.place = start + element.count * record.itemsize
        return table

    def _row_type(self, element: Element, first: list[np.ndarray]) -> np.dtype[Any]:
        """Return the NumPy type of a row of ``element`` whose lists are as long as those of the ``first`` row read."""
        fields: list[Any] = []
        for place, (one, part) in enumerate(zip(element.properties, first, strict=True)):
            if one.length:
                fields.append((f"{place}#", self.order + one.length))
            fields.append((str(place), self.order + one.type, *([(len(part),)] if one.length else [])))
        return np.dtype(fields)

    def _read_row(self, element: Element) -> list[np.ndarray]:
        """Return the next row of ``element``, an array for each property, and move past it.

        Raise InputError if the data end before, or a list's length is damaged.
        """
        row = []
        for item in element.properties:
            count = _checked_length(self._read_numbers(1, item.length, element)[0]) if item.length else 1
            row.append(self._read_numbers(count, item.type, element))
        return row

    def _read_numbers(self, count: int, kind: str, element: Element) -> np.ndarray:
        """Return the next ``count`` numbers of the NumPy type ``kind`` and move past them.

        Raise InputError, which names ``element``, if the data end before.
        """
        dtype = np.dtype(self.order + kind)
        if count * dtype.itemsize > self.bytes_left:
            raise InputError(CUT_OFF_SENTENCE.format(count=element.count, name=shown(element.name)))
        self.place += count * dtype.itemsize
        return np.frombuffer(self.data, dtype, count, self.place - count * dtype.itemsize)
