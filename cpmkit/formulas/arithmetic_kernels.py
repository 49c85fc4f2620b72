"""Compiled arithmetic of formulas: on few points, many steps take no longer than a single operation of NumPy."""

from __future__ import annotations

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats, Ints


@compiled
def run_arithmetic(table: Floats, codes: Ints) -> None:
    """Compute arithmetic steps on the rows of a table, in place and with the rounding of NumPy.

    ``table`` (s, n): in each row the values of a step of a formula at n points; results are written to it.
    ``codes`` (k, 4): in each row an operation: its number in ``cpmkit.formulas.steps.ARITHMETIC``, the rows of its
        first and second operand (equal if it has one), and the row of its result, which differs from those.
    """
    n = table.shape[1]
    for code, first, second, result in codes:
        a, b, out = table[first], table[second], table[result]
        if code == 0:
            for i in range(n):
                out[i] = a[i] + b[i]
        elif code == 1:
            for i in range(n):
                out[i] = a[i] - b[i]
        elif code == 2:
            for i in range(n):
                out[i] = a[i] * b[i]
        elif code == 3:
            for i in range(n):
                out[i] = a[i] / b[i]
        elif code == 4:
            for i in range(n):
                out[i] = -a[i]
        else:
            for i in range(n):
                out[i] = np.sqrt(a[i])
