"""Functions of values at points in equations in time: reactions, and functions applied after each step."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cpmkit.errors import InputError, ResolutionError, shown
from cpmkit.scene.data import LARGEST_DATUM, takes_time
from cpmkit.types import Floats


def call_pointwise(
    function: Callable[..., Any],
    arrays: tuple[Floats, ...],
    shape: tuple[int, ...],
    label: str,
    time: float | None = None,
    least: int = 1,
    finite: bool = True,
) -> Floats:
    """Return the values of a function at points, of this ``shape``: (p,) or (p, channels).

    The function may return one number for all points, and (p,) where (p, 1) is needed.

    Parameters
    ----------
    function : callable
        A function of the first of ``arrays``, as many as it has parameters without defaults.
    arrays : tuple of (p, ...) float64
    shape : tuple of int
    label : str
        Name of the function in messages.
    time : float, optional
        Argument of a parameter ``t`` without a default.
    least : int
        Number of arrays that the function receives at least.
    finite : bool
        Whether values that are not finite are refused.

    Raises
    ------
    InputError
        If the function fails, or does not return numbers of this shape.
    """
    timed = {"t": time} if time is not None and takes_time(function) else {}
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # some built-in functions have no signature
        parameters = {}.values()
    needed = [each for each in parameters if each.default is each.empty and each.kind is not each.VAR_KEYWORD]
    count = max(sum(each.name not in timed for each in needed), least)
    try:
        values = np.asarray(function(*arrays[:count], **timed), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{label} must return numbers of shape {shape}: {shown(str(error))}.") from error
    if values.ndim == 0 or (values.shape == shape[:1] and shape[1:] == (1,)):
        values = np.broadcast_to(values.reshape(-1, *shape[1:]), shape)
    if values.shape != shape or (finite and not np.isfinite(values).all()):
        bad = "" if np.isfinite(values).all() else " with NaN or infinity"
        at = "" if time is None else f" at time {time:.4g}"
        raise InputError(f"{label} must return finite numbers of shape {shape}, got shape {values.shape}{bad}{at}.")
    return values


#: Step of differences, as a share of the varied quantity: above the square root of the rounding error.
DIFFERENCE_SHARE = 1e-6


def difference_step(x: Floats) -> Floats:
    """Return the steps (k,) of differences of functions of x (k,), which may be zero."""
    return DIFFERENCE_SHARE * np.maximum(np.abs(x), np.abs(x).max(initial=0.0) or 1.0)


def central_difference(function: Callable[[Floats], Floats], x: Floats, step: Floats) -> Floats:
    """Return the derivative (k,) of a function of x (k,) by differences with a ``step`` (k,)."""
    return np.asarray((function(x + step) - function(x - step)) / (2 * step))


#: A function of points (p, d), values (p, channels) and, if it has a parameter ``t`` without a default, the time, that
#: returns values (p, channels).
AfterStep = Callable[..., Any]


def apply_after_step(after_step: AfterStep, points: Floats, values: Floats, time: float) -> Floats:
    """Return the result (p, channels) of ``after_step`` for ``values`` (p, channels) at ``points`` (p, d) and ``time``.

    Raises
    ------
    InputError
        If the result has another shape, or is not finite.
    """
    return call_pointwise(after_step, (points, values.copy()), values.shape, "after_step", time, least=2)


#: A function of u (p, channels), of points (p, d) if it has a second parameter, and of the time if it has a parameter
#: ``t`` without a default, that returns rates (p, channels); or the formulas of the channels.
Reaction = Callable[..., Any] | str | Sequence[str]


def reaction_rates(reaction: Any, u: Floats, points: Floats, time: float, start: float = 0.0) -> Floats:
    """Return the rates (p, channels) of a reaction for values u (p, channels) at ``points`` (p, d) and ``time``.

    Raises
    ------
    InputError
        If the rates have another shape, or are not finite at the time ``start``.
    ResolutionError
        If the rates are not finite at a later time.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        values = call_pointwise(reaction, (u.copy(), points), u.shape, "the reaction", time, finite=False)
    if not np.abs(values).max(initial=0.0) <= LARGEST_DATUM:
        if time == start:
            raise InputError("the reaction must be finite for the initial data, got NaN, infinity or more than 1e100.")
        raise ResolutionError(
            f"The reaction ceased to be finite at time {time:.4g}: it is taken from the step before, and the step must "
            "be shorter than the time in which the fastest part of it acts; use a shorter step. If that puts the time "
            "off by nothing, the equation itself has no solution beyond it."
        )
    return np.ascontiguousarray(values)
