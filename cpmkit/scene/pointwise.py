"""Functions of values at points, in problems in time: reactions, and what is done after each step."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from cpmkit.errors import InputError, ResolutionError, shown
from cpmkit.protocols import Floats
from cpmkit.runtime.arrays import positive
from cpmkit.scene.data import LARGEST_DATUM, takes_time


def call_pointwise(
    function: Callable[..., Any], given: tuple[Floats, ...], time: float, channels: int, label: str
) -> Floats:
    """Return what a function makes of arrays ``given`` and, where it has a parameter ``t``, of the time.

    Where there is one channel, an array (p,) is taken as (p, 1). The shape is left to the caller to check.

    Raises
    ------
    InputError
        If the function fails, or returns no numbers; it is named by ``label``.
    """
    timed = {"t": time} if takes_time(function) else {}
    try:
        found = np.asarray(function(*given, **timed), dtype=np.float64)
    except (TypeError, ValueError) as error:
        shape = (len(given[0]), channels)
        raise InputError(
            f"{label} must return numbers of shape {shape} for values of that shape: {shown(str(error))}."
        ) from error
    return found[:, None] if found.ndim == 1 and channels == 1 else found


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


def apply_after_step(after_step: AfterStep, points: Floats, values: Floats, time: float) -> Floats:
    """Return what ``after_step`` makes of ``values`` (p, channels) at ``points`` (p, d).

    Raises
    ------
    InputError
        If that is of another shape, or not finite.
    """
    found = call_pointwise(after_step, (points, values.copy()), time, values.shape[1], "after_step")
    if found.shape != values.shape or not np.isfinite(found).all():
        raise InputError(
            f"after_step must return finite values of shape {values.shape}, got shape {found.shape}"
            f"{'' if np.isfinite(found).all() else ' with NaN or infinity'} at time {time:.4g}."
        )
    return found


#: A function of u (p, channels), of points (p, d) where it takes them, and of the time where it has a parameter ``t``
#: without a default, that returns rates (p, channels).
Reaction = Callable[..., Any]


def takes_points(reaction: Reaction) -> bool:
    """Tell whether a reaction takes points beside u."""
    try:
        parameters = inspect.signature(reaction).parameters.values()
    except (TypeError, ValueError):  # some built-in functions tell no signature
        return False
    needed = [one for one in parameters if one.default is one.empty and one.kind is not one.VAR_KEYWORD]
    return sum(one.name != "t" for one in needed) > 1


def reaction_rates(reaction: Reaction, u: Floats, points: Floats, time: float, start: float = 0.0) -> Floats:
    """Return the rates (p, channels) of a reaction at values u (p, channels), points (p, d) and a time.

    Raises
    ------
    InputError
        If they are of another shape, or not finite at the start.
    ResolutionError
        If they are no longer finite later on.
    """
    given = (u.copy(), points) if takes_points(reaction) else (u.copy(),)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        found = call_pointwise(reaction, given, time, u.shape[1], "the reaction")
    if found.shape != u.shape:
        raise InputError(f"the reaction must return shape {u.shape} for values of u of that shape, got {found.shape}.")
    if not np.abs(found).max(initial=0.0) <= LARGEST_DATUM:
        if time == start:
            raise InputError("the reaction must be finite for the initial data, got NaN, infinity or more than 1e100.")
        raise ResolutionError(
            f"The reaction ceased to be finite at time {time:.4g}: it is taken from the step before, and the step must "
            "be shorter than the time in which the fastest part of it acts; use a shorter step. If that puts the time "
            "off by nothing, the equation itself has no solution beyond it."
        )
    return np.ascontiguousarray(found)
