"""Tracing of the cut of a surface: knots on it, dense enough for cubics between them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.plugin import Chain, ClosestPoints, Floats, InputError, Ints, dots, link_chains, norms
from cpmkit_combinations.crossings import find_crossings, select_apart
from cpmkit_combinations.cubics import Cubics, hermite_cubics
from cpmkit_combinations.level_cut import CUT_DIFFERENCE_SHARE, LevelCut

#: Largest distance of linked points of a curve, in spacings; the least is 0.1.
LINK_SPACINGS = 3.5
#: Largest distance of the middles of the cubics from the cut, relative to the size.
TRACING_TOLERANCE_SHARE = 1e-12
#: Halving a cubic divides its distance by 16 where the surface is smooth. Where the ratio is not below the first
#: number the second number of times in a row, the surface has a kink; if more than the third number of cubics have one
#: at once, they are not refined further.
SMOOTH_HALVING_SHARE, ROUGH_HALVINGS, MOST_KINKS = 0.125, 2, 32
#: Largest number of halvings of a cubic; and the shortest cubic, relative to the size, where directions come from
#: differences.
CUBIC_HALVINGS, SHORTEST_CUBIC_SHARE = 12, 8 * CUT_DIFFERENCE_SHARE
#: Below this share of its length in space, phi's gradient along the surface counts as vanishing.
VANISHING_GRADIENT_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class Knots:
    """Points along one piece of the cut.

    Attributes
    ----------
    points, tangents, conormals : (k, d) float64
        Tangents point in the direction of travel, conormals to phi > 0.
    closed : bool
        Whether the first knot follows the last.
    deviation : float
        The largest distance from the cut in the middle between two knots.
    """

    points: Floats
    tangents: Floats
    conormals: Floats
    closed: bool
    deviation: float = 0.0

    def cubics(self) -> Floats:
        """Return the coefficients (m, 4, d), of 1, s, s^2 and s^3, of the cubics from each knot to the next.

        There are as many as knots, of an open piece one less.
        """
        following = np.roll(np.arange(len(self.points)), -1)[: None if self.closed else -1]
        starts = slice(None) if self.closed else slice(0, -1)
        p, t = self.points, self.tangents
        return hermite_cubics(p[starts], t[starts], p[following], t[following])


def trace_cut(cut: LevelCut) -> list[Knots]:
    """Return the connected pieces of the zero set of ``cut`` on a surface as knots, the longest first.

    Pieces smaller than a few spacings may be missed. Raise InputError as :func:`find_crossings`, and if the zero set
    cannot be traced: where it branches, touches itself, bends sharply, or is too near to another part of itself.
    """
    crossings = find_crossings(cut)
    inside, converged = cut.project_onto_cut(_thin_out(crossings.inside, 0.5 * cut.spacing))
    inside = inside.take(converged & (inside.edge < 0))
    inside = inside.take(_rows_far_from(inside.points, crossings.at_edge.points, 0.25 * cut.spacing))
    inside = inside.take(select_apart(inside.points, 0.1 * cut.spacing))
    feet = ClosestPoints.join([inside, crossings.at_edge])
    if not len(inside):
        raise InputError(_lost_message(cut, crossings.inside.points.mean(axis=0), False))
    tangents, conormals, share = cut.directions(feet)
    pieces = link_chains(feet.points, tangents, conormals, LINK_SPACINGS * cut.spacing)
    pieces = _check_chains(cut, feet, share, pieces)
    knots = [_refine_knots(cut, _evenly_spaced_knots(cut, feet, tangents, conormals, piece)) for piece in pieces]
    return sorted(knots, key=lambda piece: -cubics_of(piece).lengths.sum())


def _thin_out(feet: ClosestPoints, side: float) -> ClosestPoints:
    """Return one of the ``feet`` in each cube of length ``side`` that contains any."""
    cells = np.floor(feet.points / side).astype(np.int64)
    return feet.take(np.unique(cells, axis=0, return_index=True)[1])


def _rows_far_from(points: Floats, others: Floats, distance: float) -> Ints:
    """Return the rows (k,) of ``points`` (n, d) that are farther than ``distance`` from all ``others`` (m, d)."""
    from scipy.spatial import cKDTree

    if not len(others):
        return np.arange(len(points))
    return np.flatnonzero(cKDTree(others).query(points)[0] > distance)


def _check_chains(cut: LevelCut, feet: ClosestPoints, share: Floats, pieces: list[Chain]) -> list[Chain]:
    """Return the chains ``pieces`` of two points or more: single points within a spacing of these are left out.

    ``share`` (n,) is the length of phi's gradient along the surface over that in space, at ``feet``. Raise InputError
    if an open chain does not end on the surface's edge, a closed one has fewer than four points, or a single point is
    far from all chains.
    """
    from scipy.spatial import cKDTree

    chained = [piece for piece in pieces if len(piece.order) > 1]
    tree = cKDTree(feet.points[np.concatenate([piece.order for piece in chained])]) if chained else None
    for piece in pieces:
        ends = piece.order[[0, -1]]
        stray = tree is not None and len(piece.order) == 1 and tree.query(feet.points[ends[0]])[0] < cut.spacing
        if stray or (piece.closed and len(piece.order) > 3) or (len(piece.order) > 1 and (feet.edge[ends] >= 0).all()):
            continue
        loose = ends[feet.edge[ends] < 0] if (feet.edge[ends] < 0).any() else ends
        lost = int(loose[np.argmin(share[loose])])
        ends = np.unique(np.concatenate([piece.order[[0, -1]] for piece in pieces if not piece.closed]))
        meeting = norms(feet.points[ends] - feet.points[lost]) <= 2 * LINK_SPACINGS * cut.spacing
        raise InputError(
            _lost_message(cut, feet.points[lost], bool(meeting.sum() > 2 or share[lost] < VANISHING_GRADIENT_SHARE))
        )
    return chained


def _lost_message(cut: LevelCut, point: Floats, branches: bool) -> str:
    """Return the error sentence for a cut lost near ``point`` (d,): it ``branches`` there, else samples are too few."""
    label, place = cut.phi.label, np.round(point + cut.phi.origin, 6).tolist()
    if branches:
        return (
            f"the cut branches or touches itself near {place}, where the gradient of {label} along the surface "
            f"vanishes; change {label} a little, or cut away this place with the kind trimmed."
        )
    return (
        f"the cut cannot be followed near {place}: it is too small or too sharply curved there, or other parts are too "
        f"near, for samples {cut.spacing:.3g} apart; raise resolution."
    )


def _evenly_spaced_knots(
    cut: LevelCut, feet: ClosestPoints, tangents: Floats, conormals: Floats, piece: Chain
) -> Knots:
    """Return knots about ``cut.spacing`` apart on one chain, projected onto the cut, as :func:`_orient_knots` directs.

    A closed chain gets at least 8, an open one 3. ``tangents`` and ``conormals`` (n, d) are those at ``feet``. Raise
    InputError if a projection does not converge.
    """
    p, t, v = feet.points[piece.order], tangents[piece.order], conormals[piece.order]
    following = np.roll(p, -1, axis=0) - p
    along = following + np.roll(following, 1, axis=0)
    if not piece.closed:
        along[0], along[-1] = following[0], following[-2]
    rough = Knots(p, np.where(dots(along, t)[:, None] < 0, -t, t), v, piece.closed)
    curve = cubics_of(rough)
    reached = np.concatenate([[0.0], np.cumsum(curve.lengths)])
    count = max(int(np.ceil(reached[-1] / cut.spacing)), 8 if piece.closed else 2)
    positions = np.linspace(0.0, reached[-1], count + 1)[: -1 if piece.closed else None]
    segment = np.clip(np.searchsorted(reached, positions, side="right") - 1, 0, len(curve.piece) - 1)
    s = np.clip((positions - reached[segment]) / curve.lengths[segment], 0.0, 1.0)
    even, converged = cut.project_onto_cut(cut.surface.closest_point(curve.evaluate(segment, s)))
    if not piece.closed:  # the ends are on the edge already
        ends = feet.take(piece.order[[0, -1]])
        inner = np.arange(1, len(even) - 1)
        even = ClosestPoints.join([ends.take(np.array([0])), even.take(inner), ends.take(np.array([1]))])
        converged[[0, -1]] = True
    if not converged.all():
        raise InputError(_lost_message(cut, even.points[np.argmin(converged)], False))
    return _orient_knots(cut, even, curve.slope(segment, s), piece.closed)


def _orient_knots(cut: LevelCut, feet: ClosestPoints, along: Floats, closed: bool) -> Knots:
    """Return knots at ``feet`` of direction ``along`` (k, d), reversed if phi > 0 would not lie on the left.

    Without normals of the surface the left has no meaning: conormals point to phi > 0, but the direction is arbitrary.
    """
    t, v, _ = cut.directions(feet)
    against = dots(t, along)[:, None] < 0
    # t is v x n with the surface's n: if n has a sign, t has the right one
    knots = Knots(feet.points, np.where(against, -t, t), v, closed)
    if np.mean(against) <= 0.5:
        return knots
    return Knots(knots.points[::-1], -knots.tangents[::-1], v[::-1], closed)


def _refine_knots(cut: LevelCut, knots: Knots) -> Knots:
    """Return knots so dense that the cubics between them lie on the cut, with the ``deviation`` that is left.

    In its middle each cubic is within :data:`TRACING_TOLERANCE_SHARE` of the size of the cut, unless it has a kink, may
    not be halved any further, or the projection of its middle does not converge.
    """
    tolerance, deviation = TRACING_TOLERANCE_SHARE * cut.size, 0.0
    target = np.arange(len(knots.cubics()))
    parent, failures = np.full(len(target), np.inf), np.zeros(len(target), dtype=np.int64)
    shortest = 0.0 if cut.knows_directions else SHORTEST_CUBIC_SHARE * cut.size
    for k in range(CUBIC_HALVINGS + 1):
        curve = cubics_of(knots)
        middle = curve.evaluate(target, np.full(len(target), 0.5))
        feet, converged = cut.project_onto_cut(cut.surface.closest_point(middle))
        off = norms(feet.points - middle)
        far = converged & (off > tolerance)
        failures = np.where(off < SMOOTH_HALVING_SHARE * parent, 0, failures + 1)
        kinks = far & (failures >= ROUGH_HALVINGS)
        halved = far & ~(kinks & (kinks.sum() > MOST_KINKS)) & (curve.lengths[target] > shortest) & (k < CUBIC_HALVINGS)
        deviation = max(deviation, float(off[~halved].max(initial=0.0)))
        if not halved.any():
            break
        knots = _insert_middles(cut, knots, curve, target[halved], feet.take(halved))
        target = (target[halved] + np.arange(halved.sum()))[:, None] + np.arange(2)
        target, parent, failures = target.ravel(), np.repeat(off[halved], 2), np.repeat(failures[halved], 2)
    return replace(knots, deviation=deviation)


def _insert_middles(cut: LevelCut, knots: Knots, curve: Cubics, segments: Ints, feet: ClosestPoints) -> Knots:
    """Return the knots with a further knot at ``feet`` (k,) in each of the ascending ``segments`` (k,) of ``curve``."""
    t, v, _ = cut.directions(feet)
    along = curve.slope(segments, np.full(len(segments), 0.5))
    t = np.where(dots(t, along)[:, None] < 0, -t, t)
    points = np.insert(knots.points, segments + 1, feet.points, axis=0)
    tangents = np.insert(knots.tangents, segments + 1, t, axis=0)
    return Knots(points, tangents, np.insert(knots.conormals, segments + 1, v, axis=0), knots.closed)


def cubics_of(knots: Knots) -> Cubics:
    """Return the cubics between ``knots`` as one piece."""
    coefficients = knots.cubics()
    return Cubics(coefficients, np.zeros(len(coefficients), dtype=np.int64))
