"""Programs of formulas: lists of distinct steps, each an operation of NumPy on the values of earlier steps.

All numbers are float64, so that 1/0 is infinite and (-1)**0.5 is NaN, as in arrays, without errors.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from cpmkit.formulas.trees import CONSTANTS
from cpmkit.types import Floats, Ints

#: The operations of steps by name: functions, operators, and operations that derivatives need.
KERNELS: dict[str, Callable[..., Any]] = {
    name: getattr(np, name)
    for name in (
        "sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh",
        "exp", "log", "sqrt", "abs", "sign", "floor", "minimum", "maximum", "hypot",
        "add", "subtract", "multiply", "divide", "power", "mod", "negative",
    )
} | {
    "less": lambda a, b: (a < b) * 1.0, "less_equal": lambda a, b: (a <= b) * 1.0,
    "where": lambda condition, a, b: np.where(condition != 0, a, b),
}  # fmt: skip
#: Kernels of operators; a > b is computed as b < a.
OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "add", ast.Sub: "subtract", ast.Mult: "multiply", ast.Div: "divide", ast.Mod: "mod", ast.Lt: "less",
    ast.LtE: "less_equal", ast.Gt: "less", ast.GtE: "less_equal",
}  # fmt: skip
#: Number of points that are computed at a time, so that intermediate values stay in the processor's cache.
BATCH_POINTS = 8192

#: A number ("number", hexadecimal text), a variable ("name", name), or a kernel and the places of its operands.
Step = tuple[Any, ...]


class Steps:
    """A growing list of distinct steps; the place of a step in the list stands for its value."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self._places: dict[Step, int] = {}

    def number(self, value: float) -> int:
        """Return the place of a number, which is added if it is new."""
        return self._place(("number", float(value).hex()))  # the text distinguishes 0.0 and -0.0

    def name(self, name: str) -> int:
        """Return the place of a variable, which is added if it is new."""
        return self._place(("name", name))

    def value(self, place: int) -> float | None:
        """Return the number at ``place``, None if the step is not a number."""
        kind, *operands = self.steps[place]
        return float.fromhex(operands[0]) if kind == "number" else None

    def apply(self, kernel: str, *operands: int) -> int:
        """Return the place of a kernel's result, which is added if it is new; it is a number if all operands are."""
        numbers = [self.value(place) for place in operands]
        if any(number is None for number in numbers):
            return self._place((kernel, *operands))
        with np.errstate(all="ignore"):
            return self.number(KERNELS[kernel](*map(np.float64, numbers)))

    def power(self, base: int, exponent: int) -> int:
        """Return the place of a power, computed by products if the exponent is a small whole number."""
        number = self.value(exponent)
        if number == 0.5:
            return self.apply("sqrt", base)
        if (
            number is None or not number.is_integer() or not 1 <= abs(number) <= 12
        ):  # NumPy's power takes ten times as long as products
            return self.apply("power", base, exponent)
        square, product, rest = base, -1, int(abs(number))
        while rest:
            if rest % 2:
                product = square if product < 0 else self.apply("multiply", product, square)
            rest //= 2
            square = self.apply("multiply", square, square) if rest else square
        return product if number > 0 else self.apply("divide", self.number(1.0), product)

    def add_tree(self, tree: ast.expr) -> int:
        """Return the place of the value of a checked syntax tree; without recursion, because sums may be long."""
        stack, results = [(tree, False)], list[int]()
        while stack:
            node, ready = stack.pop()
            operands = _operands(node)
            if not ready and operands:
                stack += [(node, True), *((operand, False) for operand in operands)]
                continue
            places = [results.pop() for _ in operands]  # the last operand was computed first
            results.append(self._node(node, places))
        return results[0]

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

    def _place(self, step: Step) -> int:
        """Return the place of a step, which is added if it is new."""
        place = self._places.setdefault(step, len(self.steps))
        if place == len(self.steps):
            self.steps.append(step)
        return place

    def _node(self, node: ast.expr, places: list[int]) -> int:
        """Return the place of the value of a syntax node whose operands have the values at ``places``."""
        match node:
            case ast.Constant(value=int() | float() as number):
                return self.number(number)
            case ast.Name(id=name):
                return self.number(CONSTANTS[name]) if name in CONSTANTS else self.name(name)
            case ast.UnaryOp(op=op):
                return self.apply("negative", *places) if isinstance(op, ast.USub) else places[0]
            case ast.BinOp(op=ast.Pow()):
                return self.power(*places)
            case ast.Compare(ops=[ast.Gt() | ast.GtE() as op]):
                return self.apply(OPERATORS[type(op)], *places[::-1])
            case ast.BinOp(op=op) | ast.Compare(ops=[op]):
                return self.apply(OPERATORS[type(op)], *places)
            case ast.Call(func=ast.Name(id=name)):
                return self.apply(name, *places)
        raise AssertionError(node)  # formula_tree refuses everything else


def _operands(node: ast.expr) -> list[ast.expr]:
    """Return the operands of a syntax node, none for names and numbers."""
    match node:
        case ast.UnaryOp(operand=operand):
            return [operand]
        case ast.BinOp(left=left, right=right) | ast.Compare(left=left, comparators=[right]):
            return [left, right]
        case ast.Call(args=arguments):
            return arguments
    return []


