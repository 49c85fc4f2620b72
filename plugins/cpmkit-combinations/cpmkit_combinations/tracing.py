"""The cut of a surface followed from sample to sample: knots on it, dense enough for cubics between them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.plugin import Chain, ClosestPoints, Floats, InputError, Ints, chains, dots, norms
from cpmkit_combinations.crossings import crossings, spaced_apart
from cpmkit_combinations.cubics import Cubics, hermite
from cpmkit_combinations.level_cut import CUT_DIFFERENCE_SHARE, LevelCut

#: Points that are linked to a curve lie at least 0.1 and at most about this many spacings apart.
LINK_SPACINGS = 3.5
#: The cubics are refined until they lie this near to the cut, relative to the size, at their middles.
TRACING_TOLERANCE_SHARE = 1e-12
#: Halving a cubic takes the distance to a sixteenth on a smooth surface. Where it is not below this share so many
#: times running, the surface is not smooth there; at more than so many such places at once refining them ends.
SMOOTH_HALVING_SHARE, ROUGH_HALVINGS, MOST_KINKS = 0.125, 2, 32
#: Halvings of a cubic at most; and the shortest, relative to the size, where directions come from differences.
CUBIC_HALVINGS, SHORTEST_CUBIC_SHARE = 12, 8 * CUT_DIFFERENCE_SHARE
#: Below this share of its length in space phi's gradient along the surface counts as vanishing.
VANISHING_GRADIENT_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class Knots:
    """Points along one piece of the cut.

    Attributes
    ----------
    points, tangents, conormals : (k, d) float64
        Tangents point in the direction of travel, conormals to phi > 0.
    closed : bool
        True where the last knot is followed by the first.
    deviation : float
        The largest distance from the cut that was found in the middle between two knots.
    """

    points: Floats
    tangents: Floats
    conormals: Floats
    closed: bool
    deviation: float = 0.0

    def cubics(self) -> Floats:
        """Return the coefficients (m, 4, d) of the cubics between the knots."""
        following = np.roll(np.arange(len(self.points)), -1)[: None if self.closed else -1]
        kept = slice(None) if self.closed else slice(0, -1)
        p, t = self.points, self.tangents
        return hermite(p[kept], t[kept], p[following], t[following])


def trace(cut: LevelCut) -> list[Knots]:
    """Return the pieces of the cut of a surface, the longest first.

    Raises
    ------
    InputError
        If there is none, or it cannot be followed: where it branches, touches itself, or is too small for the spacing.
    """
    found = crossings(cut)
    inside, good = cut.project(_thinned(found.inside, 0.5 * cut.spacing))
    inside = inside.take(good & (inside.edge < 0))
    inside = inside.take(_away_from(inside.points, found.at_edge.points, 0.25 * cut.spacing))
    inside = inside.take(spaced_apart(inside.points, 0.1 * cut.spacing))
    feet = ClosestPoints.join([inside, found.at_edge])
    if not len(inside):
        raise InputError(_lost_sentence(cut, found.inside.points.mean(axis=0), False))
    tangents, conormals, share = cut.directions(feet)
    pieces = chains(feet.points, tangents, conormals, LINK_SPACINGS * cut.spacing)
    pieces = _checked_chains(cut, feet, share, pieces)
    knots = [_refined(cut, _evenly_spaced(cut, feet, tangents, conormals, piece)) for piece in pieces]
    return sorted(knots, key=lambda piece: -joined_cubics(piece).lengths.sum())


def _thinned(feet: ClosestPoints, side: float) -> ClosestPoints:
    """Return one foot for each occupied cube of a side."""
    cells = np.floor(feet.points / side).astype(np.int64)
    return feet.take(np.unique(cells, axis=0, return_index=True)[1])


def _away_from(points: Floats, others: Floats, distance: float) -> Ints:
    from scipy.spatial import cKDTree

    if not len(others):
        return np.arange(len(points))
    return np.flatnonzero(cKDTree(others).query(points)[0] > distance)


def _checked_chains(cut: LevelCut, feet: ClosestPoints, share: Floats, pieces: list[Chain]) -> list[Chain]:
    """Return the chains, without points by themselves beside one; they must be closed or end on the surface's edge."""
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
            _lost_sentence(cut, feet.points[lost], bool(meeting.sum() > 2 or share[lost] < VANISHING_GRADIENT_SHARE))
        )
    return chained


def _lost_sentence(cut: LevelCut, point: Floats, branches: bool) -> str:
    what, place = cut.phi.what, np.round(point + cut.phi.origin, 6).tolist()
    if branches:
        return (
            f"the cut branches or touches itself near {place}, where the gradient of {what} along the surface "
            f"vanishes; change {what} a little, or cut away this place with the kind trimmed."
        )
    return (
        f"the cut cannot be followed near {place}: it is too small or too sharply bent there, or other parts are too "
        f"near, for samples {cut.spacing:.3g} apart; raise resolution."
    )


