"""Curves that coincide, or nearly: points that lie on another boundary, and points placed side by side.

Each curve is a polyline with vertices of its own. Where two curves are nearer to each other than a chord is to its arc,
their polylines would cross many times. Chords between points that are placed side by side are parallel instead.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, in_three_dimensions, nearest_shares, norms, unit
from cpmkit.types import Bools, Floats, Ints

#: A boundary lies on an earlier boundary where their distance is below this share of the spacing.
SAME_SHARE = 1e-8
#: Points on each segment of a polyline at which its distance from other boundaries is measured.
SEGMENT_POINTS = 4
#: A new point nearer than this share of the spacing to a point of the curve is replaced by that point.
LEAST_STEP_SHARE = 1e-3


def coincident_boundary(points: Floats, curve: LocalSource, earlier: Sequence[LocalSource], spacing: float) -> Ints:
    """Return the number (n,) of the earlier boundary on which each point of a curve lies, -1 for none.

    Points lie on a boundary if at least two of them have distance zero (a single point is a crossing), or where the
    curve stays within .02 spacings and changes sides three times or more: it is then the same curve with other
    vertices.

    ``points`` (n, d): consecutive points of the ``curve``.
    ``earlier``: boundaries inserted before; of several on which a point lies, the last counts.
    ``spacing``: spacing h of the lattice, to which tolerances refer.
    """
    numbers = np.full(len(points), -1)
    share = np.arange(SEGMENT_POINTS)[:, None] / SEGMENT_POINTS
    between = (points[:-1, None] + share * np.diff(points, axis=0)[:, None]).reshape(-1, points.shape[1])
    places: Floats | None = None  # points of the curve itself: a chord may cross a boundary beside its arc
    for number in _near_boundary_numbers(points, earlier, spacing):
        if places is None:
            places = curve.closest_point(np.concatenate([between, points[-1:]])).points
        off = places - earlier[number].closest_point(places).points
        same = norms(off[::SEGMENT_POINTS]) <= SAME_SHARE * spacing
        entwined = _are_entwined(off, np.diff(points, axis=0), 0.02 * spacing)
        numbers[entwined[::SEGMENT_POINTS] | (same & (same.sum() > 1))] = number
    return numbers


def _are_entwined(off: Floats, chords: Floats, reach: float) -> Bools:
    """Return whether each place (n,) of a polyline lies on a stretch that crosses another, near curve 3 times or more.

    ``off`` (n, d): vectors from the other curve to the places, ``SEGMENT_POINTS`` on each chord, and the last point.
    ``chords`` (m, d): chords of the polyline; offsets turn with the chords around a corner. ``reach``: the length below
    which an offset is near.
    """
    is_close = norms(off) < reach
    stretch = np.cumsum(np.diff(is_close, prepend=is_close[:1]))
    ways = np.append(np.repeat(chords, SEGMENT_POINTS, axis=0), chords[-1:], axis=0)
    ways, off = unit(in_three_dimensions(ways)), in_three_dimensions(off)
    crosses = (dots(off[1:], _rotate_with_chords(off[:-1], ways[:-1], ways[1:])) < 0) & is_close[1:] & is_close[:-1]
    crossings = np.bincount(stretch[1:], crosses, minlength=stretch[-1] + 1)
    return np.asarray(is_close & (crossings[stretch] >= 3))


def _rotate_with_chords(vectors: Floats, start: Floats, end: Floats) -> Floats:
    """Return ``vectors`` (n, 3) after the smallest rotation of unit vectors ``start`` to ``end`` (n, 3)."""
    axis, cosine = np.cross(start, end), dots(start, end)
    once = np.cross(axis, vectors)
    return np.asarray(vectors + once + np.cross(axis, once) / np.maximum(1 + cosine, 1e-9)[:, None])


def is_close_to_others(points: Floats, others: Sequence[LocalSource], spacing: float) -> bool:
    """Return whether two or more ``points`` (n, d) of a curve are within .05 spacings of a boundary, but not on it."""
    for number in _near_boundary_numbers(points, others, spacing):
        off = points - others[number].closest_point(points).points
        if _are_close(off, spacing).sum() > 1:
            return True
    return False


def _are_close(off: Floats, spacing: float) -> Bools:
    """Return which offsets (n, d) from another curve are below .05 spacings but not zero: the two nearly coincide."""
    distance = norms(off)
    return np.asarray((distance > SAME_SHARE * spacing) & (distance < 0.05 * spacing))


def _near_boundary_numbers(points: Floats, others: Sequence[LocalSource], spacing: float) -> Iterable[int]:
    """Yield the numbers of ``others`` whose bounds are within a spacing of the box of ``points`` (n, d)."""
    low, high = points.min(axis=0) - spacing, points.max(axis=0) + spacing
    for number, other in enumerate(others):
        if (other.bounds[0] <= high).all() and (other.bounds[1] >= low).all():
            yield number


@dataclass(frozen=True, eq=False)
class SimplifiedCurve:
    """A curve as a polyline with as few points as its shape allows."""

    #: (n, 3): points in the direction of the curve; a closed curve continues from the last to the first.
    points: Floats
    closed: bool
    source: LocalSource  #: The curve on which the points lie.
    owner: int  #: The number of the boundary to which the curve belongs.
    #: (n, 2): the number of an earlier curve, and the number of its point beside which this point was placed; -1 for
    #: none. A point with several partners is repeated.
    partners: Ints
    fixed: Bools  #: (n,): points that must stay: ends and corners.

    @classmethod
    def of(cls, points: Floats, closed: bool, source: LocalSource, owner: int) -> SimplifiedCurve:
        """Return a curve without partners; ends, and corners where it turns by more than 20 degrees, are ``fixed``."""
        around = np.concatenate([points[-1:], points, points[:1]])
        way = unit(np.diff(around, axis=0))
        fixed = np.asarray(dots(way[1:], way[:-1]) < np.cos(np.radians(20.0)))
        if not closed:
            fixed[[0, -1]] = True
        return cls(points, closed, source, owner, np.full((len(points), 2), -1), fixed)

    @property
    def loop(self) -> Floats:
        """(n, 3) or (n + 1, 3) points of the curve; those of a closed curve end with the first point again."""
        return np.concatenate([self.points, self.points[:1]]) if self.closed else self.points

    def project(self, points: Floats) -> Floats:
        """Return the points (k, 3) of the curve nearest to ``points`` (k, 3)."""
        coordinates = np.ascontiguousarray(points[:, : self.source.dim])
        return in_three_dimensions(self.source.closest_point(coordinates).points)

    def places(self, points: Floats) -> Floats:
        """Return the place (k,), in segments from the start, of the polyline's point nearest to each of ``points``."""
        loop = self.loop
        start, way = loop[:-1], np.diff(loop, axis=0)
        places = np.empty(len(points))
        for row, point in enumerate(points):
            share = nearest_shares(point - start, way)
            segment = int(np.argmin(norms(start + share[:, None] * way - point)))
            places[row] = segment + share[segment]
        return places

    def replace_points(self, points: Floats, dropped: Bools, partners: Ints, least: float) -> SimplifiedCurve:
        """Return the curve without the points ``dropped`` and with ``points`` inserted in order along the polyline.

        ``points`` (k, 3): new points on the curve, in its direction. ``dropped`` (n,): which points are left out.
        ``partners`` (k, 2): partners of the new points.
        ``least``: new points nearer than this to a point that stays are replaced by that point.
        """
        from scipy.spatial import cKDTree

        staying = np.flatnonzero(~dropped)
        places, fixed = self.places(points), np.zeros(len(points), dtype=bool)
        if len(staying):
            gap, nearest = cKDTree(self.points[staying]).query(points)
            rows = gap <= least
            same = staying[nearest[rows]]
            points, places = points.copy(), places.copy()
            points[rows], places[rows], fixed[rows] = self.points[same], same, self.fixed[same]
            if (partners[:, 0] < 0).all():
                points, places, fixed, partners = (values[~rows] for values in (points, places, fixed, partners))
            else:
                staying = np.setdiff1d(staying, same)
        order = np.argsort(np.concatenate([staying.astype(np.float64), places]), kind="stable")
        return replace(
            self,
            points=np.concatenate([self.points[staying], points])[order],
            partners=np.concatenate([self.partners[staying], partners])[order],
            fixed=np.concatenate([self.fixed[staying], fixed])[order],
        )


