"""Signed distance to closed, open and broken curves of a surface, by heat of vectors and by transport.

The signed heat method (Feng and Crane 2024): the conormals of the curves, as vectors, diffuse for a short time with the
Laplacian of the connection. The unit vectors X of the result approximate the gradient of the distance phi, Lap phi =
div X, and phi is shifted so that its mean on the curves is zero. The sign is defined, and gaps are closed, where curves
are broken.

Where all curves are closed, X is -grad v / |grad v| of the scalar heat v, which has the same direction up to the sign
that the vectors give, and is more exact on coarse lattices. Rounds of transport then correct the distance as they do
without a sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.applications import heat
from cpmkit.applications.geodesics import PRESCRIBED_SPACINGS, prepare_transport, transport_distance
from cpmkit.applications.result import Measured, check_rounds, measure_to_target
from cpmkit.errors import InputError, SceneError
from cpmkit.facade import Solution
from cpmkit.plugin import ClosestPointSource, dots, unit
from cpmkit.preparing import Prepared
from cpmkit.runtime.arrays import as_points
from cpmkit.solution.boundary_points import BoundaryPoints
from cpmkit.types import Floats


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SignedDistance(Measured):
    """The signed distance to curves: read, saved and drawn as a solution.

    ``solution`` is the distance on splines of the lattice.
    """

    curves: heat.Origins  #: Curves from which the distance is measured.
    rounds: int  #: Number of rounds of transport.

    def evaluate(self, points: Any) -> Floats:
        """Return the distance (n,) at the surface points nearest to ``points`` (n, 3), positive to the left.

        Raises InputError as :meth:`cpmkit.Solution.evaluate`, and for one point (3,).
        """
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

    Curves need not be closed or connected: the distance is zero on them and on a smooth continuation that joins them,
    and changes its sign there.

    Parameters
    ----------
    surface : ClosestPointSource, Scene or Prepared
        A surface in space; a scene whose boundaries are barriers, which nothing passes; or a prepared scene.
    curves : ClosestPointSource or sequence of these
        Directed curves in the surface, which together should separate a left from a right.
    spacing : float
        Spacing of the lattice, in the scene's unit; not for a prepared scene. In its place ``tolerance``, the accepted
        error as a share of the largest distance, ``seconds`` or ``memory``, as for :func:`cpmkit.solve`.
    method : {"transport", "heat"}
        ``heat`` is the signed heat method; ``transport`` improves it by rounds, as in :func:`geodesic_distance`.
    rounds : int
        Number of rounds of transport, from 1 to 100; not used by ``heat``.
    **options
        Options of :func:`cpmkit.prepare`, which its ``help`` shows with defaults; ``form`` is ``galerkin`` by default.

    Returns
    -------
    SignedDistance

    Raises
    ------
    InputError, SceneError
        If an argument is not accepted, a piece of the surface has no curve, or the curves do not separate one left from
        one right; others as :func:`cpmkit.prepare` and a solve raise them.

    Examples
    --------
    >>> import cpmkit as ck
    >>> from cpmkit.applications import signed_distance
    >>> equator = ck.source("analytic.circle", normal=[0, 0, 1])
    >>> distance = signed_distance(ck.source("analytic.sphere"), equator, spacing=0.3, method="heat")
    >>> distance.evaluate([[0.6, 0, 0.8], [0.6, 0, -0.8]]).round(2)
    array([ 0.93, -0.93])
    """
    rounds, manifold = check_rounds(method, rounds), heat.scene_of(surface).surface
    if manifold.dim != 3 or manifold.manifold_dim != 2:
        raise InputError("signed distances are measured on surfaces in space.")
    sources = heat.origins_of(curves, manifold)
    if len(sources.points):
        raise InputError("signed distances are those to curves, which have two sides; points have none.")
    return measure_to_target(surface, spacing, options, lambda scene: _solve_signed_distance(scene, sources, rounds))


