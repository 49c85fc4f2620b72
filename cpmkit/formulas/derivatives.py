"""Formulas with first and second derivatives by automatic differentiation, about 20 steps for each of the formula.

Functions with jumps or kinks (floor, sign, comparisons, minimum, ...) are differentiated between these.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

from cpmkit.errors import SceneError
from cpmkit.formulas.steps import MAX_STAGED_POINTS, Program, StagedProgram, Steps, make_program, stage_program
from cpmkit.types import Floats

#: Formulas with more steps, derivatives included, are refused: each step is computed at every point.
MAX_FORMULA_STEPS = 4_000


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
    programs: tuple[Program, Program, Program]

    def rows(self, order: int, columns: Floats) -> Floats:
        """Return the rows (r, n) of the program with derivatives up to ``order``, at variables ``columns`` (m, n)."""
        count = columns.shape[1]
        programs = self._staged_programs if count <= MAX_STAGED_POINTS else self.programs
        return programs[order](dict(zip(self.names, columns, strict=True)), count)

    @cached_property
    def _staged_programs(self) -> tuple[StagedProgram, ...]:
        """The programs in stages, for few points."""
        return tuple(stage_program(program) for program in self.programs)


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
    needed = len(programs[2].instructions)
    if needed > MAX_FORMULA_STEPS:
        raise SceneError(
            f"{label} takes {needed} operations with its first two derivatives; at most {MAX_FORMULA_STEPS} are "
            "accepted, use a shorter formula, or give a function from Python."
        )
    return FormulaJets(tuple(names), (programs[0], programs[1], programs[2]))


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
            return self.steps.number(1.0) if operands == [name] and kind == "name" else None
        inner = [self._known[operand, name] for operand in operands]
        if kind in ("minimum", "maximum", "where"):
            return self._selected(kind, operands, inner)
        if kind not in PARTIALS:
            return None
        total = None
        for partial, derivative in zip(PARTIALS[kind], inner, strict=True):
            if derivative is not None:
                total = self._plus(total, self._times(partial(self.steps, place, *operands), derivative))
        return total

    def _selected(self, kind: str, operands: list[int], inner: list[int | None]) -> int | None:
        """Return the derivative of the operand that a step selects; the derivative of the other may be undefined."""
        if inner[-2:] == [None, None]:
            return None
        first, second = (self.steps.number(0.0) if each is None else each for each in inner[-2:])
        if kind == "where":
            return self.steps.apply("where", operands[0], first, second)
        smaller = self.steps.apply("less", *operands)
        return self.steps.apply("where", smaller, *((first, second) if kind == "minimum" else (second, first)))

    def _times(self, a: int, b: int) -> int:
        """Return the place of the product of the values at places a and b, without a step if one of them is 1."""
        for first, second in ((a, b), (b, a)):
            if self.steps.value(first) == 1.0:
                return second
            if self.steps.value(first) == -1.0:
                return self.steps.apply("negative", second)
        return self.steps.apply("multiply", a, b)

    def _plus(self, a: int | None, b: int) -> int:
        return b if a is None else self.steps.apply("add", a, b)


#: Function that returns the derivative of a kernel by an operand, from steps and the places of its value and operands.
Partial = Callable[..., int]


def _one(s: Steps, *_: int) -> int:
    return s.number(1.0)


def _minus_one(s: Steps, *_: int) -> int:
    return s.number(-1.0)


def _reciprocal(s: Steps, place: int) -> int:
    """Return the place of 1 over the value at ``place``."""
    return s.apply("divide", s.number(1.0), place)


def _one_and_square(s: Steps, kernel: str, a: int) -> int:
    """Return the place of 1 plus or minus ``a**2``; ``kernel`` is ``add`` or ``subtract``."""
    return s.apply(kernel, s.number(1.0), s.apply("multiply", a, a))


def _over_sum_of_squares(s: Steps, numerator: int, a: int, b: int) -> int:
    """Return the place of ``numerator / (a**2 + b**2)``."""
    squares = s.apply("add", s.apply("multiply", a, a), s.apply("multiply", b, b))
    return s.apply("divide", numerator, squares)


def _arcsin_slope(s: Steps, f: int, a: int) -> int:
    """Return the place of the derivative of arcsin at a, ``1 / sqrt(1 - a**2)``."""
    del f
    return _reciprocal(s, s.apply("sqrt", _one_and_square(s, "subtract", a)))


#: Derivatives of each kernel by its operands. Other kernels are constant between their jumps.
PARTIALS: dict[str, tuple[Partial, ...]] = {
    "add": (_one, _one),
    "subtract": (_one, _minus_one),
    "negative": (_minus_one,),
    "multiply": (lambda _s, _f, _a, b: b, lambda _s, _f, a, _b: a),
    "divide": (
        lambda s, _f, _a, b: _reciprocal(s, b),
        lambda s, f, _a, b: s.apply("negative", s.apply("divide", f, b)),
    ),
    "power": (
        lambda s, _f, a, b: s.apply("multiply", b, s.power(a, s.apply("subtract", b, s.number(1.0)))),
        lambda s, f, a, _b: s.apply("multiply", f, s.apply("log", a)),
    ),
    "mod": (
        _one,
        lambda s, _f, a, b: s.apply("negative", s.apply("floor", s.apply("divide", a, b))),
    ),
    "sin": (lambda s, _f, a: s.apply("cos", a),),
    "cos": (lambda s, _f, a: s.apply("negative", s.apply("sin", a)),),
    "tan": (lambda s, f, _a: _one_and_square(s, "add", f),),
    "arcsin": (_arcsin_slope,),
    "arccos": (lambda s, f, a: s.apply("negative", _arcsin_slope(s, f, a)),),
    "arctan": (lambda s, _f, a: _reciprocal(s, _one_and_square(s, "add", a)),),
    "arctan2": (
        lambda s, _f, a, b: _over_sum_of_squares(s, b, a, b),
        lambda s, _f, a, b: s.apply("negative", _over_sum_of_squares(s, a, a, b)),
    ),
    "sinh": (lambda s, _f, a: s.apply("cosh", a),),
    "cosh": (lambda s, _f, a: s.apply("sinh", a),),
    "tanh": (lambda s, f, _a: _one_and_square(s, "subtract", f),),
    "exp": (lambda _s, f, _a: f,),
    "log": (lambda s, _f, a: _reciprocal(s, a),),
    "sqrt": (lambda s, f, _a: s.apply("divide", s.number(0.5), f),),
    "abs": (lambda s, _f, a: s.apply("sign", a),),
    "hypot": (lambda s, f, a, _b: s.apply("divide", a, f), lambda s, f, _a, b: s.apply("divide", b, f)),
}
