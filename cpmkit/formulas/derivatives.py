"""Formulas with first and second derivatives by automatic differentiation, about 20 steps for each of the formula.

Functions with jumps or kinks (floor, sign, comparisons, minimum, ...) are differentiated between these.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

from cpmkit.errors import SceneError
from cpmkit.formulas.steps import Program, Steps, make_program
from cpmkit.types import Floats

#: Formulas with more steps, derivatives included, are refused: each step is computed at every point.
MAX_FORMULA_STEPS = 4_000
#: Derivatives f of kernels by each of the operands a, b; those of kernels that are not listed are zero between jumps.
PARTIALS = {
    "add": ("1", "1"), "subtract": ("1", "-1"), "negative": ("-1",), "multiply": ("b", "a"),
    "divide": ("1/b", "-(f/b)"), "power": ("b*a**(b - 1)", "f*log(a)"), "mod": ("1", "-floor(a/b)"), "sqrt": ("0.5/f",),
    "exp": ("f",), "log": ("1/a",), "sin": ("cos(a)",), "cos": ("-sin(a)",), "tan": ("1 + f*f",),
    "arcsin": ("1/sqrt(1 - a*a)",), "arccos": ("-(1/sqrt(1 - a*a))",), "arctan": ("1/(1 + a*a)",),
    "arctan2": ("b/(a*a + b*b)", "-(a/(a*a + b*b))"),
    "sinh": ("cosh(a)",), "cosh": ("sinh(a)",), "tanh": ("1 - f*f",), "abs": ("sign(a)",), "hypot": ("a/f", "b/f"),
}  # fmt: skip
#: Derivatives of kernels that select an operand, from the derivatives da, db, dc, of which one may be undefined.
SELECTIONS = {"minimum": "where(a < b, da, db)", "maximum": "where(a < b, db, da)", "where": "where(a, db, dc)"}


@dataclass(frozen=True, eq=False)
class FormulaJets:
    """Formulas in the same variables, with their first and second derivatives.

    Attributes
    ----------
    names : tuple of str
        Names of the m variables.
    programs : tuple of Program
        The rows of the first are the k formulas; the second adds the first derivatives, k for each variable; the third
        adds the second derivatives, k for each pair of variables (first with first, first with second, ...).
    """

    names: tuple[str, ...]
    programs: tuple[Program, ...]

    def rows(self, order: int, columns: Floats) -> Floats:
        """Return the rows (r, n) of the program with derivatives up to ``order``, at variables ``columns`` (m, n)."""
        return self.programs[order](dict(zip(self.names, columns, strict=True)), columns.shape[1])


def formula_jets(trees: Sequence[ast.expr], names: Sequence[str], label: str) -> FormulaJets:
    """Return the formulas given by checked syntax trees in the variables ``names``, with their derivatives.

    Raises
    ------
    SceneError
        If they need more than :data:`MAX_FORMULA_STEPS` steps; ``label`` is their name in the message.
    """
    steps = Steps()
    zero = steps.number(0.0)
    derivatives = Derivatives(steps)

    def derivatives_of(places: Sequence[int], name: str) -> list[int]:
        results = [derivatives.of(place, name) for place in places]
        return [zero if result is None else result for result in results]

    values = [steps.add_tree(tree) for tree in trees]
    slopes = [derivatives_of(values, name) for name in names]
    curvatures = [derivatives_of(slopes[i], name) for i in range(len(names)) for name in names[i:]]
    first = [*values, *chain(*slopes)]
    programs = tuple(make_program(steps, outputs) for outputs in (values, first, [*first, *chain(*curvatures)]))
    needed = programs[2].operations
    if needed > MAX_FORMULA_STEPS:
        raise SceneError(
            f"{label} takes {needed} operations with its first two derivatives; at most {MAX_FORMULA_STEPS} are "
            "accepted, use a shorter formula, or give a function from Python."
        )
    return FormulaJets(tuple(names), programs)


class Derivatives:
    """Derivatives of the values of ``steps``, added to it as further steps; None stands for a derivative of zero."""

    def __init__(self, steps: Steps) -> None:
        self.steps = steps
        self._known: dict[tuple[int, str], int | None] = {}

    def of(self, place: int, name: str) -> int | None:
        """Return the place of the derivative of the value at ``place`` by the variable ``name``; None if it is zero."""
        for earlier in self.steps.dependencies([place]):
            if (earlier, name) not in self._known:
                self._known[earlier, name] = self._derivative(earlier, name)
        return self._known[place, name]

    def _derivative(self, place: int, name: str) -> int | None:
        """Return the place of the derivative of one step, given those of its operands; None if it is zero."""
        kind, *operands = self.steps.steps[place]
        if kind in ("name", "number"):
            return self.steps.number(1.0) if [kind, *operands] == ["name", name] else None
        inner = [self._known[operand, name] for operand in operands]
        places = dict(zip("abc", operands, strict=False)) | {"f": place}
        if kind in SELECTIONS and any(derivative is not None for derivative in inner):
            zero = self.steps.number(0.0)
            slopes = [zero if derivative is None else derivative for derivative in inner]
            return self._add(SELECTIONS[kind], places | dict(zip(("da", "db", "dc"), slopes, strict=False)))
        total = None
        for partial, derivative in zip(PARTIALS.get(kind, ()), inner, strict=False):
            if derivative is not None:
                term = self._times(self._add(partial, places), derivative)
                total = term if total is None else self.steps.apply("add", total, term)
        return total

    def _add(self, text: str, places: dict[str, int]) -> int:
        """Return the place of the value of a formula in variables at ``places``."""
        return self.steps.add_tree(ast.parse(text, mode="eval").body, places)

    def _times(self, a: int, b: int) -> int:
        """Return the place of the product of the values at places a and b, without a step if one of them is 1."""
        for first, second in ((a, b), (b, a)):
            if self.steps.value(first) == 1.0:
                return second
            if self.steps.value(first) == -1.0:
                return self.steps.apply("negative", second)
        return self.steps.apply("multiply", a, b)
