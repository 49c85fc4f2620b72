"""Parsing of formulas: text to a syntax tree of limited size that contains only available names and operations."""

from __future__ import annotations

import ast
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.runtime.messages import did_you_mean

#: Names of the coordinates.
COORDINATES = ("x", "y", "z")
#: Values of the constants.
CONSTANTS = {"pi": np.pi, "e": np.e}
#: The functions of formulas, with their numbers of arguments.
FUNCTIONS = {
    "sin": 1, "cos": 1, "tan": 1, "arcsin": 1, "arccos": 1, "arctan": 1, "arctan2": 2, "sinh": 1, "cosh": 1, "tanh": 1,
    "exp": 1, "log": 1, "sqrt": 1, "abs": 1, "sign": 1, "floor": 1, "minimum": 2, "maximum": 2, "hypot": 2,
}  # fmt: skip
#: The operators of formulas with their functions in NumPy; a > b is computed as b < a.
OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "add", ast.Sub: "subtract", ast.Mult: "multiply", ast.Div: "divide", ast.Mod: "mod", ast.Pow: "power",
    ast.USub: "negative", ast.UAdd: "positive", ast.Lt: "less", ast.LtE: "less_equal", ast.Gt: "less",
    ast.GtE: "less_equal",
}  # fmt: skip
#: Longer formulas are refused before they are parsed.
MAX_FORMULA_CHARACTERS = 20_000
#: Formulas with more numbers, names and operations are refused.
MAX_FORMULA_PARTS = 4_000


def formula_tree(text: Any, names: Sequence[str], label: str = "the formula") -> ast.expr:
    """Return the checked syntax tree of a formula in the variables ``names``.

    Parameters
    ----------
    text : str
        The formula.
    names : sequence of str
        The variables that it may use, in addition to the constants pi and e.
    label : str
        Name of the formula in messages.

    Raises
    ------
    SceneError
        If ``text`` is not text, is too long or nested too deeply, does not parse, or uses a name, an operation, a
        number of arguments or a number that is not available.
    """
    if not isinstance(text, str):
        raise SceneError(f"{label} must be a formula such as 'x**2 + y', got {shown(text)}.")
    tree = parse(text, label)
    parts = [node for node in ast.walk(tree) if isinstance(node, ast.expr)]
    if len(parts) > MAX_FORMULA_PARTS:
        raise SceneError(
            f"{label} {shown(text)} has {len(parts)} numbers, names and operations; at most {MAX_FORMULA_PARTS} are "
            "accepted, give such data by the vertex or from Python."
        )
    called = {id(node.func) for node in parts if type(node) is ast.Call}
    for node in parts:
        reason = None if id(node) in called else _refusal(node, names)
        if reason:
            part = ast.get_source_segment(text.strip(), node) or ""
            raise SceneError(f"{label} {shown(text)} {reason.format(part=shown(part))}")
    return tree


def parse(text: str, label: str = "the formula") -> ast.expr:
    """Return the syntax tree of a Python expression, of which nothing is checked but its length.

    Raises
    ------
    SceneError
        If ``text`` is too long, contains #, is nested too deeply, or does not parse.
    """
    if len(text) > MAX_FORMULA_CHARACTERS:
        raise SceneError(
            f"{label} {shown(text)} has {len(text)} characters; at most {MAX_FORMULA_CHARACTERS} are accepted, give "
            "such data by the vertex or from Python."
        )
    if "#" in text:
        raise SceneError(f"{label} {shown(text)} holds a #; comments stand outside of the quotes.")
    try:
        return ast.parse(text.strip(), mode="eval").body
    except (RecursionError, MemoryError) as error:  # the parser's stack is full
        raise SceneError(f"{label} {shown(text)} is nested too deeply; use fewer signs and parentheses.") from error
    except (SyntaxError, ValueError) as error:
        reason = error.msg if isinstance(error, SyntaxError) else str(error)
        reason = "a number has too many digits" if "digits" in reason else reason
        raise SceneError(f"{label} {shown(text)} does not parse: {reason.rstrip('.')}.") from error


def _refusal(node: ast.expr, names: Sequence[str]) -> str | None:
    """Return the reason why a syntax node is refused, with {part} in place of its text; None if it is accepted."""
    word: Any = None
    match node:
        case ast.Constant(value=True | False):
            pass
        case ast.Constant(value=int() | float() as number):
            return None if abs(number) <= sys.float_info.max else "holds the number {part}, which is beyond 1.8e308."
        case ast.Name(id=word):
            if word in names or word in CONSTANTS:
                return None
        case ast.BinOp(op=op) | ast.UnaryOp(op=op) | ast.Compare(ops=[op]):
            if type(op) in OPERATORS:
                return None
        case ast.Call(func=ast.Name(id=word), args=arguments, keywords=[]) if word in FUNCTIONS:
            needed, count = FUNCTIONS[word], len(arguments)
            if not any(type(argument) is ast.Starred for argument in arguments):
                return None if count == needed else f"calls {word} with {count} arguments; it takes {needed}."
        case ast.Call(func=ast.Name(id=word)):
            pass
    available = (*names, *CONSTANTS, *FUNCTIONS)
    hint = did_you_mean(word, available) if word not in available else ""
    return f"uses {{part}}{hint}; offered are + - * / ** % < > and {', '.join(available)}."
