"""Geodesic distance, from heat, and from a transport equation whose solution is the distance.

The heat method (Crane, Weischedel and Wardetzky 2013; King et al. (2024), section 7.2): heat v flows from the origins
for a short time, X = -grad v / |grad v|, and the distance phi is what has this gradient, Lap phi = div X. Its heat step
has a lumped mass here, so that v stays positive as far as it falls.

X is wrong where heat is smoothed over ridges and thin parts. Each round of transport,

    -e Lap phi + X . grad phi = 1 - e div X,    e = 1.05 h,

whose solution is the distance itself where X is its gradient, carries the distance on along X from the origins, and
gives the next X.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

import cpmkit as ck
from cpmkit.applications.descent import descend
from cpmkit.applications.heat import away_from, heat_solver, manifold_of
from cpmkit.applications.origins import Origins, origins_of
from cpmkit.applications.pieces import Pieces, pieces_of
from cpmkit.applications.spacings import Measured, measured
from cpmkit.applications.transport import HELD_SPACINGS, carried, carriers
from cpmkit.errors import InputError, SceneError, shown
from cpmkit.facade import Solution
from cpmkit.plugin import unit
from cpmkit.preparing import Prepared
from cpmkit.protocols import Bools, ClosestPointSource, Floats, Ints
from cpmkit.runtime.arrays import as_points, whole
from cpmkit.runtime.messages import warn_each

METHODS = ("transport", "heat")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Distance(Measured):
    """The geodesic distance from origins: read, saved and drawn as a solution.

    Attributes
    ----------
    solution : Solution
        The distance on splines of the lattice, smooth at the origins where the distance has a tip.
    origins : Origins
        Where it is measured from.
    rounds : int
        Of transport that were made.
    pieces : Pieces
        Of the manifold.
    reached : (count,) bool
        Which of them have an origin.
    """

    origins: Origins
    rounds: int
    pieces: Pieces
    reached: Bools

    def evaluate(self, points: Any) -> Floats:
        """Return the distance (n,), zero or above, at the points of the manifold nearest to ``points`` (n, d).

        Within two spacings of an origin it is the straight one; on pieces without an origin it is infinite.
        """
        at = as_points(points, self.solution.scene.surface.dim)
        found = self.solution.evaluate(at)
        feet = self.solution.scene.surface.closest_point(at).points
        near = _with_tips(self.origins.closest(feet)[0], found, self.solution.spacing)
        if self.reached.all():
            return near
        return np.where(self.reached[self.pieces.numbers_at(self.solution.discretized, feet)], near, np.inf)

    def path(self, start: Any) -> list[Floats]:
        """Return for each of the points ``start`` (k, d) or (d,) the shortest path (m, d) to the origins, by descent.

        Raises
        ------
        ResolutionError
            If a path does not arrive: it is caught at a barrier.
        """
        given = np.atleast_2d(np.asarray(start, dtype=np.float64))
        return descend(self, as_points(given, self.solution.scene.surface.dim))


def geodesic_distance(
    surface: ClosestPointSource | ck.Scene | Prepared,
    origins: Any,
    *,
    spacing: float | None = None,
    method: str = "transport",
    rounds: int = 2,
    **options: Any,
) -> Distance:
    """Return the geodesic distance from ``origins`` to everywhere on a curve or surface.

    Parameters
    ----------
    surface : ClosestPointSource, Scene or Prepared
        The manifold; a scene, whose boundaries are barriers that nothing passes; or a scene that was prepared, for many
        origins.
    origins : (k, d) array, whole numbers, ClosestPointSource, or a sequence of these
        Points, vertices of a mesh by their numbers, and curves that distances are measured from, to the nearest of
        them.
    spacing : float
        Of the lattice, in the scene's unit; not of a prepared scene. Or, in its place, ``tolerance``, the error that is
        accepted as a share of the largest distance, ``seconds`` or ``memory``, as for :func:`cpmkit.solve`.
    method : {"transport", "heat"}
        ``heat`` takes two linear solves, and little for further origins on a prepared scene. ``transport`` improves it
        on meshes by rounds that cost several times as much: on Spot with 19,000 unknowns from 1.1 percent of the mean
        distance to 0.2.
    rounds : int
        Of transport.
    **options
        Of :func:`cpmkit.prepare`.

    Returns
    -------
    Distance

    Raises
    ------
    InputError, SceneError
        If an argument is not what is accepted, or a boundary of the scene is none that nothing passes.

    Notes
    -----
    On pieces of the manifold that have no origin, or lie behind a barrier, distances are infinite, and a warning says
    so; the solution, which is saved and drawn, is zero there.

    Examples
    --------
    >>> import cpmkit as ck
    >>> from cpmkit.applications import geodesic_distance
    >>> sphere = ck.source("analytic.sphere")
    >>> distance = geodesic_distance(sphere, [[0, 0, 1]], spacing=0.2, method="heat")
    >>> bool(abs(distance.evaluate([[1, 0, 0]])[0] - 1.5708) < 0.01)
    True
    """
    if method not in METHODS:
        raise InputError(f"method must be {' or '.join(METHODS)}, got {shown(method)}.")
    rounds = whole(rounds, "rounds", 1, 100) if method == "transport" else 0
    given = origins_of(origins, manifold_of(surface))
    return measured(surface, spacing, options, lambda prepared: _measured(prepared, given, rounds))


def _measured(prepared: Prepared, given: Origins, rounds: int) -> Distance:
    points = prepared.discretized.points  # held here, so that all fields below share them
    pieces = pieces_of(prepared)
    near, reached = _near(prepared, given, pieces, points)
    field, phi = _by_heat(prepared, given, near, pieces)
    carrying = carriers(prepared)
    still = ~reached[pieces.of_point]
    for _ in range(rounds):
        phi = _carried(carrying, near, still, field, phi)
        field = prepared.field(phi).gradient().map(lambda _, slopes: np.where(still[:, None], 0.0, unit(slopes)))
    return Distance(solution=_told(phi, reached), origins=given, rounds=rounds, pieces=pieces, reached=reached)


class _Near(NamedTuple):
    """Straight distances (p,) from the points of a prepared scene to the nearest origins, and their numbers (p,)."""

    straight: Floats
    number: Ints


def _near(prepared: Prepared, origins: Origins, pieces: Pieces, points: Floats) -> tuple[_Near, Bools]:
    """Return the nearest origins, infinitely far where these are on another piece, and which pieces (k,) have one."""
    form = prepared.discretized
    straight, number = origins.distances(points)
    if pieces.count == 1:
        return _Near(straight, number), np.ones(1, dtype=bool)
    places, owner = origins.samples(form.spacing)
    on = pieces.numbers_at(form, places)
    lies_on = np.zeros((owner.max() + 1, pieces.count), dtype=bool)
    lies_on[owner, on] = True
    return _Near(np.where(lies_on[number, pieces.of_point], straight, np.inf), number), np.asarray(lies_on.any(axis=0))


def _told(phi: Solution, reached: Bools) -> Solution:
    """Return ``phi`` with a warning of pieces that are not reached, which is given."""
    if reached.all():
        return phi
    text = (
        f"{np.count_nonzero(~reached)} of {len(reached)} pieces of the {type(phi.scene.surface).__name__} have no "
        "origin: distances are infinite there, and the solution, which is saved and drawn, is zero."
    )
    warn_each([text])
    return replace(phi, warnings=(*phi.warnings, text))


def _by_heat(prepared: Prepared, origins: Origins, near: _Near, pieces: Pieces) -> tuple[ck.Field, Solution]:
    """Return X (p, d) away from the origins, and the distance that the heat method makes of it."""
    field = away_from(prepared, origins, everywhere=False)
    phi = heat_solver(prepared).solve(problem=ck.Poisson(field.divergence(-1.0)))
    moves = np.zeros(pieces.count)
    for piece in range(pieces.count):
        own = np.flatnonzero(pieces.of_point == piece)
        if np.isfinite(near.straight[own]).any():
            moves[piece] = _move(phi, near, own)
    return field, replace(phi, values=phi.values + moves[pieces.of_unknown][:, None])


def _move(phi: Solution, near: _Near, own: Ints) -> float:
    """Return by how much ``phi`` is below the straight distance near the origins, at the points ``own`` of a piece.

    It is fixed up to a constant, one for all origins.

    Raises
    ------
    SceneError
        If origins ask for different ones, as on pieces that do not hang together.
    """
    h, straight = phi.spacing, near.straight[own]
    beside = (straight > h) & (straight < HELD_SPACINGS * h)
    beside = beside if beside.any() else straight <= straight.min() + h
    rows = own[beside]
    off = near.straight[rows] - phi.discretized.at_points(phi.values, rows)[:, 0]
    found, label = np.unique(near.number[rows], return_inverse=True)
    constants = np.bincount(label, off) / np.bincount(label)
    if len(found) > 1 and np.ptp(constants) > HELD_SPACINGS * h:
        raise SceneError(
            f"distances beside {len(found)} origins differ by {np.ptp(constants):.3g}: they lie on pieces of the "
            "manifold that do not hang together; measure piece by piece."
        )
    return float(np.median(off))


def _carried(prepared: Prepared, near: _Near, still: Bools, field: ck.Field, before: Solution) -> Solution:
    """Return the solution of the transport along ``field``, the straight distance held near the origins.

    And zero where all is ``still`` (p,), on pieces without an origin.
    """
    h = prepared.discretized.spacing
    # no nearer by the way along the manifold than straight: the other side of a thin part is not held
    beside = np.maximum(prepared.field(before).values, near.straight) < HELD_SPACINGS * h
    return carried(prepared, field, beside | still, np.where(beside, near.straight, 0.0), guess=before)


def _with_tips(straight: Floats, found: Floats, spacing: float) -> Floats:
    """Return distances with the straight one within two spacings of the origins, where splines round off the tip."""
    near = (straight < 2 * spacing) & (found < HELD_SPACINGS * spacing)
    return np.where(near, straight, np.maximum(found, 0.0))
