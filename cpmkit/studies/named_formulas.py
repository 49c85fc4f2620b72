"""Named formulas of the table [let] of a study file, which replace their names in other formulas as text."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from keyword import iskeyword
from typing import Any
from unicodedata import normalize

from cpmkit.errors import SceneError, shown
from cpmkit.formulas.trees import CONSTANTS, COORDINATES, FUNCTIONS, MAX_FORMULA_CHARACTERS, formula_tree, parse

TAKEN_NAMES = {*COORDINATES, *CONSTANTS, *FUNCTIONS, "t"}
#: The variables of formulas anywhere in a scene: of position and time, and of parametric curves and surfaces.
FORMULA_VARIABLES = (*COORDINATES, "t", "u", "v")
#: Values of these keys are names or files, never formulas.
KEYS_WITHOUT_FORMULAS = ("kind", "name", "file", "values", "of", "closest", "scheme", "start")


def expand_names(table: Any) -> dict[str, str]:
    """Return the formulas of a table [let]; names of earlier formulas in a formula are replaced by their formulas.

    Raises
    ------
    SceneError
        If [let] is no table, a name is reserved or invalid, a value is no formula, or a formula becomes too long.

    Examples
    --------
    >>> expand_names({"r": "x + y", "double": "2*r"})
    {'r': 'x + y', 'double': '2*(x + y)'}
    """
    if not isinstance(table, dict):
        raise SceneError(f"[let] must be a table of names and formulas, got {shown(table)}.")
    known: dict[str, str] = {}
    for name, formula in table.items():
        if not name.isidentifier() or iskeyword(name) or normalize("NFKC", name) != name or name in TAKEN_NAMES:
            raise SceneError(
                f"the name {shown(name)} of [let] is reserved or invalid; use letters, digits and underscores."
            )
        text = str(formula) if isinstance(formula, (int, float)) and not isinstance(formula, bool) else formula
        if not isinstance(text, str):
            raise SceneError(f"{name} of [let] must be a formula or a number, got {shown(formula)}.")
        parse(text, f"{name} of [let]")
        known[name] = expand(text, known)
        formula_tree(known[name], FORMULA_VARIABLES, f"{name} of [let]")
    return known


def expand(formula: str, known: Mapping[str, str]) -> str:
    """Return ``formula`` with names replaced by the ``known`` formulas; text that does not parse is returned unchanged.

    Raises
    ------
    SceneError
        If the result is too long: each further name of [let] may double the length.
    """
    try:
        tree = parse(formula)
    except SceneError:  # refused where the formula is read, with the key's name; or it is no formula
        return formula
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id in known]
    length = len(formula) + sum(len(known[node.id]) for node in names)
    if length > MAX_FORMULA_CHARACTERS:
        raise SceneError(
            f"the formula {shown(formula)} becomes {length} characters long with the names of [let]; at most "
            f"{MAX_FORMULA_CHARACTERS} are accepted, use fewer."
        )
    lines = [line.encode() for line in formula.strip().split("\n")]  # columns are counted in bytes
    for node in sorted(names, key=lambda node: (node.lineno, node.col_offset), reverse=True):
        line, begin, end = lines[node.lineno - 1], node.col_offset, node.end_col_offset
        lines[node.lineno - 1] = line[:begin] + f"({known[node.id]})".encode() + line[end:]
    return b"\n".join(lines).decode() if names else formula


def expand_all(value: Any, known: Mapping[str, str]) -> Any:
    """Return a value of a study file with the names in all its formulas replaced by ``known`` formulas.

    The value may be a text, a list or a table, nested to any depth.
    """
    if isinstance(value, str):
        return expand(value, known)
    if isinstance(value, list):
        return [expand_all(entry, known) for entry in value]
    if isinstance(value, dict):
        return {
            key: _tables_in(entry, known) if key in KEYS_WITHOUT_FORMULAS else expand_all(entry, known)
            for key, entry in value.items()
        }
    return value


def _tables_in(value: Any, known: Mapping[str, str]) -> Any:
    """Return the value of a key that holds names or files, with formulas expanded only in tables inside a list of them.

    Such tables are the sources of a union.
    """
    if isinstance(value, list):
        return [_tables_in(entry, known) for entry in value]
    return expand_all(value, known) if isinstance(value, dict) else value
