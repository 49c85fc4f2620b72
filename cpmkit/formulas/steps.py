"""Formulas as lists of steps: each an operation of NumPy on earlier steps, no two alike.

Every number is float64, so that 1/0 is infinite and (-1)**0.5 is NaN, as in arrays, and nothing raises.
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

#: What a step does, by its name: the functions of formulas, and what their operators and derivatives need.
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
#: The kernel of an operator; a > b is b < a.
OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "add", ast.Sub: "subtract", ast.Mult: "multiply", ast.Div: "divide", ast.Mod: "mod", ast.Lt: "less",
    ast.LtE: "less_equal", ast.Gt: "less", ast.GtE: "less_equal",
}  # fmt: skip
#: Powers up to this are products: NumPy's general power takes ten times longer.
HIGHEST_PRODUCT_POWER = 12
#: So many points are computed at a time: their intermediate values stay in the processor's cache.
BATCH_POINTS = 8192

#: A number ("number", bits), a variable ("name", name), or a kernel's name and the places of its operands.
Step = tuple[Any, ...]


class Steps:
    """A list of steps that grows; a place in it stands for a value."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self._places: dict[Step, int] = {}

    def number(self, value: float) -> int:
        """Return the place of a number."""
        return self._place(("number", float(value).hex()))  # the bits tell 0.0 from -0.0

    def name(self, name: str) -> int:
        """Return the place of a variable."""
        return self._place(("name", name))

    def value(self, place: int) -> float | None:
        """Return the number at a place, None where there is something else."""
        kind, *label = self.steps[place]
        return float.fromhex(label[0]) if kind == "number" else None

    def apply(self, kernel: str, *operands: int) -> int:
        """Return the place of a kernel's result; that of numbers is a number."""
        numbers = [self.value(place) for place in operands]
        if any(number is None for number in numbers):
            return self._place((kernel, *operands))
        with np.errstate(all="ignore"):
            return self.number(KERNELS[kernel](*map(np.float64, numbers)))

    def power(self, base: int, exponent: int) -> int:
        """Return the place of a power: a product where the exponent is a small whole number."""
        number = self.value(exponent)
        if number == 0.5:
            return self.apply("sqrt", base)
        if number is None or not number.is_integer() or not 1 <= abs(number) <= HIGHEST_PRODUCT_POWER:
            return self.apply("power", base, exponent)
        square, product, rest = base, -1, int(abs(number))
        while rest:
            if rest % 2:
                product = square if product < 0 else self.apply("multiply", product, square)
            rest //= 2
            square = self.apply("multiply", square, square) if rest else square
        return product if number > 0 else self.apply("divide", self.number(1.0), product)

    def add_tree(self, tree: ast.expr) -> int:
        """Return the place of the value of a checked syntax tree; without recursion, for sums may be long."""
        waiting, done = [(tree, False)], list[int]()
        while waiting:
            node, ready = waiting.pop()
            operands = _operands(node)
            if not ready and operands:
                waiting += [(node, True), *((operand, False) for operand in operands)]
                continue
            places = [done.pop() for _ in operands]
            done.append(self._node(node, places))  # the last operand is done first
        return done[0]

    def cone(self, outputs: Iterable[int]) -> list[int]:
        """Return the places that ``outputs`` depend on, themselves among them, in the order of the list."""
        found, waiting = set(), list(outputs)
        while waiting:
            place = waiting.pop()
            if place not in found:
                found.add(place)
                kind, *operands = self.steps[place]
                waiting += operands if kind in KERNELS else []
        return sorted(found)

    def _place(self, step: Step) -> int:
        place = self._places.setdefault(step, len(self.steps))
        if place == len(self.steps):
            self.steps.append(step)
        return place

    def _node(self, node: ast.expr, places: list[int]) -> int:
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
        raise AssertionError(node)  # formula_tree lets nothing else pass


