"""The one ghost formula: value at a ghost = sum of coefficients * u(points) + factor * data, for every condition.

For ``alpha du/db + beta u = gamma``, with t the ghost's distance from the boundary and s its
distance from the mirror point (CONVENTIONS, Ghosts):

order 2: ``[(alpha - beta s/2) u(mirror) + s gamma] / (alpha + beta s/2)``, and for Dirichlet, with
the mirror at distance ``h = max(t, spacing/2)``, ``-(t/h) u(mirror) + (1 + t/h) g``;
order 1, with u read on the boundary: ``[alpha u + t gamma] / (alpha + beta t)``, for Dirichlet g;
order 3 and 4: the polynomial through the values at points inside that fulfils the condition.

Differs from King et al. (2024), eq. 8 and section 4.3: there h = t, and a ghost on the boundary then
reads itself with weight -1, which no smoother damps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.forms.collocation.boundary.row_formula import BoundaryData, ExtraPoint, RowFormula
from cpmkit.forms.collocation.ghosts.continuation import Continued, continued
from cpmkit.forms.collocation.ghosts.continued import continue_ghosts
from cpmkit.forms.collocation.ghosts.geometry import GhostGeometry
from cpmkit.forms.collocation.ghosts.transmitted import transmitted
from cpmkit.protocols import Bools, Floats, Ints
from cpmkit.scene.laws import Interface, OneSided, Value, beta_at


@dataclass(frozen=True, eq=False)
class GhostFormula:
    """What the ghosts of a boundary read, edges aside.

    Attributes
    ----------
    rows : RowFormula
        What they read on the side that they carry, and data.
    own_points : list of ExtraPoint
        What they read on the side on which they stand.
    parts : list of Continued
        Those of them that continue polynomials.
    orders : (g,) int64
        Order of each, lower than asked where there is no room.
    alone : (g,) bool
        True for those that read at one point, or at that and their own.
    """

    rows: RowFormula
    own_points: list[ExtraPoint]
    parts: list[Continued]
    orders: Ints
    alone: Bools


def ghost_formula(geometry: GhostGeometry, order: int) -> GhostFormula:
    """Return what the ghosts of a boundary read at an order, less where their condition says so; edges aside.

    A ghost whose mirror point lies beyond another boundary is of order 1. A transmission's has no other reading.
    """
    count, points, feet = len(geometry), geometry.seen.foot.copy(), geometry.start
    coefficient, orders, alone = np.zeros(count), np.empty(count, dtype=np.int64), np.ones(count, dtype=bool)
    parts: list[Continued] = []
    data: list[BoundaryData] = []
    own_points: list[ExtraPoint] = []
    for condition, side in geometry.sides():
        law, target = condition.law, condition.order or order
        orders[side] = np.where(geometry.apart[side], min(target, 2), target)
        if target > 2 or isinstance(law, Interface):
            made, orders[side] = continue_ghosts(geometry, law, side, orders[side])
            parts += made
            for part in made:
                alone[part.rows] = False
        rows = side[alone[side]]
        second = rows[(orders[rows] == 2) | isinstance(law, Interface)]
        if len(second) and not isinstance(law, Interface):
            orders[second[geometry.is_hidden[second]]] = 1
            second = second[~geometry.is_hidden[second]]
        if len(second):
            points[second] = geometry.mirror.points[second]
            feet = None if feet is None else feet.replaced(second, geometry.mirror.take(second))
        if isinstance(law, Interface):
            if len(rows):
                coefficient[rows], added, beside = transmitted(geometry, law, rows)
                own_points.append(beside)
                data += added
        else:
            coefficient[rows], added = _mirrored(geometry, law, rows, points[rows], orders[rows] == 1)
            data += added
    plain = RowFormula(points, coefficient, data, feet=feet)
    own_points += [term for part in parts for term in part.own_terms]
    return GhostFormula(continued(plain, parts) if parts else plain, own_points, parts, orders, alone)


def _mirrored(
    geometry: GhostGeometry, law: OneSided, rows: Ints, points: Floats, first: Bools
) -> tuple[Floats, list[BoundaryData]]:
    """Return the coefficients (k,) of the ghosts ``rows`` of order 2, or ``first``, and their data."""
    where = geometry.at_boundary(rows)
    s = np.linalg.norm(geometry.foot_point[rows] - points, axis=1)
    beta = beta_at(law, where, geometry.what)
    coefficient, factor = coefficient_and_factor(law, beta, geometry.seen.distance[rows], s, first, geometry.spacing)
    return coefficient, [BoundaryData(rows, factor, where, law.datum, geometry.what, law)]


def coefficient_and_factor(
    law: OneSided, beta: Floats, t: Floats, s: Floats, first_order: Bools, spacing: float
) -> tuple[Floats, Floats]:
    """Return the coefficient of u(mirror) and the factor of gamma, each (n,).

    Parameters
    ----------
    law : OneSided
        With its alpha.
    beta : (n,) float64
        Its beta at the ghosts' feet.
    t, s : (n,) float64
        Distance of the ghost from the boundary, and from its mirror point.
    first_order : (n,) bool
        Ghosts of order 1.
    spacing : float
        Spacing of the level that owns the ghost.

    Raises
    ------
    ResolutionError
        If the condition feeds the solution more strongly than the spacing can follow.
    """
    if isinstance(law, Value):
        ratio = np.where(first_order, 0.0, t / np.maximum(t, 0.5 * spacing))
        return -ratio, (1.0 + ratio) / beta
    alpha = law.alpha
    first = alpha + beta * t
    second = alpha + 0.5 * beta * s
    divisors = np.where(first_order, first, second) / alpha
    if np.any(divisors <= 0):
        room = spacing / (1.0 - float(divisors.min()))
        raise ResolutionError(
            f"spacing={spacing:g} is too coarse for the Robin condition alpha={alpha:g}, "
            f"beta={float(beta[divisors.argmin()]):g}, which feeds the solution; use {room:.2g} or less."
        )
    coefficient = np.where(first_order, alpha / first, (alpha - 0.5 * beta * s) / second)
    return coefficient, np.where(first_order, t / first, s / second)
