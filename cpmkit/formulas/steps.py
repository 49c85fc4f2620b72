"""Formulas as checked syntax trees, and as programs: distinct steps, each an operation of NumPy on earlier values.

All numbers are float64, so that 1/0 is infinite and (-1)**0.5 is NaN, as in arrays, without errors.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.runtime.messages import did_you_mean
from cpmkit.types import Floats, Ints

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
    """Return the checked syntax tree of a formula in the variables ``names`` and the constants pi and e.

    Raises SceneError, in which the formula is called ``label``, if ``text`` is not text, is too long or nested too
    deeply, contains #, does not parse, or contains an unknown name or operation, a call with a wrong number of
    arguments, or a number beyond the largest float.
    """
    if not isinstance(text, str):
        raise SceneError(f"{label} must be a formula such as 'x**2 + y', got {shown(text)}.")
    tree = parse_expression(text, label)
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


def parse_expression(text: str, label: str = "the formula") -> ast.expr:
    """Return the syntax tree of a Python expression, whose names and operations are not checked.

    :func:`formula_tree` checks them. Raises SceneError, in which the expression is called ``label``, if ``text`` is too
    long, contains #, is nested too deeply, or does not parse.
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
    """Return why a node of a formula in ``names`` is refused, with {part} in place of its text; None if accepted."""
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
    pieces = isinstance(node, ast.Call | ast.IfExp) and not hint
    remedy = "; for two pieces write (z > 0.3)*A + (z <= 0.3)*B" if pieces else ""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitXor):
        return "uses ^ in {part}; write ** for ^."
    return f"uses {{part}}{hint}; offered are + - * / ** % < > and {', '.join(available)}{remedy}."


#: The kernels of ``run_arithmetic``, in its order; IEEE 754 defines their results, which equal NumPy's exactly.
ARITHMETIC = ("add", "subtract", "multiply", "divide", "negative", "sqrt")
#: The operations of steps by name: functions, operators, and operations that derivatives need.
KERNELS: dict[str, Callable[..., Any]] = {
    **{name: getattr(np, name) for name in (*FUNCTIONS, *ARITHMETIC, "power", "mod")},
    "less": lambda a, b: (a < b) * 1.0,
    "less_equal": lambda a, b: (a <= b) * 1.0,
    "where": lambda condition, a, b: np.where(condition != 0, a, b),
}

#: A number ("number", hexadecimal text), a variable ("name", name), or a kernel and the places of its operands.
Step = tuple[Any, ...]