def _operands(node: ast.expr) -> list[ast.expr]:
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
    """Steps that compute some outputs.

    Attributes
    ----------
    numbers : mapping of place to number
    variables : mapping of name to place
    instructions : tuple of (place, kernel's name, operands, places that are not needed afterwards)
    outputs : tuple of places
    """

    numbers: Mapping[int, Any]
    variables: Mapping[str, int]
    instructions: tuple[tuple[int, str, tuple[int, ...], tuple[int, ...]], ...]
    outputs: tuple[int, ...]

    def __call__(self, variables: Mapping[str, Any], count: int) -> Floats:
        """Return one row an output (k, count), of variables that are arrays (count,) or numbers."""
        table = np.empty((len(self.outputs), count))
        needed = {name: np.asarray(variables[name], dtype=np.float64) for name in self.variables}
        with np.errstate(all="ignore"):
            for start in range(0, count, BATCH_POINTS):
                part = slice(start, start + BATCH_POINTS)
                values = {self.variables[n]: array[part] if array.ndim else array for n, array in needed.items()}
                self._run(values, table[:, part])
        return table

    def _run(self, values: dict[int, Any], rows: Floats) -> None:
        values.update(self.numbers)
        for place, kernel, operands, released in self.instructions:
            values[place] = KERNELS[kernel](*[values[operand] for operand in operands])
            for old in released:
                del values[old]
        for row, place in zip(rows, self.outputs, strict=True):
            row[:] = values[place]


def make_program(steps: Steps, outputs: Sequence[int]) -> Program:
    """Return what computes ``outputs``."""
    cone = steps.cone(outputs)
    numbers = {place: np.float64(value) for place in cone if (value := steps.value(place)) is not None}
    variables = {steps.steps[place][1]: place for place in cone if steps.steps[place][0] == "name"}
    kernels = [place for place in cone if steps.steps[place][0] in KERNELS]
    kept, released = set(outputs), {}
    for place in reversed(kernels):  # whoever uses a value last lets go of it
        operands = set(steps.steps[place][1:])
        released[place] = tuple(operands - kept)
        kept |= operands
    instructions = tuple((p, steps.steps[p][0], steps.steps[p][1:], released[p]) for p in kernels)
    return Program(numbers, variables, instructions, tuple(outputs))


#: What ``run_arithmetic`` knows, in its order; rounding leaves each but one result, so that it is NumPy's to the bit.
ARITHMETIC = ("add", "subtract", "multiply", "divide", "negative", "sqrt")
#: For more points than these, NumPy's own loops are the faster ones.
MAX_STAGED_POINTS = 1024

#: A run of arithmetic (k, 4), or a kernel's name, the rows of its operands, and that of its result.
Stage = Ints | tuple[str, list[int], int]


@dataclass(frozen=True, eq=False)
class StagedProgram:
    """A program whose values are rows of a table.

    Attributes
    ----------
    rows : int
        Of the table. The first are those of the numbers; they, and the variables', are never used again.
    numbers : (k, 1) float64
    variables : tuple of (name, row)
    stages : tuple of Stage
    outputs : (o,) int64
        Their rows.
    """

    rows: int
    numbers: Floats
    variables: tuple[tuple[str, int], ...]
    stages: tuple[Stage, ...]
    outputs: Ints

    def __call__(self, columns: dict[str, Floats], count: int) -> Floats:
        """Return one row an output (o, count), of variables that are arrays (count,)."""
        from cpmkit.formulas.arithmetic_kernels import run_arithmetic

        table = np.empty((self.rows, count))
        table[: len(self.numbers)] = self.numbers
        for name, row in self.variables:
            table[row] = columns[name]
        with np.errstate(all="ignore"):
            for stage in self.stages:
                if isinstance(stage, tuple):
                    kernel, operands, target = stage
                    table[target] = KERNELS[kernel](*[table[row] for row in operands])
                else:
                    run_arithmetic(table, stage)
        results: Floats = table[self.outputs]
        return results


def stage_program(program: Program) -> StagedProgram:
    """Return the same program in stages; rows whose values are not needed any more are used again."""
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
    for plain, group in groupby(steps, key=lambda step: step[0] in ARITHMETIC):
        some = list(group)
        stages += [np.array([_coded(*step) for step in some])] if plain else some
    numbers = np.array([float(number) for number in program.numbers.values()]).reshape(-1, 1)
    variables = tuple((name, row[place]) for name, place in program.variables.items())
    return StagedProgram(rows, numbers, variables, tuple(stages), np.array([row[place] for place in program.outputs]))


def _coded(kernel: str, operands: list[int], target: int) -> list[Any]:
    return [ARITHMETIC.index(kernel), operands[0], operands[-1], target]
