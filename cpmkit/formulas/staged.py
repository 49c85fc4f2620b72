"""Programs in stages, for few points at a time: runs of arithmetic are compiled, the functions between are NumPy's.

One operation of NumPy on a hundred points takes ten times what its sums take.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from cpmkit.formulas.steps import KERNELS, Program
from cpmkit.protocols import Floats, Ints

#: What ``run_arithmetic`` knows, in its order; rounding leaves each but one result, so that it is NumPy's to the bit.
ARITHMETIC = ("add", "subtract", "multiply", "divide", "negative", "sqrt")
#: For more points than these, NumPy's own loops are the faster ones.
MOST_STAGED_POINTS = 1024

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


def staged(program: Program) -> StagedProgram:
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
