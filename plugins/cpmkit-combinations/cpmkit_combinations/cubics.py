"""Chains of cubics, and their nearest points: a tree of bounding capsules, with Newton's method at its leaves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints, dots, norms

#: Number of cubics, or of capsules, in one capsule of the next level.
CAPSULE_CHILDREN = 4
#: Newton's method starts from the nearest of this number plus one of points of a cubic.
NEWTON_STARTS = 4
#: Largest number of Newton steps; a step that leaves the bracket is replaced by bisection.
CUBIC_NEWTON_STEPS = 60
#: Rounding of a distance, relative to the distance.
DISTANCE_ROUNDING = 8e-16
#: Number of queries in one batch, whose temporary arrays fit into the processor's cache.
CUBIC_BATCH_QUERIES = 8192


@dataclass(frozen=True, eq=False)
class Capsules:
    """Bounds of parts of a curve: all points within ``radius`` (k,) of segments from ``start`` to ``end`` (k, d).

    ``whole`` (k,) is true where the part is connected: the curve then passes within ``radius`` of every point of the
    segment.
    """

    start: Floats
    end: Floats
    radius: Floats
    whole: Bools


@dataclass(frozen=True, eq=False)
class Cubics:
    """Cubics p(s), 0 <= s <= 1, each followed by the next of its piece.

    Attributes
    ----------
    coefficients : (m, 4, d) float64
        Of 1, s, s^2 and s^3.
    piece : (m,) int64
        Number of the connected piece of each cubic, ascending.
    """

    coefficients: Floats
    piece: Ints

    def evaluate(self, segment: Ints, s: Floats) -> Floats:
        """Return the points p(s) (n, d) of the cubics ``segment`` (n,) at the parameters ``s`` (n,)."""
        a, b, c, d = (self.coefficients[segment, k] for k in range(4))
        s = s[:, None]
        return np.asarray(a + s * (b + s * (c + s * d)))

    def slope(self, segment: Ints, s: Floats) -> Floats:
        """Return the derivatives dp/ds (n, d) of the cubics ``segment`` (n,) at the parameters ``s`` (n,)."""
        b, c, d = (self.coefficients[segment, k] for k in (1, 2, 3))
        s = s[:, None]
        return np.asarray(b + s * (2 * c + 3 * s * d))

    @cached_property
    def control(self) -> Floats:
        """(m, 4, d) the Bezier control points: each cubic lies in their convex hull."""
        a, b, c, d = (self.coefficients[:, k] for k in range(4))
        return np.stack([a, a + b / 3, a + (2 * b + c) / 3, a + b + c + d], axis=1)

    @cached_property
    def lengths(self) -> Floats:
        """(m,) the arc length of each cubic, by five Gauss points."""
        nodes, weights = np.polynomial.legendre.leggauss(5)
        segments = np.arange(len(self.piece))
        speeds = [norms(self.slope(segments, np.full(len(segments), 0.5 + 0.5 * node))) for node in nodes]
        return np.asarray(0.5 * dots(np.stack(speeds, axis=1), weights))

    @cached_property
    def levels(self) -> list[Capsules]:
        """The levels of the tree of capsules, from one for each cubic to at most ``CAPSULE_CHILDREN`` at the top.

        Capsule k of a level holds those from ``CAPSULE_CHILDREN * k`` on of the level before.
        """
        start, end = self.control[:, 0], self.control[:, 3]
        radius = np.maximum(*(_distances_from_segments(self.control[:, k], start, end) for k in (1, 2)))
        levels, piece = [Capsules(start, end, radius, np.ones(len(start), dtype=bool))], (self.piece, self.piece)
        while len(levels[-1].start) > CAPSULE_CHILDREN:
            first = np.arange(0, len(levels[-1].start), CAPSULE_CHILDREN)
            last = np.minimum(first + CAPSULE_CHILDREN, len(levels[-1].start)) - 1
            levels.append(_merge_capsules(levels[-1], first, last, piece[0][first] == piece[1][last]))
            piece = piece[0][first], piece[1][last]
        return levels

    def nearest(self, x: Floats) -> tuple[Ints, Floats]:
        """Return for each of ``x`` (n, d) the cubic (n,) that contains the nearest point, and its parameter s (n,)."""
        segment, s = np.empty(len(x), dtype=np.int64), np.empty(len(x))
        for start in range(0, len(x), CUBIC_BATCH_QUERIES):
            part = slice(start, start + CUBIC_BATCH_QUERIES)
            segment[part], s[part] = self._nearest_in_batch(x[part])
        return segment, s

    def _nearest_in_batch(self, x: Floats) -> tuple[Ints, Floats]:
        """Return the answer of :meth:`nearest` for one batch of queries ``x`` (n, d)."""
        rows, leaves = self._candidate_pairs(x)
        s, distance = self._foot_parameters(x[rows], leaves)
        first = np.flatnonzero(np.diff(rows, prepend=-1))
        least = np.minimum.reduceat(distance, first) if len(first) else distance
        winners = np.flatnonzero(distance == least[rows])
        winners = winners[np.unique(rows[winners], return_index=True)[1]]
        return leaves[winners], s[winners]

    def _candidate_pairs(self, x: Floats) -> tuple[Ints, Ints]:
        """Return pairs (k,), (k,) of a row of ``x`` (n, d), ascending, and a cubic that may be nearest to it."""
        top = self.levels[-1]
        rows = np.repeat(np.arange(len(x)), len(top.start))
        nodes = np.tile(np.arange(len(top.start)), len(x))
        for level in range(len(self.levels) - 1, -1, -1):
            capsules = self.levels[level]
            distance = _distances_from_segments(x[rows], capsules.start[nodes], capsules.end[nodes])
            radius = capsules.radius[nodes]
            most = np.where(capsules.whole[nodes], distance + radius, np.inf)
            first = np.flatnonzero(np.diff(rows, prepend=-1))
            bound = np.minimum.reduceat(most, first) if len(first) else most
            possible = distance - radius <= bound[rows] + DISTANCE_ROUNDING * distance
            rows, nodes = rows[possible], nodes[possible]
            if level:
                below = len(self.levels[level - 1].start)
                rows = np.repeat(rows, CAPSULE_CHILDREN)
                nodes = (CAPSULE_CHILDREN * nodes[:, None] + np.arange(CAPSULE_CHILDREN)).ravel()
                rows, nodes = rows[nodes < below], nodes[nodes < below]
        return rows, nodes

    def _foot_parameters(self, x: Floats, segment: Ints) -> tuple[Floats, Floats]:
        """Return s (n,) of local minima of the distance from ``x`` (n, d) on cubics ``segment`` (n,), and distances.

        Newton's method in a bracket around the nearest of five points finds it: the nearest point, unless the cubic
        bends back between these.
        """
        shares = np.linspace(0.0, 1.0, NEWTON_STARTS + 1)
        s = shares[np.argmin([norms(self.evaluate(segment, np.full(len(x), share)) - x) for share in shares], axis=0)]
        low, high = np.maximum(s - 1 / NEWTON_STARTS, 0.0), np.minimum(s + 1 / NEWTON_STARTS, 1.0)
        a, b, c, d = (self.coefficients[segment, k] for k in range(4))
        q, rows = x - a, np.arange(len(x))
        for _ in range(CUBIC_NEWTON_STEPS):
            if not len(rows):
                break
            u = s[rows, None]
            offset = u * (b[rows] + u * (c[rows] + u * d[rows])) - q[rows]
            slope = b[rows] + u * (2 * c[rows] + 3 * u * d[rows])
            pull = dots(offset, slope)
            stiffness = dots(slope, slope) + dots(offset, 2 * c[rows] + 6 * u * d[rows])
            low[rows], high[rows] = np.where(pull < 0, s[rows], low[rows]), np.where(pull < 0, high[rows], s[rows])
            with np.errstate(all="ignore"):
                newton = s[rows] - pull / stiffness
            # at an end from which the cubic leads away from the query the bracket shrinks to the end
            accepted = (newton >= low[rows]) & (newton <= high[rows]) & (stiffness > 0)
            following = np.where(accepted, newton, 0.5 * (low[rows] + high[rows]))
            change = np.abs(following - s[rows])
            s[rows] = following
            rows = rows[change > DISTANCE_ROUNDING]
        return s, norms(self.evaluate(segment, s) - x)


def hermite_cubics(start: Floats, start_tangent: Floats, end: Floats, end_tangent: Floats) -> Floats:
    """Return coefficients (m, 4, d), of 1, s, s^2 and s^3, of cubics between two points with given unit tangents there.

    The cubics go from ``start`` to ``end`` (m, d). Their speed at both ends is ``2 chord / (1 + cos(angle / 2))`` for
    the angle between the tangents: an arc of a circle is then approximated to angle^6 / 27,000 of its radius.
    """
    chord = end - start
    cosine = np.sqrt(np.maximum(0.5 * (1 + dots(start_tangent, end_tangent)), 0.0))
    speed = (2 * norms(chord) / (1 + cosine))[:, None]
    first, last = speed * start_tangent, speed * end_tangent
    return np.stack([start, first, 3 * chord - 2 * first - last, first + last - 2 * chord], axis=1)


def _merge_capsules(parts: Capsules, first: Ints, last: Ints, whole: Bools) -> Capsules:
    """Return a capsule around each run of ``parts``, from ``first`` (k,) to ``last``; connected where ``whole``."""
    start, end = parts.start[first], parts.end[last]
    run = np.repeat(np.arange(len(first)), last - first + 1)
    off = [_distances_from_segments(points, start[run], end[run]) for points in (parts.start, parts.end)]
    radius = np.maximum.reduceat(np.maximum(*off) + parts.radius, first)
    return Capsules(start, end, radius, whole)


def _distances_from_segments(x: Floats, start: Floats, end: Floats) -> Floats:
    """Return the distances (n,) of points ``x`` (n, d) from the segments from ``start`` to ``end`` (n, d)."""
    chord, away = end - start, x - start
    squared = dots(chord, chord)
    share = np.clip(dots(away, chord) / np.where(squared > 0, squared, 1.0), 0.0, 1.0)
    return norms(away - share[:, None] * chord)
