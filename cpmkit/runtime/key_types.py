"""Whether the value of a key has the type that its factory declares."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from cpmkit.errors import SceneError, shown

#: How messages name the types that are checked; a parameter with any other is left to its factory.
TYPE_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text", NoneType: ""}


def check_types(make: Callable[..., Any], what: str, table: Mapping[str, Any]) -> None:
    """Refuse values that are not of the plain types that the parameters of ``make`` declare.

    Raises
    ------
    SceneError
        Naming the first such key and what it takes.
    """
    hints = _hints(make)
    for key, value in table.items():
        accepted = _plain(hints.get(key))
        if accepted and not any(_is(value, kind) for kind in accepted):
            names = " or ".join(TYPE_WORDS[kind] for kind in accepted if TYPE_WORDS[kind])
            place = what[:1].lower() + what[1:]
            raise SceneError(f"{key} of {place} must be {names}, got {shown(value)}.")


def _hints(make: Callable[..., Any]) -> dict[str, Any]:
    try:
        return get_type_hints(make)
    except (NameError, TypeError):  # a name that is imported for type checkers alone, or no function at all
        return {}


def _plain(hint: Any) -> tuple[type, ...]:
    """Return the types of a hint, none if there is another than the plain ones among them."""
    kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    return tuple(kinds) if all(isinstance(kind, type) and kind in TYPE_WORDS for kind in kinds) else ()


def _is(value: Any, kind: type) -> bool:
    import numpy as np  # not above: a list of the commands needs none of it

    if isinstance(value, (bool, np.bool_)):
        return kind is bool
    if kind is float:
        return isinstance(value, (int, float, np.integer, np.floating))
    return isinstance(value, (int, np.integer) if kind is int else kind)
