"""Segments on a curve that is known by closest points alone: the trace from the first lattice that leaves no defect."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.grid.blocks import cell_levels
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.contouring.contour_edges import connected_groups
from cpmkit.meshing.contouring.curve_trace import Trace, project_middles, trace_curve
from cpmkit.meshing.contouring.plane_crossings import plane_crossings
from cpmkit.types import Bools, Floats, Ints

#: Lattices of a trace: spacing and shift in spacings of the form's. They are tried in turn until no defect is left. The
#: shifts are no simple fractions, so that sides and corners of curves do not lie in planes of the lattice.
LATTICES = (
    (1.0, (0.1723, 0.2301, 0.3119)),
    (1.0, (0.4142, 0.0677, 0.1459)),
    (0.5, (0.3371, 0.4561, 0.0823)),
    (0.5, (0.0911, 0.3723, 0.4337)),
    (0.25, (0.1723, 0.2301, 0.3119)),
)
#: Segments whose chords come nearer than this, in spacings, may cross.
NEAR_CHORDS = 0.05
#: Points of the curve farther than this, in spacings, from all segments are missed by the trace.
MISSED_DISTANCE = 0.1
#: A segment is covered twice if its middle is nearer to another segment's inside than this, in spacings.
DOUBLE_DISTANCE = 0.02


@dataclass(frozen=True, eq=False)
class TraceDefects:
    """Points, relative to the lattice's origin, at which a trace does not represent the curve.

    Attributes
    ----------
    missed : (k, d) float64
        Points of the curve far from all segments.
    missed_distances : (k,) float64
        Distances of these points from the nearest vertex.
    covered_twice : (k, d) float64
        Points that two segments cover.
    gaps : (k, d) float64
        Points at which the trace ends but not the curve.
    """

    missed: Floats
    missed_distances: Floats
    covered_twice: Floats
    gaps: Floats

    @property
    def count(self) -> int:
        """The number of defects."""
        return len(self.missed) + len(self.covered_twice) + len(self.gaps)

    def translate(self, shift: Floats) -> TraceDefects:
        """Return the defects moved by ``shift`` (d,)."""
        return TraceDefects(self.missed + shift, self.missed_distances, self.covered_twice + shift, self.gaps + shift)


@dataclass(frozen=True)
class CurveReport:
    """Properties of the trace of a curve that may cause warnings.

    Attributes
    ----------
    junctions : int
        Number of vertices of three segments or more: also where the curve crosses itself.
    ends : int
        Number of vertices at which the curve ends.
    defects : TraceDefects
    """

    junctions: int
    ends: int
    defects: TraceDefects


def contour_curve(source: LocalSource, spacing: float, curved: bool = True) -> tuple[Mesh, CurveReport]:
    """Return segments on a curve, and a report; vertices lie at its ends, corners, junctions and lattice planes.

    Parameters
    ----------
    source : LocalSource
        A curve (m = 1) in the plane or in space. Its tangents are not used.
    spacing : float
        Spacing h of the form's lattice. The trace is made on lattices of its own (``LATTICES``).
    curved : bool
        Whether midpoints of segments, on the curve, are returned too.

    Raises
    ------
    ResolutionError
        If the curve lies in one cell of the first lattice.
    """
    best = None
    for side, shift in LATTICES:
        attempt = _trace_on(source, spacing, side * spacing, spacing * np.array(shift[: source.dim]))
        if attempt is None and best is None:
            raise ResolutionError(
                f"spacing={spacing:g} is too coarse for the curve: it lies in one cell of the lattice; use a smaller "
                "spacing."
            )
        if attempt is not None and (best is None or attempt[1].count < best[1].count):
            best = attempt
        if best is not None and not best[1].count:
            break
    assert best is not None
    trace, defects = best
    degree = np.bincount(trace.segments.ravel(), minlength=len(trace.vertices))
    mesh = Mesh.of(trace.vertices, trace.segments, trace.midpoints[:, None] if curved else None)
    return mesh, CurveReport(int((degree > 2).sum()), int((degree == 1).sum()), defects)


def _trace_on(source: LocalSource, spacing: float, side: float, shift: Floats) -> tuple[Trace, TraceDefects] | None:
    """Return the trace from the lattice with a cell centred at ``shift`` (d,), and its defects; None without a segment.

    ``side`` is the spacing of this lattice, ``spacing`` that of the form's lattice.
    """
    shifted = replace(source, shift=source.shift + shift)
    for _, level in cell_levels(shifted, side, 0.5):
        cells = level
    crossings = plane_crossings(shifted, cells, side)
    if not len(crossings.points):
        return None
    trace = trace_curve(shifted, crossings, side)
    if not len(trace.segments):
        return None
    trace = add_self_crossings(shifted, trace, spacing)
    points = shifted.closest_point(np.asarray(cells * side)).points
    defects = trace_defects(trace, points, spacing)
    return trace.translate(shift), defects.translate(shift)


def add_self_crossings(source: LocalSource, trace: Trace, spacing: float) -> Trace:
    """Return the trace with a common vertex where two strands cross that are not connected in a cell."""
    i, j, points = _self_crossings(source, trace, spacing)
    if not len(i):
        return trace
    vertices = np.concatenate([trace.vertices, points])
    new = len(trace.vertices) + np.arange(len(points))
    same = _merge_into_new(vertices, len(trace.vertices), 0.05 * spacing)
    segments = same[_split_segments(trace, np.concatenate([i, j]), np.tile(new, 2), np.tile(points, (2, 1)))]
    segments = np.unique(np.sort(segments[segments[:, 0] != segments[:, 1]], axis=1), axis=0)
    used, segments = np.unique(segments, return_inverse=True)
    vertices, segments = vertices[used], segments.reshape(-1, 2)
    ends = np.flatnonzero(np.isin(used, trace.ends))
    on_curve = project_middles(source, vertices, segments)
    return replace(trace, vertices=vertices, segments=segments, midpoints_on_curve=on_curve, ends=ends)


def _self_crossings(source: LocalSource, trace: Trace, spacing: float) -> tuple[Ints, Ints, Floats]:
    """Return the pairs (k,), (k,) of segments that cross without a common vertex, and the crossings (k, d)."""
    from scipy.spatial import KDTree

    a, b = trace.vertices[trace.segments].transpose(1, 0, 2)
    on_curve = trace.midpoints_on_curve
    reach = float(norms(b - a).max()) + 2 * NEAR_CHORDS * spacing
    pairs = KDTree(on_curve).query_pairs(reach, output_type="ndarray")
    i, j = pairs[~_are_linked(trace, pairs)].T.astype(np.int64)
    best, along = np.full(len(i), np.inf), np.zeros((2, len(i), trace.vertices.shape[1]))
    on_i, on_j = np.zeros_like(along[0]), np.zeros_like(along[0])
    for start_i, end_i in ((a[i], on_curve[i]), (on_curve[i], b[i])):
        for start_j, end_j in ((a[j], on_curve[j]), (on_curve[j], b[j])):
            p, q = _nearest_on_chords(start_i, end_i, start_j, end_j)
            distance = norms(p - q)
            nearer = distance < best
            best = np.where(nearer, distance, best)
            on_i[nearer], on_j[nearer] = p[nearer], q[nearer]
            along[0, nearer], along[1, nearer] = (end_i - start_i)[nearer], (end_j - start_j)[nearer]
    directions = unit(along[0]), unit(along[1])
    parallel = np.abs(dots(*directions)) >= 0.98
    is_close = (best < NEAR_CHORDS * spacing) & ~parallel
    i, j, best = i[is_close], j[is_close], best[is_close]
    points, miss = _meeting_points(
        source, on_i[is_close], on_j[is_close], directions[0][is_close], directions[1][is_close]
    )
    crossing = np.minimum(miss, best) < max(5e-3 * spacing, 5.0 * source.noise)
    return i[crossing], j[crossing], points[crossing]


def _are_linked(trace: Trace, pairs: Ints) -> Bools:
    """Return which ``pairs`` (k, 2) of segments have a common vertex, or are connected by one or two other segments."""
    from scipy.sparse import coo_array, eye_array

    size = len(trace.vertices)
    graph = coo_array((np.ones(len(trace.segments)), tuple(trace.segments.T)), shape=(size, size))
    step = (graph + graph.T + eye_array(size)).tocsr()
    row, column = (step @ step).nonzero()
    first, second = trace.segments[pairs[:, 0]], trace.segments[pairs[:, 1]]
    codes = first[:, :, None] * size + second[:, None]
    return np.asarray(np.isin(codes, row.astype(np.int64) * size + column).any(axis=(1, 2)))


def _nearest_on_chords(a: Floats, b: Floats, c: Floats, d: Floats) -> tuple[Floats, Floats]:
    """Return the points (n, d) of two chords, from a to b and from c to d, that are nearest to each other."""
    u, v, w = b - a, d - c, a - c
    uu, uv, vv, uw, vw = dots(u, u), dots(u, v), dots(v, v), dots(u, w), dots(v, w)
    with np.errstate(all="ignore"):
        s = (uv * vw - vv * uw) / (uu * vv - uv * uv)
        s = np.clip(np.where(np.isfinite(s), s, 0.5), 0.0, 1.0)
        t = np.clip(np.where(vv > 0, (s * uv + vw) / vv, 0.5), 0.0, 1.0)
        s = np.clip(np.where(uu > 0, (t * uv - uw) / uu, 0.5), 0.0, 1.0)
    return a + s[:, None] * u, c + t[:, None] * v


def _meeting_points(
    source: LocalSource, p: Floats, q: Floats, direction_p: Floats, direction_q: Floats
) -> tuple[Floats, Floats]:
    """Return points (n, d) of the curve where strands through p and q (n, d) meet, and their errors (n,).

    The tangents of both strands are intersected, and the result is projected onto the curve. The error is the larger of
    the distance between the tangents and the distance of this projection.
    """
    closest = source.closest_point(np.concatenate([p, q])).points
    p, q = closest[: len(p)], closest[len(p) :]
    cosine, off = dots(direction_p, direction_q), q - p
    along_p = (dots(off, direction_p) - cosine * dots(off, direction_q)) / (1 - cosine * cosine)
    along_q = (cosine * dots(off, direction_p) - dots(off, direction_q)) / (1 - cosine * cosine)
    p, q = p + along_p[:, None] * direction_p, q + along_q[:, None] * direction_q
    middle = 0.5 * (p + q)
    points = source.closest_point(middle).points
    return points, np.maximum(norms(p - q), norms(points - middle))


def _merge_into_new(vertices: Floats, old: int, reach: float) -> Ints:
    """Return the representative (v,) of each vertex: the first new vertex of those connected by steps up to ``reach``.

    New vertices have the numbers from ``old`` on. Groups without a new vertex are represented by an old one.
    """
    from scipy.spatial import KDTree

    pairs = KDTree(vertices[old:]).sparse_distance_matrix(KDTree(vertices), reach, output_type="coo_matrix")
    count, group = connected_groups(pairs.row + old, pairs.col, len(vertices))
    representative = np.empty(count, dtype=np.int64)
    order = np.arange(len(vertices))[::-1]
    order = np.concatenate([order[order < old], order[order >= old]])  # the first of the new ones is written last
    representative[group[order]] = order
    return np.asarray(representative[group])


def _split_segments(trace: Trace, segment: Ints, new: Ints, points: Floats) -> Ints:
    """Return all segments (s, 2), with ``segment`` (k,) split at the vertices ``new`` (k,) at ``points`` (k, d)."""
    a, b = trace.vertices[trace.segments[segment]].transpose(1, 0, 2)
    order = np.lexsort((dots(points - a, b - a) / dots(b - a, b - a), segment))
    segment, new = segment[order], new[order]
    first = np.searchsorted(segment, np.arange(len(trace.segments)))
    parts = np.bincount(segment, minlength=len(trace.segments))
    return np.stack(
        [np.insert(new, first, trace.segments[:, 0]), np.insert(new, first + parts, trace.segments[:, 1])], axis=1
    )


def trace_defects(trace: Trace, points: Floats, spacing: float) -> TraceDefects:
    """Return the defects of a trace: points that it misses or covers twice, and ends where the curve continues.

    ``points`` (n, d) are samples of the whole curve.
    """
    from scipy.spatial import KDTree

    a, b = trace.vertices[trace.segments].transpose(1, 0, 2)
    on_curve = trace.midpoints_on_curve
    starts, stops = np.concatenate([a, on_curve]), np.concatenate([on_curve, b])
    reach = MISSED_DISTANCE * spacing
    missed = points[_distances_from_chords(points, starts, stops, reach) > reach]
    length = norms(b - a)
    long = np.flatnonzero(length > 0.08 * spacing)  # shorter segments are nearer to others than they are long
    reach = DOUBLE_DISTANCE * spacing
    owners = long, np.tile(np.arange(len(a)), 2)
    is_double = _distances_from_chords(on_curve[long], starts, stops, reach, owners) < np.minimum(
        reach, 0.1 * length[long]
    )
    degree = np.bincount(trace.segments.ravel(), minlength=len(trace.vertices))
    loose = np.setdiff1d(np.flatnonzero(degree == 1), trace.ends)
    gaps = np.unique(np.concatenate([trace.gaps, trace.vertices[loose]]), axis=0)
    return TraceDefects(missed, KDTree(trace.vertices).query(missed)[0], on_curve[long[is_double]], gaps)


def _distances_from_chords(
    points: Floats, starts: Floats, stops: Floats, reach: float, owners: tuple[Ints, Ints] | None = None
) -> Floats:
    """Return the distance (n,) of each point from the nearest chord, infinity if there is none within ``reach``.

    Parameters
    ----------
    points : (n, d) float64
    starts, stops : (c, d) float64
        The ends of the chords.
    reach : float
    owners : ((n,) int64, (c,) int64), optional
        The segment of each point and of each chord: chords of a point's own segment do not count.
    """
    from scipy.spatial import KDTree

    far = 0.5 * float(norms(stops - starts).max()) + reach
    pairs = KDTree(points).sparse_distance_matrix(KDTree(0.5 * (starts + stops)), far, output_type="coo_matrix")
    row, chord = pairs.row, pairs.col
    if owners is not None:
        other = owners[0][row] != owners[1][chord]
        row, chord = row[other], chord[other]
    along, off = (stops - starts)[chord], points[row] - starts[chord]
    square = dots(along, along)
    share = np.clip(dots(off, along) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    best = np.full(len(points), np.inf)
    np.minimum.at(best, row, norms(off - share[:, None] * along))
    return best
