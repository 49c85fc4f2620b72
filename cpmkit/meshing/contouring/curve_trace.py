"""A curve's crossings with the planes of one lattice, connected to segments with corners, junctions and ends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.meshing.contouring.connectedness import CREASE_SHARE, connected_on_curve
from cpmkit.meshing.contouring.dual_vertices import solve_truncated
from cpmkit.meshing.contouring.plane_crossings import (
    SAME_NOISES,
    PlaneCrossings,
    merge_near,
    number_groups,
    same_share,
)
from cpmkit.types import Bools, Floats, Ints

#: Partners of a crossing in directions whose cosine is above this lie on one side of it, below the negative of it on
#: opposite sides.
SAME_SIDE_COSINE = 0.8
#: A segment whose tangents at its ends have a cosine below this has a corner in it.
CORNER_COSINE = 0.94
#: Steps along the curve that look for its end in a cell, in spacings.
PACE = 0.1


@dataclass(frozen=True, eq=False)
class Trace:
    """Segments on a curve.

    Attributes
    ----------
    vertices : (v, d) float64
        Points of the curve.
    segments : (s, 2) int64
        The vertices at the ends of each segment.
    midpoints_on_curve : (s, d) float64
        The closest points on the curve of the middles of the segments.
    ends : (k,) int64
        The vertices at which the curve is known to end.
    gaps : (g, d) float64
        Crossings with no segment on one side.
    """

    vertices: Floats
    segments: Ints
    midpoints_on_curve: Floats
    ends: Ints
    gaps: Floats

    def translate(self, shift: Floats) -> Trace:
        """Return the trace moved by ``shift`` (d,)."""
        return replace(
            self,
            vertices=self.vertices + shift,
            midpoints_on_curve=self.midpoints_on_curve + shift,
            gaps=self.gaps + shift,
        )

    @property
    def midpoints(self) -> Floats:
        """(s, d) midpoints of the segments on the curve, or on the chord for a segment across a corner."""
        a, b = self.vertices[self.segments].transpose(1, 0, 2)
        middle = 0.5 * (a + b)
        has_corner = norms(self.midpoints_on_curve - middle) > CREASE_SHARE * norms(b - a)
        return np.asarray(np.where(has_corner[:, None], middle, self.midpoints_on_curve))


def trace_curve(source: LocalSource, crossings: PlaneCrossings, spacing: float) -> Trace:
    """Return the trace of a curve through its crossings with the planes of a lattice of this spacing.

    Crossings of one cell that are connected in it become segments. Where a crossing is connected with several others,
    these meet in a junction. From a crossing connected with no other, the curve is followed to an end in the cell.
    """
    pairs = _connected_pairs(source, crossings, spacing)
    degree = np.bincount(pairs.ravel(), minlength=len(crossings.member))
    at_junction = (degree[pairs] > 1 + _are_passed_through(crossings, pairs)[pairs]).any(axis=1)
    centres, spokes = _junctions(source, crossings, pairs[at_junction])
    lone = np.flatnonzero(degree == 0)
    of_lone = crossings.member[lone]
    tips, ended, enters = _ends_in_cells(
        source, crossings.points[of_lone], crossings.tangents[of_lone], crossings.cells[lone], spacing
    )
    ended &= norms(tips - crossings.points[of_lone]) > 0
    tip, first = merge_near(tips[ended], 0.05 * spacing)  # strands that end that near to each other meet in a cusp
    vertices = np.concatenate([crossings.points, centres, tips[ended][first]])
    ends = len(vertices) - len(first) + np.flatnonzero(np.bincount(tip, minlength=len(first)) == 1)
    unconnected = of_lone[enters & ~ended]
    joins = _join_across_cells(source, crossings, unconnected, spacing)
    to_tips = np.stack([of_lone[ended], len(vertices) - len(first) + tip], axis=1)
    parts = [crossings.member[pairs[~at_junction]], spokes, to_tips, joins]
    segments = _collapse_short(vertices, np.concatenate(parts), SAME_NOISES * source.noise)
    gaps = crossings.points[np.setdiff1d(unconnected, joins)]
    return _add_corners(source, vertices, crossings.tangents, segments, ends, gaps)


def _connected_pairs(source: LocalSource, crossings: PlaneCrossings, spacing: float) -> Ints:
    """Return the pairs (k, 2) of entries of one cell that the curve connects in it without a crossing in between."""
    from cpmkit.meshing.contouring.contouring_kernels import nearest_pairs

    alone = np.arange(len(crossings.member))
    points, tangents = crossings.points, crossings.tangents
    pairs = np.empty((0, 2), dtype=np.int64)
    pairs = np.empty((nearest_pairs(crossings.start, crossings.member, points, alone, pairs), 2), dtype=np.int64)
    nearest_pairs(crossings.start, crossings.member, points, alone, pairs)
    i, j = crossings.member[pairs].T
    cells, half = crossings.cells[pairs[:, 0]], 0.5 + same_share(source, spacing)
    low, high = np.asarray((cells - half) * spacing), np.asarray((cells + half) * spacing)
    pairs = pairs[connected_on_curve(source, points[i], points[j], tangents[i], tangents[j], low, high)]
    return pairs[~_has_crossing_between(crossings, pairs)]


def _has_crossing_between(crossings: PlaneCrossings, pairs: Ints) -> Bools:
    """Return for each pair (k,) whether another crossing of its cell, of similar tangent, lies between the two."""
    cell = np.searchsorted(crossings.start, pairs[:, 0], side="right") - 1
    low, high = crossings.start[cell], crossings.start[cell + 1]
    a, b = crossings.points[crossings.member[pairs]].transpose(1, 0, 2)
    chord, length = unit(b - a), norms(b - a)
    between = np.zeros(len(pairs), dtype=bool)
    for k in range(int((high - low).max(initial=0))):  # the k-th entry of every cell
        entry = np.minimum(low + k, high - 1)
        other = crossings.points[crossings.member[entry]] - a
        along = dots(other, chord)
        off = norms(other - along[:, None] * chord)
        same_direction = np.abs(dots(crossings.tangents[crossings.member[entry]], chord)) > SAME_SIDE_COSINE
        is_third = (entry != pairs[:, 0]) & (entry != pairs[:, 1]) & same_direction
        between |= is_third & (along > 0) & (along < length) & (off < 0.1 * length)
    return between


def _are_passed_through(crossings: PlaneCrossings, pairs: Ints) -> Bools:
    """Return which entries (k,) have two partners, on opposite sides: the curve passes there without a junction.

    Noise puts such crossings into the neighbouring cell.
    """
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    entry, first, count = np.unique(both[:, 0], return_index=True, return_counts=True)
    entry, first = entry[count == 2], first[count == 2]
    points = crossings.points[crossings.member]
    directions = [unit(points[both[first + k, 1]] - points[entry]) for k in range(2)]
    passed = np.zeros(len(crossings.member), dtype=bool)
    passed[entry[dots(*directions) < -SAME_SIDE_COSINE]] = True
    return passed


def _junctions(source: LocalSource, crossings: PlaneCrossings, pairs: Ints) -> tuple[Floats, Ints]:
    """Return the centres (j, d) of junctions, and the segments (s, 2) from crossings to them.

    Entries connected by ``pairs`` (k, 2) meet in one junction, nearest to their tangents.
    """
    if not len(pairs):
        return np.zeros((0, crossings.points.shape[1])), np.zeros((0, 2), dtype=np.int64)
    entries, pairs = np.unique(pairs, return_inverse=True)
    i, j = pairs.reshape(-1, 2).T
    junction, _ = number_groups(i, j, len(entries))
    of_entry = crossings.member[entries]
    meeting = _nearest_to_lines(crossings.points[of_entry], crossings.tangents[of_entry], junction)
    centres = source.closest_point(meeting).points
    return centres, np.stack([of_entry, len(crossings.points) + junction], axis=1)


def _nearest_to_lines(points: Floats, tangents: Floats, group: Ints) -> Floats:
    """Return the point (g, d) nearest to the lines of each group, by least squares about the mean of the lines' points.

    In directions of small eigenvalues, which the lines hardly determine, the point stays at the mean.

    Parameters
    ----------
    points, tangents : (n, d) float64
        A point and the direction of each line.
    group : (n,) int64
        The group of each line, numbered from 0.
    """
    dim, share = points.shape[1], 1.0 / np.bincount(group)

    def mean(values: Floats) -> Floats:
        """Return the mean (g,) of ``values`` (n,) over each group."""
        return np.asarray(np.bincount(group, values) * share)

    centre = np.stack([mean(points[:, k]) for k in range(dim)], axis=1)
    off = points - centre[group]
    off = off - dots(off, tangents)[:, None] * tangents
    matrix = np.empty((len(share), dim, dim))
    for i in range(dim):
        for j in range(dim):
            matrix[:, i, j] = (i == j) - mean(tangents[:, i] * tangents[:, j])
    side = np.stack([mean(off[:, k]) for k in range(dim)], axis=1)
    return np.asarray(centre + solve_truncated(matrix, side)[0])


def _ends_in_cells(
    source: LocalSource, points: Floats, tangents: Floats, cells: Ints, spacing: float
) -> tuple[Floats, Bools, Bools]:
    """Return the ends of a curve that is followed from points on faces of cells into these cells.

    ``points`` (n, d) lie on faces of ``cells`` (n, d). The curve is followed until it ends or leaves the cell.

    Returns
    -------
    end : (n, d) float64
        The end of the curve, if there is one.
    ended : (n,) bool
        Whether the curve ends in the cell.
    enters : (n,) bool
        Whether the curve enters the cell at all.
    """
    least = 5.0 * source.noise  # shorter moves cannot be told from noise
    after, enters = points.copy(), np.zeros(len(points), dtype=bool)
    end, ended = points.copy(), np.zeros(len(points), dtype=bool)

    def inside(places: Floats, rows: Ints | slice) -> Bools:
        """Return which ``places`` (n, d) lie in the cells of ``rows``."""
        return np.asarray((np.abs(places / spacing - cells[rows]) <= 0.5 + 1e-9).all(axis=1))

    for sign in (1.0, -1.0):
        answer = source.closest_point(points + sign * 0.5 * PACE * spacing * tangents)
        leads_on = norms(answer.points - points) > max(1e-3 * PACE * spacing, least)
        new = ~enters & leads_on & inside(answer.points, slice(None))
        after[new], enters[new] = answer.points[new], True
        stops = new & (answer.edge >= 0)
        end[stops], ended[stops] = answer.points[stops], True
    rows = np.flatnonzero(enters & ~ended)
    before, now = points[rows], after[rows]
    for _ in range(40):  # a limit: the way through a cell is at most so many steps long
        if not len(rows):
            break
        answer = source.closest_point(now + PACE * spacing * unit(now - before))
        is_inside = inside(answer.points, rows)
        # A step that leads nowhere has come to an end, or to a cusp, where another strand ends too.
        is_stuck = norms(answer.points - now) < max(0.05 * PACE * spacing, least)
        stops = is_inside & ((answer.edge >= 0) | is_stuck)
        end[rows[stops]], ended[rows[stops]] = answer.points[stops], True
        go = is_inside & ~stops
        rows, before, now = rows[go], now[go], answer.points[go]
    return end, ended, enters


def _join_across_cells(source: LocalSource, crossings: PlaneCrossings, candidates: Ints, spacing: float) -> Ints:
    """Return pairs (k, 2) of crossings that have no neighbour on one side and are connected on the curve.

    Each is the nearest of the ``candidates`` (n,) to the other, and at most 1.5 spacings away.
    """
    from scipy.spatial import KDTree

    if len(candidates) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    places = crossings.points[candidates]
    distance, nearest = KDTree(places).query(places, k=2)
    partner = nearest[:, 1]
    mutual = (partner[partner] == np.arange(len(candidates))) & (distance[:, 1] < 1.5 * spacing)
    i = np.flatnonzero(mutual & (np.arange(len(candidates)) < partner))
    a, b = candidates[i], candidates[partner[i]]
    low, high = (np.full_like(crossings.points[a], side * np.inf) for side in (-1.0, 1.0))
    points, tangents = crossings.points, crossings.tangents
    connected = connected_on_curve(source, points[a], points[b], tangents[a], tangents[b], low, high)
    return np.stack([a[connected], b[connected]], axis=1)


def _collapse_short(vertices: Floats, segments: Ints, length: float) -> Ints:
    """Return the distinct segments (s, 2) left when all segments not longer than ``length`` collapse to a vertex.

    Segments as short as that are made by noise alone.
    """
    short = segments[norms(vertices[segments[:, 1]] - vertices[segments[:, 0]]) <= length]
    number, first = number_groups(short[:, 0], short[:, 1], len(vertices))
    segments = np.unique(np.sort(first[number[segments]], axis=1), axis=0)
    return np.asarray(segments[segments[:, 0] != segments[:, 1]])


def _add_corners(
    source: LocalSource, vertices: Floats, tangents: Floats, segments: Ints, ends: Ints, gaps: Floats
) -> Trace:
    """Return the trace in which segments across a corner are halved, where the tangents at their ends meet.

    A corner near one end of a segment leaves its middle near the curve; the angle between these tangents reveals it.
    """
    a, b = vertices[segments].transpose(1, 0, 2)
    middle, length = 0.5 * (a + b), norms(b - a)
    on_curve = source.closest_point(middle).points
    between = np.flatnonzero((segments < len(tangents)).all(axis=1))
    cosine = np.abs(dots(*tangents[segments[between]].transpose(1, 0, 2)))
    is_off = norms(on_curve - middle)[between] > CREASE_SHARE * length[between]
    turned = between[is_off | (cosine < CORNER_COSINE)]
    corners = segments[turned]
    group = np.repeat(np.arange(len(turned)), 2)
    meeting = _nearest_to_lines(vertices[corners.ravel()], tangents[corners.ravel()], group)
    is_close = norms(meeting - middle[turned]) < length[turned]
    meeting = np.where(is_close[:, None], meeting, middle[turned])
    new = len(vertices) + np.arange(len(turned))
    vertices = np.concatenate([vertices, source.closest_point(meeting).points])
    halves = np.concatenate([np.stack([corners[:, end], new], axis=1) for end in range(2)])
    segments = np.concatenate([np.delete(segments, turned, axis=0), halves])
    on_curve = np.concatenate([np.delete(on_curve, turned, axis=0), project_middles(source, vertices, halves)])
    return Trace(vertices, segments, on_curve, ends, gaps)


def project_middles(source: LocalSource, vertices: Floats, segments: Ints) -> Floats:
    """Return the closest points (s, d) of the middles of segments (s, 2)."""
    return source.closest_point(vertices[segments].mean(axis=1)).points
