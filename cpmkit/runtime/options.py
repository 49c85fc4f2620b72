"""Options, each declared once with its name, default, check and description.

The declaration is a field of a frozen dataclass. Signatures, docstrings, keys of files, saved values and the options
that studies vary are derived from it, so that a new field is a new option everywhere.
"""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.runtime.messages import did_you_mean

OptionsClass = TypeVar("OptionsClass", bound="DeclaredOptions")
Function = TypeVar("Function", bound=Callable[..., Any])

#: Key of a field's metadata under which the declaration of the option is stored.
OPTION_KEY = "option"


@dataclass(frozen=True)
class Option:
    """The declaration of an option, in addition to its name, type and default."""

    summary: str  #: Sentences that describe its effect and its accepted values.
    #: Takes a value and the option's name in messages; returns the value to store, or raises an InputError.
    check: Callable[[Any, str], Any]
    plural: str = ""  #: Key of a study under which the values to try are listed.
    #: Instead of such a list: the value of the option for each method of a study that sets it.
    methods: Mapping[str, Any] = field(default_factory=dict)

    def accepts(self, value: Any) -> bool:
        """Return whether a value passes the check, that is, whether the check raises no InputError."""
        try:
            self.check(value, "")
        except InputError:
            return False
        return True


def option(default: Any, summary: str, check: Callable[[Any, str], Any] = lambda value, _: value, **study: Any) -> Any:
    """Return the dataclass field of an option; parameters are those of :class:`Option`, any value passes by default."""
    return field(default=default, metadata={OPTION_KEY: Option(summary, check, **study)})


@dataclass(frozen=True)
class DeclaredOptions:
    """Base class of groups of options, whose constructor checks all values; these are numbers, flags or text."""

    def __post_init__(self) -> None:
        for name, declaration in declared_options(type(self)).items():
            object.__setattr__(self, name, declaration.check(getattr(self, name), name))

    def as_dict(self) -> dict[str, Any]:
        """Return the values of the options by name."""
        return {name: getattr(self, name) for name in declared_options(type(self))}


def declared_options(kind: type[DeclaredOptions]) -> dict[str, Option]:
    """Return the options that the class ``kind`` declares, by name."""
    return {member.name: member.metadata[OPTION_KEY] for member in fields(kind) if OPTION_KEY in member.metadata}


def either_option(first: Option, second: Option) -> Option:
    """Return the declaration of an option of two classes: ``second`` checks what it accepts, ``first`` the rest."""

    def check(value: Any, label: str) -> Any:
        return (second if second.accepts(value) else first).check(value, label)

    methods = {**first.methods, **second.methods}
    return Option(f"{first.summary} {second.summary}", check, first.plural or second.plural, methods)


def split_options(
    kind: type[OptionsClass], keywords: Mapping[str, Any], **further: Any
) -> tuple[OptionsClass, dict[str, Any]]:
    """Return an instance of ``kind`` made of the ``keywords`` that are options of ``kind``, and the other keywords.

    ``further`` are more fields of the instance; a keyword of the same name is returned among the other keywords.
    Raises InputError if the value of an option is not accepted.
    """
    selected = {name: keywords[name] for name in declared_options(kind) if name in keywords and name not in further}
    return kind(**selected, **further), {name: value for name, value in keywords.items() if name not in selected}


def document_options(*kinds: type[DeclaredOptions]) -> Callable[[Function], Function]:
    """Return a decorator that inserts options before ``**options`` in signature and docstring, in place.

    If several of the ``kinds`` declare an option, all its summaries are shown, and ``...`` as its default. Options that
    are parameters of the function already are left out.
    """

    def document(function: Function) -> Function:
        """Insert the options into docstring and signature of ``function``, and return it."""
        signature = inspect.signature(function)
        *parameters, rest = signature.parameters.values()
        members: dict[str, list[Any]] = {}
        for member in (member for kind in kinds for member in fields(kind) if OPTION_KEY in member.metadata):
            members.setdefault(member.name, []).append(member)
        for name in signature.parameters:
            members.pop(name, None)
        shown_options, lines = [], []
        for name, (first, *others) in members.items():
            default = ... if others else first.default
            kind = inspect.Parameter.KEYWORD_ONLY
            shown_options.append(inspect.Parameter(name, kind, default=default, annotation=first.type))
            summaries = " ".join(member.metadata[OPTION_KEY].summary for member in (first, *others))
            text = textwrap.fill(summaries, width=114, initial_indent="    ", subsequent_indent="    ")
            lines.append(f"{name} : {first.type}\n{text}\n")
        doc = inspect.cleandoc(function.__doc__ or "")
        function.__doc__ = doc.replace("\n**options\n", f"\n{''.join(lines)}**options\n")
        vars(function).update(__signature__=signature.replace(parameters=[*parameters, *shown_options, rest]))
        return function

    return document


#: Names in messages of the types that are checked; a factory itself checks parameters of other types.
TYPE_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text", NoneType: ""}


def check_key_types(make: Callable[..., Any], label: str, table: Mapping[str, Any]) -> None:
    """Raise if a value does not have one of the plain types that the factory ``make`` declares for this parameter.

    ``table`` has the values by parameter name. Raises SceneError for the first wrong value; the message calls the table
    ``label`` and states the accepted types. Parameters with other annotations, or none, are not checked.
    """
    try:
        hints = get_type_hints(make)
    except (NameError, TypeError):  # a name that is imported for type checkers alone, or no function at all
        hints = {}
    import numpy as np  # the list of commands starts without numpy

    numbers = {int: (int, np.integer), float: (int, float, np.integer, np.floating)}
    for key, value in table.items():
        hint = hints.get(key)
        accepted = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
        if not all(isinstance(kind, type) and kind in TYPE_WORDS for kind in accepted):
            continue
        kinds = [bool] if isinstance(value, (bool, np.bool_)) else [kind for kind in accepted if kind is not bool]
        if not any(kind in accepted and isinstance(value, numbers.get(kind, kind)) for kind in kinds):
            names = " or ".join(TYPE_WORDS[kind] for kind in accepted if TYPE_WORDS[kind])
            place = label[:1].lower() + label[1:]
            raise SceneError(f"{key} of {place} must be {names}, got {shown(value)}.")


def check_one_of(value: object, accepted: Sequence[str], label: str) -> None:
    """Raise SceneError if ``value`` is none of the ``accepted``; ``label`` is its name in the message."""
    if value not in accepted:
        hint = did_you_mean(value, accepted)
        raise SceneError(f"{label} must be {' or '.join(map(repr, accepted))}, got {shown(value)}{hint}.")


def one_of(*names: str) -> Callable[[Any, str], str]:
    """Return a check ``(value, label)`` of an option: it returns one of ``names``, and raises InputError for others."""

    def check(value: Any, label: str) -> str:
        if not isinstance(value, str) or value not in names:
            listed = f"{', '.join(map(repr, names[:-1]))} or {names[-1]!r}"
            raise InputError(f"{label} must be {listed}, got {shown(value)}.")
        return value

    return check
