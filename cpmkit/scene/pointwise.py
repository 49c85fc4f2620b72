"""Functions of values at points, in problems in time: reactions, and what is done after each step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.protocols import Floats
from cpmkit.scene.data import takes_time


def values_of(function: Callable[..., Any], given: tuple[Floats, ...], time: float, channels: int, what: str) -> Floats:
    """Return what a function makes of arrays ``given`` and, where it has a parameter ``t``, of the time.

    Where there is one channel, an array (p,) is taken as (p, 1). The shape is left to the caller to check.

    Raises
    ------
    InputError
        If the function fails, or returns no numbers; it is named by ``what``.
    """
    timed = {"t": time} if takes_time(function) else {}
    try:
        found = np.asarray(function(*given, **timed), dtype=np.float64)
    except (TypeError, ValueError) as error:
        shape = (len(given[0]), channels)
        raise InputError(
            f"{what} must return numbers of shape {shape} for values of that shape: {shown(str(error))}."
        ) from error
    return found[:, None] if found.ndim == 1 and channels == 1 else found
