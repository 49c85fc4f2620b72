"""The compiled arithmetic of formulas: many steps on a few points take no longer than one operation of NumPy."""

from __future__ import annotations

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats, Ints


@compiled
def run_arithmetic(table: Floats, codes: Ints) -> None:
    """Take steps on the rows of a table, which are rounded as NumPy's are.

    Parameters
    ----------
    table : (s, n) float64
        A row for each value; overwritten.
    codes : (k, 4) int64
        A step a row: which of ``ARITHMETIC``, its first and second operand, and its result, which is none of them.
    """
    n = table.shape[1]
    for code, first, second, target in codes:
        a, b, out = table[first], table[second], table[target]
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
