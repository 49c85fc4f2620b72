"""A formula with the derivatives that SymPy finds, compiled once into NumPy.

The tree comes from :class:`cpmkit.expressions.Expression`, which offers a closed list of names; no text of the user's
is evaluated.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.expressions import COORDINATES, OPERATIONS, Expression
from cpmkit.protocols import Floats

#: The functions of formulas that have two derivatives, by their names in SymPy.
SMOOTH = {
    "sin": "sin", "cos": "cos", "tan": "tan", "arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2",
    "sinh": "sinh", "cosh": "cosh", "tanh": "tanh", "exp": "exp", "log": "log", "sqrt": "sqrt",
}  # fmt: skip

#: Powers up to this are printed as products: NumPy's general power takes ten times longer.
HIGHEST_PRODUCT = 12

Compiled = Callable[..., Any]


@dataclass(frozen=True)
class FormulaField:
    """A formula in x, y, z and its derivatives.

    Attributes
    ----------
    text : str
        The formula.
    dim : int
        2 or 3.
    upto0, upto1, upto2 : callable
        Of the coordinates: phi; phi and its gradient; these and the upper half of its Hessian.
    """

    text: str
    dim: int
    upto0: Compiled
    upto1: Compiled
    upto2: Compiled

    def value(self, p: Floats) -> Floats:
        """Return phi (n,)."""
        values: Floats = self._columns(self.upto0, p)[0]
        return values

    def gradient(self, p: Floats) -> tuple[Floats, Floats]:
        """Return phi (n,) and its gradient (n, d)."""
        columns = self._columns(self.upto1, p)
        return columns[0], np.ascontiguousarray(columns[1:].T)

    def jet(self, p: Floats) -> tuple[Floats, Floats, Floats]:
        """Return phi (n,), its gradient (n, d) and its Hessian (n, d, d)."""
        columns = self._columns(self.upto2, p)
        d = self.dim
        hessian = np.empty((len(p), d, d))
        for (i, j), column in zip(_upper(d), columns[1 + d :], strict=True):
            hessian[:, i, j] = hessian[:, j, i] = column
        return columns[0], np.ascontiguousarray(columns[1 : 1 + d].T), hessian

    def _columns(self, compiled: Compiled, p: Floats) -> Floats:
        """Return one row an entry of what was compiled; a constant entry is repeated."""
        with np.errstate(all="ignore"):
            entries = compiled(*np.ascontiguousarray(p.T))
        columns = np.empty((len(entries), len(p)))
        for column, entry in zip(columns, entries, strict=True):
            column[:] = entry
        return columns


def formula_field(text: Any, dim: int, what: str) -> FormulaField:
    """Return the formula ``text`` with its first two derivatives.

    Raises
    ------
    SceneError
        If it does not parse, uses a name that is not offered, or one that has no second derivative.
    """
    if not isinstance(text, str):
        raise SceneError(f"{what} must be a formula such as 'x**2 + y**2 - 1', got {text!r}.")
    import sympy

    symbols = sympy.symbols(COORDINATES[:dim])
    tree = _symbolic(Expression(text, dim), symbols, what)
    if not tree.free_symbols:
        raise SceneError(f"{what} must depend on {', '.join(COORDINATES[:dim])}, got the constant {text!r}.")
    first = [sympy.diff(tree, symbol) for symbol in symbols]
    second = [sympy.diff(first[i], symbols[j]) for i, j in _upper(dim)]
    return FormulaField(text, dim, *(_compiled(symbols, [tree, *more]) for more in ([], first, first + second)))


def _symbolic(expression: Expression, symbols: Any, what: str) -> Any:
    """Return the formula as a SymPy expression in ``symbols``; its names were checked when it was made."""
    import sympy

    functions = {name: getattr(sympy, target) for name, target in SMOOTH.items()}
    functions["hypot"] = lambda a, b: sympy.sqrt(a**2 + b**2)
    functions["abs"] = lambda a: sympy.sqrt(a**2)
    constants = {"pi": sympy.pi, "e": sympy.E}

    def symbolic(node: ast.AST) -> Any:
        match node:
            case ast.Constant(value=int() | float() as number):
                # whole exponents must be integers, or their powers are no products
                return sympy.Integer(int(number)) if float(number).is_integer() else sympy.Float(number)
            case ast.Name(id=name):
                return constants[name] if name in constants else symbols[COORDINATES.index(name)]
            case ast.BinOp(left=left, op=op, right=right) if not isinstance(op, ast.Mod):
                return OPERATIONS[type(op)](symbolic(left), symbolic(right))
            case ast.UnaryOp(op=op, operand=operand):
                return OPERATIONS[type(op)](symbolic(operand))
            case ast.Call(func=ast.Name(id=name), args=arguments) if name in functions:
                return functions[name](*map(symbolic, arguments))
        raise SceneError(
            f"{what} uses {ast.unparse(node)!r}, which has no second derivative everywhere; "
            f"a level set is smooth: use + - * / ** and {', '.join(functions)}."
        )

    return symbolic(expression.tree())


def _upper(dim: int) -> list[tuple[int, int]]:
    return [(i, j) for i in range(dim) for j in range(i, dim)]


def _compiled(symbols: Any, entries: list[Any]) -> Compiled:
    """Return a NumPy function of the coordinates that returns the list of ``entries``."""
    import sympy
    from sympy.printing.numpy import NumPyPrinter

    class Printer(NumPyPrinter):  # type: ignore[misc]
        def _print_Pow(self, power: Any, rational: bool = False) -> str:
            exponent = power.exp
            if exponent.is_Integer and 2 <= abs(exponent) <= HIGHEST_PRODUCT:
                base = f"({self._print(power.base)})"
                product = "*".join([base] * abs(int(exponent)))
                return f"({product})" if exponent > 0 else f"(1.0/({product}))"
            printed: str = super()._print_Pow(power, rational=rational)
            return printed

    printer = Printer({"fully_qualified_modules": False, "inline": True, "allow_unknown_functions": False})
    compiled: Compiled = sympy.lambdify(symbols, entries, modules="numpy", printer=printer, cse=True)
    return compiled
