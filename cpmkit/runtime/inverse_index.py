"""Compiled: the positions of each number in a list."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.types import Ints


@compiled
def inverse_index(values: Any, n: int) -> tuple[Ints, Any]:
    """Return the positions of each integer below ``n`` in ``values``, in compressed rows.

    Parameters
    ----------
    values : (k,) integers
        Integers from 0 to n - 1.
    n : int
        Number of integers that may occur.

    Returns
    -------
    starts : (n + 1,) int64
        The positions of i are ``places[starts[i] : starts[i + 1]]``, ascending.
    places : (k,) of the type of ``values``
        Positions in ``values``.
    """
    starts = np.zeros(n + 1, dtype=np.int64)
    for value in values:
        starts[value + 1] += 1
    for i in range(n):
        starts[i + 1] += starts[i]
    places = np.empty(len(values), dtype=values.dtype)
    for at in range(len(values)):
        places[starts[values[at]]] = at
        starts[values[at]] += 1
    for i in range(n, 0, -1):
        starts[i] = starts[i - 1]
    starts[0] = 0
    return starts, places
