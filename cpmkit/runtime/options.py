"""Options, each declared once: its name, its default, what is accepted, and the sentence that documents it.

A frozen dataclass is the declaration. Signatures, docstrings, keys of files, what is saved and what studies vary are
read off it, so that one more field is one more option everywhere.
"""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import partial
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from cpmkit.errors import InputError, SceneError, shown

Made = TypeVar("Made", bound="Declared")
Function = TypeVar("Function", bound=Callable[..., Any])

#: Under this key a field's metadata hold what is declared of the option.
OPTION_KEY = "option"
_filled = partial(textwrap.fill, width=114, initial_indent="    ", subsequent_indent="    ")


@dataclass(frozen=True)
class Option:
    """What is declared of an option, beside its name, its type and its default.

    Attributes
    ----------
    told : str
        What it does and what it accepts, in sentences.
    check : callable
        Given a value and what to call it; returns the value as it is kept, or raises an InputError.
    plural : str
        Under this key a study lists the values that it tries.
    methods : mapping
        Instead of a list: the methods of a study that set the option, and to what.
    """

    told: str
    check: Callable[[Any, str], Any]
    plural: str = ""
    methods: Mapping[str, Any] = field(default_factory=dict)

    def accepts(self, value: Any) -> bool:
        """Tell whether a value passes the check."""
        try:
            self.check(value, "")
        except InputError:
            return False
        return True


def option(default: Any, told: str, check: Callable[[Any, str], Any] = lambda value, _: value, **study: Any) -> Any:
    """Return the field of an option; ``study`` is its ``plural`` or its ``methods``."""
    return field(default=default, metadata={OPTION_KEY: Option(told, check, **study)})


@dataclass(frozen=True)
class Declared:
    """Options that belong together. All are checked when they are made; their values are numbers, flags or text."""

    def __post_init__(self) -> None:
        for name, one in declared(type(self)).items():
            object.__setattr__(self, name, one.check(getattr(self, name), name))

    def as_dict(self) -> dict[str, Any]:
        """Return the values of the options by their names."""
        return {name: getattr(self, name) for name in declared(type(self))}


def declared(kind: type[Declared]) -> dict[str, Option]:
    """Return the options that a class declares, by their names."""
    return {one.name: one.metadata[OPTION_KEY] for one in fields(kind) if OPTION_KEY in one.metadata}


def either(first: Option, second: Option) -> Option:
    """Return what two kinds declare of an option of one name: a value is accepted if one of them accepts it."""

    def check(value: Any, what: str) -> Any:
        return (second if second.accepts(value) else first).check(value, what)

    methods = {**first.methods, **second.methods}
    return Option(f"{first.told} {second.told}", check, first.plural or second.plural, methods)


def take(kind: type[Made], given: Mapping[str, Any], **further: Any) -> tuple[Made, dict[str, Any]]:
    """Return ``kind`` made of what is given of its options, and of ``further`` fields, and what else is given."""
    own = {name: given[name] for name in declared(kind) if name in given and name not in further}
    return kind(**own, **further), {name: value for name, value in given.items() if name not in own}


def showing(*kinds: type[Declared]) -> Callable[[Function], Function]:
    """Let ``**options`` of a function show as the options that ``kinds`` declare, in its signature and docstring.

    Where several declare one name, all that is told of it is shown, and ``...`` as its default.
    """

    def show(function: Function) -> Function:
        signature = inspect.signature(function)
        *kept, rest = signature.parameters.values()
        own: dict[str, list[Any]] = {}
        for one in (one for kind in kinds for one in fields(kind) if OPTION_KEY in one.metadata):
            own.setdefault(one.name, []).append(one)
        shown = [
            inspect.Parameter(
                name,
                inspect.Parameter.KEYWORD_ONLY,
                default=one.default if not others else ...,
                annotation=one.type,
            )
            for name, (one, *others) in own.items()
            if name not in signature.parameters
        ]
        words = {name: " ".join(one.metadata[OPTION_KEY].told for one in all_of) for name, all_of in own.items()}
        told = [f"{one.name} : {one.annotation}\n{_filled(words[one.name])}\n" for one in shown]
        doc = inspect.cleandoc(function.__doc__ or "")
        function.__doc__ = doc.replace("\n**options\n", f"\n{''.join(told)}**options\n")
        vars(function).update(__signature__=signature.replace(parameters=[*kept, *shown, rest]))
        return function

    return show


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
