"""Curves that are known by closest points alone, traced step by step to a graph of segments."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from itertools import product

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.types import Bools, Floats, Ints

#: A step that moves by less than this share of a full step does not count.
LEAST_STEP = 0.5
#: After a corner a curve continues at points farther than this share of a step from its part before the corner.
LEAST_TURN = 0.2
#: A step meets points of a trace that are nearer to its end than this share of the step.
MET_SHARE = 0.7


@dataclass(frozen=True, eq=False)
class OpenEnds:
    """Ends of traces that are being continued, one per row."""

    last: Ints  #: (f,): the number of the last point of each trace.
    heading: Floats  #: (f, d): the direction of the trace there.
    sign: Ints  #: (f,): by how much ``place`` changes at a step, 1 or -1.
    target: Floats  #: (f, d): the point of the curve to which each trace steps next.
    turned: Bools  #: (f,): whether the next step turns a corner at the last point.
    beyond: Floats  #: (f, d): a point beyond that corner, straight ahead of the trace before the corner.

    def take(self, rows: Bools | Ints) -> OpenEnds:
        """Return the ends at ``rows``, numbers or a mask, as new arrays."""
        return OpenEnds(*(getattr(self, column.name)[rows] for column in fields(self)))

    def append(self, others: OpenEnds) -> OpenEnds:
        """Return these ends and ``others``."""
        pairs = ((getattr(self, column.name), getattr(others, column.name)) for column in fields(self))
        return OpenEnds(*(np.concatenate(pair) for pair in pairs))


@dataclass(eq=False)
class CurveTracer:
    """Traces a curve from many places at once; all open ends are stepped together."""

    source: LocalSource
    step: float  #: The length of a step.
    #: points, directions (n, d): the points traced so far, and the direction of the trace at each.
    points: Floats
    directions: Floats
    #: piece, place (n,): the start from which each point was traced, and its signed number along the trace from there.
    piece: Ints
    place: Ints
    #: list of (k, 2) int64: numbers of the points that are connected.
    segments: list[Ints] = field(default_factory=list)
    #: list of (k,) int64: numbers of the last points of traces that turned and met a strand traced before: a junction.
    before_junctions: list[Ints] = field(default_factory=list)
    #: list of (k, d) float64: for each of these points a point straight ahead of the trace, beyond the junction.
    beyond: list[Floats] = field(default_factory=list)

    @classmethod
    def of(cls, source: LocalSource, step: float) -> CurveTracer:
        """Return a tracer without points of the curve ``source``, with steps of length ``step``."""
        no_points, no_numbers = np.zeros((0, source.dim)), np.zeros(0, dtype=np.int64)
        return cls(source, step, no_points, no_points, no_numbers, no_numbers)

    def trace_all(self, seeds: Floats) -> None:
        """Trace all pieces of the curve that contain one of its points ``seeds`` (n, d), into the tracer's fields."""
        from scipy.spatial import KDTree

        while len(seeds):
            self._trace_from(seeds[_far_apart(seeds, 12.0 * self.step)])
            distance, _ = KDTree(self.points).query(seeds)
            seeds = seeds[distance > self.step]

    def _trace_from(self, starts: Floats) -> None:
        """Trace the pieces through ``starts`` (n, d), which are far apart, in both directions, into the fields."""
        ahead, found = self._points_around(starts)
        rows = np.arange(len(starts))
        target = ahead[rows, np.where(found, norms(ahead - starts[:, None]), -1.0).argmax(axis=1)]
        heading, has_ahead = unit(target - starts), np.asarray(found.any(axis=1))
        last = len(self.points) + rows
        self._record(starts, heading, last, np.zeros(len(starts), dtype=np.int64))
        forward = OpenEnds(last, heading, np.ones(len(rows), dtype=np.int64), target, ~has_ahead, starts)
        backward = OpenEnds(last, -heading, -forward.sign, target, forward.turned, starts)
        ends = self._advance(forward.take(has_ahead)).append(backward.take(has_ahead))
        for _ in range(100_000):  # a limit
            if not len(ends.last):
                break
            ends = self._advance(self._choose_targets(ends))

    def _advance(self, ends: OpenEnds) -> OpenEnds:
        """Step open ends to their targets, or to points met there; record points, and return the ends that continue."""
        last, target, turned = ends.last, ends.target, ends.turned
        direction = unit(target - self.points[last])
        bend = norms(direction - ends.heading)
        met = self._met_points(last, target, direction, bend, turned)
        smooth = (met >= 0) & ~turned
        self.segments.append(np.stack([last[smooth], met[smooth]], axis=1))
        arrived = (met >= 0) & turned
        self.before_junctions.append(last[arrived])
        self.beyond.append(ends.beyond[arrived])
        free = np.flatnonzero(met < 0)
        partner = self._met_ends(last[free], target[free], direction[free], bend[free], turned[free])
        own = free[partner < 0]
        number = np.full(len(free), -1)
        number[partner < 0] = len(self.points) + np.arange(len(own))
        self.segments.append(np.stack([last[free], np.where(partner < 0, number, number[partner])], axis=1))
        self._record(target[own], direction[own], self.piece[last[own]], self.place[last[own]] + ends.sign[own])
        return replace(ends.take(own), last=number[partner < 0], heading=direction[own])

    def _record(self, points: Floats, directions: Floats, piece: Ints, place: Ints) -> None:
        """Append k traced points; all arguments are rows of the fields of the same names, (k, d) or (k,)."""
        self.points, self.directions = (
            np.concatenate(pair) for pair in ((self.points, points), (self.directions, directions))
        )
        self.piece, self.place = (np.concatenate(pair) for pair in ((self.piece, piece), (self.place, place)))

    def _met_points(self, last: Ints, target: Floats, direction: Floats, bend: Floats, turned: Bools) -> Ints:
        """Return the number (f,) of the first traced point met by the step from ``last`` to ``target``, -1 for none.

        The trace must have the step's ``direction`` (f, d) at that point, unless the step follows a corner
        (``turned``). ``bend`` (f,) is the change of direction at the step. Points within six steps along the same trace
        do not count.
        """
        from scipy.spatial import KDTree

        pairs = KDTree(target).sparse_distance_matrix(
            KDTree(self.points), MET_SHARE * self.step, output_type="coo_matrix"
        )
        row, number = pairs.row, pairs.col
        is_along = self._are_along(target[row], direction[row], bend[row], self.points[number], self.directions[number])
        recent = self._are_recent(last[row], number)
        way = dots(self.points[number] - self.points[last[row]], direction[row])
        fits = (is_along | turned[row]) & ~recent & (way > 0)
        row, number, way = row[fits], number[fits], way[fits]
        order = np.lexsort((way, row))
        row, first = np.unique(row[order], return_index=True)
        met = np.full(len(target), -1)
        met[row] = number[order][first]
        return met

    def _are_along(
        self, points: Floats, directions: Floats, bend: Floats, others: Floats, their_directions: Floats
    ) -> Bools:
        """Return which points (k, d) of two traces lie on one strand, from the directions (k, d) of both.

        ``bend`` (k,) is the change of direction of the first trace over its last step.
        """
        off = others - points
        off = off - dots(off, directions)[:, None] * directions
        is_close = norms(off) < (0.03 + 0.5 * bend) * self.step + 6.0 * self.source.noise
        return np.asarray(is_close & (np.abs(dots(directions, their_directions)) > 0.8))

    def _are_recent(self, first: Ints, second: Ints) -> Bools:
        """Return which pairs of points (k,), (k,) are less than six steps apart along one trace."""
        same = self.piece[first] == self.piece[second]
        return np.asarray(same & (np.abs(self.place[first] - self.place[second]) < 6))

    def _met_ends(self, last: Ints, target: Floats, direction: Floats, bend: Floats, turned: Bools) -> Ints:
        """Return for each open end the number (f,) of an earlier end whose step ends beside its own, -1 for none.

        Arguments are as in :meth:`_met_points`. Several ends may have the same earlier end, which has -1 itself.
        """
        from scipy.spatial import KDTree

        pairs = np.sort(KDTree(target).query_pairs(MET_SHARE * self.step, output_type="ndarray"), axis=1)
        i, j = pairs[np.lexsort(pairs.T[::-1])].T
        is_along = self._are_along(target[i], direction[i], bend[i], target[j], direction[j]) | turned[i] | turned[j]
        fits = is_along & ~self._are_recent(last[i], last[j])
        partner = np.full(len(target), -1)
        for first, second in zip(i[fits].tolist(), j[fits].tolist(), strict=True):
            if partner[first] < 0 and partner[second] < 0:
                partner[second] = first
        return partner

    def _choose_targets(self, ends: OpenEnds) -> OpenEnds:
        """Return the ends that continue, with new targets; corners and ends of the curve are recorded in the fields."""
        here, heading, last = self.points[ends.last], ends.heading, ends.last.copy()
        target = self.source.closest_point(here + self.step * heading).points
        way = target - here
        length = norms(way)
        leads_on = (length > LEAST_STEP * self.step) & (dots(way, heading) > 0.7 * length)
        rows = np.flatnonzero(~leads_on)
        if not len(rows):
            return replace(ends, target=target, turned=~leads_on)
        corner = self._ends_ahead(here[rows], heading[rows])
        apart = norms(corner - here[rows]) > 1e-3 * self.step
        at = rows[apart]
        new = len(self.points) + np.arange(len(at))
        self._record(corner[apart], heading[at], self.piece[last[at]], self.place[last[at]] + ends.sign[at])
        self.segments.append(np.stack([last[at], new], axis=1))
        last[at] = new
        around, found = self._points_around(corner)
        back = np.where(apart[:, None], unit(here[rows] - corner), -heading[rows])
        offset = around - corner[:, None]
        behind = np.maximum(dots(offset, back[:, None]), 0.0)
        found &= norms(offset - behind[..., None] * back[:, None]) > LEAST_TURN * self.step
        cosine = np.where(found, dots(unit(offset), back[:, None]), 2.0)
        target[rows] = around[np.arange(len(rows)), cosine.argmin(axis=1)]
        go = leads_on.copy()
        go[rows] = found.any(axis=1)
        beyond = here + 2.0 * self.step * heading
        return replace(ends, last=last, target=target, turned=~leads_on, beyond=beyond).take(go)

    def _ends_ahead(self, here: Floats, heading: Floats) -> Floats:
        """Return the end or corner (k, d) of the curve within 1.5 steps ahead of ``here`` (k, d), else ``here``."""
        targets = here[:, None] + np.array([0.5, 1.0, 2.0])[:, None] * self.step * heading[:, None]
        closest, found = self._closest_near(here, targets, 1.5)
        ahead = np.where(found, dots(closest - here[:, None], heading[:, None]), 0.0)
        best = ahead.argmax(axis=1)
        rows = np.arange(len(here))
        return np.where((ahead[rows, best] > 0)[:, None], closest[rows, best], here)

    def _points_around(self, here: Floats) -> tuple[Floats, Bools]:
        """Return closest points (k, c, d) of the ends of steps from ``here`` (k, d) in c = 3^d - 1 directions.

        The mask (k, c) is True for closest points between ``LEAST_STEP`` and 1.05 steps away from ``here``.
        """
        directions = unit(np.array([d for d in product((-1.0, 0.0, 1.0), repeat=self.source.dim) if any(d)]))
        closest, found = self._closest_near(here, here[:, None] + self.step * directions, 1.05)
        return closest, found & (norms(closest - here[:, None]) > LEAST_STEP * self.step)

    def _closest_near(self, here: Floats, targets: Floats, steps: float) -> tuple[Floats, Bools]:
        """Return the closest points of ``targets`` (k, c, d), and whether they are within ``steps`` of ``here``."""
        closest = self.source.closest_point(targets.reshape(-1, targets.shape[2])).points.reshape(targets.shape)
        return closest, norms(closest - here[:, None]) < steps * self.step


def _far_apart(points: Floats, distance: float) -> Ints:
    """Return the numbers of some of ``points`` (n, d) with mutual distances above ``distance``."""
    _, first = np.unique(np.floor(points / distance), axis=0, return_index=True)
    chosen: list[int] = []
    for number in first.tolist():
        if not chosen or norms(points[chosen] - points[number]).min() > distance:
            chosen.append(number)
    return np.array(chosen, dtype=np.int64)