def align_close_curves(
    curves: Sequence[SimplifiedCurve], spacing: float, coincident: Container[tuple[int, int]]
) -> list[SimplifiedCurve]:
    """Return the curves with points beside each other where they nearly coincide, nearer than .05 spacings.

    An earlier curve gets a point beside each end and corner of later curves. In a later curve the closest points of the
    earlier curve's points replace its own. Where two curves cross and separate, both keep their points. ``coincident``
    (int, int): pairs, left out here, of the numbers of a curve and of a boundary on which it lies in places.
    """
    aligned = list(curves)
    pairs = [
        (late, early)
        for late in range(len(aligned))
        for early in range(late)
        if (late, curves[early].owner) not in coincident
        and (curves[late].points.min(axis=0) <= curves[early].points.max(axis=0) + spacing).all()
        and (curves[early].points.min(axis=0) <= curves[late].points.max(axis=0) + spacing).all()
    ]
    for late, early in pairs:
        aligned[early] = _add_fixed_points(aligned[early], aligned[late], spacing)
    for late, early in pairs:
        aligned[late] = _align_with_earlier(aligned[late], aligned[early], early, spacing)
    return aligned


def _add_fixed_points(early: SimplifiedCurve, late: SimplifiedCurve, spacing: float) -> SimplifiedCurve:
    """Return the earlier curve with the closest points of the later curve's ends and corners near it added."""
    fixed = late.points[late.fixed]
    projected = early.project(fixed)
    projected = projected[_are_close(projected - fixed, spacing)]
    if not len(projected):
        return early
    no_partners = np.full((len(projected), 2), -1)
    return early.replace_points(
        projected, np.zeros(len(early.points), dtype=bool), no_partners, LEAST_STEP_SHARE * spacing
    )


