"""Arrays of files that cpmkit wrote itself: a table says what each is, and what the table does not name is not read."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.files.array_files import read_arrays

#: What arrays of each kind of NumPy type are made on reading.
DTYPE_OF_KIND = {"b": np.bool_, "i": np.int64, "f": np.float64, "U": np.str_}
#: Bytes of a text.
MOST_TEXT_BYTES = 1 << 26
KIND_WORDS = {"b": "truth values", "i": "whole numbers", "f": "numbers", "U": "text"}


@dataclass(frozen=True)
class SavedArray:
    """One array of a file.

    Attributes
    ----------
    name : str
    kinds : str
        Kinds of NumPy types that it may have, such as ``"f"``.
    shape : tuple of str or int
        A name stands for one size wherever it appears in the table.
    needed : bool
        Whether the file is refused without it.
    """

    name: str
    kinds: str
    shape: tuple[str | int, ...] = ()
    needed: bool = True


def read_saved(
    path: Path, table: Iterable[SavedArray], what: str, sizes: Mapping[str, int] | None = None
) -> dict[str, np.ndarray]:
    """Read the arrays that ``table`` names from an ``.npz`` file, floats as float64 and whole numbers as int64.

    Shapes are compared before an array is read: those that ``sizes`` fixes beforehand, and others with one another.

    Raises
    ------
    InputError
        If the file is missing, damaged, or no ``.npz`` file; if an array that is needed is not in it; or if one is of
        another type or shape than the table says, or holds NaN or infinity.
    """
    rows, known = {row.name: row for row in table}, dict(sizes or {})

    def check(name: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        row = rows[name]
        expected = tuple(known.get(size, size) if isinstance(size, str) else size for size in row.shape)
        fits = len(shape) == len(expected) and all(
            isinstance(size, str) or size == given for size, given in zip(expected, shape, strict=True)
        )
        if dtype.kind == "U" and dtype.itemsize > MOST_TEXT_BYTES:
            raise InputError(f"{shown(path.name)} holds {dtype.itemsize} bytes of text as {name}; it is damaged.")
        if not fits or dtype.kind not in row.kinds:
            kinds = " or ".join(KIND_WORDS[kind] for kind in row.kinds)
            raise InputError(
                f"{shown(path.name)} holds {name} as {dtype.name} of shape {shape}, where {kinds} of shape "
                f"({', '.join(map(str, expected))}) belong in {what}; it is damaged, or not one."
            )
        known.update((size, given) for size, given in zip(row.shape, shape, strict=True) if isinstance(size, str))

    arrays = read_arrays(path, rows, what, check)
    lacking = [row.name for row in rows.values() if row.needed and row.name not in arrays]
    if lacking:
        raise InputError(f"{shown(path.name)} is not {what}: it lacks the array {lacking[0]!r}.")
    for name, array in arrays.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise InputError(f"{shown(path.name)} is not {what} as it was written: {name} holds NaN or infinity.")
    return {name: array.astype(DTYPE_OF_KIND[array.dtype.kind], copy=False) for name, array in arrays.items()}


def read_json_table(array: np.ndarray, path: Path, name: str) -> dict[str, Any]:
    """Return the table of plain values that a text array holds.

    Raises
    ------
    InputError
        If the text is not a JSON object.
    """
    try:
        table = json.loads(str(array))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{shown(path.name)} holds a {name} that is not JSON; it is damaged.") from error
    if not isinstance(table, dict):
        raise InputError(f"{shown(path.name)} holds a {name} that is not a JSON object but {shown(table)}.")
    return table
