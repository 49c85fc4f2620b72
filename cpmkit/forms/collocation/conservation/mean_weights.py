"""Weights with which sums over a band are integrals over the manifold, to second order.

The integral over the manifold is that over the space around it, of the extension times a bump in the distance
(Kublik and Tsai 2016, whose Jacobian an even bump makes 1 to second order). The plain mean over a band's nodes is
not one over the manifold: the band is thicker where the surface is oblique to the lattice.
"""

from __future__ import annotations

import numpy as np

from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.protocols import Floats

#: Nodes farther past an end than this many spacings weigh nothing.
TAIL_SPACINGS = 2.0
#: Nothing is divided by a smaller distance past or from an end, in spacings.
LEAST_END_DISTANCE_SPACINGS = 1e-6


def mean_weights(tables: Discretization) -> Floats:
    """Return the weight (n,) of each unknown in means over the pieces of a manifold.

    A node weighs by its distance from the manifold. Nodes past an edge, and ghosts, continue the solution past the
    end of their piece; they weigh by how far past it they are, so that the end need not fall on a node. Without
    them the mean is off in first order (a cap, spacing 0.05: by 3e-3 of the range, with them by 6e-4).
    """
    bump, beyond = _places(tables)
    return bump * _tail(beyond)


def end_weights(tables: Discretization) -> Floats:
    """Return the weight (n,) in fluxes of what boundary data add to each unknown, ``2 t gamma`` at t past an end.

    The sum, over that of the mean's weights and the square of the spacing, is the flux gamma through the ends over
    the measure of the piece.
    """
    bump, beyond = _places(tables)
    t = np.clip(beyond, LEAST_END_DISTANCE_SPACINGS, TAIL_SPACINGS)
    return bump * np.minimum(0.5, 0.5 * (TAIL_SPACINGS - t) / t)


def _places(tables: Discretization) -> tuple[Floats, Floats]:
    """Return the bump's value at each unknown (n,), and how many spacings it lies past the end of its piece."""
    band, inner = tables.layout.band, tables.layout.band.inner
    reach = 0.5 * (band.degree + 1) * band.spacing
    away = (band.positions - band.feet.points)[:inner]
    past = _past_edge(tables, away)
    distance = np.sqrt(np.maximum(np.sum(away**2, axis=1) - past**2, 0.0))
    nodes = _bump(distance / reach, band.degree)
    bumps, places = [nodes], [past / band.spacing]
    for view, ghosts in zip(tables.layout.boundaries.side_views, tables.layout.ghosts, strict=True):
        beyond = np.full(len(band.nodes), TAIL_SPACINGS)
        beyond[view.rows] = np.nan_to_num(np.abs(view.signed) / band.spacing, nan=TAIL_SPACINGS)
        stands = ghosts.nodes[: ghosts.unknowns]
        bumps.append(nodes[stands] * _tail(places[0][stands]))
        places.append(beyond[stands])
    return np.concatenate(bumps), np.concatenate(places)


def _past_edge(tables: Discretization, away: Floats) -> Floats:
    """Return how far along the manifold each inner node (n,) lies past an edge, zero where it does not.

    With t that distance, r the node's height over the tangent plane and k the curvature, the mirror point lies
    ``t (1 + k r)`` from the foot, in a direction along which the node is ``t (1 + k r / 2)`` from it. At order 1
    there is no mirror point, and zero is returned.
    """
    band = tables.layout.band
    rows = np.flatnonzero(band.feet.edge[: len(away)] >= 0)
    inwards = tables.layout.formula.points[rows] - band.feet.points[rows]
    length = np.linalg.norm(inwards, axis=1)
    known = (
        length > LEAST_END_DISTANCE_SPACINGS * band.spacing
    )  # the mirror point of a node beside the end is the end itself, to rounding
    along = np.divide(-np.sum(away[rows] * inwards, axis=1), length, out=np.zeros(len(rows)), where=known)
    past = np.zeros(len(away))
    past[rows] = np.maximum(2 * along - length, 0.0)
    return past


def _bump(distance: Floats, degree: int) -> Floats:
    """Return the Kaiser-Bessel window at distances in units of its radius, ``(degree + 1) / 2`` spacings.

    Its spectrum is zero at the lattice's own frequency and below 1e-3 of its peak at all higher ones, so that sums
    hardly depend on where the nodes lie.
    """
    shape = np.pi * np.sqrt((degree + 1.0) ** 2 - 1.0)
    inside = np.i0(shape * np.sqrt(np.maximum(1.0 - distance**2, 0.0))) / np.i0(shape)
    return np.where(distance < 1.0, inside, 0.0)


def _tail(beyond: Floats) -> Floats:
    """Return the weight of a node ``beyond`` spacings past an end; at 0 it is 1, from TAIL on 0.

    With t the first node's distance, ``tail(t) + tail(t + 1) = 1/2 - t``: the end correction of the trapezoidal
    rule. It is continuous, and its first moment vanishes, so that sums along a line are of third order.
    """
    t = np.mod(beyond, 1.0)
    first = 1.0 - 3.5 * t + 2.0 * t**2
    return np.where(beyond < 1.0, first, np.where(beyond < TAIL_SPACINGS, 0.5 - t - first, 0.0))
