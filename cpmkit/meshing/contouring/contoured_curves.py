"""Segments on a curve that is known by closest points alone: traces from several lattices, until one has no defect."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.grid.lattice import cell_levels
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import norms
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.contouring.curve_graph import CurveGraph, near_chords, trace_curve
from cpmkit.runtime.index_sets import connected_components
from cpmkit.types import Floats, Ints

#: The steps of traces, in spacings of the form, and the shifts, in spacings, of the lattice cells from whose closest
#: points traces start. They are tried in turn until no defect is left.
LATTICES = ((0.5, 0.1723), (0.3, 0.1723), (0.2, 0.4142), (0.12, 0.3371), (0.05, 0.0911))


@dataclass(frozen=True, eq=False)
class TraceDefects:
    """Points, relative to the lattice's origin, at which a trace does not represent the curve."""

    missed: Floats  #: (k, d): points of the curve far from all segments.
    missed_distances: Floats  #: (k,): distances of these points from the nearest vertex.
    covered_twice: Floats  #: (k, d): points that two segments cover.
    gaps: Floats  #: (k, d): points at which the trace ends but not the curve.

    @property
    def count(self) -> int:
        """The number of defects."""
        return len(self.missed) + len(self.covered_twice) + len(self.gaps)


def contour_curve(source: LocalSource, spacing: float) -> tuple[Mesh, TraceDefects]:
    """Return segments on a curve, and their defects; vertices lie at its ends, corners and junctions.

    Raises ResolutionError if the first trace has no piece as large as half a spacing.
    ``source``: a curve in the plane or in space. Its tangents are not used.
    ``spacing``: spacing h of the form's lattice.
    """
    best = None
    for step, shift in LATTICES:
        attempt = _trace_from_cells(source, spacing, max(step * spacing, 60.0 * source.noise), shift)
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
    graph, defects = best
    return Mesh.of(graph.vertices, graph.segments), defects


def _trace_from_cells(
    source: LocalSource, spacing: float, step: float, shift: float
) -> tuple[CurveGraph, TraceDefects] | None:
    """Return the graph of a curve traced from the lattice cells that it meets, and its defects.

    ``spacing`` is that of the form's lattice, ``step`` the length of a step; the cells are shifted by ``shift``
    spacings. Pieces below half a spacing are dropped; None if no piece is left.
    """
    for _, level in cell_levels(source, spacing, shift):
        cells = level
    points = source.closest_point(np.asarray((cells - shift + 0.5) * spacing)).points
    graph = _remove_small_pieces(trace_curve(source, points, step), 0.5 * spacing)
    return (graph, trace_defects(graph, points, spacing, source.noise)) if len(graph.segments) else None


def _remove_small_pieces(graph: CurveGraph, size: float) -> CurveGraph:
    """Return the graph without connected pieces whose bounding boxes have no side of at least ``size``."""
    count, piece = connected_components(len(graph.vertices), graph.segments)
    low, high = np.full((count, graph.vertices.shape[1]), np.inf), np.full((count, graph.vertices.shape[1]), -np.inf)
    np.minimum.at(low, piece, graph.vertices)
    np.maximum.at(high, piece, graph.vertices)
    large = ((high - low) >= size).any(axis=1)[piece[graph.segments[:, 0]]]
    return replace(graph, segments=graph.segments[large], midpoints_on_curve=graph.midpoints_on_curve[large])


def trace_defects(graph: CurveGraph, points: Floats, spacing: float, noise: float = 0.0) -> TraceDefects:
    """Return the defects of a trace: points that it misses or covers twice, and ends where the curve continues.

    ``points`` (n, d) are samples of the whole curve, ``noise`` the error of closest points, ``spacing`` the lattice's.
    """
    from scipy.spatial import KDTree

    a, b = graph.vertices[graph.segments].transpose(1, 0, 2)
    on_curve = graph.midpoints_on_curve
    starts, stops = np.concatenate([a, on_curve]), np.concatenate([on_curve, b])
    length, height = norms(b - a), np.tile(norms(on_curve - 0.5 * (a + b)), 2)
    reach = max(0.002 * spacing, 6.0 * noise)
    missed = points[_distances_from_chords(points, starts, stops, 20 * reach, height=0.5 * height) > reach]
    long = np.flatnonzero(length > 0.08 * spacing)  # shorter segments are nearer to others than they are long
    reach = 0.02 * spacing
    owners = long, np.tile(np.arange(len(a)), 2)
    is_double = _distances_from_chords(on_curve[long], starts, stops, reach, owners) < np.minimum(
        reach, 0.1 * length[long]
    )
    degree = np.bincount(graph.segments.ravel(), minlength=len(graph.vertices))
    loose = np.setdiff1d(np.flatnonzero(degree == 1), graph.ends)
    far = KDTree(graph.vertices).query(missed)[0]
    return TraceDefects(missed, far, on_curve[long[is_double]], graph.vertices[loose])


def _distances_from_chords(
    points: Floats,
    starts: Floats,
    stops: Floats,
    reach: float,
    owners: tuple[Ints, Ints] | None = None,
    height: Floats | float = 0.0,
) -> Floats:
    """Return the distance (n,) of ``points`` (n, d) from the nearest chord; infinity if none may be within ``reach``.

    ``starts``, ``stops`` (c, d): the ends of the chords.
    ``owners`` ((n,) int64, (c,) int64): the segment of each point and chord: chords of its own segment do not count.
    ``height`` (c,) or float: subtracted from the distances of each chord, which has an arc above it.
    """
    row, chord, distance, _ = near_chords(points, starts, stops, reach)
    distance = distance - np.broadcast_to(height, len(starts))[chord]
    if owners is not None:
        other = owners[0][row] != owners[1][chord]
        row, distance = row[other], distance[other]
    best = np.full(len(points), np.inf)
    np.minimum.at(best, row, distance)
    return best
