"""Conversion of the tables of scene files that describe conditions and data."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.files.array_files import read_array
from cpmkit.files.whole_files import find_file
from cpmkit.formulas.expressions import Expression, ReactionExpression, StateExpression
from cpmkit.manifold.abilities import HasValues
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.plugins import call_factory, check_accepted, factory
from cpmkit.runtime.arrays import number, whole
from cpmkit.runtime.messages import did_you_mean
from cpmkit.scene.conditions import Condition, Dirichlet, Neumann, Robin
from cpmkit.scene.data import Data, as_vector_field, is_sequence, read_formula
from cpmkit.scene.junction import Junction
from cpmkit.scene.member_data import MemberData
from cpmkit.scene.special_conditions import SimplySupported, Steklov, Transmission
from cpmkit.scene.special_data import VertexData

CONDITIONS: dict[str, Any] = {kind.kind: kind for kind in (Dirichlet, Neumann, Robin, Steklov, SimplySupported)}


def read_side(key: str, value: Any, dim: int, where: str) -> Any:
    """Return the ``value`` of the ``key`` of a [[boundary]]: of ``left_of`` unchanged, of other keys as a condition.

    A table ``across`` without a kind is a transmission. ``dim``, ``where`` and errors are as for
    :func:`read_condition`.
    """
    if key == "left_of":
        return value
    if key != "across":
        return read_condition(value, dim, where)
    table = as_table(value, where)
    if "kind" in table:
        return read_condition(table, dim, where)
    return call_factory(Transmission, where, _read_keys(table, dim, where))


def _read_keys(table: dict[str, Any], dim: int, where: str) -> dict[str, Any]:
    """Return a table whose values are read by :func:`read_data`; ``where`` is the table's name in messages."""
    return {key: read_data(value, dim, f"{key} of {where}") for key, value in table.items()}


def read_condition(table: Any, dim: int, where: str) -> Condition:
    """Return the condition that a table describes.

    A number, a formula or a list of them is a Dirichlet condition. A table has the kind as a key, with the datum or a
    list of the parameters as its value; for the condition of a plugin it has ``kind = NAME`` and the keys of that kind.
    It may also have an ``order``. Raises SceneError if the kind or its value is not accepted, InputError if a number or
    the order is not, and PluginError if no plugin has the kind. ``dim`` is the number of coordinates in
    formulas, ``where`` the name of the condition in messages.
    """
    if _is_datum(table):
        return Dirichlet(read_data(table, dim, where))
    table = as_table(table, where)
    order = {"order": whole(table.pop("order"), f"order of {where}", 1, 4)} if "order" in table else {}
    if isinstance(table.get("kind"), str):
        make = factory(table.pop("kind"), "cpmkit_conditions")
        condition: Condition = call_factory(make, where, {**_read_keys(table, dim, where), **order})
        return condition
    kinds = list(table)
    if "clamped" in kinds:
        raise SceneError(
            f"{where} is clamped, which gives Lap u no condition of its own and is not offered; use simply_supported."
        )
    if len(kinds) != 1 or kinds[0] not in CONDITIONS:
        hint = did_you_mean(kinds[0], CONDITIONS) if len(kinds) == 1 else ""
        raise SceneError(
            f"{where} must be one of {', '.join(f'{{ {kind} = ... }}' for kind in CONDITIONS)}, got "
            f"{shown(table)}{hint}."
        )
    built_in: Condition = CONDITIONS[kinds[0]](*_condition_arguments(kinds[0], table[kinds[0]], dim, where), **order)
    return built_in


def _condition_arguments(kind: str, value: Any, dim: int, where: str) -> list[Any]:
    """Return the positional arguments of a built-in kind of condition: none, a datum, or the entries of its list.

    ``value`` is that of the key ``kind``; ``dim`` and ``where`` are as for :func:`read_condition`. Raises SceneError if
    the value is not as the kind needs it, InputError if it has a number that is not finite.
    """
    parameters = [member for member in fields(CONDITIONS[kind]) if member.name != "order"]
    if not parameters:
        if value is not True:
            raise SceneError(f"{kind} of {where} must be true, got {shown(value)}; it has no data.")
        return []
    if len(parameters) == 1:
        return [read_data(value, dim, where)]
    if not is_sequence(value) or len(value) != len(parameters):
        names = ", ".join(member.name for member in parameters)
        raise SceneError(f"{kind} of {where} must be [{names}], got {shown(value)}.")
    return [
        number(entry, f"{member.name} of {where}") if member.type == "float" else read_data(entry, dim, where)
        for member, entry in zip(parameters, value, strict=True)
    ]


