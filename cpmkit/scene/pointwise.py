"""Functions of values at points in equations in time: reactions, and functions applied after each step."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from cpmkit.errors import InputError, ResolutionError, shown
from cpmkit.runtime.arrays import positive
from cpmkit.scene.data import LARGEST_DATUM, takes_time
from cpmkit.types import Floats


def call_pointwise(
    function: Callable[..., Any], arrays: tuple[Floats, ...], time: float, channels: int, label: str
) -> Floats:
    """Return the values of a function of ``arrays`` (p, ...) and, if it has a parameter ``t``, of ``time``.

    With one channel, values (p,) are returned as (p, 1). The caller checks the shape.

    Raises
    ------
    InputError
        If the function fails, or does not return numbers; ``label`` is its name in the message.
    """
    timed = {"t": time} if takes_time(function) else {}
    try:
        values = np.asarray(function(*arrays, **timed), dtype=np.float64)
    except (TypeError, ValueError) as error:
        shape = (len(arrays[0]), channels)
        raise InputError(
            f"{label} must return numbers of shape {shape} for values of that shape: {shown(str(error))}."
        ) from error
    return values[:, None] if values.ndim == 1 and channels == 1 else values


#: A function of points (p, d), values (p, channels) and, if it has a parameter ``t`` without a default, the time, that
#: returns values (p, channels).
AfterStep = Callable[..., Any]


def check_after_step(after_step: Any, rest: Any, kind: str) -> None:
    """Raise if ``after_step`` is neither a function nor None, or ``rest`` neither a number above zero nor None.

    Raises
    ------
    InputError
        In these cases; ``kind`` is the name of the equation in the message.
    """
    if after_step is not None and not callable(after_step):
        raise InputError(
            f"after_step of {kind} must be a function of points (p, d) and values (p, channels), got "
            f"{shown(after_step)}."
        )
    if rest is not None:
        positive(rest, f"rest of {kind}")


def apply_after_step(after_step: AfterStep, points: Floats, values: Floats, time: float) -> Floats:
    """Return the result (p, channels) of ``after_step`` for ``values`` (p, channels) at ``points`` (p, d) and ``time``.

    Raises
    ------
    InputError
        If the result has another shape, or is not finite.
    """
    changed = call_pointwise(after_step, (points, values.copy()), time, values.shape[1], "after_step")
    if changed.shape != values.shape or not np.isfinite(changed).all():
        raise InputError(
            f"after_step must return finite values of shape {values.shape}, got shape {changed.shape}"
            f"{'' if np.isfinite(changed).all() else ' with NaN or infinity'} at time {time:.4g}."
        )
    return changed


#: A function of u (p, channels), of points (p, d) if it has a second parameter, and of the time if it has a parameter
#: ``t`` without a default, that returns rates (p, channels).
Reaction = Callable[..., Any]


def takes_points(reaction: Reaction) -> bool:
    """Return True if a reaction has a second parameter, which is for points."""
    try:
        parameters = inspect.signature(reaction).parameters.values()
    except (TypeError, ValueError):  # some built-in functions have no signature
        return False
    needed = [each for each in parameters if each.default is each.empty and each.kind is not each.VAR_KEYWORD]
    return sum(each.name != "t" for each in needed) > 1


def reaction_rates(reaction: Reaction, u: Floats, points: Floats, time: float, start: float = 0.0) -> Floats:
    """Return the rates (p, channels) of a reaction for values u (p, channels) at ``points`` (p, d) and ``time``.

    Raises
    ------
    InputError
        If the rates have another shape, or are not finite at the time ``start``.
    ResolutionError
        If the rates are not finite at a later time.
    """
    arrays = (u.copy(), points) if takes_points(reaction) else (u.copy(),)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        values = call_pointwise(reaction, arrays, time, u.shape[1], "the reaction")
    if values.shape != u.shape:
        raise InputError(f"the reaction must return shape {u.shape} for values of u of that shape, got {values.shape}.")
    if not np.abs(values).max(initial=0.0) <= LARGEST_DATUM:
        if time == start:
            raise InputError("the reaction must be finite for the initial data, got NaN, infinity or more than 1e100.")
        raise ResolutionError(
            f"The reaction ceased to be finite at time {time:.4g}: it is taken from the step before, and the step must "
            "be shorter than the time in which the fastest part of it acts; use a shorter step. If that puts the time "
            "off by nothing, the equation itself has no solution beyond it."
        )
    return np.ascontiguousarray(values)
