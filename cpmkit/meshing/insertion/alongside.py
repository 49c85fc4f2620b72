"""Curves that nearly coincide: the later one takes its points beside those of the earlier one.

Each curve is drawn with vertices of its own. Where two are nearer to each other than a chord is to its arc, their
polylines would cross, and the zone between them would be cut to pieces. Chords between points that lie beside each
other run side by side.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.meshing.insertion.coincidence import CLOSE_SHARE, SAME_SHARE
from cpmkit.meshing.insertion.polylines import in_space
from cpmkit.protocols import Bools, Floats, Ints

#: A curve that turns by more than this at a point has a corner there.
CORNER_COSINE = np.cos(np.radians(20.0))
#: Between neighbouring points a curve that is so many times as long as the other one does not run beside it.
LONGEST_SHARE = 2.0
#: A point nearer than this share of the spacing to one that is kept is not put in.
LEAST_STEP_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class Chain:
    """A curve as a simplified polyline.

    Attributes
    ----------
    points : (n, 3) float64
        In the direction of travel; a closed one goes on from the last to the first.
    closed : bool
    curve : LocalSource
        That they lie on.
    owner : int
        The number of its boundary.
    beside : (n, 2) int64
        The number of an earlier chain, and the point of it beside which each point lies; -1 where there is none. A
        point that lies beside several is there as often.
    marks : (n,) bool
        Which points it cannot do without: ends and corners.
    """

    points: Floats
    closed: bool
    curve: LocalSource
    owner: int
    beside: Ints
    marks: Bools

    @classmethod
    def of(cls, points: Floats, closed: bool, curve: LocalSource, owner: int) -> Chain:
        """Return a curve that runs beside none."""
        around = np.concatenate([points[-1:], points, points[:1]])
        way = unit(np.diff(around, axis=0))
        marks = np.asarray(dots(way[1:], way[:-1]) < CORNER_COSINE)
        if not closed:
            marks[[0, -1]] = True
        return cls(points, closed, curve, owner, np.full((len(points), 2), -1), marks)

    @property
    def loop(self) -> Floats:
        """Its points, a closed one's first again at the end."""
        return np.concatenate([self.points, self.points[:1]]) if self.closed else self.points

    def feet(self, points: Floats) -> Floats:
        """Return the points (k, 3) of the curve nearest to ``points`` (k, 3)."""
        return in_space(self.curve.closest_point(np.ascontiguousarray(points[:, : self.curve.dim])).points)

    def places(self, points: Floats) -> Floats:
        """Return where (k,) along the chain points near it are, in segments from its start."""
        loop = self.loop
        start, way = loop[:-1], np.diff(loop, axis=0)
        square = np.maximum(dots(way, way), np.finfo(float).tiny)
        found = np.empty(len(points))
        for row, point in enumerate(points):
            share = np.clip(dots(point - start, way) / square, 0.0, 1.0)
            segment = int(np.argmin(norms(start + share[:, None] * way - point)))
            found[row] = segment + share[segment]
        return found

    def with_points(self, points: Floats, dropped: Bools, beside: Ints, least: float) -> Chain:
        """Return the chain without those dropped and with ``points`` (k, 3) of the curve in their places.

        Parameters
        ----------
        points : (k, 3) float64
            In the direction of travel. Those nearer than ``least`` to one that stays are replaced by that.
        dropped : (n,) bool
        beside : (k, 2) int64
            Of the new ones.
        least : float
        """
        from scipy.spatial import cKDTree

        kept = np.flatnonzero(~dropped)
        places, marks = self.places(points), np.zeros(len(points), dtype=bool)
        if len(kept):
            gap, nearest = cKDTree(self.points[kept]).query(points)
            same = kept[nearest[gap <= least]]
            rows = gap <= least
            points, places = points.copy(), places.copy()
            points[rows], places[rows], marks[rows] = self.points[same], same, self.marks[same]
            if (beside[:, 0] < 0).all():
                points, places, marks, beside = (of[~rows] for of in (points, places, marks, beside))
            else:
                kept = np.setdiff1d(kept, same)
        order = np.argsort(np.concatenate([kept.astype(np.float64), places]), kind="stable")
        return replace(
            self,
            points=np.concatenate([self.points[kept], points])[order],
            beside=np.concatenate([self.beside[kept], beside])[order],
            marks=np.concatenate([self.marks[kept], marks])[order],
        )


