"""Formulas in scene files: a closed list of names and operations, parsed into NumPy, never evaluated as Python."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.protocols import Floats

COORDINATES = ("x", "y", "z")
CONSTANTS = {"pi": np.pi, "e": np.e}
FUNCTIONS: dict[str, Callable[..., Any]] = {
    name: getattr(np, name)
    for name in (
        "sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh",
        "exp", "log", "sqrt", "abs", "sign", "floor", "minimum", "maximum", "hypot",
    )
}  # fmt: skip
OPERATIONS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.Mod: operator.mod,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


@dataclass(frozen=True)
class Expression:
    """A function of position, written as a formula in x, y, z, and of time where it has a t in it.

    Parameters
    ----------
    text : str
        For example ``"0.5 + 0.5 * sin(x / 20)"``. ``^`` is not a power; write ``**``. A comparison is 1 or 0.
    dim : int
        2 or 3: which coordinates there are.

    Raises
    ------
    SceneError
        If the text does not parse, or uses a name or an operation that is not offered.

    Examples
    --------
    >>> import numpy as np
    >>> Expression("x * y + (x > 1)", 2)(np.array([[2.0, 3.0]]))
    array([7.])
    """

    text: str
    dim: int

    def __post_init__(self) -> None:
        self(np.full((1, self.dim), 0.5), t=0.5)

    def __call__(self, points: Floats, t: float | None = None) -> Floats:
        """Return the values (n,) at points (n, d) and, where the formula has a t in it, the time ``t``."""
        tree = self.tree()
        with np.errstate(all="ignore"):
            return np.broadcast_to(np.asarray(self._value(tree, points, t), dtype=np.float64), (len(points),)).copy()

    @property
    def takes_time(self) -> bool:
        """True where the formula has a t in it."""
        return any(isinstance(node, ast.Name) and node.id == "t" for node in ast.walk(self.tree()))

    def tree(self) -> ast.expr:
        """Return the formula as a syntax tree, from which derivatives can be built; it holds what is offered only."""
        try:
            return ast.parse(self.text, mode="eval").body
        except SyntaxError as error:
            raise SceneError(f"the formula {self.text!r} does not parse: {error.msg}.") from error

    def _value(self, node: ast.AST, points: Floats, t: float | None) -> Any:
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                return float(number)
            case ast.Name(id=name) if name in COORDINATES[: self.dim]:
                return points[:, COORDINATES.index(name)]
            case ast.Name(id="t") if t is not None:
                return t
            case ast.Name(id=name) if name in CONSTANTS:
                return CONSTANTS[name]
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATIONS:
                return OPERATIONS[type(op)](self._value(left, points, t), self._value(right, points, t))
            case ast.UnaryOp(op=op, operand=operand) if type(op) in OPERATIONS:
                return OPERATIONS[type(op)](self._value(operand, points, t))
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in OPERATIONS:
                return OPERATIONS[type(op)](self._value(left, points, t), self._value(right, points, t)) * 1.0
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in FUNCTIONS:
                return self._call(name, [self._value(argument, points, t) for argument in arguments])
        names = (*COORDINATES[: self.dim], "t", *CONSTANTS, *FUNCTIONS)
        raise SceneError(
            f"the formula {self.text!r} uses {ast.unparse(node)!r}; offered are "
            f"+ - * / ** % < > and {', '.join(names)}."
        )

    def _call(self, name: str, values: list[Any]) -> Any:
        try:
            return FUNCTIONS[name](*values)
        except (TypeError, ValueError) as error:
            raise SceneError(f"the formula {self.text!r} calls {name} with {len(values)} arguments.") from error
