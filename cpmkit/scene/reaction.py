"""Reactions: what becomes of the channels of a solution at each point, by themselves."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from cpmkit.errors import InputError, ResolutionError
from cpmkit.protocols import Floats
from cpmkit.scene.data import LARGEST_DATUM
from cpmkit.scene.pointwise import values_of

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


def rates(reaction: Reaction, u: Floats, points: Floats, time: float, start: float = 0.0) -> Floats:
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
        found = values_of(reaction, given, time, u.shape[1], "the reaction")
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
