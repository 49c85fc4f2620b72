"""The first step of the heat method: heat of a short time, and the directions in which it flows."""

from __future__ import annotations

from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.applications.origins import Origins
from cpmkit.applications.pieces import pieces_of
from cpmkit.errors import InputError, SceneError
from cpmkit.plugin import unit
from cpmkit.preparing import Prepared
from cpmkit.protocols import Bools, ClosestPointSource, Floats

#: Residuals at which solves end: distances are right to 1e-3, so that a direct solve need not be refined.
ENOUGH = 1e-7
#: Unknowns up to which the heat step is solved directly: v then has digits as far as it falls.
MOST_FACTORISED = 60_000
#: Time of the heat step over the spacing's square, and by how much it grows until heat arrives everywhere.
HEAT_TIME, LONGER = 0.5, 4.0
#: Below this share of its largest value, v of an iterative solver is noise.
ITERATED_SHARE = 1e-9
#: So few points may stay without a direction where v was lost in rounding: a longer time would blur all others.
LOST_SHARE = 1e-2


def manifold_of(surface: ClosestPointSource | ck.Scene | Prepared) -> ClosestPointSource:
    """Return the manifold of what an application is given."""
    if isinstance(surface, Prepared):
        return surface.scene.surface
    scene = surface if isinstance(surface, ck.Scene) else ck.Scene(surface, ck.Poisson(0.0))
    found: ClosestPointSource = scene.surface
    return found


def prepared_manifold(surface: Any, spacing: float | None, options: dict[str, Any]) -> Prepared:
    """Return a source, a scene or a prepared scene prepared, with barriers for boundaries.

    Raises
    ------
    InputError
        If a boundary is no barrier, or a spacing or options are given beside a prepared scene.
    """
    if isinstance(surface, Prepared):
        if spacing is not None or options:
            raise InputError("spacing and options are those of the prepared scene; leave them out.")
        _check_barriers(surface.scene)
        return surface
    made: Prepared = ck.prepare(barriers(surface), spacing, **{"form": "galerkin", **options})
    return made


def barriers(surface: ClosestPointSource | ck.Scene) -> ck.Scene:
    """Return the scene of a manifold with barriers, and nothing else.

    Raises
    ------
    InputError
        If a boundary is no barrier.
    """
    scene = surface if isinstance(surface, ck.Scene) else ck.Scene(surface, ck.Poisson(0.0))
    _check_barriers(scene)
    return ck.Scene(scene.surface, ck.Poisson(0.0), scene.boundaries, scene.edge)


def _check_barriers(scene: ck.Scene) -> None:
    for one in scene.conditions:
        if one.kind != "neumann":
            raise InputError(
                f"boundaries of a scene are barriers, with the condition Neumann(0), got {one.kind!r}; curves that "
                "distances are measured from are origins."
            )


def heat_solver(prepared: Prepared) -> Prepared:
    """Return the scene with the solver for heat: the direct one as long as it is affordable."""
    size = prepared.discretized.size
    return prepared.solved_by("direct", solver_tolerance=ENOUGH) if size <= MOST_FACTORISED else prepared


def longest_time(prepared: Prepared) -> float:
    """Return the time of heat from end to end of the manifold."""
    return float(np.ptp(prepared.scene.surface.bounds, axis=0).max()) ** 2


def away_from(prepared: Prepared, origins: Origins, everywhere: bool = True) -> ck.Field:
    """Return the unit directions (p, d) in which heat flows away from the origins, zero at few points that are lost.

    Where a piece need not have an origin, they are zero on pieces without.

    Raises
    ------
    SceneError
        If none arrives somewhere, on a piece that has an origin or on any if it must be ``everywhere``.
    """
    h, heated = prepared.discretized.spacing, heat_solver(prepared)
    share, time = 0.0 if heated is not prepared else ITERATED_SHARE, HEAT_TIME * h * h
    while True:
        source = origins.source(h, time**0.5)
        v = prepared.field(heated.solve(problem=ck.ScreenedPoisson(source, c=1 / time, lumped=True)))
        cold = v.values <= share * v.values.max()
        if not everywhere:
            pieces = pieces_of(prepared)
            cold &= pieces.any_of(v.values > 0.0)[pieces.of_point]
        lost = lost_alone(v.values, cold)
        if lost or time > longest_time(prepared):
            break
        time *= LONGER
    if not lost:
        check_warmed(cold, prepared.scene.surface)
    still = cold | (v.values <= 0.0)
    return v.gradient().map(lambda _, slopes: np.where(still[:, None], 0.0, -unit(slopes)))


def lost_alone(v: Floats, cold: Bools) -> bool:
    """Tell whether the points (p,) that are cold are few, and have values v (p,) that were lost in rounding.

    On a piece without an origin nothing arrives, not even rounding.
    """
    return bool(cold.mean() <= LOST_SHARE and v[cold].all())


def check_warmed(cold: Bools, surface: ClosestPointSource) -> None:
    """Refuse a manifold that heat does not reach everywhere.

    Raises
    ------
    SceneError
        With the number of points that are cold (p,).
    """
    if cold.any():
        raise SceneError(
            f"no heat arrives at {np.count_nonzero(cold)} points of the {type(surface).__name__}: a piece of it has no "
            "origin, or is too far away for the spacing; give each piece an origin, or leave the piece out."
        )
