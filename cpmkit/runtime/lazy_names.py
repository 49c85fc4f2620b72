"""Names of a package that are imported on first use: one table, beside imports that type checkers alone read."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazy_names(
    package: str, modules: Mapping[str, str], inside: str, advice: str = ""
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return the functions ``__getattr__`` and ``__dir__`` of a package whose names are imported on first use.

    Parameters
    ----------
    package : str
        Its name.
    modules : mapping
        The module that holds each name, relative to ``inside``.
    inside : str
        A package.
    advice : str
        Said of a name that is not offered.
    """
    held = vars(sys.modules[package])

    def get(name: str) -> Any:
        if name not in modules:
            told = f"module {package!r} has no attribute {name!r}{advice}"
            raise AttributeError(told, name=name, obj=sys.modules[package])
        held[name] = getattr(import_module(f"{inside}.{modules[name]}"), name)
        return held[name]

    return get, lambda: sorted({*held, *modules})
