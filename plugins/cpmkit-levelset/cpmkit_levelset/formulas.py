"""A continuous formula of position with its first two derivatives, and the zeros at which these may jump."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.plugin import COORDINATES, FUNCTIONS, Floats, FormulaJets, SceneError, formula_jets, formula_tree, shown

#: What formulas offer and level sets do not: it jumps.
DISCONTINUOUS_FUNCTIONS = ("sign", "floor")
#: Which of the rows of second derivatives is an entry of the Hessian, by dimension.
HALF_OF_HESSIAN = {2: np.array([[0, 1], [1, 2]]), 3: np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])}


@dataclass(frozen=True)
class FormulaField:
    """A formula in x, y, z and its derivatives.

    Attributes
    ----------
    text : str
        The formula.
    dim : int
        2 or 3.
    jets : FormulaJets
        The formula, its gradient, and the upper half of its Hessian.
    """

    text: str
    dim: int
    jets: FormulaJets
    #: The functions at whose zeros the gradient may jump: a of ``abs(a)``, a - b of ``minimum`` and ``maximum(a, b)``.
    kinks: tuple[FormulaField, ...] = ()

    def value(self, p: Floats) -> Floats:
        """Return phi (n,) at points ``p`` (n, d)."""
        values: Floats = self.jets.rows(0, p.T)[0]
        return values

    def gradient(self, p: Floats) -> tuple[Floats, Floats]:
        """Return phi (n,) and its gradient (n, d) at points ``p`` (n, d)."""
        rows = self.jets.rows(1, p.T)
        return rows[0], np.ascontiguousarray(rows[1:].T)

    def jet(self, p: Floats) -> tuple[Floats, Floats, Floats]:
        """Return phi (n,), its gradient (n, d) and its Hessian (n, d, d) at points ``p`` (n, d)."""
        rows, d = self.jets.rows(2, p.T), self.dim
        hessian = np.ascontiguousarray(rows[1 + d :].T).take(HALF_OF_HESSIAN[d], axis=1)
        return rows[0], np.ascontiguousarray(rows[1 : 1 + d].T), hessian


def formula_field(text: Any, dim: int, label: str) -> FormulaField:
    """Return the formula ``text`` in the first ``dim`` of x, y, z with its first two derivatives.

    Raise SceneError, which names ``label``, if it does not parse, is too long or constant, or uses what jumps or is not
    offered.
    """
    names = COORDINATES[:dim]
    tree = formula_tree(text, names, label)
    jump = next((node for node in ast.walk(tree) if _is_discontinuous(node)), None)
    if jump is not None:
        raise SceneError(
            f"{label} uses {shown(ast.get_source_segment(text.strip(), jump))}, which jumps; a level set is "
            f"continuous: use + - * / ** and "
            f"{', '.join(name for name in FUNCTIONS if name not in DISCONTINUOUS_FUNCTIONS)}."
        )
    jets = formula_jets([tree], names, label)
    if not jets.programs[0].variables:
        raise SceneError(f"{label} must depend on {', '.join(names)}, got the constant {shown(text)}.")
    arguments = [argument for node in ast.walk(tree) if (argument := _kink_argument(node)) is not None]
    kinks = [FormulaField(ast.unparse(each), dim, formula_jets([each], names, label)) for each in arguments]
    return FormulaField(text, dim, jets, tuple(kink for kink in kinks if kink.jets.programs[0].variables))


def _kink_argument(node: ast.AST) -> ast.expr | None:
    """Return the function at whose zeros the gradient of ``node`` may jump; None if there is none."""
    match node:
        case ast.Call(func=ast.Name(id="abs"), args=[argument]):
            return argument
        case ast.Call(func=ast.Name(id="minimum" | "maximum"), args=[first, second]):
            return ast.BinOp(first, ast.Sub(), second)
    return None


def _is_discontinuous(node: ast.AST) -> bool:
    """Return whether a node of a formula's tree jumps: sign, floor, % or a comparison."""
    match node:
        case ast.Call(func=ast.Name(id=name)):
            return name in DISCONTINUOUS_FUNCTIONS
        case ast.BinOp(op=ast.Mod()) | ast.Compare():
            return True
    return False
