"""Named formulas of a study file, [let], put in place of their names. Nothing is evaluated."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any

from cpmkit.errors import SceneError
from cpmkit.expressions import CONSTANTS, COORDINATES, FUNCTIONS

TAKEN = {*COORDINATES, *CONSTANTS, *FUNCTIONS, "t"}
#: Values of these keys are names or files, never formulas.
NO_FORMULAS = ("kind", "name", "file", "scheme", "start")
#: A formula that would become longer than this many characters is refused: each name may double it.
LONGEST = 20_000


def expand_names(table: Mapping[str, Any]) -> dict[str, str]:
    """Return the formulas of a table [let], each with those before it in place of their names.

    Raises
    ------
    SceneError
        If a name is taken or no name, a value is no formula, or a formula becomes too long.

    Examples
    --------
    >>> expand_names({"r": "x + y", "double": "2*r"})
    {'r': 'x + y', 'double': '2 * (x + y)'}
    """
    known: dict[str, str] = {}
    for name, formula in table.items():
        if not name.isidentifier() or name in TAKEN:
            raise SceneError(f"the name {name!r} of [let] is taken or no name; use letters, digits and underscores.")
        text = str(formula) if isinstance(formula, (int, float)) and not isinstance(formula, bool) else formula
        if not isinstance(text, str):
            raise SceneError(f"{name} of [let] must be a formula or a number, got {formula!r}.")
        known[name] = expand(text, known)
    return known


def expand(formula: str, known: Mapping[str, str]) -> str:
    """Return ``formula`` with the ``known`` formulas in place of their names; what does not parse stays as it is.

    Raises
    ------
    SceneError
        If it becomes too long.
    """
    try:
        tree = ast.parse(formula, mode="eval")
    except SyntaxError:
        return formula
    if not {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} & known.keys():
        return formula
    text = ast.unparse(_Substitution(known).visit(tree))
    if len(text) > LONGEST:
        raise SceneError(
            f"the formula {formula!r} becomes longer than {LONGEST} characters with the names of [let]; use fewer."
        )
    return text


def expand_all(value: Any, known: Mapping[str, str]) -> Any:
    """Return tables and lists with the ``known`` formulas in place of their names in every formula."""
    if isinstance(value, str):
        return expand(value, known)
    if isinstance(value, list):
        return [expand_all(entry, known) for entry in value]
    if isinstance(value, dict):
        return {key: entry if key in NO_FORMULAS else expand_all(entry, known) for key, entry in value.items()}
    return value


class _Substitution(ast.NodeTransformer):
    """Replaces names by the formulas that they stand for."""

    def __init__(self, known: Mapping[str, str]) -> None:
        self._known = known

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """Return the formula in place of its name; functions are names too, and are never replaced."""
        formula = self._known.get(node.id)
        return node if formula is None else ast.parse(formula, mode="eval").body
