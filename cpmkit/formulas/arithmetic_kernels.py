"""Compiled: arithmetic of formulas, of which many steps on few points take no longer than one operation of NumPy."""

from __future__ import annotations

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats, Ints


@compiled
def run_arithmetic(table: Floats, codes: Ints) -> None:
    """Compute steps on the rows of a table, with the rounding of NumPy.

    Parameters
    ----------
    table : (s, n) float64
        The values, one in each row; results are written to it.
    codes : (k, 4) int64
        A step in each row: its number in ``ARITHMETIC``, the rows of its first and second operand, and the row of its
        result, which is another one.
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
