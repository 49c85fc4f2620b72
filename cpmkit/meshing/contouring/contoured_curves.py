"""A curve that is known by its closest points alone, as segments."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.grid.band import cell_levels
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.meshing.contouring.curve_trace import Trace, trace_of
from cpmkit.meshing.contouring.knot_crossings import knot_crossings
from cpmkit.meshing.contouring.strand_crossings import with_shared_vertices
from cpmkit.protocols import Floats, Ints

#: Points of the curve farther than so many spacings from all segments are missed by the trace.
MISSED_REACH = 0.1
#: A middle nearer to the inside of another segment than this, in spacings and as a share of its own segment, is
#: covered twice; segments shorter than so many spacings are not looked at.
DOUBLE_REACH, DOUBLE_SHARE, SHORT_SEGMENT = 0.02, 0.1, 0.08


@dataclass(frozen=True, eq=False)
class TraceDefects:
    """Where a trace is not what it has to be; points (k, d) each, relative to the lattice's origin.

    Attributes
    ----------
    missed : (k, d) float64
        Points of the curve with no segment near by.
    missed_distances : (k,) float64
        How far from the nearest vertex these are.
    covered_twice : (k, d) float64
        Points that two segments cover.
    gaps : (k, d) float64
        Points at which the trace ends and the curve does not.
    """

    missed: Floats
    missed_distances: Floats
    covered_twice: Floats
    gaps: Floats

    @property
    def count(self) -> int:
        """How many places there are."""
        return len(self.missed) + len(self.covered_twice) + len(self.gaps)

    def moved(self, shift: Floats) -> TraceDefects:
        """Return the same places moved by ``shift`` (d,)."""
        return TraceDefects(self.missed + shift, self.missed_distances, self.covered_twice + shift, self.gaps + shift)


def trace_defects(trace: Trace, points: Floats, spacing: float) -> TraceDefects:
    """Return where the laws are broken; ``points`` (n, d) of the curve, from all over it, have to be met."""
    from scipy.spatial import KDTree

    a, b = trace.vertices[trace.segments].transpose(1, 0, 2)
    starts, stops = np.concatenate([a, trace.feet]), np.concatenate([trace.feet, b])
    number = np.arange(len(a))
    missed = points[_distances(points, starts, stops, MISSED_REACH * spacing) > MISSED_REACH * spacing]
    length = norms(b - a)
    long = np.flatnonzero(length > SHORT_SEGMENT * spacing)
    reach = np.minimum(DOUBLE_REACH * spacing, DOUBLE_SHARE * length[long])
    away = _distances(trace.feet[long], starts, stops, DOUBLE_REACH * spacing, long, np.tile(number, 2))
    degree = np.bincount(trace.segments.ravel(), minlength=len(trace.vertices))
    loose = np.setdiff1d(np.flatnonzero(degree == 1), trace.ends)
    gaps = np.unique(np.concatenate([trace.gaps, trace.vertices[loose]]), axis=0)
    return TraceDefects(missed, KDTree(trace.vertices).query(missed)[0], trace.feet[long[away < reach]], gaps)


def _distances(
    points: Floats, starts: Floats, stops: Floats, reach: float, own: Ints | None = None, of: Ints | None = None
) -> Floats:
    """Return the distances (n,) of points from the nearest chord, where there is one within ``reach``; else infinity.

    Chords ``of`` the segment that a point is ``own`` to do not count.
    """
    from scipy.spatial import KDTree

    far = 0.5 * float(norms(stops - starts).max()) + reach
    near = KDTree(points).sparse_distance_matrix(KDTree(0.5 * (starts + stops)), far, output_type="coo_matrix")
    row, chord = near.row, near.col
    if own is not None and of is not None:
        other = own[row] != of[chord]
        row, chord = row[other], chord[other]
    along, off = (stops - starts)[chord], points[row] - starts[chord]
    square = dots(along, along)
    share = np.clip(dots(off, along) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    best = np.full(len(points), np.inf)
    np.minimum.at(best, row, norms(off - share[:, None] * along))
    return best


#: Lattices on which a trace is tried until no law is broken: their side and their shift, in spacings. The shifts are
#: no simple fractions, so that sides and corners of curves do not lie in planes of the lattice.
LATTICES = (
    (1.0, (0.1723, 0.2301, 0.3119)),
    (1.0, (0.4142, 0.0677, 0.1459)),
    (0.5, (0.3371, 0.4561, 0.0823)),
    (0.5, (0.0911, 0.3723, 0.4337)),
    (0.25, (0.1723, 0.2301, 0.3119)),
)


@dataclass(frozen=True)
class CurveReport:
    """What a reader should know of a traced curve.

    Attributes
    ----------
    junctions : int
        Vertices in which three segments or more meet: junctions, crossings of a curve with itself.
    ends : int
        Ends of the curve.
    defects : BrokenLaws
        Where the trace is not what a trace has to be; nowhere, mostly.
    """

    junctions: int
    ends: int
    defects: TraceDefects


def contour_curve(source: LocalSource, spacing: float, curved: bool = True) -> tuple[SampleMesh, CurveReport]:
    """Return segments on a curve, with vertices at its ends, corners, junctions and crossings with planes of a lattice.

    Parameters
    ----------
    source : LocalSource
        A curve (m = 1) in the plane or in space. No tangents are asked of it.
    spacing : float
        h, of the form's lattice; the trace is made on lattices of its own, see ``LATTICES``.
    curved : bool
        Whether midpoints of segments are given too, on the curve.

    Raises
    ------
    ResolutionError
        If the curve lies in one cell of the first lattice.
    """
    best = None
    for side, shift in LATTICES:
        found = _traced_on(source, spacing, side * spacing, spacing * np.array(shift[: source.dim]))
        if found is None and best is None:
            raise ResolutionError(
                f"spacing={spacing:g} is too coarse for the curve: it lies in one cell of the lattice; use a smaller "
                "one."
            )
        if found is not None and (best is None or found[1].count < best[1].count):
            best = found
        if best is not None and not best[1].count:
            break
    assert best is not None
    trace, broken = best
    degree = np.bincount(trace.segments.ravel(), minlength=len(trace.vertices))
    mesh = SampleMesh.of(trace.vertices, trace.segments, trace.midpoints[:, None] if curved else None)
    return mesh, CurveReport(int((degree > 2).sum()), int((degree == 1).sum()), broken)


def _traced_on(source: LocalSource, spacing: float, side: float, shift: Floats) -> tuple[Trace, TraceDefects] | None:
    """Return the trace on the lattice with a cell centred at ``shift`` (d,); None where that has no segment."""
    shifted = replace(source, shift=source.shift + shift)
    for _, found in cell_levels(shifted, side, 0.5):
        cells = found
    crossings = knot_crossings(shifted, cells, side)
    if not len(crossings.points):
        return None
    trace = trace_of(shifted, crossings, side)
    if not len(trace.segments):
        return None
    trace = with_shared_vertices(shifted, trace, spacing)
    feet = shifted.closest_point(np.asarray(cells * side)).points
    broken = trace_defects(trace, feet, spacing)
    return trace.moved(shift), broken.moved(shift)
