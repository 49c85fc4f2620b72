"""Plain values from JSON and TOML files, checked for type and range before they are used."""

from __future__ import annotations

import math
import tomllib
import unicodedata
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from cpmkit.errors import InputError, SceneError, shown

Made = TypeVar("Made")


@dataclass(frozen=True)
class ValueKind:
    """A kind of plain values (numbers, text, lists, tables), defined by a check; for data read from files."""

    words: str  #: Its name in errors: "a whole number of at least 0".
    accepts: Callable[[Any], bool]  #: Returns whether a value is of the kind.


def numbers(least: float = -math.inf, most: float = math.inf) -> ValueKind:
    """Return the kind of finite numbers from ``least`` to ``most``, without true and false."""

    def accepts(value: Any) -> bool:
        """Return whether a value is a finite number from ``least`` to ``most``."""
        try:
            return type(value) in (int, float) and math.isfinite(value) and least <= value <= most
        except OverflowError:  # a whole number of hundreds of digits
            return False

    return ValueKind(f"a finite number{_range_text(least, most)}", accepts)


def whole_numbers(least: float = -math.inf, most: float = math.inf) -> ValueKind:
    """Return the kind of integers from ``least`` to ``most``, without true and false."""
    return ValueKind(
        f"a whole number{_range_text(least, most)}", lambda value: type(value) is int and least <= value <= most
    )


def choice_of(*words: str) -> ValueKind:
    """Return the kind of texts that are one of ``words``."""
    return ValueKind(f"one of {', '.join(words)}", lambda value: type(value) is str and value in words)


TEXT = ValueKind("text", lambda value: type(value) is str)
FLAG = ValueKind("true or false", lambda value: type(value) is bool)
ANYTHING = ValueKind("anything", lambda _: True)


def or_none(kind: ValueKind) -> ValueKind:
    """Return the kind of values that are of ``kind`` or null."""
    return ValueKind(f"{kind.words}, or null", lambda value: value is None or kind.accepts(value))


def list_of(kind: ValueKind) -> ValueKind:
    """Return the kind of lists whose entries are of ``kind``."""
    return ValueKind(
        f"a list with {kind.words} each", lambda value: isinstance(value, list) and all(map(kind.accepts, value))
    )


def table_of(kind: ValueKind) -> ValueKind:
    """Return the kind of tables whose values are of ``kind``."""
    return ValueKind(
        f"a table with {kind.words} each",
        lambda value: isinstance(value, Mapping) and all(map(kind.accepts, value.values())),
    )


def check_fields(
    table: Any, needed: Mapping[str, ValueKind], where: str, optional: Mapping[str, ValueKind] | None = None
) -> Mapping[str, Any]:
    """Return ``table`` if it has all ``needed`` fields, and these and its ``optional`` fields are of their kinds.

    Other fields are allowed. Raises InputError, with the name ``where``, if ``table`` is no table, or a field is
    missing or of another kind.
    """
    if not isinstance(table, Mapping):
        raise InputError(f"{where} must be a table, got {shown(table)}.")
    for name, kind in {**needed, **(optional or {})}.items():
        if name not in table and name in needed:
            raise InputError(f"{where} lacks {name!r}, which must be {kind.words}.")
        if name in table and not kind.accepts(table[name]):
            raise InputError(f"{name} of {where} must be {kind.words}, got {shown(table[name])}.")
    return table


def record_from_table(record: type[Made], saved: Any, where: str) -> Made:
    """Return an object of a dataclass with plain fields from the table as which it was saved; unknown keys are ignored.

    Lists become tuples. Raises InputError, with the name ``where``, if ``saved`` is no table, a field without a default
    is missing, or a value is not of the field's type (integers must not be negative); TypeError if a field's type is
    not of plain values.
    """
    hints = get_type_hints(record)
    kinds = {field.name: _kind(hints[field.name]) for field in fields(record)}  # type: ignore[arg-type] # a dataclass
    free = {
        field.name
        for field in fields(record)  # type: ignore[arg-type]
        if not field.init or field.default is not MISSING or field.default_factory is not MISSING
    }
    needed = {name: kind for name, kind in kinds.items() if name not in free}
    check_fields(saved, needed, where, kinds)
    values = {name: saved[name] for name in kinds if name in saved}
    return record(**{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})


