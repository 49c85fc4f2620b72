"""Points inside a manifold, one behind the other from its boundary inwards, and their places along an arc.

Ghosts of order 3 and 4 continue the polynomial through the values there. The chord of an arc of curvature
kappa is shorter than it by ``kappa^2 s^3 / 24``: of third order, so it is corrected by the circle through the points.
King et al. (2024), section 8, leaves boundaries of these orders open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpmkit.forms.collocation.boundary.row_formula import BoundaryData, ExtraPoint, RowFormula
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.walking import nearest_on_sheet
from cpmkit.protocols import Bools, ClosestPoints, Floats, Ints, Rows
from cpmkit.scene.laws import Law, OneSided, Value, beta_at

#: Distance of the points, in spacings. (1.25 and 1.5 have 1.2 to 5 times the error on arcs, caps and circles on the
#: sphere, and vary more with the position of the lattice.)
CONTINUATION_STEP_SPACINGS = 1.0
#: Points nearer to each other than this share of the step have met an edge or a fold.
CROWDED_STEP_SHARE = 0.5
#: Below this an arc is as long as its chord.
STRAIGHT_ARC_RADIANS = 1e-7


@dataclass(frozen=True, eq=False)
class Inside(Rows):
    """Points inside, for each of n feet on a boundary.

    Attributes
    ----------
    points : (n, k, d) float64
        The points, nearest first.
    positions : (n, k) float64
        Arc lengths from the foot.
    curvature : (n, d) float64
        The curvature vector of the arc at the foot: it points to the centre, its length is one over the radius.
    sound : (n,) bool
        False where a point is not where it should be: the manifold ends or folds before.
    feet : list of ClosestPoints
        The surface's records of the k points.
    """

    points: Floats
    positions: Floats
    curvature: Floats
    sound: Bools
    feet: list[ClosestPoints]

    def terms(self, rows: Ints, weights: Floats) -> list[ExtraPoint]:
        """Return what the rows ``rows`` read at the points, with ``weights`` (n, k)."""
        return [ExtraPoint(rows, self.points[:, j], weights[:, j], feet=self.feet[j]) for j in range(weights.shape[1])]


@dataclass(frozen=True, eq=False)
class Continued:
    """Rows that continue polynomials, of one condition and order.

    Attributes
    ----------
    rows : (k,) int64
        Which rows of a batch these are.
    terms, own_terms : list of ExtraPoint
        Points that they read; of ghosts, seen from the side that they carry, and from the side on which they stand.
    data : list of BoundaryData
        What the condition's data add.
    here : (k,) float64
        Factor of a right-hand side read at the boundary.
    ahead : list of ExtraPoint
        Where else it is read.
    """

    rows: Ints
    terms: list[ExtraPoint]
    own_terms: list[ExtraPoint]
    data: list[BoundaryData]
    here: Floats
    ahead: list[ExtraPoint]


def continue_rows(
    law: OneSided, rows: Ints, where: Floats, what: str, inside: Inside, at: Floats, spacing: float
) -> Continued:
    """Return what rows at arc lengths ``at`` (k,) past a boundary read, of a law that holds ``where`` (k, d).

    ``what`` names the boundary in messages.
    """
    beta = beta_at(law, where, what)
    weights, factor = polynomial_weights(law.alpha, beta, inside.positions, at, spacing)
    ahead, here = polynomial_weights(0.0, np.ones(len(rows)), inside.positions, at, spacing)
    data = [BoundaryData(rows, factor, where, law.datum, what, law)]
    return Continued(rows, inside.terms(rows, weights), [], data, here, inside.terms(rows, ahead))


def continued(plain: RowFormula, parts: Sequence[Continued]) -> RowFormula:
    """Return a reading with some of its rows replaced by those that continue polynomials."""
    place, coefficient = np.arange(len(plain)), plain.coefficient.copy()
    for part in parts:
        place[part.rows], coefficient[part.rows] = -1, 0.0
    data = [datum.renumbered(place) for datum in plain.data] + [datum for part in parts for datum in part.data]
    terms = [term for part in parts for term in part.terms]
    return RowFormula(plain.points, coefficient, data, terms, plain.feet)


def continued_sources(plain: RowFormula, parts: Sequence[Continued]) -> RowFormula:
    """Return where right-hand sides are read, those of rows that continue polynomials continued too."""
    here = np.ones(len(plain))
    for part in parts:
        here[part.rows] = part.here
    terms = [replace(term, coefficient=term.coefficient * here[term.rows]) for term in plain.terms]
    return RowFormula(
        plain.points, plain.coefficient * here, (), terms + [term for part in parts for term in part.ahead]
    )


def points_inside(law: Law, order: int) -> int:
    """Return at how many points inside a ghost of ``order`` 3 or 4 reads: the degree of its polynomial.

    The slope of a cubic costs an order that its value keeps, so a flux gets one point more.
    """
    return order - 1 if isinstance(law, Value) else order


def polynomial_weights(
    alpha: float, beta: Floats, positions: Floats, at: Floats, spacing: float
) -> tuple[Floats, Floats]:
    """Return the weights (n, k) of values inside and the factor (n,) of gamma in a polynomial's value outside.

    The polynomial has degree k, takes the values at ``-positions``, and fulfils ``alpha p' + beta p = gamma`` at 0.

    Parameters
    ----------
    alpha, beta : float, (n,) float64
        Of the condition.
    positions : (n, k) float64
        Arc lengths from the boundary to the points inside.
    at : (n,) float64
        Arc length from the boundary to the ghost outside.
    spacing : float
        Unit of length in which the small systems are well scaled.
    """
    n, k = positions.shape
    powers = np.arange(k + 1)
    system = np.empty((n, k + 1, k + 1))
    system[:, :k] = (-positions / spacing)[:, :, None] ** powers
    system[:, k] = 0.0
    unit = spacing if alpha else 1.0
    system[:, k, 0] = beta * unit
    if k:
        system[:, k, 1] = alpha * unit / spacing
    value = (at / spacing)[:, None] ** powers
    weights = np.linalg.solve(system.transpose(0, 2, 1), value[:, :, None])[:, :, 0]
    return np.asarray(weights[:, :k]), np.asarray(weights[:, k] * unit)


def points_inwards(
    surface: LocalSource, foot: Floats, inward: Floats, count: int, spacing: float, start: ClosestPoints | None = None
) -> Inside:
    """Return ``count`` (2 or more) points behind each ``foot`` (n, d), in the unit directions ``inward`` (n, d).

    Where the surface has several sheets in one band, ``start`` are its records of the feet, whose sheets are kept.
    """
    step = CONTINUATION_STEP_SPACINGS * spacing
    ahead = foot[:, None] + step * np.arange(1, count + 1)[:, None] * inward[:, None]
    start = None if start is None else start.take(np.repeat(np.arange(len(foot)), count))
    feet = nearest_on_sheet(surface, start, ahead.reshape(-1, foot.shape[1]), spacing)
    points = feet.points.reshape(ahead.shape)
    chords = np.linalg.norm(points - foot[:, None], axis=2)
    wanted = step * np.arange(1, count + 1)
    sound = (np.diff(chords, axis=1, prepend=0.0) > CROWDED_STEP_SHARE * step).all(axis=1)
    sound &= (feet.edge.reshape(chords.shape) < 0).all(axis=1)
    curvature = _curvature(points[:, :2] - foot[:, None], np.where(sound[:, None], chords[:, :2], wanted[:2]))
    positions = arc_length(chords, np.linalg.norm(curvature, axis=1)[:, None])
    return Inside(
        points, positions, curvature, sound, [feet.take(np.arange(j, len(feet), count)) for j in range(count)]
    )


def _curvature(chords: Floats, lengths: Floats) -> Floats:
    """Return the curvature vectors (n, d) of the parabolas through a foot and two points, ``chords`` (n, 2, d) away."""
    slopes = chords / lengths[:, :, None]
    bend = 2 * (slopes[:, 1] - slopes[:, 0]) / (lengths[:, 1] - lengths[:, 0])[:, None]
    along = slopes[:, 0] / np.linalg.norm(slopes[:, 0], axis=1, keepdims=True)
    tangent = along - 0.5 * lengths[:, :1] * bend
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return np.asarray(bend - np.sum(bend * tangent, axis=1, keepdims=True) * tangent)


def arc_length(chords: Floats, curvature: Floats) -> Floats:
    """Return the lengths of arcs over ``chords``: ``(2 / kappa) arcsin(kappa chord / 2)``."""
    angle = np.minimum(0.5 * curvature * chords, 1.0)
    small = angle < STRAIGHT_ARC_RADIANS
    return np.where(small, chords, chords * np.arcsin(angle) / np.where(small, 1.0, angle))


def beyond_edge(offset: Floats, outward: Floats, curvature: Floats) -> Floats:
    """Return the arc length (n,) at which nodes ``offset`` (n, d) from an edge stand, on the arc continued outwards.

    ``(1 / kappa) arctan2(kappa a, 1 - kappa c)``, a along the conormal ``outward`` and c towards the centre.
    """
    kappa = np.linalg.norm(curvature, axis=1)
    a = np.sum(offset * outward, axis=1)
    towards = np.sum(offset * curvature, axis=1)
    straight = kappa * np.abs(a) < STRAIGHT_ARC_RADIANS
    return np.asarray(np.where(straight, a, np.arctan2(kappa * a, 1 - towards) / np.where(straight, 1.0, kappa)))
