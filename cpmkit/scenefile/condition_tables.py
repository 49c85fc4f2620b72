"""Conditions and data in scene files: tables of TOML made into what a scene holds."""

from __future__ import annotations

import re
from typing import Any

from cpmkit.errors import SceneError, shown
from cpmkit.formulas.expressions import Expression
from cpmkit.plugins import call
from cpmkit.runtime.arrays import number, whole
from cpmkit.runtime.suggestions import did_you_mean
from cpmkit.scene.condition import Condition
from cpmkit.scene.conditions import Dirichlet, Neumann, Robin
from cpmkit.scene.data import Data
from cpmkit.scene.special_conditions import SimplySupported, Steklov, Transmission
from cpmkit.scene.vertex_data import VertexData

#: The number of a rim.
LOOP = re.compile(r"[0-9]{1,6}")
CONDITIONS: dict[str, Any] = {
    "dirichlet": Dirichlet,
    "neumann": Neumann,
    "robin": Robin,
    "steklov": Steklov,
    "simply_supported": SimplySupported,
}


def read_side(key: str, value: Any, dim: int, where: str) -> Any:
    """Return what a boundary's key for its sides holds: a point, a transmission, or a condition."""
    if key == "left_of":
        return value
    if key != "across":
        return read_condition(value, dim, where)
    table = as_table(value, where)
    for name in ("jump", "flux", "left", "right"):
        if name in table:
            table[name] = read_data(table[name], dim, f"{name} of {where}")
    return call(Transmission, where, table)


def read_condition(table: Any, dim: int, where: str) -> Condition:
    """Return the condition that a table with one kind, and perhaps an order, describes.

    Raises
    ------
    SceneError
        If the kind or its value is not accepted.
    """
    table = as_table(table, where)
    order = table.pop("order", None)
    if order is not None:
        whole(order, f"order of {where}", 1, 4)
    kinds = list(table)
    if "clamped" in kinds:
        raise SceneError(
            f"{where} is clamped, which gives Lap u no condition of its own and is not offered; use simply_supported."
        )
    if len(kinds) != 1 or kinds[0] not in CONDITIONS:
        near = did_you_mean(kinds[0], CONDITIONS) if len(kinds) == 1 else ""
        raise SceneError(
            f"{where} must be one of {', '.join(f'{{ {kind} = ... }}' for kind in CONDITIONS)}, got "
            f"{shown(table)}{near}."
        )
    value = table[kinds[0]]
    if kinds[0] == "robin":
        if not isinstance(value, list) or len(value) != 3:
            raise SceneError(f"robin of {where} must be [alpha, beta, gamma], got {shown(value)}.")
        beta: Any = read_data(value[1], dim, where)
        alpha = number(value[0], f"alpha of {where}")
        return Robin(alpha, beta, read_data(value[2], dim, where), order=order)
    if kinds[0] == "steklov":
        if value is not True:
            raise SceneError(f"steklov of {where} must be true, got {shown(value)}; it has no data.")
        return Steklov(order=order)
    if kinds[0] == "simply_supported":
        if not isinstance(value, list) or len(value) != 2:
            raise SceneError(f"simply_supported of {where} must be [u, Lap u], got {shown(value)}.")
        return SimplySupported(read_data(value[0], dim, where), read_data(value[1], dim, where), order=order)
    made: Condition = CONDITIONS[kinds[0]](read_data(value, dim, where), order=order)
    return made


def read_edge(table: Any, where: str) -> Any:
    """Return a function of the dimension that makes the edge's condition, or one a loop number."""
    table = as_table(table, where)
    if table and all(LOOP.fullmatch(key) for key in table):
        return lambda dim: {int(key): read_condition(value, dim, f"edge {key}") for key, value in table.items()}
    return lambda dim: read_condition(table, dim, "edge")


def read_data(value: Any, dim: int, where: str) -> Data:
    """Return numbers and per-vertex data as they are, formulas as functions, and lists of them entry by entry."""
    if isinstance(value, str):
        try:
            return Expression(value, dim)
        except SceneError as error:
            raise SceneError(f"{where}: {error}") from error
    if isinstance(value, VertexData):
        return value
    if isinstance(value, list):
        return [read_data(entry, dim, where) for entry in value]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SceneError(
            f"{where} must be a number, a formula, {{ values = 'FILE.npy' }}, or a list with one of them a channel, "
            f"got {shown(value)}."
        )
    return number(value, where)


def as_table(value: Any, where: str) -> dict[str, Any]:
    """Return a copy of ``value`` if it is a table; ``where`` names it in the error."""
    if not isinstance(value, dict):
        raise SceneError(f"{where} must be a table, got {shown(value)}.")
    return dict(value)