def side_by_side(chains: Sequence[Chain], spacing: float, shared: Container[tuple[int, int]]) -> list[Chain]:
    """Return the curves with points beside each other where they nearly coincide.

    The first has a point beside each end and corner of others; each later one takes the feet of the points of those
    before it in place of its own. Where two cross, and go apart, they keep theirs.

    Parameters
    ----------
    chains : sequence of Chain
    spacing : float
    shared : container of (int, int)
        Chains, by their numbers, and the boundaries on which they lie in places.
    """
    found = list(chains)
    pairs = [
        (late, early)
        for late in range(len(found))
        for early in range(late)
        if (late, found[early].owner) not in shared and _boxes_meet(found[late].points, found[early].points, spacing)
    ]
    for late, early in pairs:
        found[early] = _with_marks(found[early], found[late], spacing)
    for late, early in pairs:
        found[late] = _following(found[late], found[early], early, spacing)
    return found


def _boxes_meet(a: Floats, b: Floats, spacing: float) -> bool:
    return bool(((a.min(axis=0) <= b.max(axis=0) + spacing) & (b.min(axis=0) <= a.max(axis=0) + spacing)).all())


def _is_beside(off: Floats, spacing: float) -> Bools:
    distance = norms(off)
    return np.asarray((distance > SAME_SHARE * spacing) & (distance < CLOSE_SHARE * spacing))


def _with_marks(early: Chain, late: Chain, spacing: float) -> Chain:
    """Return the earlier chain with the feet of the later one's ends and corners."""
    marks = late.points[late.marks]
    feet = early.feet(marks)
    feet = feet[_is_beside(feet - marks, spacing)]
    none, free = np.zeros(len(early.points), dtype=bool), np.full((len(feet), 2), -1)
    return early.with_points(feet, none, free, LEAST_STEP_SHARE * spacing) if len(feet) else early


def _following(late: Chain, early: Chain, number: int, spacing: float) -> Chain:
    """Return the later chain with the feet of the earlier one's points, a ``number``, in place of its own there."""
    feet = late.feet(early.points)
    off = feet - early.points
    near = _is_beside(off, spacing)
    if not near.any():
        return late
    places = np.zeros(len(feet))
    places[near] = late.places(feet[near])
    dropped, taken = np.zeros(len(late.points), dtype=bool), np.zeros(len(feet), dtype=bool)
    for rows in _stretches(near, early.closed):
        if _crosses(off[rows], whole=bool(near.all())):
            continue
        taken[rows] = True
        lengths = norms(np.diff(early.points[rows], axis=0))
        for a, b, length in zip(places[rows[:-1]], places[rows[1:]], lengths, strict=True):
            dropped |= _between(late, a, b, length)
    if not taken.any():
        return late
    rows = np.flatnonzero(taken)
    if np.sign(np.diff(places[rows])).sum() < 0:  # it runs the other way
        rows = rows[::-1]
    beside = np.stack([np.full(len(rows), number), rows], axis=1)
    return late.with_points(feet[rows], dropped & ~late.marks, beside, LEAST_STEP_SHARE * spacing)


def _stretches(near: Bools, closed: bool) -> Iterator[Ints]:
    """Yield the numbers of consecutive points that are near; a closed chain goes on at its start."""
    count = len(near)
    if near.all():
        yield np.arange(count + closed) % count
        return
    start = int((~near).argmax()) if closed else 0
    order = (np.arange(count) + start) % count
    for run in np.split(order, np.flatnonzero(np.diff(near[order])) + 1):
        if near[run[0]]:
            yield run


def _crosses(off: Floats, whole: bool) -> bool:
    """Tell whether a curve with these offsets (k, 3) from another changes sides and then goes away."""
    return not whole and bool((dots(off[1:], off[:-1]) < 0).any())


def _between(chain: Chain, start: float, end: float, length: float) -> Bools:
    """Return which points of a chain lie between two places, the shorter way round, unless that way is too long."""
    number, low, high = np.arange(len(chain.points)), min(start, end), max(start, end)
    inside = (number > low) & (number < high)
    if chain.closed and high - low > 0.5 * len(number):
        inside = (number < low) | (number > high)
    way = float(norms(np.diff(chain.points[inside], axis=0)).sum())
    return inside & (way < LONGEST_SHARE * length)
