"""A curve's crossings with the planes of one lattice, joined to segments that meet in corners, junctions and ends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.meshing.contouring.ends import ends_in_cells
from cpmkit.meshing.contouring.knot_crossings import SAME_NOISES, KnotCrossings, grouped, merged
from cpmkit.meshing.contouring.midpoints import CREASE
from cpmkit.meshing.contouring.strands import follow, neighbours
from cpmkit.protocols import Bools, Floats, Ints

#: Strands that come to an end so near to each other, in spacings, meet in a cusp.
SAME_TIP = 0.05
#: How far apart, in spacings, two crossings are at most that have no partner in their cells and are joined.
LONE_REACH = 1.5
#: Of the tangent lines through a star's crossings: eigenvalues below this share of the largest say nothing.
TELLING_EIGENVALUE = 0.12
#: Partners in directions of this cosine are on opposite sides.
THROUGH_COSINE = 0.8
#: A segment whose tangents at its ends have a cosine below this has a corner in it, maybe near one of them.
CORNER_COSINE = 0.94


@dataclass(frozen=True, eq=False)
class Trace:
    """Segments on a curve.

    Attributes
    ----------
    vertices : (v, d) float64
        Points of the curve.
    segments : (s, 2) int64
        Their ends.
    feet : (s, d) float64
        The closest points of their middles.
    ends : (k,) int64
        The vertices at which the curve is known to end.
    gaps : (g, d) float64
        Crossings that nothing goes on from on one side.
    """

    vertices: Floats
    segments: Ints
    feet: Floats
    ends: Ints
    gaps: Floats

    def moved(self, shift: Floats) -> Trace:
        """Return the trace moved by ``shift`` (d,)."""
        return replace(self, vertices=self.vertices + shift, feet=self.feet + shift, gaps=self.gaps + shift)

    @property
    def midpoints(self) -> Floats:
        """(s, d) points of the curve halfway along the segments, straight where a corner lies between."""
        a, b = self.vertices[self.segments].transpose(1, 0, 2)
        middle = 0.5 * (a + b)
        corner = norms(self.feet - middle) > CREASE * norms(b - a)
        return np.asarray(np.where(corner[:, None], middle, self.feet))


def trace_of(source: LocalSource, crossings: KnotCrossings, spacing: float) -> Trace:
    """Return the trace of a curve through its crossings with the planes of a lattice of this spacing."""
    pairs = neighbours(source, crossings, spacing)
    degree = np.bincount(pairs.ravel(), minlength=len(crossings.member))
    several = (degree[pairs] > 1 + _passed(crossings, pairs)[pairs]).any(axis=1)
    centres, spokes = _stars(source, crossings, pairs[several])
    lone = np.flatnonzero(degree == 0)
    of = crossings.member[lone]
    tips, ended, enters = ends_in_cells(
        source, crossings.points[of], crossings.tangents[of], crossings.cells[lone], spacing
    )
    ended &= norms(tips - crossings.points[of]) > 0
    tip, first = merged(tips[ended], SAME_TIP * spacing)
    vertices = np.concatenate([crossings.points, centres, tips[ended][first]])
    ends = len(vertices) - len(first) + np.flatnonzero(np.bincount(tip, minlength=len(first)) == 1)
    left = of[enters & ~ended]
    joins = _joined_lone(source, crossings, left, spacing)
    parts = [crossings.member[pairs[~several]], spokes]
    parts += [np.stack([of[ended], len(vertices) - len(first) + tip], axis=1), joins]
    segments = _without_short(vertices, np.concatenate(parts), SAME_NOISES * source.noise)
    gaps = crossings.points[np.setdiff1d(left, joins)]
    return _with_corners(source, vertices, crossings.tangents, segments, ends, gaps)


def _without_short(vertices: Floats, segments: Ints, length: float) -> Ints:
    """Return the segments, each once, those shorter than ``length`` drawn together: noise alone makes such."""
    short = segments[norms(vertices[segments[:, 1]] - vertices[segments[:, 0]]) <= length]
    number, first = grouped(short[:, 0], short[:, 1], len(vertices))
    segments = np.unique(np.sort(first[number[segments]], axis=1), axis=0)
    return np.asarray(segments[segments[:, 0] != segments[:, 1]])


def _passed(found: KnotCrossings, pairs: Ints) -> Bools:
    """Return the entries (k,) that have two partners on opposite sides: the curve goes on through them, in no star.

    Noise puts such beside the cell whose entries they are.
    """
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    entry, first, count = np.unique(both[:, 0], return_index=True, return_counts=True)
    entry, first = entry[count == 2], first[count == 2]
    at = found.points[found.member]
    ways = [unit(at[both[first + k, 1]] - at[entry]) for k in range(2)]
    passed = np.zeros(len(found.member), dtype=bool)
    passed[entry[dots(*ways) < -THROUGH_COSINE]] = True
    return passed


def _stars(source: LocalSource, found: KnotCrossings, pairs: Ints) -> tuple[Floats, Ints]:
    """Return the centres of stars of entries that hang together by ``pairs``, and their spokes (k, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if not len(pairs):
        return np.zeros((0, found.points.shape[1])), np.zeros((0, 2), dtype=np.int64)
    entries, pairs = np.unique(pairs, return_inverse=True)
    pairs = pairs.reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs), dtype=np.int8), tuple(pairs.T)), shape=(len(entries),) * 2)
    count, star = connected_components(graph, directed=False)
    of = found.member[entries]
    nearest = nearest_to_lines(found.points[of], found.tangents[of], star, count)
    centres = source.closest_point(nearest).points
    return centres, np.stack([of, len(found.points) + star.astype(np.int64)], axis=1)


