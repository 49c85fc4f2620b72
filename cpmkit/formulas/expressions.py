"""Formulas as functions: of position and time, of a solution and its slope, of several channels; and derivatives.

Functions with jumps or kinks (floor, sign, comparisons, minimum, ...) are differentiated between these. First and
second derivatives take about 20 steps for each of the formula.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.formulas.steps import COORDINATES, Program, Steps, formula_tree, make_program
from cpmkit.types import Floats


class Formulas:
    """Base class of functions that are given by formulas in x, y, z and further variables."""

    dim: int

    def __post_init__(self) -> None:
        _ = self._program  # parsed here, so that errors are raised here

    @property
    def _texts(self) -> tuple[str, ...]:
        """The formulas."""
        raise NotImplementedError

    @property
    def _variables(self) -> tuple[str, ...]:
        """The names that the formulas may use, in the order in which messages list them."""
        return COORDINATES[: self.dim]

    @cached_property
    def _program(self) -> Program:
        """The program that computes the formulas."""
        steps = Steps()
        return make_program(steps, [steps.add_tree(formula_tree(text, self._variables)) for text in self._texts])

    @property
    def takes_time(self) -> bool:
        """True if any of the formulas contains t, the time."""
        return "t" in self._program.variables

    def _values(self, points: Floats, **others: Any) -> Floats:
        """Return the values (k, n) of the k formulas at points (n, d), given ``others``, their other variables by name.

        Raises SceneError if a formula uses a coordinate that the points do not have.
        """
        names = COORDINATES[: points.shape[1]]
        missing = [name for name in COORDINATES if name in self._program.variables and name not in names]
        if missing:
            text = shown(self._texts if len(self._texts) > 1 else self._texts[0])
            raise SceneError(f"the formula {text} uses {missing[0]}, and points here have {' and '.join(names)} alone.")
        return self._program({**dict(zip(names, points.T, strict=True)), **others}, len(points))


@dataclass(frozen=True)
class Formula(Formulas):
    """Base class of functions that are given by one formula.

    Raises SceneError if the text does not parse, is too long, or uses a name or operation that is not available.
    """

    #: For example ``"0.5 + 0.5 * sin(x / 20)"``. A power is ``**``, not ``^``. A comparison is 1 or 0. Undefined
    #: values, such as ``1/0``, are infinite or NaN.
    text: str
    dim: int = len(COORDINATES)  #: 2 or 3, the number of coordinates that it may use.

    @property
    def _texts(self) -> tuple[str, ...]:
        return (self.text,)


class Expression(Formula):
    """A function of position, and of time if the formula contains t.

    Examples
    --------
    >>> import numpy as np
    >>> Expression("x * y + (x > 1)", 2)(np.array([[2.0, 3.0]]))
    array([7.])
    """

    @property
    def _variables(self) -> tuple[str, ...]:
        return (*super()._variables, "t")

    def __call__(self, points: Floats, t: float | None = None) -> Floats:
        """Return the values (n,) at points (n, d) and, if the formula contains t, the time ``t``.

        Raises SceneError if the formula contains t and ``t`` is None, or a coordinate that the points do not have.
        """
        if t is None and self.takes_time:
            raise SceneError(f"the formula {shown(self.text)} depends on t, and there is no time here; leave t out.")
        return np.asarray(self._values(points, t=t)[0])


class StateExpression(Formula):
    """A function of a solution u, the norm s of its gradient, and position, such as a diffusivity that depends on u.

    Examples
    --------
    >>> import numpy as np
    >>> StateExpression("1 + u * s + x", 2)(np.array([2.0]), np.array([3.0]), np.array([[0.5, 0.0]]))
    array([7.5])
    """

    @property
    def _variables(self) -> tuple[str, ...]:
        return ("u", "s", *super()._variables)

    def __call__(self, u: Floats, s: Floats, points: Floats) -> Floats:
        """Return the values (n,) for u (n,), s (n,) and points (n, d); SceneError if they lack a coordinate."""
        return np.asarray(self._values(points, u=u, s=s)[0])


@dataclass(frozen=True)
class ReactionExpression(Formulas):
    """A reaction: one formula for each channel, in the channels u1, u2, ..., the position and the time t.

    A single channel is also called u. Raises SceneError unless there are 1 to 100 formulas, each a text that parses, is
    not too long, and uses available names and operations alone.

    Examples
    --------
    >>> ReactionExpression(("u2 - u1", "x * u1"), 2)(np.array([[1.0, 3.0]]), np.array([[0.5, 0.0]]))
    array([[2. , 0.5]])
    """

    texts: tuple[str, ...]  #: The rates of the channels, for example ``("u1*u2**2 - u1", "-u1*u2**2")``; 100 at most.
    dim: int = len(COORDINATES)  #: 2 or 3, the number of coordinates that they may use.

    def __post_init__(self) -> None:
        """Parse the formulas; raise SceneError if they are not 1 to 100 texts or one is not accepted."""
        if not 1 <= len(self.texts) <= 100 or not all(isinstance(text, str) for text in self.texts):
            raise SceneError(
                "a reaction must be 1 to 100 formulas, one formula a channel, such as '-u1*u2**2', got "
                f"{len(self.texts)}: {shown(self.texts)}."
            )
        super().__post_init__()

    @property
    def channels(self) -> int:
        """The number of channels."""
        return len(self.texts)

    @property
    def _texts(self) -> tuple[str, ...]:
        return self.texts

    @property
    def _variables(self) -> tuple[str, ...]:
        channels = [f"u{k}" for k in range(1, self.channels + 1)]
        return (*(["u"] if self.channels == 1 else []), *channels, *super()._variables, "t")

    def __call__(self, u: Floats, points: Floats, t: float | None = None) -> Floats:
        """Return the rates (n, channels) for u (n, channels), points (n, d) and the time ``t``.

        Raises SceneError if a formula contains t and ``t`` is None, or a coordinate that the points do not have.
        """
        if t is None and self.takes_time:
            raise SceneError(f"the reaction {shown(self.texts)} depends on t, and no time was given.")
        channels = {f"u{k}": u[:, k - 1] for k in range(1, self.channels + 1)}
        return np.ascontiguousarray(self._values(points, u=u[:, 0], t=t, **channels).T)


#: Formulas with more steps, derivatives included, are refused: each step is computed at every point.
MAX_FORMULA_STEPS = 4_000
#: Derivatives of each kernel f by its operands a, b; derivatives of kernels not listed here are zero between jumps.
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
    """Formulas in the same variables, with their first and second derivatives."""

    names: tuple[str, ...]  #: Names of the m variables.
    #: Three programs. The rows of the first are the k formulas; the second adds their first derivatives, k rows for
    #: each variable; the third adds second derivatives, k rows for each pair of variables (1 with 1, 1 with 2, ...).
    programs: tuple[Program, ...]

    def rows(self, order: int, columns: Floats) -> Floats:
        """Return the rows (r, n) of ``programs[order]``, ``order`` 0, 1 or 2, at points given as ``columns`` (m, n)."""
        return self.programs[order](dict(zip(self.names, columns, strict=True)), columns.shape[1])


def formula_jets(trees: Sequence[ast.expr], names: Sequence[str], label: str) -> FormulaJets:
    """Return the formulas given by checked syntax trees in the variables ``names``, with first and second derivatives.

    Raises SceneError, with ``label``, if they need more than :data:`MAX_FORMULA_STEPS` steps with the derivatives.
    """
    steps = Steps()
    zero = steps.number(0.0)
    derivatives = Derivatives(steps)

    def derivatives_of(places: Sequence[int], name: str) -> list[int]:
        results = [derivatives.find_derivative(place, name) for place in places]
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
    """Symbolic derivatives of the values of ``steps``, the list to which derivatives are added as further steps.

    The place of a value is its index in the list; None in place of a derivative means zero.
    """

    def __init__(self, steps: Steps) -> None:
        self.steps = steps
        self._known: dict[tuple[int, str], int | None] = {}

    def find_derivative(self, place: int, name: str) -> int | None:
        """Return the place of the derivative of the value at ``place`` by the variable ``name``; None means zero."""
        for earlier in self.steps.dependencies([place]):
            if (earlier, name) not in self._known:
                self._known[earlier, name] = self._derivative(earlier, name)
        return self._known[place, name]

    def _derivative(self, place: int, name: str) -> int | None:
        """Return the place of a step's derivative with respect to ``name``, given its operands'; None if it is zero."""
        kind, *operands = self.steps.steps[place]
        if kind in ("name", "number"):
            return self.steps.number(1.0) if [kind, *operands] == ["name", name] else None
        inner = [self._known[operand, name] for operand in operands]
        places = dict(zip("abc", operands, strict=False)) | {"f": place}
        if kind in SELECTIONS and any(derivative is not None for derivative in inner):
            zero = self.steps.number(0.0)
            slopes = [zero if derivative is None else derivative for derivative in inner]
            return self._add_formula(SELECTIONS[kind], places | dict(zip(("da", "db", "dc"), slopes, strict=False)))
        total = None
        for partial, derivative in zip(PARTIALS.get(kind, ()), inner, strict=False):
            if derivative is not None:
                term = self._multiply(self._add_formula(partial, places), derivative)
                total = term if total is None else self.steps.apply("add", total, term)
        return total

    def _add_formula(self, text: str, places: dict[str, int]) -> int:
        """Return the place of the value of a formula, given the ``places`` of its variables by name."""
        return self.steps.add_tree(ast.parse(text, mode="eval").body, places)

    def _multiply(self, a: int, b: int) -> int:
        """Return the place of the product of the values at places a and b, without a product if one is 1 or -1."""
        for first, second in ((a, b), (b, a)):
            if self.steps.constant_value(first) == 1.0:
                return second
            if self.steps.constant_value(first) == -1.0:
                return self.steps.apply("negative", second)
        return self.steps.apply("multiply", a, b)