def _kind(hint: Any) -> ValueKind:
    """Return the kind of plain values that ``hint`` accepts, of a tuple by its first type; else raise TypeError."""
    plain = {str: TEXT, bool: FLAG, int: whole_numbers(0), float: numbers()}
    if hint in plain:
        return plain[hint]
    if get_origin(hint) is Literal:
        return choice_of(*get_args(hint))
    arguments = [_kind(argument) for argument in get_args(hint) if argument not in (NoneType, Ellipsis)]
    if get_origin(hint) is tuple:
        return list_of(arguments[0])
    if get_origin(hint) in (Union, UnionType) and len(arguments) == 1:
        return or_none(arguments[0])
    if get_origin(hint) is not None and issubclass(get_origin(hint), Mapping):
        return table_of(arguments[-1])
    raise TypeError(f"{hint} is not the type of a plain value")


def _range_text(least: float, most: float) -> str:
    """Return the bounds in words, such as " of at least 0 and at most 9"; infinite bounds are left out."""
    low = f" of at least {least:g}" if math.isfinite(least) else ""
    return f"{low}{' and' if low and math.isfinite(most) else ''}{f' at most {most:g}' if math.isfinite(most) else ''}"


Parsed = TypeVar("Parsed")

#: Most bytes of a TOML file; larger data belong into array files.
MOST_TOML_BYTES = 16 * 2**20
#: Deepest nesting of tables and lists.
DEEPEST_NESTING = 40
#: TOML's own bound on whole numbers.
WHOLE_NUMBER_BOUND = 2**63


def read_toml(path: str | Path, make: Callable[[dict[str, Any], Path], Parsed], label: str, like: str) -> Parsed:
    """Return the result of ``make`` for the tables and the path of a TOML file.

    An error calls the file ``label``, such as "scene file", and ends with ``like``, such as ", such as a.toml". Raises
    SceneError if the file is missing, too large or does not parse, nests tables too deeply, or holds a control
    character or a whole number beyond 64 bits. InputErrors of ``make`` are raised with the file's name.
    """
    path = Path(path)
    tables = _read_tables(path, label, like)
    try:
        _check_values(tables)
        return make(tables, path)
    except InputError as error:  # a SceneError is one
        raise type(error)(f"{path.name}: {error}") from error


def _read_tables(path: Path, label: str, like: str) -> dict[str, Any]:
    """Return the tables of a TOML file; raise SceneError if it is missing, too large or does not parse."""
    try:
        if not path.is_file():
            raise SceneError(f"no {label} {shown(str(path))}; give the path of a TOML file{like}.")
        with path.open("rb") as file:
            content = file.read(MOST_TOML_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise SceneError(f"the {label} {shown(str(path))} cannot be read: {reason}.") from error
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
    """Raise SceneError if tables are nested too deeply, or a number exceeds 64 bits, or text has control characters."""
    waiting: list[tuple[str, Any, int]] = [("the file", tables, 0)]
    while waiting:
        where, value, depth = waiting.pop()
        if depth > DEEPEST_NESTING:
            raise SceneError(f"{where} nests more than {DEEPEST_NESTING} tables or lists in each other.")
        if type(value) is int and not -WHOLE_NUMBER_BOUND <= value < WHOLE_NUMBER_BOUND:
            raise SceneError(f"{where} is a whole number beyond 9.2e18; write it with an exponent, such as 1e20.")
        if type(value) is str:
            _check_text(value, where)
        waiting += [(name, entry, depth + 1) for name, entry in _entries(value, where)]


def _entries(value: Any, where: str) -> Iterator[tuple[str, Any]]:
    """Yield the entries of a table or list, each after the words that name it in errors; none for other values.

    Raises SceneError if a key holds a control character.
    """
    if isinstance(value, dict):
        for key, entry in value.items():
            _check_text(key, f"a key of {where}")
            yield f"the key {key[:40]!r}", entry
    elif isinstance(value, list):
        for entry in value:
            yield (where if where.startswith("an entry") else f"an entry of {where}"), entry


def _check_text(text: str, where: str) -> None:
    """Raise SceneError, with the name ``where``, if ``text`` has control characters other than newline and tab."""
    if text.isprintable():
        return
    control = next((letter for letter in text if unicodedata.category(letter) == "Cc" and letter not in "\n\t"), None)
    if control is not None:
        raise SceneError(f"{where} holds the control character {control!r}; leave it out.")
