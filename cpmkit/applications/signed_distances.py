"""Signed distance to closed, open and broken curves of a surface, by heat of vectors and by transport.

The signed heat method (Feng and Crane 2024): the conormals of the curves, as vectors, flow as heat with the Laplacian
of the connection for a short time; X, what arrives, made unit, is the gradient of the distance phi, Lap phi = div X,
which is moved so that its mean on the curves is zero. It tells a side, and closes gaps, where curves are broken.

Where all curves are closed, X is -grad v / |grad v| of the scalar heat v, the same but for its sign, which the vectors
give: on coarse lattices it is more exact. Rounds of transport then carry the distance away from the curves as they do
without a sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.applications.coupling import tangential_coupling
from cpmkit.applications.geodesics import METHODS
from cpmkit.applications.heat import HEAT_TIME, away_from, heat_solver, manifold_of
from cpmkit.applications.origins import Origins, origins_of
from cpmkit.applications.spacings import Measured, measured
from cpmkit.applications.transport import HELD_SPACINGS, carried, carriers
from cpmkit.applications.vector_heat import directions_of_heat
from cpmkit.errors import InputError, SceneError, shown
from cpmkit.facade import Solution
from cpmkit.plugin import dots, unit
from cpmkit.preparing import Prepared
from cpmkit.protocols import ClosestPointSource, Floats
from cpmkit.runtime.arrays import as_points, whole
from cpmkit.solution.boundary_points import BoundaryPoints

#: Across a curve is what is no more than this share along it: else the nearest point is an end.
ALONG_SHARE = 0.3


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SignedDistance(Measured):
    """The signed distance to curves: read, saved and drawn as a solution.

    Attributes
    ----------
    solution : Solution
        The distance on splines of the lattice.
    curves : Origins
        Where it is measured from.
    rounds : int
        Of transport that were made.
    """

    curves: Origins
    rounds: int

    def evaluate(self, points: Any) -> Floats:
        """Return the distance (n,) at the points of the surface nearest to ``points`` (n, 3), positive to the left."""
        return self.solution.evaluate(as_points(points, self.solution.scene.surface.dim))


def signed_distance(
    surface: ClosestPointSource | ck.Scene | Prepared,
    curves: ClosestPointSource | Sequence[ClosestPointSource],
    *,
    spacing: float | None = None,
    method: str = "transport",
    rounds: int = 2,
    **options: Any,
) -> SignedDistance:
    """Return the signed distance to curves on a surface, positive to the left of their direction of travel.

    Curves need not be closed nor hang together: the distance is zero on them and on a smooth continuation that joins
    them, and changes its sign there.

    Parameters
    ----------
    surface : ClosestPointSource, Scene or Prepared
        A surface in space; a scene, whose boundaries are barriers that nothing passes; or a scene that was prepared.
    curves : ClosestPointSource or sequence of these
        That have a direction, each in the surface; together they should part a left from a right.
    spacing : float
        Of the lattice, in the scene's unit; not of a prepared scene. Or, in its place, ``tolerance``, the error that is
        accepted as a share of the largest distance, ``seconds`` or ``memory``, as for :func:`cpmkit.solve`.
    method : {"transport", "heat"}
        ``heat`` is the signed heat method; ``transport`` improves it by rounds, as in :func:`geodesic_distance`.
    rounds : int
        Of transport.
    **options
        Of :func:`cpmkit.prepare`.

    Returns
    -------
    SignedDistance

    Raises
    ------
    InputError, SceneError
        If an argument is not what is accepted, a piece of the surface has no curve, or curves do not part one left from
        one right.

    Examples
    --------
    >>> import cpmkit as ck
    >>> from cpmkit.applications import signed_distance
    >>> equator = ck.source("analytic.circle", normal=[0, 0, 1])
    >>> distance = signed_distance(ck.source("analytic.sphere"), equator, spacing=0.3, method="heat")
    >>> distance.evaluate([[0.6, 0, 0.8], [0.6, 0, -0.8]]).round(2)
    array([ 0.93, -0.93])
    """
    if method not in METHODS:
        raise InputError(f"method must be {' or '.join(METHODS)}, got {shown(method)}.")
    rounds = whole(rounds, "rounds", 1, 100) if method == "transport" else 0
    manifold = manifold_of(surface)
    if manifold.dim != 3 or manifold.manifold_dim != 2:
        raise InputError("signed distances are measured on surfaces in space.")
    given = origins_of(curves, manifold)
    if len(given.points):
        raise InputError("signed distances are those to curves, which have two sides; points have none.")
    return measured(surface, spacing, options, lambda prepared: _measured(prepared, given, rounds))


def _measured(prepared: Prepared, given: Origins, rounds: int) -> SignedDistance:
    manifold = prepared.scene.surface
    along = [ck.boundary_points(one, manifold, prepared.discretized.spacing) for one in given.curves]
    field = _upwards(prepared, given, along)
    phi = heat_solver(prepared).solve(problem=ck.Poisson(field.divergence(-1.0)))
    phi = replace(phi, values=phi.values - _on_curves(phi, along))
    straight, across = _beside(given, prepared.points)
    carrying = carriers(prepared)
    for _ in range(rounds):
        phi = _carried(carrying, straight, across, field, phi)
        field = prepared.field(phi).gradient().map(lambda _, slopes: unit(slopes))
    return SignedDistance(solution=phi, curves=given, rounds=rounds)


def _on_curves(phi: Solution, along: Sequence[BoundaryPoints]) -> float:
    """Return the mean of phi on the curves, to be zero.

    Raises
    ------
    SceneError
        If curves ask for different constants.
    """
    means = np.concatenate(
        [np.bincount(one.curve, one.weights * phi.evaluate(one.points)) / one.lengths for one in along]
    )
    if np.ptp(means) > phi.spacing:
        raise SceneError(
            f"the distance is to be zero on {len(means)} curves and differs by {np.ptp(means):.3g} between them: they "
            "do not part one left from one right, or lie on pieces of the surface that do not hang together; turn some "
            "round, or measure from fewer."
        )
    return float(np.average(means, weights=np.concatenate([one.lengths for one in along])))


def _upwards(prepared: Prepared, curves: Origins, along: Sequence[BoundaryPoints]) -> ck.Field:
    """Return X (p, 3), the unit directions in which the distance grows."""
    vectors = _heat_of_conormals(prepared, along)
    if not all(all(one.closed) for one in along):
        return prepared.field(vectors)
    return away_from(prepared, curves).map(lambda _, one: np.sign(dots(vectors, one))[:, None] * one)


def _heat_of_conormals(prepared: Prepared, along: Sequence[BoundaryPoints]) -> Floats:
    """Return the unit vectors (p, 3) that the curves' conormals become after the shortest time in which any arrive."""
    h = prepared.discretized.spacing
    strength = np.concatenate([one.weights[:, None] / h * one.conormals for one in along])
    source = ck.PointSource(np.concatenate([one.points for one in along]), strength)
    return directions_of_heat(prepared, tangential_coupling(prepared, parallel=True), source, HEAT_TIME)[0]


