"""Formulas in t, or in u and v: the scene files' closed list of names, as SymPy trees that can be differentiated.

SymPy is built from the syntax tree, node by node: ``sympify`` would evaluate the text as Python.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.expressions import CONSTANTS, FUNCTIONS, OPERATIONS

#: Larger whole numbers become floating point: exact powers of them could fill the memory.
LARGEST_EXACT = 1000


def parsed(text: str, names: Sequence[str]) -> Any:
    """Return the SymPy expression of a formula in the parameters ``names``.

    Raises
    ------
    SceneError
        If the text does not parse, or uses a name or an operation that is not offered.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError) as error:
        reason = error.msg if isinstance(error, SyntaxError) else str(error)
        raise SceneError(f"the formula {text!r} does not parse: {reason}.") from error
    return Translation(text, tuple(names)).of(tree)


class Translation:
    """From a syntax tree to SymPy, for one formula.

    Parameters
    ----------
    text : str
        The formula, for messages.
    names : tuple of str
        Its parameters.
    """

    def __init__(self, text: str, names: tuple[str, ...]) -> None:
        import sympy

        self.text = text
        self.symbols = {name: sympy.Symbol(name) for name in names}
        self.offered: dict[str, Any] = {**self.symbols, "pi": sympy.pi, "e": sympy.E}
        self.offered = {name: self.offered[name] for name in (*names, *CONSTANTS)}

    def of(self, node: ast.AST) -> Any:
        """Return the SymPy expression of a node."""
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                return _number(number)
            case ast.Name(id=name) if name in self.offered:
                return self.offered[name]
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATIONS:
                return self._operation(type(op), self.of(left), self.of(right))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -self.of(operand)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.of(operand)
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in OPERATIONS:
                return self._operation(type(op), self.of(left), self.of(right))
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in FUNCTIONS:
                return self._call(name, [self.of(argument) for argument in arguments])
        raise SceneError(
            f"the formula {self.text!r} uses {ast.unparse(node)!r}; offered are "
            f"+ - * / ** % < > and {', '.join((*self.offered, *FUNCTIONS))}."
        )

    def _operation(self, op: type[ast.AST], a: Any, b: Any) -> Any:
        steps = _step_functions()
        if op is ast.Mod:
            return a - b * steps["cpm_floor"](a / b)
        if op in COMPARISONS:
            return steps["cpm_less"](*((a, b) if op in (ast.Lt, ast.LtE) else (b, a)))
        if op is ast.Pow and a.is_number and b.is_number:
            return self._float_power(a, b)
        return OPERATIONS[op](a, b)

    def _float_power(self, a: Any, b: Any) -> Any:
        try:
            return _number(float(a) ** float(b))
        except (ArithmeticError, TypeError) as error:
            raise SceneError(f"the formula {self.text!r} has a power that is no finite number.") from error

    def _call(self, name: str, arguments: list[Any]) -> Any:
        count = 2 if name in ("arctan2", "hypot", "minimum", "maximum") else 1
        if len(arguments) != count:
            raise SceneError(f"the formula {self.text!r} calls {name} with {len(arguments)} arguments.")
        return _functions()[name](*arguments)


COMPARISONS = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)


def _number(value: float) -> Any:
    import sympy

    if float(value).is_integer() and abs(value) <= LARGEST_EXACT:
        return sympy.Integer(int(value))
    return sympy.Float(value, 17)  # 17 digits are printed and read back without loss


@cache
def _step_functions() -> Mapping[str, Any]:
    """Return functions that SymPy differentiates as NumPy computes them: between their jumps and kinks.

    SymPy's own would leave Dirac pulses and unevaluated derivatives in the second derivatives.
    """
    import sympy

    def make(name: str, *derivatives: Any) -> Any:
        def fdiff(self: Any, argindex: int = 1) -> Any:
            return derivatives[argindex - 1](*self.args) if derivatives else sympy.S.Zero

        return type(name, (sympy.Function,), {"fdiff": fdiff})

    sign, floor, less = make("cpm_sign"), make("cpm_floor"), make("cpm_less")
    made = [
        sign,
        floor,
        less,
        make("cpm_abs", sign),
        make("cpm_minimum", lambda a, b: less(a, b), lambda a, b: 1 - less(a, b)),
        make("cpm_maximum", lambda a, b: 1 - less(a, b), lambda a, b: less(a, b)),
    ]
    return {function.__name__: function for function in made}


NUMPY_STEPS: Mapping[str, Any] = {
    "cpm_sign": np.sign,
    "cpm_floor": np.floor,
    "cpm_less": lambda a, b: 1.0 * (a < b),
    "cpm_abs": np.abs,
    "cpm_minimum": np.minimum,
    "cpm_maximum": np.maximum,
}


@cache
def _functions() -> Mapping[str, Any]:
    """Return the SymPy function of each name in :data:`cpmkit.expressions.FUNCTIONS`."""
    import sympy

    other = {
        "arcsin": sympy.asin,
        "arccos": sympy.acos,
        "arctan": sympy.atan,
        "arctan2": sympy.atan2,
        "hypot": lambda a, b: sympy.sqrt(a * a + b * b),
    }
    steps = _step_functions()
    return {name: other.get(name) or steps.get(f"cpm_{name}") or getattr(sympy, name) for name in FUNCTIONS}
