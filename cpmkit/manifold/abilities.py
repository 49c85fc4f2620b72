"""Wrappers that have just the abilities of what they wrap: the core asks for abilities by what methods there are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, TypeVar

import numpy as np

from cpmkit.protocols import (
    ClosestPoints,
    ClosestPointSource,
    Floats,
    HasFeet,
    HasFloor,
    HasManyEdges,
    HasWarnings,
    Ints,
)

Base = TypeVar("Base")


#: What a combination makes of each optional ability of its sources: the subclass that passes it on, True where the
#: combination has it in any case, or the reason why it has not. ``TABLE`` in :mod:`cpmkit.combinations.table` has all.
Passing = Mapping[Any, Any]

#: Numbers of edges are below this, unless a source says otherwise.
EDGES = 1000


def with_abilities(base: type[Base], passing: Passing, *sources: object) -> type[Base]:
    """Return ``base`` extended by what passes on those abilities that all ``sources`` have.

    Parameters
    ----------
    base : type
        The wrapper, without optional abilities.
    passing : mapping
        From a protocol of :mod:`cpmkit.protocols`, for example ``HasNormals``, to the subclass of ``base`` that
        adds its methods and nothing else; to True or to a reason where nothing is to be added.
    *sources
        What is wrapped.

    Examples
    --------
    >>> class Wrapped: ...
    >>> class WithNormals(Wrapped):
    ...     def normals(self, feet): ...
    >>> from cpmkit import protocols, source
    >>> passing = {protocols.HasNormals: WithNormals, protocols.HasValues: "there are no vertices"}
    >>> made = with_abilities(Wrapped, passing, source("analytic.sphere"))
    >>> isinstance(made(), protocols.HasNormals), made is Wrapped
    (True, False)
    """
    mixins = {ability: mixin for ability, mixin in passing.items() if isinstance(mixin, type)}
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


def edge_limit_of(source: object) -> int:
    """Return what all numbers of edges of ``source`` are below."""
    return int(source.edge_limit) if isinstance(source, HasManyEdges) else EDGES