def _is_datum(value: Any) -> bool:
    """Return True for data: a number, a formula, a list or vertex data, but no table."""
    return isinstance(value, (int, float, str, list, VertexData, MemberData)) and not isinstance(value, bool)


def read_edge(table: Any, dim: int, where: str) -> Any:
    """Return the conditions of the edge that ``table`` describes, by the number of the loop if its keys are numbers.

    ``dim``, ``where`` and errors are as for :func:`read_condition`.
    """
    if not _is_datum(table):
        table = as_table(table, where)
        if table and all(re.fullmatch(r"[0-9]{1,6}", key) for key in table):
            return {int(key): _conditions_on_loop(value, dim, f"edge {key}") for key, value in table.items()}
        where = "edge"
    return _conditions_on_loop(table, dim, where)


def _conditions_on_loop(table: Any, dim: int, where: str) -> Any:
    """Return the condition of an edge loop, or the list of its parts by position.

    A part is a pair (condition, formula), or the condition alone for the rest. ``dim``, ``where`` and errors are as for
    :func:`read_condition`.
    """
    if not is_sequence(table) or not any(isinstance(entry, Mapping) for entry in table):  # data of several channels
        return read_condition(table, dim, where)
    parts = []
    for k, entry in enumerate(table):
        entry, formula = (dict(entry), entry.get("where")) if isinstance(entry, Mapping) else (entry, None)
        if formula is not None:
            del entry["where"]
        condition = read_condition(entry, dim, f"part {k} of {where}")
        parts.append(condition if formula is None else (condition, formula))
    return parts


def read_junctions(value: Any, where: str) -> Any:
    """Return the junctions that a table, or a list of tables with the ``members`` of each, describes.

    Raises SceneError, with the name ``where``, if a key or value is not accepted.
    """
    if not is_sequence(value):
        table = as_table(value, where)
        check_accepted(where, table, [member.name for member in fields(Junction)])
        return Junction(**table)
    found = {}
    for count, entry in enumerate(value, 1):
        label = f"entry {count} of {where}"
        table = as_table(entry, label)
        pair = table.pop("members", None)
        if not is_sequence(pair) or len(pair) != 2 or not all(type(one) is int for one in pair):
            raise SceneError(f"{label} needs members, the numbers of two members such as [0, 1], got {shown(pair)}.")
        found[tuple(pair)] = read_junctions(table, label)
    return found


def read_data(value: Any, dim: int, where: str) -> Data:
    """Return data of a scene file: formulas as functions, numbers as floats, vertex data as they are, lists by entry.

    Raises SceneError if the value is none of these, or a formula in ``dim`` coordinates does not parse; InputError if a
    number is not finite. ``where`` is the name of the value in messages.
    """
    match value:
        case str():
            function: Data = read_formula(Expression, value, where, dim)
            return function
        case VertexData() | MemberData():
            return value
        case list():
            return [read_data(entry, dim, where) for entry in value]
        case int() | float() if value is not True and value is not False:
            return number(value, where)
    raise SceneError(
        f"{where} must be a number, a formula, {{ values = 'FILE.npy' }}, or a list with one of them a channel, "
        f"got {shown(value)}."
    )


def _read_scalar(value: Any, dim: int, where: str) -> Any:
    """Return a scalar as :func:`read_data` does, with its errors; raise SceneError for a list."""
    if is_sequence(value):
        raise SceneError(f"{where} must be one number or formula, got {shown(value)}.")
    return read_data(value, dim, where)


def _read_tensor(value: Any, dim: int, where: str) -> Any:
    """Return a scalar or tensor as :func:`read_data` does; SceneError for a list that is not ``dim`` by ``dim``."""
    if is_sequence(value) and [is_sequence(row) and len(row) for row in value] != [dim] * dim:
        raise SceneError(
            f"{where} must be one number or formula, or a tensor, a list of {dim} lists of {dim} numbers or formulas, "
            f"got {shown(value)}."
        )
    return read_data(value, dim, where)


def read_vector(value: Any, dim: int, where: str, count: int | None = None) -> Any:
    """Return the function of points given as a list with a number or formula for each of ``count`` components.

    By default these are the ``dim`` coordinates of a vector. Raises InputError, with the name ``where``, if the list
    has another length, or an entry is not accepted or depends on t.
    """
    count = dim if count is None else count
    if not is_sequence(value) or len(value) != count:
        raise SceneError(f"{where} must be a list of {count} numbers or formulas, got {shown(value)}.")
    entries = [read_data(entry, dim, f"entry {number} of {where}") for number, entry in enumerate(value, 1)]
    return as_vector_field(entries, where)