def _beside(curves: Origins, points: Floats) -> tuple[Floats, Floats]:
    """Return the straight distance (p,) to the nearest curve, and the same with its sign, NaN beside and past ends."""
    straight, places, number = curves.closest(points)
    signed = np.full(len(points), np.nan)
    for k, curve in enumerate(curves.curves):
        mine = np.flatnonzero(number == k)
        tangents, conormals = ck.directions_along(curve, curves.surface)(places[mine])
        way = points[mine] - places[mine]
        across = np.abs(dots(way, tangents)) <= ALONG_SHARE * straight[mine]
        signed[mine[across]] = (np.sign(dots(way, conormals)) * straight[mine])[across]
    return straight, signed


def _carried(prepared: Prepared, straight: Floats, signed: Floats, field: ck.Field, before: Solution) -> Solution:
    """Return the distance carried along ``field``: beside curves the straight one is held, in gaps that ``before``."""
    own = prepared.field(before).values
    reach = HELD_SPACINGS * prepared.discretized.spacing
    across = np.isfinite(signed)
    beside = across & (np.maximum(np.abs(own), straight) < reach)
    gap = ~across & (np.abs(own) < reach)
    target = np.where(beside, signed, own)
    return carried(prepared, field, beside | gap, target, np.sign(target), before)