@dataclass(frozen=True, eq=False)
class Program:
    """The instructions that compute the outputs of formulas from variables.

    Attributes
    ----------
    numbers : mapping
        The numbers by place.
    variables : mapping
        The places of the variables by name.
    instructions : tuple
        For each kernel to apply: the place of the result, its name, the places of its operands, and the places of
        values that are not needed afterwards.
    outputs : tuple of int
        The places of the outputs.
    """

    numbers: Mapping[int, Any]
    variables: Mapping[str, int]
    instructions: tuple[tuple[int, str, tuple[int, ...], tuple[int, ...]], ...]
    outputs: tuple[int, ...]

    def __call__(self, variables: Mapping[str, Any], count: int) -> Floats:
        """Return the outputs (k, count) at ``count`` points, given variables that are arrays (count,) or numbers."""
        table = np.empty((len(self.outputs), count))
        needed = {name: np.asarray(variables[name], dtype=np.float64) for name in self.variables}
        with np.errstate(all="ignore"):
            for start in range(0, count, BATCH_POINTS):
                part = slice(start, start + BATCH_POINTS)
                values = {self.variables[n]: array[part] if array.ndim else array for n, array in needed.items()}
                self._run(values, table[:, part])
        return table

    def _run(self, values: dict[int, Any], rows: Floats) -> None:
        """Fill the ``rows`` (k, n) with the outputs, given in ``values`` those of the variables by place."""
        values.update(self.numbers)
        for place, kernel, operands, released in self.instructions:
            values[place] = KERNELS[kernel](*[values[operand] for operand in operands])
            for old in released:
                del values[old]
        for row, place in zip(rows, self.outputs, strict=True):
            row[:] = values[place]


def make_program(steps: Steps, outputs: Sequence[int]) -> Program:
    """Return the program that computes the values at the places ``outputs``."""
    places = steps.dependencies(outputs)
    numbers = {place: np.float64(value) for place in places if (value := steps.value(place)) is not None}
    variables = {steps.steps[place][1]: place for place in places if steps.steps[place][0] == "name"}
    kernels = [place for place in places if steps.steps[place][0] in KERNELS]
    needed, released = set(outputs), {}
    for place in reversed(kernels):  # a value is released by the last step that uses it
        operands = set(steps.steps[place][1:])
        released[place] = tuple(operands - needed)
        needed |= operands
    instructions = tuple((p, steps.steps[p][0], steps.steps[p][1:], released[p]) for p in kernels)
    return Program(numbers, variables, instructions, tuple(outputs))


#: The kernels of ``run_arithmetic``, in its order; IEEE 754 defines their results, which equal NumPy's exactly.
ARITHMETIC = ("add", "subtract", "multiply", "divide", "negative", "sqrt")
#: Most points of a staged program; for more points NumPy's own loops are faster.
MAX_STAGED_POINTS = 1024

#: Codes of arithmetic (k, 4), or a kernel's name, the rows of its operands, and the row of its result.
Stage = Ints | tuple[str, list[int], int]


@dataclass(frozen=True, eq=False)
class StagedProgram:
    """A program for few points whose values are the rows of a table.

    Sequences of arithmetic steps are compiled, and the functions between them are NumPy's: one operation of NumPy on a
    hundred points takes ten times as long as the arithmetic.

    Attributes
    ----------
    rows : int
        Number of rows of the table. The first rows are numbers, then variables; these are not overwritten.
    numbers : (k, 1) float64
        Values of the first k rows.
    variables : tuple of (str, int)
        Name and row of each variable.
    stages : tuple of Stage
        The stages, in the order of computation.
    outputs : (o,) int64
        Rows of the outputs.
    """

    rows: int
    numbers: Floats
    variables: tuple[tuple[str, int], ...]
    stages: tuple[Stage, ...]
    outputs: Ints

    def __call__(self, columns: dict[str, Floats], count: int) -> Floats:
        """Return the outputs (o, count), given the variables as arrays (count,) by name."""
        from cpmkit.formulas.arithmetic_kernels import run_arithmetic

        table = np.empty((self.rows, count))
        table[: len(self.numbers)] = self.numbers
        for name, row in self.variables:
            table[row] = columns[name]
        with np.errstate(all="ignore"):
            for stage in self.stages:
                if isinstance(stage, tuple):
                    kernel, operands, result = stage
                    table[result] = KERNELS[kernel](*[table[row] for row in operands])
                else:
                    run_arithmetic(table, stage)
        results: Floats = table[self.outputs]
        return results


def stage_program(program: Program) -> StagedProgram:
    """Return the program in stages, in which rows of values that are not needed any more are used again."""
    fixed = [*program.numbers, *program.variables.values()]
    row = {place: k for k, place in enumerate(fixed)}
    free, rows = list[int](), len(fixed)
    steps = list[tuple[str, list[int], int]]()
    for place, kernel, operands, released in program.instructions:
        if not free:
            free, rows = [rows], rows + 1
        row[place] = free.pop()
        steps.append((kernel, [row[operand] for operand in operands], row[place]))
        free += [row[old] for old in released if row[old] >= len(fixed)]
    stages = list[Stage]()
    for is_arithmetic, group in groupby(steps, key=lambda step: step[0] in ARITHMETIC):
        part = list(group)
        stages += [np.array([_code(*step) for step in part])] if is_arithmetic else part
    numbers = np.array([float(number) for number in program.numbers.values()]).reshape(-1, 1)
    variables = tuple((name, row[place]) for name, place in program.variables.items())
    return StagedProgram(rows, numbers, variables, tuple(stages), np.array([row[place] for place in program.outputs]))


def _code(kernel: str, operands: list[int], result: int) -> list[Any]:
    """Return a row of ``codes`` of ``run_arithmetic``: the kernel's number, the rows of its operands and its result."""
    return [ARITHMETIC.index(kernel), operands[0], operands[-1], result]