def _evenly_spaced(cut: LevelCut, feet: ClosestPoints, tangents: Floats, conormals: Floats, piece: Chain) -> Knots:
    """Return knots about a spacing apart along one chain, in the direction of travel."""
    p, t, v = feet.points[piece.order], tangents[piece.order], conormals[piece.order]
    following = np.roll(p, -1, axis=0) - p
    along = following + np.roll(following, 1, axis=0)
    if not piece.closed:
        along[0], along[-1] = following[0], following[-2]
    rough = Knots(p, np.where(dots(along, t)[:, None] < 0, -t, t), v, piece.closed)
    curve = joined_cubics(rough)
    reached = np.concatenate([[0.0], np.cumsum(curve.lengths)])
    count = max(int(np.ceil(reached[-1] / cut.spacing)), 8 if piece.closed else 2)
    wanted = np.linspace(0.0, reached[-1], count + 1)[: -1 if piece.closed else None]
    segment = np.clip(np.searchsorted(reached, wanted, side="right") - 1, 0, len(curve.piece) - 1)
    s = np.clip((wanted - reached[segment]) / curve.lengths[segment], 0.0, 1.0)
    even, good = cut.project(cut.surface.closest_point(curve.at(segment, s)))
    if not piece.closed:  # the ends are on the edge already
        ends = feet.take(piece.order[[0, -1]])
        inner = np.arange(1, len(even) - 1)
        even = ClosestPoints.join([ends.take(np.array([0])), even.take(inner), ends.take(np.array([1]))])
        good[[0, -1]] = True
    if not good.all():
        raise InputError(_lost_sentence(cut, even.points[np.argmin(good)], False))
    return _travelled(cut, even, curve.slope(segment, s), piece.closed)


def _travelled(cut: LevelCut, feet: ClosestPoints, along: Floats, closed: bool) -> Knots:
    """Return knots in the direction of travel, phi > 0 at the left, given the direction in which they stand."""
    t, v, _ = cut.directions(feet)
    against = dots(t, along)[:, None] < 0
    # t is v x n with the surface's own n: it has the right sign, where n has one
    knots = Knots(feet.points, np.where(against, -t, t), v, closed)
    if np.mean(against) <= 0.5:
        return knots
    return Knots(knots.points[::-1], -knots.tangents[::-1], v[::-1], closed)


def _refined(cut: LevelCut, knots: Knots) -> Knots:
    """Return knots so dense that the cubics between them lie on the cut, as far as the surface is smooth."""
    tolerance, deviation = TRACING_TOLERANCE_SHARE * cut.size, 0.0
    target = np.arange(len(knots.cubics()))
    parent, strikes = np.full(len(target), np.inf), np.zeros(len(target), dtype=np.int64)
    shortest = 0.0 if cut.knows_directions else SHORTEST_CUBIC_SHARE * cut.size
    for k in range(CUBIC_HALVINGS + 1):
        curve = joined_cubics(knots)
        middle = curve.at(target, np.full(len(target), 0.5))
        feet, good = cut.project(cut.surface.closest_point(middle))
        off = norms(feet.points - middle)
        far = good & (off > tolerance)
        strikes = np.where(off < SMOOTH_HALVING_SHARE * parent, 0, strikes + 1)
        rough = far & (strikes >= ROUGH_HALVINGS)
        halved = far & ~(rough & (rough.sum() > MOST_KINKS)) & (curve.lengths[target] > shortest) & (k < CUBIC_HALVINGS)
        deviation = max(deviation, float(off[~halved].max(initial=0.0)))
        if not halved.any():
            break
        knots = _with_middles(cut, knots, curve, target[halved], feet.take(halved))
        target = (target[halved] + np.arange(halved.sum()))[:, None] + np.arange(2)
        target, parent, strikes = target.ravel(), np.repeat(off[halved], 2), np.repeat(strikes[halved], 2)
    return replace(knots, deviation=deviation)


def _with_middles(cut: LevelCut, knots: Knots, curve: Cubics, segments: Ints, feet: ClosestPoints) -> Knots:
    """Return the knots with one more, at ``feet``, in each of some segments (ascending)."""
    t, v, _ = cut.directions(feet)
    along = curve.slope(segments, np.full(len(segments), 0.5))
    t = np.where(dots(t, along)[:, None] < 0, -t, t)
    points = np.insert(knots.points, segments + 1, feet.points, axis=0)
    tangents = np.insert(knots.tangents, segments + 1, t, axis=0)
    return Knots(points, tangents, np.insert(knots.conormals, segments + 1, v, axis=0), knots.closed)


def joined_cubics(knots: Knots) -> Cubics:
    """Return the cubics between knots."""
    coefficients = knots.cubics()
    return Cubics(coefficients, np.zeros(len(coefficients), dtype=np.int64))
