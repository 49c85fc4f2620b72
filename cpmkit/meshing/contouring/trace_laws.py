"""What every trace of a curve keeps: all of the curve is met, once, and it ends where the curve does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.vectors import dots, norms
from cpmkit.meshing.contouring.trace import Trace
from cpmkit.protocols import Floats, Ints

#: Points of the curve farther than so many spacings from all segments are missed by the trace.
MISSED_REACH = 0.1
#: A middle nearer to the inside of another segment than this, in spacings and as a share of its own segment, is
#: covered twice; segments shorter than so many spacings are not looked at.
DOUBLE_REACH, DOUBLE_SHARE, SHORT_SEGMENT = 0.02, 0.1, 0.08


@dataclass(frozen=True, eq=False)
class BrokenLaws:
    """Where a trace is not what it has to be; points (k, d) each, relative to the lattice's origin.

    Attributes
    ----------
    missed : (k, d) float64
        Points of the curve with no segment near by.
    distances : (k,) float64
        How far from the nearest vertex these are.
    doubled : (k, d) float64
        Points that two segments cover.
    gaps : (k, d) float64
        Points at which the trace ends and the curve does not.
    """

    missed: Floats
    distances: Floats
    doubled: Floats
    gaps: Floats

    @property
    def count(self) -> int:
        """How many places there are."""
        return len(self.missed) + len(self.doubled) + len(self.gaps)

    def moved(self, shift: Floats) -> BrokenLaws:
        """Return the same places moved by ``shift`` (d,)."""
        return BrokenLaws(self.missed + shift, self.distances, self.doubled + shift, self.gaps + shift)


def broken_laws(trace: Trace, points: Floats, spacing: float) -> BrokenLaws:
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
    return BrokenLaws(missed, KDTree(trace.vertices).query(missed)[0], trace.feet[long[away < reach]], gaps)


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