#: Functions that read the keys of [problem], by the type of the field of the equation: they take the value, the
#: dimension of the space, and the name of the key in messages.
DATA_READERS: dict[str, Callable[..., Any]] = {
    "Data": read_data,
    "ChannelData": lambda value, dim, where: (
        [_read_scalar(entry, dim, f"entry {number} of {where}") for number, entry in enumerate(value, 1)]
        if is_sequence(value)
        else read_data(value, dim, where)
    ),
    "ScalarData": _read_scalar,
    "TensorData": _read_tensor,
    "VectorField": read_vector,
    "StateFunction": lambda value, dim, where: read_formula(StateExpression, value, where, dim),
    "Reaction": lambda value, dim, where: read_formula(
        ReactionExpression, tuple(value) if is_sequence(value) else (value,), where, dim
    ),
}


def as_table(value: Any, where: str) -> dict[str, Any]:
    """Return a shallow copy of the table ``value``; raise SceneError, with its name ``where``, if it is no dict."""
    if not isinstance(value, dict):
        raise SceneError(f"{where} must be a table, got {shown(value)}.")
    return dict(value)


def with_vertex_data(value: Any, folder: Path, carriers: Sequence[Carrier], where: str) -> Any:
    """Return a value of a scene file with each table ``{ values = "FILE.npy" }`` replaced by :class:`VertexData`.

    A table ``{ members = [...] }`` of data for each member of a union becomes :class:`MemberData`. Tables and lists are
    replaced at any depth; files are searched first in ``folder``. The rows of an array belong to the vertices of one of
    the ``carriers``: the carrier that the table names with ``of = NAME``, or the only one that has as many vertices as
    the array has rows. ``where`` is the name of the value in errors. Raises SceneError if an array fits no carrier, or
    several; InputError if a file is missing or does not contain an array of finite numbers.
    """
    match value:
        case dict() if "values" in value:
            return _vertex_data(value, folder, carriers, where)
        case {"members": list() as entries, **rest} if not rest:
            source = carriers[0][1]
            given = [with_vertex_data(entry, folder, carriers, where) for entry in entries]
            return MemberData(source, [read_data(each, source.dim, f"members of {where}") for each in given])
        case dict():
            return {key: with_vertex_data(entry, folder, carriers, f"{key} of {where}") for key, entry in value.items()}
        case list():
            return [with_vertex_data(entry, folder, carriers, where) for entry in value]
    return value


def _vertex_data(table: dict[str, Any], folder: Path, carriers: Sequence[Carrier], where: str) -> VertexData:
    """Return the vertex data of a table ``{ values = "FILE.npy" }``; arguments as for :func:`with_vertex_data`.

    Raises SceneError for other keys, or an array that fits no carrier, or several; InputError for a damaged file.
    """
    unknown = sorted(set(table) - {"values", "of"})
    names = [name for name, _ in carriers]
    if unknown or not isinstance(table["values"], str) or table.get("of", names[0]) not in names:
        raise SceneError(
            f"{where} must be {{ values = 'FILE.npy' }}, with of = {' or '.join(map(repr, names))} if need be, got "
            f"{shown(table)}."
        )
    array = read_array(find_file(table["values"], folder), "an array of numbers")
    sources = [carrier for carrier in carriers if table.get("of", carrier[0]) == carrier[0]]
    counts = {name: source.value_count for name, source in sources if isinstance(source, HasValues)}
    fitting = [name for name, count in counts.items() if np.shape(array)[:1] == (count,)]
    if len(fitting) != 1:
        rows = f"{shown(table['values'])} of {where} has the shape {array.shape}"
        if fitting:
            raise SceneError(f"{rows}, which fits {' and '.join(fitting)}; add of = {fitting[0]!r} or another of them.")
        known = " and ".join(f"{name} has {count} vertices" for name, count in counts.items())
        raise SceneError(f"{rows}, where {known or f'{names[0]} carries no values'}; give one row a vertex.")
    return VertexData(dict(sources)[fitting[0]], array)


#: The name of a part of a scene in messages, and the source of the part, whose vertices may have data.
Carrier = tuple[str, ClosestPointSource]


def list_of_tables(tables: Mapping[str, Any], name: str) -> list[tuple[int, dict[str, Any]]]:
    """Return pairs (number from 1, copy of the table) for the list [[name]] of ``tables``; empty without the list.

    Raises SceneError if the entry ``name`` is not a list of tables.
    """
    entries = tables.get(name, [])
    if not is_sequence(entries):
        raise SceneError(f"{name} must be a list of tables, written [[{name}]].")
    return [(number, as_table(table, f"[[{name}]] {number}")) for number, table in enumerate(entries, 1)]
