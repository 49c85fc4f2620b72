"""Wrappers that have just the abilities of what they wrap: the core asks for abilities by what methods there are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, TypeVar

import numpy as np

from cpmkit.protocols import ClosestPoints, ClosestPointSource, Floats, HasFeet, HasFloor, HasWarnings, Ints

Base = TypeVar("Base")


def with_abilities(base: type[Base], mixins: Mapping[Any, type[Base]], *sources: object) -> type[Base]:
    """Return ``base`` extended by those of ``mixins`` whose ability all ``sources`` have.

    Parameters
    ----------
    base : type
        The wrapper, without optional abilities.
    mixins : mapping
        From a protocol of :mod:`cpmkit.protocols`, for example ``HasNormals``, to the subclass of ``base`` that
        adds its methods and nothing else.
    *sources
        What is wrapped.

    Examples
    --------
    >>> class Wrapped: ...
    >>> class WithNormals(Wrapped):
    ...     def normals(self, feet): ...
    >>> from cpmkit import protocols, source
    >>> made = with_abilities(Wrapped, {protocols.HasNormals: WithNormals}, source("analytic.sphere"))
    >>> isinstance(made(), protocols.HasNormals), made is Wrapped
    (True, False)
    """
    chosen = tuple(mixin for ability, mixin in mixins.items() if all(isinstance(source, ability) for source in sources))
    extended: type[Base] = _composed((*chosen, base)) if chosen else base
    return extended


@cache
def _composed(bases: tuple[Any, ...]) -> Any:
    return type(bases[-1].__name__, bases, {"__module__": bases[-1].__module__, "__doc__": bases[-1].__doc__})


def feet_of(source: ClosestPointSource, x: Floats, radius: float) -> tuple[Ints, ClosestPoints]:
    """Return the rows (k,) of ``x`` and their feet within ``radius``; closest points where ``source`` has no others."""
    if isinstance(source, HasFeet):
        return source.feet(x, radius)
    feet = source.closest_point(x)
    rows = np.flatnonzero(feet.distance <= radius)
    return rows, feet.take(rows)


def warnings_of(source: object, spacing: float) -> Sequence[str]:
    """Return what ``source`` has to say at ``spacing``; nothing where it has no warnings."""
    return source.warnings(spacing) if isinstance(source, HasWarnings) else ()


def floor_of(source: object, spacing: float) -> float:
    """Return the floor of ``source`` at ``spacing``, 0 where it states none."""
    return source.floor(spacing) if isinstance(source, HasFloor) else 0.0