def _solve_signed_distance(prepared: Prepared, curves: heat.Origins, rounds: int) -> SignedDistance:
    """Return the signed distance on a prepared scene, by heat, then by ``rounds`` of transport."""
    manifold = prepared.scene.surface
    samples = [ck.boundary_points(curve, manifold, prepared.discretized.spacing) for curve in curves.curves]
    field = _gradient_directions(prepared, curves, samples)
    phi = heat.with_direct_solver_if_small(prepared).solve(problem=ck.Poisson(field.divergence(-1.0)))
    phi = replace(phi, values=phi.values - _mean_along_curves(phi, samples))
    straight, signed = _signed_straight_distance(curves, prepared.points)
    transport = prepare_transport(prepared)
    for _ in range(rounds):
        phi = _transport_round(transport, straight, signed, field, phi)
        field = prepared.field(phi).gradient().map(lambda _, slopes: unit(slopes))
    return SignedDistance(solution=phi, curves=curves, rounds=rounds)


def _mean_along_curves(phi: Solution, samples: Sequence[BoundaryPoints]) -> float:
    """Return the mean of phi over the curves, weighted by their lengths; ``samples`` are points on each source.

    Raises SceneError if the means of curves differ by more than a spacing.
    """
    means = np.concatenate(
        [np.bincount(curve.curve, curve.weights * phi.evaluate(curve.points)) / curve.lengths for curve in samples]
    )
    if np.ptp(means) > phi.spacing:
        raise SceneError(
            f"the distance is to be zero on {len(means)} curves and differs by {np.ptp(means):.3g} between them: they "
            "do not separate one left from one right, or lie on pieces of the surface that are not connected; turn "
            "some round, or measure from fewer."
        )
    return float(np.average(means, weights=np.concatenate([curve.lengths for curve in samples])))


def _gradient_directions(prepared: Prepared, curves: heat.Origins, samples: Sequence[BoundaryPoints]) -> ck.Field:
    """Return the field X (p, 3) of unit vectors along which the distance grows, by heat from ``samples`` of curves."""
    h = prepared.discretized.spacing
    strength = np.concatenate([curve.weights[:, None] / h * curve.conormals for curve in samples])
    source = ck.PointSource(np.concatenate([curve.points for curve in samples]), strength)
    coupling = heat.tangential_coupling(prepared, parallel=True)
    vectors, _ = heat.vector_heat_directions(prepared, coupling, source, heat.HEAT_TIME)
    if not all(all(curve.closed) for curve in samples):
        return prepared.field(vectors)
    away = heat.heat_directions(prepared, curves)
    return away.map(lambda _, directions: np.sign(dots(vectors, directions))[:, None] * directions)


def _signed_straight_distance(curves: heat.Origins, points: Floats) -> tuple[Floats, Floats]:
    """Return straight distances (p,) to curves, and signed ones: positive to the left, NaN where an end is nearest."""
    straight, places, number = curves.closest_origins(points)
    signed = np.full(len(points), np.nan)
    for k, curve in enumerate(curves.curves):
        rows = np.flatnonzero(number == k)
        tangents, conormals = ck.directions_along(curve, curves.surface)(places[rows])
        offset = points[rows] - places[rows]
        across = np.abs(dots(offset, tangents)) <= 0.3 * straight[rows]  # else the nearest point is an end
        signed[rows[across]] = (np.sign(dots(offset, conormals)) * straight[rows])[across]
    return straight, signed


def _transport_round(
    prepared: Prepared, straight: Floats, signed: Floats, field: ck.Field, previous: Solution
) -> Solution:
    """Return the signed distance after one round of transport along ``field``, X (p, 3).

    Beside curves the straight distance is prescribed, and in gaps of curves the ``previous`` distance. ``straight`` and
    ``signed`` (p,) are those of :func:`_signed_straight_distance`.
    """
    values = prepared.field(previous).values
    reach = PRESCRIBED_SPACINGS * prepared.discretized.spacing
    across = np.isfinite(signed)
    beside_curve = across & (np.maximum(np.abs(values), straight) < reach)
    in_gap = ~across & (np.abs(values) < reach)
    target = np.where(beside_curve, signed, values)
    return transport_distance(prepared, field, beside_curve | in_gap, target, np.sign(target), previous)
