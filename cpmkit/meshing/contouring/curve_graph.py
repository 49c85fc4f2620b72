"""The graph of a curve that is known by closest points alone: its trace, with corners, junctions and crossings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, nearest_shares, norms, unit
from cpmkit.mesh.subdivision import divide_segments
from cpmkit.meshing.contouring.curve_tracing import CurveTracer
from cpmkit.runtime.index_sets import connected_components
from cpmkit.types import Bools, Floats, Ints

#: Segments whose chords come nearer than this, in steps, may cross.
NEAR_CHORDS = 0.05


@dataclass(frozen=True, eq=False)
class CurveGraph:
    """Segments on a curve, connected at its vertices."""

    vertices: Floats  #: (v, d): points of the curve.
    segments: Ints  #: (s, 2): the vertices at the ends of each segment.
    midpoints_on_curve: Floats  #: (s, d): the closest points on the curve of the midpoints of the segments.
    ends: Ints  #: (k,): the vertices at which the curve is known to end.


def trace_curve(source: LocalSource, seeds: Floats, step: float) -> CurveGraph:
    """Return the graph of the pieces of a curve through its points ``seeds`` (n, d), in steps of length ``step``."""
    tracer = CurveTracer.of(source, step)
    tracer.trace_all(seeds)
    graph = _graph_of_trace(tracer)
    if not len(graph.segments):
        return graph
    graph = split_at_vertices(source, add_self_crossings(source, graph, step), 0.05 * step)
    return add_corners(source, _refine_junctions(source, graph, step), step)


def _graph_of_trace(tracer: CurveTracer) -> CurveGraph:
    """Return the graph that a tracer made, with the last vertex before each junction moved straight ahead, beyond it.

    The last segment of that strand then crosses the strand which it meets, so that :func:`add_self_crossings` finds the
    junction. ``ends`` of the graph are the moved vertices.
    """
    segments = np.concatenate([np.zeros((0, 2), dtype=np.int64), *tracer.segments])
    moved = np.concatenate([np.zeros(0, dtype=np.int64), *tracer.before_junctions])
    vertices = tracer.points.copy()
    vertices[moved] = np.concatenate([vertices[:0], *tracer.beyond])
    segments = _distinct(segments)
    on_curve = project_midpoints(tracer.source, vertices, segments)
    prolonged = np.isin(segments, moved).any(axis=1)
    on_curve[prolonged] = vertices[segments[prolonged]].mean(axis=1)
    return CurveGraph(vertices, segments, on_curve, moved)


def project_midpoints(source: LocalSource, vertices: Floats, segments: Ints) -> Floats:
    """Return the closest points (s, d) of the midpoints of ``segments`` (s, 2) between ``vertices`` (v, d)."""
    return source.closest_point(vertices[segments].mean(axis=1)).points


def split_at_vertices(source: LocalSource, graph: CurveGraph, reach: float) -> CurveGraph:
    """Return the graph with segments split at vertices of other segments within ``reach``."""
    a, b = graph.vertices[graph.segments].transpose(1, 0, 2)
    vertex, segment, distance, share = near_chords(graph.vertices, a, b, reach)
    length = norms(b - a)[segment]
    lies_on = (distance < reach) & (np.minimum(share, 1 - share) * length > reach)
    lies_on &= (graph.segments[segment] != vertex[:, None]).all(axis=1)
    vertex, segment = vertex[lies_on], segment[lies_on]
    segments = divide_segments(graph.vertices, graph.segments, segment, vertex, graph.vertices[vertex])
    segments = _distinct(segments)
    return replace(graph, segments=segments, midpoints_on_curve=project_midpoints(source, graph.vertices, segments))


def _refine_junctions(source: LocalSource, graph: CurveGraph, step: float) -> CurveGraph:
    """Return the graph with junctions (vertices of three segments or more) moved to where tangents of strands meet.

    The first place of a junction has an error due to the curvature of the strands, the parts of the curve that meet
    there. The tangent of a strand is the secant of two closest points ahead of the junction, nearer in later rounds.
    The new place has the least sum of squared distances from the tangents. A junction stays if the tangents are nearly
    parallel, or if it would move by more than a step. Junctions that become one are moved again with all their strands.
    """
    ends = np.concatenate([graph.segments, graph.segments[:, ::-1]])
    junctions = np.flatnonzero(np.bincount(ends[:, 0]) > 2)
    at_junction = np.isin(ends[:, 0], junctions)
    row, neighbour = np.searchsorted(junctions, ends[at_junction, 0]), ends[at_junction, 1]
    vertices, dimension = graph.vertices.copy(), graph.vertices.shape[1]
    for share in (0.5, 0.5, 0.2, 0.1):
        start = vertices[junctions[row]]
        ahead = max(share * step, 30.0 * source.noise) * unit(graph.vertices[neighbour] - start)
        near, far = (source.closest_point(start + factor * ahead).points for factor in (1, 2))
        secant = unit(near - far)
        across = np.eye(dimension) - secant[:, :, None] * secant[:, None, :]
        matrix, right = np.zeros((len(junctions), dimension, dimension)), np.zeros((len(junctions), dimension))
        np.add.at(matrix, row, across)
        np.add.at(right, row, (across @ near[:, :, None])[:, :, 0])
        regular = np.linalg.eigvalsh(matrix)[:, 0] > 0.05
        meeting = np.asarray(np.linalg.solve(matrix[regular], right[regular][:, :, None])[:, :, 0], dtype=np.float64)
        meeting, moved = source.closest_point(meeting).points, junctions[regular]
        accepted = norms(meeting - graph.vertices[moved]) < step
        vertices[moved[accepted]] = meeting[accepted]
    is_junction = np.isin(np.arange(len(vertices)), junctions)
    same = _merge_into_junctions(vertices, is_junction, 0.2 * step)
    segments = _distinct(same[graph.segments])
    refined = CurveGraph(vertices, segments, project_midpoints(source, vertices, segments), graph.ends)
    are_one = (same[junctions] != junctions).any()
    return _refine_junctions(source, refined, step) if are_one else refined


def add_corners(source: LocalSource, graph: CurveGraph, step: float) -> CurveGraph:
    """Return the graph with each segment that cuts off a corner halved where the tangents at its ends meet.

    A corner turns by more than 20 degrees. ``step`` is the step of the trace, to which tolerances refer.
    """
    a, b = graph.vertices[graph.segments].transpose(1, 0, 2)
    middle, length = 0.5 * (a + b), norms(b - a)
    off = np.flatnonzero(norms(graph.midpoints_on_curve - middle) > 0.03 * length)
    a, b, middle, length = a[off], b[off], middle[off], length[off]
    reach = max(1e-3 * step, 30.0 * source.noise)
    at_a, at_b = (unit(source.closest_point(x + reach * unit(y - x)).points - x) for x, y in ((a, b), (b, a)))
    cosine = dots(at_a, -at_b)
    turned = (cosine < 0.94) & (cosine > -0.9999)  # parallel tangents do not meet
    meeting, _ = _meeting_points(source, a[turned], b[turned], at_a[turned], -at_b[turned])
    near = norms(meeting - middle[turned]) < length[turned]
    rows, meeting = off[turned][near], meeting[near]
    new = len(graph.vertices) + np.arange(len(rows))
    vertices = np.concatenate([graph.vertices, meeting])
    same = _merge_into_junctions(vertices, np.arange(len(vertices)) >= len(graph.vertices), NEAR_CHORDS * step)
    halves = np.concatenate([np.stack([graph.segments[rows, end], new], axis=1) for end in range(2)])
    segments = same[np.concatenate([np.delete(graph.segments, rows, axis=0), halves])]
    on_curve = np.concatenate(
        [np.delete(graph.midpoints_on_curve, rows, axis=0), project_midpoints(source, vertices, halves)]
    )
    has_length = segments[:, 0] != segments[:, 1]
    return replace(graph, vertices=vertices, segments=segments[has_length], midpoints_on_curve=on_curve[has_length])


def add_self_crossings(source: LocalSource, graph: CurveGraph, step: float) -> CurveGraph:
    """Return the graph with a common vertex where two segments cross that are not linked (:func:`_are_linked`).

    The vertices that :func:`_graph_of_trace` moved beyond junctions are removed; ``ends`` of the result are those
    vertices of one segment at which the curve ends. ``step`` is the step of the trace, to which tolerances refer.
    """
    i, j, points = _self_crossings(source, graph, step)
    vertices = np.concatenate([graph.vertices, points])
    old = len(graph.vertices)
    new = old + np.arange(len(points))
    same = _merge_into_junctions(vertices, np.arange(len(vertices)) >= old, 0.2 * step)
    pair, twice = np.concatenate([i, j]), np.tile(points, (2, 1))
    segments = same[divide_segments(vertices, graph.segments, pair, np.tile(new, 2), twice)]
    segments = _distinct(segments)
    is_tip = np.zeros(len(vertices), dtype=bool)
    is_tip[graph.ends] = True
    is_tip &= same == np.arange(len(vertices))
    segments = segments[~is_tip[segments].any(axis=1)]
    used, segments = np.unique(segments, return_inverse=True)
    vertices, segments = vertices[used], segments.reshape(-1, 2)
    on_curve = project_midpoints(source, vertices, segments)
    degree = np.bincount(segments.ravel(), minlength=len(vertices))
    loose = np.flatnonzero((degree[segments] == 1).any(axis=1))
    inner = (degree[segments[loose, 0]] == 1).astype(np.int64)
    inner, outer = segments[loose, inner], segments[loose, 1 - inner]
    beyond = vertices[outer] + 0.5 * step * unit(vertices[outer] - vertices[inner])
    ends = norms(source.closest_point(beyond).points - vertices[outer]) < 5e-3 * step + 6.0 * source.noise
    return CurveGraph(vertices, segments, on_curve, outer[ends])


def _distinct(segments: Ints) -> Ints:
    """Return the distinct ``segments`` (s, 2), sorted, without segments from a vertex to itself."""
    return np.unique(np.sort(segments[segments[:, 0] != segments[:, 1]], axis=1), axis=0)


def _self_crossings(source: LocalSource, graph: CurveGraph, step: float) -> tuple[Ints, Ints, Floats]:
    """Return pairs (k,), (k,) of segments that cross and are neither linked nor parallel, and the crossings (k, d)."""
    from scipy.spatial import KDTree

    a, b = graph.vertices[graph.segments].transpose(1, 0, 2)
    on_curve = graph.midpoints_on_curve
    reach = float(norms(b - a).max()) + 2 * NEAR_CHORDS * step
    pairs = KDTree(on_curve).query_pairs(reach, output_type="ndarray")
    i, j = pairs[~_are_linked(graph, pairs)].T.astype(np.int64)
    best, along = np.full(len(i), np.inf), np.zeros((2, len(i), graph.vertices.shape[1]))
    on_i, on_j = np.zeros_like(along[0]), np.zeros_like(along[0])
    for start_i, end_i in ((a[i], on_curve[i]), (on_curve[i], b[i])):
        for start_j, end_j in ((a[j], on_curve[j]), (on_curve[j], b[j])):
            p, q = nearest_on_chords(start_i, end_i, start_j, end_j)
            distance = norms(p - q)
            nearer = distance < best
            best = np.where(nearer, distance, best)
            on_i[nearer], on_j[nearer] = p[nearer], q[nearer]
            along[0, nearer], along[1, nearer] = (end_i - start_i)[nearer], (end_j - start_j)[nearer]
    directions = unit(along[0]), unit(along[1])
    parallel = np.abs(dots(*directions)) >= 0.98
    is_close = (best < NEAR_CHORDS * step) & ~parallel
    i, j, best = i[is_close], j[is_close], best[is_close]
    points, miss = _meeting_points(
        source, on_i[is_close], on_j[is_close], directions[0][is_close], directions[1][is_close]
    )
    crossing = np.minimum(miss, best) < max(0.02 * step, 5.0 * source.noise)
    return i[crossing], j[crossing], points[crossing]


def _are_linked(graph: CurveGraph, pairs: Ints) -> Bools:
    """Return which ``pairs`` (k, 2) of segments have a common vertex, or are connected by one or two other segments."""
    from scipy.sparse import coo_array, eye_array

    size = len(graph.vertices)
    links = coo_array((np.ones(len(graph.segments)), tuple(graph.segments.T)), shape=(size, size))
    step = (links + links.T + eye_array(size)).tocsr()
    row, column = (step @ step).nonzero()
    first, second = graph.segments[pairs[:, 0]], graph.segments[pairs[:, 1]]
    codes = first[:, :, None] * size + second[:, None]
    return np.asarray(np.isin(codes, row.astype(np.int64) * size + column).any(axis=(1, 2)))


def nearest_on_chords(a: Floats, b: Floats, c: Floats, d: Floats) -> tuple[Floats, Floats]:
    """Return the points (n, d), (n, d) of two chords, from a to b and from c to d, that are nearest to each other."""
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

    The tangents of both strands, of unit directions (n, d), are intersected, and the result is projected onto the
    curve. The error is the larger of the distance between the tangents and the distance of the projection. Tangents
    must not be parallel.
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


def _merge_into_junctions(vertices: Floats, is_junction: Bools, reach: float) -> Ints:
    """Return the vertex (v,) that each vertex of a curve graph is merged into: a junction within ``reach``, or itself.

    Junctions within ``reach`` of each other or of the same vertex are all merged into the first of them.
    """
    from scipy.spatial import KDTree

    junctions = np.flatnonzero(is_junction)
    if not len(junctions):
        return np.arange(len(vertices))
    pairs = KDTree(vertices[junctions]).sparse_distance_matrix(KDTree(vertices), reach, output_type="coo_matrix")
    count, group = connected_components(len(vertices), np.stack([junctions[pairs.row], pairs.col], axis=1))
    representative = np.empty(count, dtype=np.int64)
    order = np.arange(len(vertices))[::-1]
    order = np.concatenate([order[~is_junction[order]], order[is_junction[order]]])  # the last value assigned stays
    representative[group[order]] = order
    return np.asarray(representative[group])


def near_chords(points: Floats, starts: Floats, stops: Floats, reach: float) -> tuple[Ints, Ints, Floats, Floats]:
    """Return all pairs of points (n, d) and chords that may be within ``reach``, with their distances.

    Chords lead from ``starts`` to ``stops`` (c, d). For each pair are returned the row (p,) of the point, the number
    (p,) of the chord, the distance (p,), and the share (p,) of the chord's length at which its nearest point lies.
    """
    from scipy.spatial import KDTree

    far = 0.5 * float(norms(stops - starts).max(initial=0.0)) + reach
    pairs = KDTree(points).sparse_distance_matrix(KDTree(0.5 * (starts + stops)), far, output_type="coo_matrix")
    row, chord = pairs.row.astype(np.int64), pairs.col.astype(np.int64)
    along, off = (stops - starts)[chord], points[row] - starts[chord]
    share = nearest_shares(off, along)
    return row, chord, norms(off - share[:, None] * along), share
