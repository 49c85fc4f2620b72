"""The optional abilities of a source, and their values where a source lacks them."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import (
    Advice,
    ClosestPoints,
    ClosestPointSource,
    Floats,
    HasAdvice,
    HasCreases,
    HasFiniteFeet,
    HasGivenMesh,
    HasIntegralFloor,
    HasLeft,
    HasLocalMinima,
    HasManyEdges,
    HasMembers,
    HasMesh,
    HasNormals,
    HasTangents,
    HasTranslation,
    HasValues,
    HasWarnings,
    Ints,
    NamesLeft,
)

#: Numbers of edges are below this, unless a source says otherwise.
MOST_EDGES = 1000


#: Every optional ability.
ABILITIES: tuple[type, ...] = (
    HasNormals,
    HasCreases,
    HasTangents,
    HasLeft,
    NamesLeft,
    HasLocalMinima,
    HasValues,
    HasGivenMesh,
    HasMesh,
    HasTranslation,
    HasMembers,
    HasManyEdges,
    HasFiniteFeet,
    HasAdvice,
)


def local_minima_of(source: ClosestPointSource, x: Floats, radius: float) -> tuple[Ints, ClosestPoints]:
    """Return the rows (k,) of ``x`` and their feet within ``radius``; closest points where ``source`` has no others."""
    if isinstance(source, HasLocalMinima):
        return source.local_minima(x, radius)
    feet = source.closest_point(x)
    rows = np.flatnonzero(feet.distance <= radius)
    return rows, feet.take(rows)


def advice_of(source: object, spacing: float) -> Advice:
    """Return what ``source`` says of itself at ``spacing``: no warnings and no floor where it says nothing."""
    return source.advice(spacing) if isinstance(source, HasAdvice) else Advice()


def warnings_of(source: object, spacing: float) -> tuple[str, ...]:
    """Return the warnings in the advice of ``source`` at ``spacing``, without what else may take long to be found."""
    return source.own_warnings(spacing) if isinstance(source, HasWarnings) else advice_of(source, spacing).warnings


def integral_floor_of(source: object, spacing: float) -> float:
    """Return the error, as a share, that ``source`` leaves in integrals at ``spacing``, without the other advice."""
    if isinstance(source, HasIntegralFloor):
        return source.own_integral_floor(spacing)
    advice = advice_of(source, spacing)
    return advice.floor if advice.integral_floor is None else advice.integral_floor


def has_finite_feet(source: object) -> bool:
    """Whether feet on ``source``, or on a member of it, are finitely many points that stand for a manifold."""
    members = source.members if isinstance(source, HasMembers) else (source,)
    return any(isinstance(member, HasFiniteFeet) for member in members)


def edge_limit_of(source: object) -> int:
    """Return what all numbers of edges of ``source`` are below."""
    return int(source.edge_limit) if isinstance(source, HasManyEdges) else MOST_EDGES
