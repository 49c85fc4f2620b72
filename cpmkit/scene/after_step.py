"""What a run in time does after each of its steps, and when it has come to rest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.protocols import Floats
from cpmkit.runtime.arrays import positive
from cpmkit.scene.pointwise import values_of

#: A function of points (p, d), values (p, channels) and, where it has a parameter ``t`` without a default, the time,
#: that returns values (p, channels).
AfterStep = Callable[..., Any]


def check_after_step(after_step: Any, rest: Any, kind: str) -> None:
    """Refuse what cannot be called after each step, and a rate of rest that is not above zero.

    Raises
    ------
    InputError
        Naming the equation by its ``kind``.
    """
    if after_step is not None and not callable(after_step):
        raise InputError(
            f"after_step of {kind} must be a function of points (p, d) and values (p, channels), got "
            f"{shown(after_step)}."
        )
    if rest is not None:
        positive(rest, f"rest of {kind}")


def changed_values(after_step: AfterStep, points: Floats, values: Floats, time: float) -> Floats:
    """Return what ``after_step`` makes of ``values`` (p, channels) at ``points`` (p, d).

    Raises
    ------
    InputError
        If that is of another shape, or not finite.
    """
    found = values_of(after_step, (points, values.copy()), time, values.shape[1], "after_step")
    if found.shape != values.shape or not np.isfinite(found).all():
        raise InputError(
            f"after_step must return finite values of shape {values.shape}, got shape {found.shape}"
            f"{'' if np.isfinite(found).all() else ' with NaN or infinity'} at time {time:.4g}."
        )
    return found
