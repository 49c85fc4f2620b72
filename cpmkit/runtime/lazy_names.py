"""Public names of a package that are imported on first use, from a table of the modules that define them."""

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
        Name of the package.
    modules : mapping
        The module that defines each name, relative to ``inside``.
    inside : str
        Name of the package that contains these modules.
    advice : str
        End of the error's message for a name that is not in the table.
    """
    namespace = vars(sys.modules[package])

    def get(name: str) -> Any:
        """Return the object with this name, imported from its module and stored in the package."""
        if name not in modules:
            message = f"module {package!r} has no attribute {name!r}{advice}"
            raise AttributeError(message, name=name, obj=sys.modules[package])
        namespace[name] = getattr(import_module(f"{inside}.{modules[name]}"), name)
        return namespace[name]

    return get, lambda: sorted({*namespace, *modules})