def nearest_to_lines(points: Floats, tangents: Floats, group: Ints, count: int) -> Floats:
    """Return the points (count, d) nearest to the lines of each group, about the mean of the lines' points."""
    dim, share = points.shape[1], 1.0 / np.bincount(group, minlength=count)

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(group, values, minlength=count) * share)

    centre = np.stack([mean(points[:, k]) for k in range(dim)], axis=1)
    off = points - centre[group]
    off = off - dots(off, tangents)[:, None] * tangents
    matrix = np.empty((count, dim, dim))
    for i in range(dim):
        for j in range(dim):
            matrix[:, i, j] = (i == j) - mean(tangents[:, i] * tangents[:, j])
    side = np.stack([mean(off[:, k]) for k in range(dim)], axis=1)
    values, axes = np.linalg.eigh(matrix)
    telling = values >= TELLING_EIGENVALUE * values[:, -1:]
    part = np.einsum("vki,vk->vi", axes, side) * np.where(telling, 1.0 / np.where(telling, values, 1.0), 0.0)
    return np.asarray(centre + np.einsum("vki,vi->vk", axes, part))


def _joined_lone(source: LocalSource, found: KnotCrossings, left: Ints, spacing: float) -> Ints:
    """Return pairs of crossings that lack a neighbour on one side, each the other's nearest, that hang together."""
    from scipy.spatial import KDTree

    if len(left) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    points = found.points[left]
    distance, nearest = KDTree(points).query(points, k=2)
    partner = nearest[:, 1]
    mutual = (partner[partner] == np.arange(len(left))) & (distance[:, 1] < LONE_REACH * spacing)
    i = np.flatnonzero(mutual & (np.arange(len(left)) < partner))
    a, b = left[i], left[partner[i]]
    box = (np.full_like(found.points[a], side * np.inf) for side in (-1.0, 1.0))
    together = follow(source, found.points[a], found.points[b], found.tangents[a], found.tangents[b], *box)
    return np.stack([a[together], b[together]], axis=1)


def _with_corners(
    source: LocalSource, vertices: Floats, tangents: Floats, segments: Ints, ends: Ints, gaps: Floats
) -> Trace:
    """Return the trace, segments between crossings that turn too much halved where the tangents there meet.

    A corner near one end of a segment leaves the middle of it near the curve: the tangents tell it then.
    """
    a, b = vertices[segments].transpose(1, 0, 2)
    middle, reach = 0.5 * (a + b), norms(b - a)
    feet = source.closest_point(middle).points
    between = np.flatnonzero((segments < len(tangents)).all(axis=1))
    turn = np.abs(dots(*tangents[segments[between]].transpose(1, 0, 2)))
    away = norms(feet - middle)[between] > CREASE * reach[between]
    turned = between[away | (turn < CORNER_COSINE)]
    corners = segments[turned]
    group = np.repeat(np.arange(len(turned)), 2)
    meeting = nearest_to_lines(vertices[corners.ravel()], tangents[corners.ravel()], group, len(turned))
    near = norms(meeting - middle[turned]) < reach[turned]
    meeting = np.where(near[:, None], meeting, middle[turned])
    new = len(vertices) + np.arange(len(turned))
    vertices = np.concatenate([vertices, source.closest_point(meeting).points])
    halves = np.concatenate([np.stack([corners[:, end], new], axis=1) for end in range(2)])
    segments = np.concatenate([np.delete(segments, turned, axis=0), halves])
    feet = np.concatenate([np.delete(feet, turned, axis=0), middle_feet(source, vertices, halves)])
    return Trace(vertices, segments, feet, ends, gaps)


def middle_feet(source: LocalSource, vertices: Floats, segments: Ints) -> Floats:
    """Return the closest points (s, d) of the middles of segments."""
    return source.closest_point(vertices[segments].mean(axis=1)).points
