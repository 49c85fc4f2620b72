"""Public names imported on first use, and renamed ones: the old name works for one release and warns of the new."""

from __future__ import annotations

import functools
import re
import sys
import warnings
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, TypeVar

from cpmkit.errors import CpmkitWarning, InputError


def names_by_use(package: str) -> dict[str, dict[str, str]]:
    """Return the public names of a package and the modules that define them, by use: ``{use: {name: module}}``.

    Public names are those that the source of ``package`` imports as themselves (``a as a``) in its blocks ``if
    TYPE_CHECKING:``. The comment in the first line of a block is the use, "" without a comment.
    """
    loader: Any = sys.modules[package].__loader__
    blocks = re.findall(r"^if TYPE_CHECKING:(?:  # (.*))?\n((?: .*\n)+)", loader.get_source(package), re.MULTILINE)
    imports = {use: re.findall(r"from (\S+) import (\w+) as \2\n", block) for use, block in blocks}
    return {use: {name: module for module, name in pairs} for use, pairs in imports.items()}


def lazy_names(
    package: str, uses: Mapping[str, Mapping[str, str]], advice: str = ""
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return the functions ``__getattr__`` and ``__dir__`` of a package whose names are imported on first use.

    ``package``: name of the package.
    ``uses``: its names, as :func:`names_by_use` returns them.
    ``advice``: end of the message of the AttributeError for another name.
    """
    namespace = vars(sys.modules[package])
    modules = {name: module for names in uses.values() for name, module in names.items()}

    def get(name: str) -> Any:
        """Return the object ``name``, imported and stored in the package; raise AttributeError if it is not listed."""
        if name not in modules:
            message = f"module {package!r} has no attribute {name!r}{advice}"
            raise AttributeError(message, name=name, obj=sys.modules[package])
        module = import_module(modules[name])
        namespace[name] = module if modules[name] == f"{package}.{name}" else getattr(module, name)
        return namespace[name]

    return get, lambda: sorted({*namespace, *modules})


Function = TypeVar("Function", bound=Callable[..., Any])


class RenamedWarning(CpmkitWarning, DeprecationWarning):
    """A public name was renamed; the command line shows it as it shows the warnings of a solution."""


def warn_renamed(old: str, new: str) -> None:
    """Issue a RenamedWarning that ``old`` is now called ``new``, attributed to the nearest caller outside cpmkit."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).partition(".")[0] == "cpmkit":
        frame, level = frame.f_back, level + 1
    sentence = f"{old} is now called {new}; the old name goes with the next release."
    warnings.warn(sentence, RenamedWarning, stacklevel=level)


def deprecated_names(
    module: str, new_names: Mapping[str, str], otherwise: Callable[[str], Any] | None = None
) -> Callable[[str], Any]:
    """Return a function ``__getattr__`` for a module in which public names were renamed or moved.

    ``module``: the module's ``__name__``.
    ``new_names``: for each old name the new, with the module that defines it: ``"cpmkit.scene.scene.Scene"``.
    ``otherwise``: the module's ``__getattr__`` for all other names; without it they raise AttributeError.
    """

    def get(name: str) -> Any:
        """Return the object with the old ``name`` and warn with RenamedWarning, or return ``otherwise(name)``."""
        if name in new_names:
            place, _, new = new_names[name].rpartition(".")
            warn_renamed(f"{module}.{name}", new_names[name])
            return getattr(import_module(place), new)
        if otherwise is not None:
            return otherwise(name)
        raise AttributeError(f"module {module!r} has no attribute {name!r}", name=name)

    return get


class DeprecatedMember:
    """Descriptor for the old name of a method, property or field: ``put_back = DeprecatedMember("project")``."""

    def __init__(self, new: str) -> None:
        self.new = new

    def __set_name__(self, owner: type, name: str) -> None:
        self.names = f"{owner.__name__}.{name}", f"{owner.__name__}.{self.new}"

    def __get__(self, instance: object, owner: type | None = None) -> Any:
        warn_renamed(*self.names)
        return getattr(owner if instance is None else instance, self.new)


def current_keywords(keywords: Mapping[str, Any], new_names: Mapping[str, str]) -> dict[str, Any]:
    """Return keywords, or keys of a file, under their new names, and issue a RenamedWarning for each old name.

    ``new_names`` has the new name of each old name. Raises InputError if a value is given under both names.
    """
    current: dict[str, Any] = {}
    for name, value in keywords.items():
        new = new_names.get(name, name)
        if new != name:
            warn_renamed(f"{name}=", f"{new}=")
            if new in keywords:
                raise InputError(f"{new} is given twice, once under its old name {name}; leave {name} out.")
        current[new] = value
    return current


def deprecated_keywords(**new_names: str) -> Callable[[Function], Function]:
    """Return a decorator with which a function also accepts old keywords, with a RenamedWarning: ``old="new"``."""

    def decorate(function: Function) -> Function:
        """Return the function, called with old keywords replaced by new ones."""

        @functools.wraps(function)
        def call(*args: Any, **keywords: Any) -> Any:
            return function(*args, **current_keywords(keywords, new_names))

        return call  # type: ignore[return-value]

    return decorate