class Steps:
    """A growing list of distinct steps; the place of a step in the list stands for its value."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self._places: dict[Step, int] = {}

    def number(self, value: float) -> int:
        """Return the place of a number, which is added if it is new."""
        return self._place_of_step(("number", float(value).hex()))  # the text distinguishes 0.0 and -0.0

    def constant_value(self, place: int) -> float | None:
        """Return the number at ``place``, None if the step is not a number."""
        kind, *operands = self.steps[place]
        return float.fromhex(operands[0]) if kind == "number" else None

    def apply(self, kernel: str, *operands: int) -> int:
        """Return the place of ``kernel`` applied to places ``operands``, a number if these are; add it if new."""
        numbers = [self.constant_value(place) for place in operands]
        if any(number is None for number in numbers):
            return self._place_of_step((kernel, *operands))
        with np.errstate(all="ignore"):
            return self.number(KERNELS[kernel](*map(np.float64, numbers)))

    def power(self, base: int, exponent: int) -> int:
        """Return the place of the ``exponent``-th power of ``base``, both places; products for integers +-1 to +-12."""
        number = self.constant_value(exponent)
        if number == 0.5:
            return self.apply("sqrt", base)
        # NumPy's power takes ten times as long as products.
        if number is None or not number.is_integer() or not 1 <= abs(number) <= 12:
            return self.apply("power", base, exponent)
        square, product, rest = base, -1, int(abs(number))
        while rest:
            if rest % 2:
                product = square if product < 0 else self.apply("multiply", product, square)
            rest //= 2
            square = self.apply("multiply", square, square) if rest else square
        return product if number > 0 else self.apply("divide", self.number(1.0), product)

    def add_tree(self, tree: ast.expr, known: Mapping[str, int] | None = None) -> int:
        """Return the place of the value of a checked syntax tree, whose new steps are added.

        ``known`` are the places of some variables by name; each other is a step of its own. Operands are added before
        the operations on them, without recursion, because sums may be long.
        """
        places: dict[int, int] = {}
        for node in reversed([node for node in ast.walk(tree) if isinstance(node, ast.expr)]):
            operands = [places[id(child)] for child in ast.iter_child_nodes(node) if id(child) in places]
            places[id(node)] = self._place_of_node(node, operands, known or {})
        return places[id(tree)]

    def dependencies(self, outputs: Iterable[int]) -> list[int]:
        """Return the places of ``outputs`` and of all values that they depend on, in ascending order."""
        places, stack = set(), list(outputs)
        while stack:
            place = stack.pop()
            if place not in places:
                places.add(place)
                kind, *operands = self.steps[place]
                stack += operands if kind in KERNELS else []
        return sorted(places)

    def _place_of_step(self, step: Step) -> int:
        """Return the place of a step, which is added if it is new."""
        place = self._places.setdefault(step, len(self.steps))
        if place == len(self.steps):
            self.steps.append(step)
        return place

    def _place_of_node(self, node: ast.expr, places: list[int], known: Mapping[str, int]) -> int:
        """Return the place of a node whose operands are at ``places``; ``known`` has places of variables by name."""
        match node:
            case ast.Constant(value=int() | float() as number):
                return self.number(number)
            case ast.Name(id=name):
                if name in known:
                    return known[name]
                return self.number(CONSTANTS[name]) if name in CONSTANTS else self._place_of_step(("name", name))
            case ast.UnaryOp(op=op):
                return self.apply("negative", *places) if type(op) is ast.USub else places[0]
            case ast.BinOp(op=ast.Pow()):
                return self.power(*places)
            case ast.Compare(ops=[ast.Gt() | ast.GtE() as op]):
                return self.apply(OPERATORS[type(op)], *places[::-1])
            case ast.BinOp(op=op) | ast.Compare(ops=[op]):
                return self.apply(OPERATORS[type(op)], *places)
            case ast.Call(func=ast.Name(id=name)):
                return self.apply(name, *places[1:])
        raise AssertionError(node)  # formula_tree refuses everything else


#: Number of points that are computed at a time, so that intermediate values stay in the processor's cache.
BATCH_POINTS = 1024


@dataclass(frozen=True, eq=False)
class Program:
    """The instructions that compute the outputs of formulas from variables; values are the rows of a table.

    Sequences of arithmetic steps are compiled, and the functions between them are NumPy's: one operation of NumPy on a
    hundred points takes ten times as long as the arithmetic.
    """

    numbers: Floats  #: (k, 1): numbers, the first rows of the table.
    variables: Mapping[str, int]  #: The rows of the variables by name.
    operations: int  #: Number of further rows, each the result of one step.
    #: In the order of computation: codes of arithmetic (k, 4), or a kernel's name, the rows of its operands, and the
    #: row of its result.
    stages: tuple[Ints | tuple[str, list[int], int], ...]
    outputs: Ints  #: (o,): the rows of the outputs.

    def __call__(self, variables: Mapping[str, Any], count: int) -> Floats:
        """Return the outputs (o, count), inf or NaN where undefined; ``variables`` by name: (count,) or numbers."""
        results = np.empty((len(self.outputs), count))
        columns = {row: np.broadcast_to(variables[name], count) for name, row in self.variables.items()}
        rows = len(self.numbers) + len(columns) + self.operations
        with np.errstate(all="ignore"):
            for start in range(0, count, BATCH_POINTS):
                part = slice(start, min(start + BATCH_POINTS, count))
                table = np.empty((rows, part.stop - start))
                table[: len(self.numbers)] = self.numbers
                for row, column in columns.items():
                    table[row] = column[part]
                for stage in self.stages:
                    if isinstance(stage, tuple):
                        kernel, operands, result = stage
                        table[result] = KERNELS[kernel](*[table[row] for row in operands])
                    else:
                        from cpmkit.formulas.arithmetic_kernels import run_arithmetic

                        run_arithmetic(table, stage)
                results[:, part] = table[self.outputs]
        return results


def make_program(steps: Steps, outputs: Sequence[int]) -> Program:
    """Return the program that computes the values at the places ``outputs`` in ``steps``, in that order."""
    kinds = {place: steps.steps[place][0] for place in steps.dependencies(outputs)}
    numbers, names = ([place for place in kinds if kinds[place] == kind] for kind in ("number", "name"))
    applied = [place for place in kinds if kinds[place] in KERNELS]
    row = {place: k for k, place in enumerate([*numbers, *names, *applied])}
    stages = list[Any]()
    for is_arithmetic, group in groupby(applied, key=lambda place: kinds[place] in ARITHMETIC):
        part: list[Any] = []
        for place in group:
            operands = [row[operand] for operand in steps.steps[place][1:]]
            part.append((kinds[place], operands, row[place]))
        codes = [[ARITHMETIC.index(kernel), rows[0], rows[-1], result] for kernel, rows, result in part * is_arithmetic]
        stages += [np.array(codes)] if is_arithmetic else part
    return Program(
        numbers=np.array([steps.constant_value(place) for place in numbers], dtype=np.float64).reshape(-1, 1),
        variables={steps.steps[place][1]: row[place] for place in names},
        operations=len(applied),
        stages=tuple(stages),
        outputs=np.array([row[place] for place in outputs]),
    )
