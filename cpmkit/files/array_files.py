"""Untrusted NumPy files: sizes in headers are compared with the file and the memory before anything is allocated."""

from __future__ import annotations

import json
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.files.whole_files import explain_system_error
from cpmkit.runtime.memory import available_bytes

#: Exceptions that NumPy, zipfile and Python's tokenizer raise on damaged files.
DAMAGE_ERRORS = (ValueError, TypeError, KeyError, EOFError, SyntaxError, OverflowError, RecursionError, MemoryError,
           NotImplementedError, RuntimeError, tokenize.TokenError, zipfile.BadZipFile, zlib.error)  # fmt: skip


def read_array(path: Path, label: str = "an array of numbers") -> np.ndarray:
    """Return the array in an ``.npy`` file, of the type and shape that it has there.

    ``label`` describes the expected contents in errors. Raises InputError if the file cannot be opened, is no ``.npy``
    file, holds other data than integers or real numbers, is shorter than its header says, or larger than the available
    memory.
    """
    with explain_system_error(f"{shown(path.name)} cannot be read"), path.open("rb") as opened:
        return _read_stream(opened, path.stat().st_size, path.name, f"a .npy file with {label}", "iuf")


def read_bytes(path: Path) -> bytes:
    """Return the bytes of a file; raise InputError if it exceeds the available memory, OSError if unreadable."""
    _check_size(path.stat().st_size, path.name)
    return path.read_bytes()


def read_arrays(
    path: Path, names: Container[str], label: str, check: Callable[[str, tuple[int, ...], np.dtype[Any]], None]
) -> dict[str, np.ndarray]:
    """Return those arrays of an ``.npz`` file whose names are in ``names``, by name.

    Other arrays are not read. ``label`` describes the expected file in errors, such as "a saved solution". ``check`` is
    called with the name, shape and type in each array's header before any array is read, and may raise. Raises
    InputError if the file cannot be opened, is not whole, or an array in it holds other data than numbers, truth values
    and text, or is larger than the available memory.
    """
    try:
        with explain_system_error(f"{shown(path.name)} cannot be read"), zipfile.ZipFile(path) as archive:
            named = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
            members = {name: entry for name, entry in named.items() if name in names}
            _check_size(sum(entry.file_size for entry in members.values()), path.name)
            for name, entry in members.items():
                with archive.open(entry) as opened:
                    shape, _, dtype, _ = _read_header(opened)
                    check(name, shape, dtype)
            read = {}
            for name, entry in members.items():
                with archive.open(entry) as opened:
                    read[name] = _read_stream(opened, entry.file_size, path.name, label, "biufUS")
            return read
    except InputError:
        raise
    except DAMAGE_ERRORS as error:
        raise InputError(f"{shown(path.name)} is damaged or not {label}.") from error


def _check_size(needed: int, name: str) -> None:
    """Raise InputError if the ``needed`` bytes of the file ``name`` exceed the available memory."""
    available = available_bytes()
    if needed > available:
        raise InputError(
            f"{shown(name)} says that it holds {needed / 2**30:.3g} GiB, and {available / 2**30:.3g} GiB are available."
        )


def _read_stream(opened: IO[bytes], length: int, name: str, label: str, kinds: str) -> np.ndarray:
    """Return the array in an opened .npy file, or such a part of an archive, of ``length`` bytes with its header.

    Raises InputError if its NumPy kind is no letter of ``kinds``, such as "iuf", it is larger than the memory, or the
    file is damaged or cut off; ``name`` and ``label`` are the file and its expected contents in messages.
    """
    try:
        shape, fortran, dtype, header = _read_header(opened)
    except DAMAGE_ERRORS as error:
        raise InputError(f"{shown(name)} is not {label}, or its header is damaged.") from error
    if dtype.kind not in kinds:
        raise InputError(f"{shown(name)} holds {shown(dtype.name)} where {label} was expected.")
    needed = prod(shape) * dtype.itemsize
    if needed > length - header:
        raise InputError(f"{shown(name)} says that it holds {shape} numbers and ends before: it is damaged.")
    _check_size(needed, name)
    try:
        return np.frombuffer(opened.read(needed), dtype=dtype).reshape(shape, order="F" if fortran else "C").copy()
    except DAMAGE_ERRORS as error:
        raise InputError(f"{shown(name)} ends before its last number: it is cut off or damaged.") from error


