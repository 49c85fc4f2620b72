"""Strands of a curve that cross each other share a vertex there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.meshing.contouring.curve_trace import Trace, middle_feet
from cpmkit.protocols import Bools, Floats, Ints

#: Chords nearer than this, in spacings, may belong to strands that cross; such strands come as near as that.
NEAR_CHORDS, CROSSING_GAP = 0.05, 5e-3
#: Or so near in units of the noise of feet.
CROSSING_NOISES = 5.0
#: Strands whose directions have a larger cosine run side by side.
SIDE_BY_SIDE_COSINE = 0.98
#: Vertices so near to a crossing, in spacings, are that crossing.
SAME_VERTEX = 0.05


def with_shared_vertices(source: LocalSource, trace: Trace, spacing: float) -> Trace:
    """Return the trace with a vertex on both of any two strands that cross, which the lattice's cells did not join."""
    i, j, points = _crossings(source, trace, spacing)
    if not len(i):
        return trace
    vertices = np.concatenate([trace.vertices, points])
    new = len(trace.vertices) + np.arange(len(points))
    same = _same_vertices(vertices, len(trace.vertices), SAME_VERTEX * spacing)
    segments = same[_split(trace, np.concatenate([i, j]), np.tile(new, 2), np.tile(points, (2, 1)))]
    segments = np.unique(np.sort(segments[segments[:, 0] != segments[:, 1]], axis=1), axis=0)
    used, segments = np.unique(segments, return_inverse=True)
    vertices, segments = vertices[used], segments.reshape(-1, 2)
    ends = np.flatnonzero(np.isin(used, trace.ends))
    return replace(trace, vertices=vertices, segments=segments, feet=middle_feet(source, vertices, segments), ends=ends)


def _crossings(source: LocalSource, trace: Trace, spacing: float) -> tuple[Ints, Ints, Floats]:
    """Return the pairs (k,), (k,) of segments that cross without being linked, and where (k, d)."""
    from scipy.spatial import KDTree

    a, b = trace.vertices[trace.segments].transpose(1, 0, 2)
    reach = float(norms(b - a).max()) + 2 * NEAR_CHORDS * spacing
    pairs = KDTree(trace.feet).query_pairs(reach, output_type="ndarray")
    i, j = pairs[~_linked(trace, pairs)].T.astype(np.int64)
    best, along = np.full(len(i), np.inf), np.zeros((2, len(i), trace.vertices.shape[1]))
    on_i, on_j = np.zeros_like(along[0]), np.zeros_like(along[0])
    for start_i, end_i in ((a[i], trace.feet[i]), (trace.feet[i], b[i])):
        for start_j, end_j in ((a[j], trace.feet[j]), (trace.feet[j], b[j])):
            p, q = nearest_on_chords(start_i, end_i, start_j, end_j)
            gap = norms(p - q)
            nearer = gap < best
            best = np.where(nearer, gap, best)
            on_i[nearer], on_j[nearer] = p[nearer], q[nearer]
            along[0, nearer], along[1, nearer] = (end_i - start_i)[nearer], (end_j - start_j)[nearer]
    ways = unit(along[0]), unit(along[1])
    near = (best < NEAR_CHORDS * spacing) & (np.abs(dots(*ways)) < SIDE_BY_SIDE_COSINE)
    i, j, best = i[near], j[near], best[near]
    points, gap = _meeting(source, on_i[near], on_j[near], ways[0][near], ways[1][near])
    crossing = np.minimum(gap, best) < max(CROSSING_GAP * spacing, CROSSING_NOISES * source.noise)
    return i[crossing], j[crossing], points[crossing]


def _meeting(source: LocalSource, p: Floats, q: Floats, way_p: Floats, way_q: Floats) -> tuple[Floats, Floats]:
    """Return points of the curve where strands that run by p and q (n, d) along ways meet, and how far these miss."""
    feet = source.closest_point(np.concatenate([p, q])).points
    p, q = feet[: len(p)], feet[len(p) :]
    cosine, off = dots(way_p, way_q), q - p
    along = (dots(off, way_p) - cosine * dots(off, way_q)) / (1 - cosine * cosine)
    back = (cosine * dots(off, way_p) - dots(off, way_q)) / (1 - cosine * cosine)
    p, q = p + along[:, None] * way_p, q + back[:, None] * way_q
    middle = 0.5 * (p + q)
    points = source.closest_point(middle).points
    return points, np.maximum(norms(p - q), norms(points - middle))


def nearest_on_chords(a: Floats, b: Floats, c: Floats, d: Floats) -> tuple[Floats, Floats]:
    """Return the nearest points (n, d) of the chords from a to b and from c to d."""
    u, v, w = b - a, d - c, a - c
    uu, uv, vv, uw, vw = dots(u, u), dots(u, v), dots(v, v), dots(u, w), dots(v, w)
    with np.errstate(all="ignore"):
        s = (uv * vw - vv * uw) / (uu * vv - uv * uv)
        s = np.clip(np.where(np.isfinite(s), s, 0.5), 0.0, 1.0)
        t = np.clip(np.where(vv > 0, (s * uv + vw) / vv, 0.5), 0.0, 1.0)
        s = np.clip(np.where(uu > 0, (t * uv - uw) / uu, 0.5), 0.0, 1.0)
    return a + s[:, None] * u, c + t[:, None] * v


def _linked(trace: Trace, pairs: Ints) -> Bools:
    """Return the pairs of segments that hang together, or that one or two others link."""
    from scipy.sparse import coo_array, eye_array

    size = len(trace.vertices)
    graph = coo_array((np.ones(len(trace.segments)), tuple(trace.segments.T)), shape=(size, size))
    step = (graph + graph.T + eye_array(size)).tocsr()
    row, column = (step @ step).nonzero()
    first, second = trace.segments[pairs[:, 0]], trace.segments[pairs[:, 1]]
    codes = first[:, :, None] * size + second[:, None]
    return np.asarray(np.isin(codes, row.astype(np.int64) * size + column).any(axis=(1, 2)))


def _same_vertices(vertices: Floats, old: int, reach: float) -> Ints:
    """Return for each vertex the one that stands for it: the first of the new ones, from ``old`` on, within reach."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    near = KDTree(vertices[old:]).sparse_distance_matrix(KDTree(vertices), reach, output_type="coo_matrix")
    graph = coo_array((np.ones(near.nnz), (near.row + old, near.col)), shape=(len(vertices),) * 2)
    count, group = connected_components(graph, directed=False)
    stands = np.empty(count, dtype=np.int64)
    order = np.arange(len(vertices))[::-1]
    order = np.concatenate([order[order < old], order[order >= old]])  # the first of the new ones is written last
    stands[group[order]] = order
    return np.asarray(stands[group])


def _split(trace: Trace, segment: Ints, new: Ints, points: Floats) -> Ints:
    """Return the segments (s, 2), those of ``segment`` (k,) in parts that end at the vertices ``new`` (k,)."""
    a, b = trace.vertices[trace.segments[segment]].transpose(1, 0, 2)
    order = np.lexsort((dots(points - a, b - a) / dots(b - a, b - a), segment))
    segment, new = segment[order], new[order]
    first = np.searchsorted(segment, np.arange(len(trace.segments)))
    parts = np.bincount(segment, minlength=len(trace.segments))
    return np.stack(
        [np.insert(new, first, trace.segments[:, 0]), np.insert(new, first + parts, trace.segments[:, 1])], axis=1
    )
