"""Curves that meet: the segments of each curve, split where it meets another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.mesh.adjacency import WELDED_SIZE_SHARE, box_size, repair
from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.subdivision import divide_segments
from cpmkit.meshing.contouring.curve_graph import near_chords, nearest_on_chords
from cpmkit.types import Bools, Floats, Ints

#: Rounds of Newton's method; where two curves touch, a round halves the distance from that point.
ROUNDS = 12
#: Curves that meet at an angle whose sine is below this touch, or run along each other.
LEAST_SINE = 0.02


def join_curves(curves: Sequence[tuple[LocalSource, Mesh]], length: float) -> Mesh | None:
    """Return one mesh of several curves, with a vertex where two meet; None where two touch or run along each other.

    Curves meet where their distance is at most ``WELDED_SIZE_SHARE`` of their box. Each curve has flat, repaired
    segments with vertices on it, as a rule not longer than ``length``. If no two curves meet, segments are unchanged.
    """
    meetings = meetings_of_curves(curves, length)
    if meetings is None:
        return None
    parts = [split_at(*curve, points) for curve, points in zip(curves, meetings, strict=True)]
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in parts[:-1]])
    cells = np.concatenate([mesh.cells + start for mesh, start in zip(parts, starts, strict=True)])
    mesh = Mesh.of(np.concatenate([mesh.vertices for mesh in parts]), cells)
    return repair(mesh)[0] if any(map(len, meetings)) else mesh


@dataclass(frozen=True, eq=False)
class FlatCurve:
    """A source of closest points on flat segments."""

    mesh: Mesh  #: The segments.

    def closest_point(self, points: Floats) -> ClosestPoints:
        """Return the closest points of ``points`` (n, d) on the segments; ``edge`` is -1 for all."""
        from scipy.spatial import KDTree

        a, b = self.mesh.vertices[self.mesh.cells].transpose(1, 0, 2)
        reach = float(KDTree(a).query(points)[0].max(initial=0.0)) + WELDED_SIZE_SHARE * float(norms(b - a).max())
        row, chord, distance, share = near_chords(points, a, b, reach)
        order = np.lexsort((distance, row))
        best = order[np.unique(row[order], return_index=True)[1]]
        feet = a[chord[best]] + share[best, None] * (b - a)[chord[best]]
        return ClosestPoints(feet, distance[best], np.full(len(points), -1))


#: A curve as a pair: its source of closest points, and its flat segments.
Curve = tuple[LocalSource | FlatCurve, Mesh]


def meetings_of_curves(curves: Sequence[Curve], length: float) -> list[Floats] | None:
    """Return the points (k, d) of each curve at which it meets others; None where two touch or run along each other.

    Curves and ``length`` are as in :func:`join_curves`.
    """
    tolerance = WELDED_SIZE_SHARE * box_size(np.concatenate([mesh.vertices for _, mesh in curves]))
    meetings = [mesh.vertices[:0] for _, mesh in curves]
    for i, j in combinations(range(len(curves)), 2):
        points = _meeting_points(curves[i], curves[j], length, tolerance)
        if points is None:
            return None
        meetings[i], meetings[j] = np.concatenate([meetings[i], points]), np.concatenate([meetings[j], points])
    return meetings


def split_at(source: LocalSource | FlatCurve, mesh: Mesh, points: Floats) -> Mesh:
    """Return the segments of a curve split at its ``points`` (k, d), each a new vertex even beside another vertex."""
    new = len(mesh.vertices) + np.arange(len(points))
    cells = divide_segments(mesh.vertices, mesh.cells, _segments_at(source, mesh, points), new, points)
    return Mesh.of(np.concatenate([mesh.vertices, points]), cells)


def split_at_own_crossings(mesh: Mesh, source: LocalSource | None) -> Mesh:
    """Return the segments of a curve with a vertex where two of them cross, projected to the ``source``, if given.

    The vertex is the crossing of chords, which differs from that of curved arcs by their distance from the chords.
    """
    a, b = mesh.vertices[mesh.cells].transpose(1, 0, 2)
    tolerance = WELDED_SIZE_SHARE * box_size(mesh.vertices)
    i, j = _near_pairs(a, b, a, b, tolerance)
    i, j = np.stack([i, j])[:, i < j]
    p, q = nearest_on_chords(a[i], b[i], a[j], b[j])
    common = (mesh.cells[i][:, :, None] == mesh.cells[j][:, None, :]).any(axis=(1, 2))
    crosses = (norms(p - q) <= tolerance) & ~common
    i, j, points = i[crosses], j[crosses], 0.5 * (p + q)[crosses]
    if not len(i):
        return mesh
    points = points if source is None else source.closest_point(points).points
    new = len(mesh.vertices) + np.arange(len(points))
    rows, twice = np.concatenate([i, j]), np.tile(points, (2, 1))
    cells = divide_segments(mesh.vertices, mesh.cells, rows, np.tile(new, 2), twice)
    return repair(Mesh.of(np.concatenate([mesh.vertices, points]), cells))[0]


def _meeting_points(first: Curve, second: Curve, length: float, tolerance: float) -> Floats | None:
    """Return the points (k, d) where two curves meet, ends of either first; None if they touch elsewhere.

    ``length`` is that of segments, and ``tolerance`` the largest distance of curves that meet. An end of both curves is
    listed twice.
    """
    at_ends = []
    for (_, mesh), (other, _) in ((first, second), (second, first)):
        ends = mesh.vertices[np.bincount(mesh.cells.ravel(), minlength=len(mesh.vertices)) == 1]
        at_ends.append(ends[norms(other.closest_point(ends).points - ends) <= tolerance])
    ends = np.concatenate(at_ends)
    crossings, is_touching = _crossings(first, second, length, tolerance)
    if len(ends):
        distances = norms(crossings[:, None] - ends).min(axis=1)
        apart = distances > np.where(is_touching, length, 2 * tolerance)
        crossings, is_touching = crossings[apart], is_touching[apart]
    return None if is_touching.any() else np.concatenate([ends, crossings])


def _crossings(first: Curve, second: Curve, length: float, tolerance: float) -> tuple[Floats, Bools]:
    """Return the points (k, d) where two curves cross, and whether (k,) their tangents there are nearly parallel.

    Newton's method starts from pairs of chords that are nearer to each other than the curves deviate from the chords.
    """
    (a, b), (c, d) = (mesh.vertices[mesh.cells].transpose(1, 0, 2) for _, mesh in (first, second))
    heights = [_heights(*curve) for curve in (first, second)]
    reach = 2 * (heights[0].max() + heights[1].max()) + tolerance
    i, j = _near_pairs(a, b, c, d, reach)
    p, q = nearest_on_chords(a[i], b[i], c[j], d[j])
    near = norms(p - q) <= 2 * (heights[0][i] + heights[1][j]) + tolerance
    i, j, x = i[near], j[near], 0.5 * (p + q)[near]
    tangents = [unit((b - a)[i]), unit((d - c)[j])]
    sources = first[0], second[0]
    for ahead in length * 10.0 ** np.linspace(-2, -7, ROUNDS):
        points = [source.closest_point(x).points for source in sources]
        ends = [
            [source.closest_point(at + way * along).points for way in (ahead, -ahead)]
            for source, at, along in zip(sources, points, tangents, strict=True)
        ]
        tangents = [unit(forward - backward) for forward, backward in ends]
        gap, sine, step = _newton_step(*points, *tangents)
        x = points[0] + step * np.minimum(1.0, length / np.maximum(norms(step), length))[:, None]
    met = gap <= tolerance
    return points[0][met], sine[met] < LEAST_SINE


def _near_pairs(a: Floats, b: Floats, c: Floats, d: Floats, reach: float) -> tuple[Ints, Ints]:
    """Return pairs (k,), (k,) of chords, from a to b (n, d) and from c to d (m, d), that may come within ``reach``."""
    from scipy.spatial import KDTree

    far = 0.5 * (norms(b - a) + norms(d - c).max()) + reach
    near = KDTree(0.5 * (c + d)).query_ball_point(0.5 * (a + b), far)
    counts = [len(rows) for rows in near]
    return np.repeat(np.arange(len(a)), counts), np.concatenate([np.zeros(0), *near]).astype(np.int64)


def _heights(source: LocalSource | FlatCurve, mesh: Mesh) -> Floats:
    """Return the distances (s,) of a curve from the midpoints of its segments."""
    midpoints = mesh.vertices[mesh.cells].mean(axis=1)
    return norms(source.closest_point(midpoints).points - midpoints)


def _newton_step(p: Floats, q: Floats, along_p: Floats, along_q: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the distances (k,) of p and q (k, d), the sines (k,) of the angles of their tangents, and Newton's steps.

    A step (k, d) leads from p to where the lines through p and q along their unit tangents (k, d) meet: halfway between
    the nearest points of the lines, or between p and q if the lines are parallel.
    """
    off, cosine = q - p, dots(along_p, along_q)
    squared = np.maximum(1 - cosine**2, 1e-12)
    s = (dots(off, along_p) - cosine * dots(off, along_q)) / squared
    t = (cosine * dots(off, along_p) - dots(off, along_q)) / squared
    step = 0.5 * (s[:, None] * along_p + off + t[:, None] * along_q)
    return norms(off), np.sqrt(squared), step


def _segments_at(source: LocalSource | FlatCurve, mesh: Mesh, points: Floats) -> Ints:
    """Return the segment (k,) of a curve's mesh that is nearest to each of its ``points`` (k, d)."""
    a, b = mesh.vertices[mesh.cells].transpose(1, 0, 2)
    reach = 2 * float(_heights(source, mesh).max()) + WELDED_SIZE_SHARE * box_size(mesh.vertices)
    row, chord, distance, _ = near_chords(points, a, b, reach)
    order = np.lexsort((distance, row))
    return chord[order[np.unique(row[order], return_index=True)[1]]]
