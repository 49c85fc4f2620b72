"""Reading TOML files, with errors that name the file; what no key may hold is refused here, once for all keys."""

from __future__ import annotations

import tomllib
import unicodedata
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from cpmkit.errors import SceneError, shown

Made = TypeVar("Made")

#: Bytes of a file; more belong into array files that it names.
MOST_TOML_BYTES = 16 * 2**20
#: Tables and lists inside tables and lists.
DEEPEST_NESTING = 40
#: TOML's own bound on whole numbers.
WHOLE_NUMBER_BOUND = 2**63


def from_toml(path: str | Path, make: Callable[[dict[str, Any], Path], Made], what: str, like: str) -> Made:
    """Return what ``make`` makes of a file's tables and path.

    Parameters
    ----------
    path : path
        Of the file.
    make : callable
        What it raises as SceneError is told with the file's name.
    what : str
        Named in the error if there is no file, such as "scene file".
    like : str
        Which file to give then.

    Raises
    ------
    SceneError
        If the file is missing, too large or does not parse, nests tables too deeply, holds a control character or a
        whole number beyond 64 bits, or of ``make``.
    """
    path = Path(path)
    tables = _tables(path, what, like)
    try:
        _check_values(tables)
        return make(tables, path)
    except SceneError as error:
        raise SceneError(f"{path.name}: {error}") from error


def _tables(path: Path, what: str, like: str) -> dict[str, Any]:
    try:
        if not path.is_file():
            raise SceneError(f"no {what} {shown(str(path))}; give the path of a TOML file{like}.")
        with path.open("rb") as file:
            content = file.read(MOST_TOML_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise SceneError(f"the {what} {shown(str(path))} cannot be read: {reason}.") from error
    if len(content) > MOST_TOML_BYTES:
        raise SceneError(f"{path.name} has more than {MOST_TOML_BYTES // 2**20} MiB; write long lists into .npy files.")
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except RecursionError as error:
        raise SceneError(f"{path.name} nests more than {DEEPEST_NESTING} tables or lists in each other.") from error
    except ValueError as error:  # no UTF-8, no TOML, or a number of thousands of digits
        reason = "a number has too many digits" if "digits" in str(error) else str(error).rstrip(".")
        raise SceneError(f"{path.name} is not TOML: {reason}.") from error


def _check_values(tables: dict[str, Any]) -> None:
    """Refuse what no key accepts."""
    waiting: list[tuple[str, Any, int]] = [("the file", tables, 0)]
    while waiting:
        where, value, depth = waiting.pop()
        if depth > DEEPEST_NESTING:
            raise SceneError(f"{where} nests more than {DEEPEST_NESTING} tables or lists in each other.")
        if isinstance(value, int) and not -WHOLE_NUMBER_BOUND <= value < WHOLE_NUMBER_BOUND:
            raise SceneError(f"{where} is a whole number beyond 9.2e18; write it with an exponent, such as 1e20.")
        if isinstance(value, str):
            _check_text(value, where)
        waiting += [(name, entry, depth + 1) for name, entry in _entries(value, where)]


def _entries(value: Any, where: str) -> Iterator[tuple[str, Any]]:
    """Yield the name and the value of each entry of a table or list."""
    if isinstance(value, dict):
        for key, entry in value.items():
            _check_text(key, f"a key of {where}")
            yield f"the key {key[:40]!r}", entry
    elif isinstance(value, list):
        for entry in value:
            yield (where if where.startswith("an entry") else f"an entry of {where}"), entry


def _check_text(text: str, where: str) -> None:
    """Refuse control characters: they could steer a terminal, and end names of files."""
    if text.isprintable():
        return
    control = next((letter for letter in text if unicodedata.category(letter) == "Cc" and letter not in "\n\t"), None)
    if control is not None:
        raise SceneError(f"{where} holds the control character {control!r}; leave it out.")