def _read_header(opened: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any], int]:
    """Return (shape, True for Fortran order, type, length in bytes) of the .npy header that is read from ``opened``.

    Raises one of :data:`DAMAGE_ERRORS` if the header is damaged.
    """
    version = np.lib.format.read_magic(opened)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    shape, fortran, dtype = readers[version](opened)
    if any(count < 0 for count in shape):
        raise ValueError(f"the shape {shape} is negative")
    return shape, fortran, dtype, opened.tell()


@dataclass(frozen=True)
class SavedArray:
    """The name, types and shape that an array of a file must have."""

    name: str
    kinds: str  #: Kinds of NumPy types that it may have, such as ``"f"``.
    shape: tuple[str | int, ...] = ()  #: Sizes; a name stands for the same size in all arrays of a table.
    needed: bool = True  #: Whether the file is refused without it.


def read_saved(
    path: Path, table: Iterable[SavedArray], label: str, sizes: Mapping[str, int] | None = None
) -> dict[str, np.ndarray]:
    """Return the arrays of an ``.npz`` file that ``table`` names, floats as float64 and whole numbers as int64.

    An array that is not needed may be absent. Shapes are compared before an array is read: with the known ``sizes``, by
    name, and with each other. ``label`` describes the file in errors. Raises InputError if the file is missing, damaged
    or no ``.npz`` file, lacks a needed array, or has one of another type or shape, or with NaN or infinity.
    """
    rows, known = {row.name: row for row in table}, dict(sizes or {})

    def check_header(name: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        """Raise InputError if shape or type in the header of array ``name`` is not as in the table; store its sizes."""
        row = rows[name]
        expected = tuple(known.get(size, size) if isinstance(size, str) else size for size in row.shape)
        fits = len(shape) == len(expected) and all(
            isinstance(size, str) or size == actual for size, actual in zip(expected, shape, strict=True)
        )
        if dtype.kind == "U" and dtype.itemsize > 1 << 26:
            raise InputError(f"{shown(path.name)} holds {dtype.itemsize} bytes of text as {name}; it is damaged.")
        if not fits or dtype.kind not in row.kinds:
            words = {"b": "truth values", "i": "whole numbers", "f": "numbers", "U": "text"}
            kinds = " or ".join(words[kind] for kind in row.kinds)
            raise InputError(
                f"{shown(path.name)} holds {name} as {dtype.name} of shape {shape}, where {kinds} of shape "
                f"({', '.join(map(str, expected))}) belong in {label}; it is damaged, or not one."
            )
        known.update((size, actual) for size, actual in zip(row.shape, shape, strict=True) if isinstance(size, str))

    arrays = read_arrays(path, rows, label, check_header)
    lacking = [row.name for row in rows.values() if row.needed and row.name not in arrays]
    if lacking:
        raise InputError(f"{shown(path.name)} is not {label}: it lacks the array {lacking[0]!r}.")
    for name, array in arrays.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise InputError(f"{shown(path.name)} is not {label} as it was written: {name} holds NaN or infinity.")
    dtypes = {"b": np.bool_, "i": np.int64, "f": np.float64, "U": np.str_}
    return {name: array.astype(dtypes[array.dtype.kind], copy=False) for name, array in arrays.items()}


def read_json_table(array: np.ndarray, path: Path, name: str) -> dict[str, Any]:
    """Return the dict in the JSON text of the array ``name`` of file ``path``; raise InputError for other text."""
    try:
        table = json.loads(str(array))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{shown(path.name)} holds a {name} that is not JSON; it is damaged.") from error
    if not isinstance(table, dict):
        raise InputError(f"{shown(path.name)} holds a {name} that is not a JSON object but {shown(table)}.")
    return table