def _align_with_earlier(late: SimplifiedCurve, early: SimplifiedCurve, number: int, spacing: float) -> SimplifiedCurve:
    """Return the later curve with its points near the earlier curve replaced by closest points of that curve's points.

    Ends and corners stay. ``number`` is that of the earlier curve, for ``partners``.
    """
    projected = late.project(early.points)
    off = projected - early.points
    close = _are_close(off, spacing)
    if not close.any():
        return late
    places = np.zeros(len(projected))
    places[close] = late.places(projected[close])
    dropped, taken = np.zeros(len(late.points), dtype=bool), np.zeros(len(projected), dtype=bool)
    for rows in _stretches(close, early.closed):
        changes_sides = bool((dots(off[rows[1:]], off[rows[:-1]]) < 0).any())
        if changes_sides and not close.all():  # the curves cross and separate
            continue
        taken[rows] = True
        lengths = norms(np.diff(early.points[rows], axis=0))
        for a, b, length in zip(places[rows[:-1]], places[rows[1:]], lengths, strict=True):
            dropped |= _points_between(late, a, b, length)
    if not taken.any():
        return late
    rows = np.flatnonzero(taken)
    if np.sign(np.diff(places[rows])).sum() < 0:  # it has the opposite direction
        rows = rows[::-1]
    partners = np.stack([np.full(len(rows), number), rows], axis=1)
    return late.replace_points(projected[rows], dropped & ~late.fixed, partners, LEAST_STEP_SHARE * spacing)


def _stretches(close: Bools, closed: bool) -> Iterator[Ints]:
    """Yield the numbers (k,) of each run of points that are ``close`` (n,); a closed curve continues at its start."""
    count = len(close)
    if close.all():
        yield np.arange(count + closed) % count
        return
    start = int((~close).argmax()) if closed else 0
    order = (np.arange(count) + start) % count
    for run in np.split(order, np.flatnonzero(np.diff(close[order])) + 1):
        if close[run[0]]:
            yield run


def _points_between(curve: SimplifiedCurve, start: float, end: float, length: float) -> Bools:
    """Return which points (n,) of a curve lie between two places, counted in segments from its start.

    On a closed curve the shorter of the two ways between the places counts. If that way is longer than twice the
    ``length`` of the other curve there, the curves are not parallel, and no point is returned.
    """
    number, low, high = np.arange(len(curve.points)), min(start, end), max(start, end)
    between = number[(number > low) & (number < high)]
    if curve.closed and high - low > 0.5 * len(number):
        between = np.concatenate([number[number > high], number[number < low]])
    way = float(norms(np.diff(curve.points[between], axis=0)).sum())
    return np.isin(number, between) & (way < 2.0 * length)
