"""Reading TOML files, with errors that name the file."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from cpmkit.errors import SceneError

Made = TypeVar("Made")


def made_from_toml(path: str | Path, make: Callable[[dict[str, Any], Path], Made], what: str, like: str) -> Made:
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
        If the file is missing or does not parse, or of ``make``.
    """
    path = Path(path)
    if not path.is_file():
        raise SceneError(f"no {what} {str(path)!r}; give the path of a TOML file{like}.")
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SceneError(f"{path.name} is not TOML: {error}.") from error
    try:
        return make(tables, path)
    except SceneError as error:
        raise SceneError(f"{path.name}: {error}") from error
