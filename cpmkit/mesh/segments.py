"""Segments in parts: of equal length, and where a curve crosses knot planes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import norms
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.protocols import Floats, Ints

#: A crossing nearer to an end of its segment than this share of it, or to another crossing, is none of its own.
SAME_CROSSING_SHARE = 1e-6
#: Secant steps from the chord to the place where a curve crosses a knot plane.
CROSSING_STEPS = 6


def in_equal_parts(mesh: SampleMesh, length: float) -> SampleMesh:
    """Return segments in parts no longer than ``length``."""
    ends = mesh.vertices[mesh.cells]
    parts = np.maximum(np.ceil(norms(ends[:, 1] - ends[:, 0]) / length), 1).astype(np.int64)
    segment, place = steps(parts - 1)
    return _split_segments(mesh, segment, (place + 1) / parts[segment])


def steps(counts: Ints) -> tuple[Ints, Ints]:
    """Return each row as often as ``counts`` (n,) says, and how often it was returned before."""
    row = np.repeat(np.arange(len(counts)), counts)
    return row, np.arange(len(row)) - (np.cumsum(counts) - counts)[row]


def split_at_knots(mesh: SampleMesh, spacing: float, source: LocalSource | None = None) -> SampleMesh:
    """Return segments that end where they cross a knot plane, x = (k + 1/2) spacing along any axis.

    Without it samples of one segment lie in several lattice cells, and the error does not fall with the spacing.

    Parameters
    ----------
    mesh : SampleMesh
        Flat segments.
    spacing : float
        h, in the unit of the vertices.
    source : LocalSource, optional
        The curve: crossings are those of the curve, not of its chords.
    """
    assert mesh.midpoints is None
    assert mesh.manifold_dim == 1
    start, end = (mesh.vertices[mesh.cells[:, k]] for k in range(2))
    found = [_crossings(start[:, axis] / spacing, end[:, axis] / spacing) for axis in range(mesh.dim)]
    axis = np.repeat(np.arange(mesh.dim), [len(segment) for segment, _, _ in found])
    segment, share, knot = (np.concatenate([one[k] for one in found]) for k in range(3))
    plane = spacing * (knot + 0.5)
    if source is not None:
        share = _on_curve(source, start[segment], end[segment], axis, plane, share)
    order = np.lexsort((share, segment))
    segment, share, axis, plane = segment[order], share[order], axis[order], plane[order]
    again = (np.diff(segment, prepend=-1) == 0) & (np.diff(share, prepend=-1.0) < SAME_CROSSING_SHARE)
    kept = ~again & (share > SAME_CROSSING_SHARE) & (share < 1 - SAME_CROSSING_SHARE)
    segment, share, axis, plane = segment[kept], share[kept], axis[kept], plane[kept]
    points = _at(start[segment], end[segment], share)
    if source is not None:
        points = source.closest_point(points).points
    points[np.arange(len(points)), axis] = plane
    return _split_segments(mesh, segment, share, points)


def _crossings(start: Floats, end: Floats) -> tuple[Ints, Floats, Ints]:
    """Return the segments that cross half-integers k + 1/2 between two coordinates (m,), the share of the way, and k.

    A segment is listed as often as it crosses one.
    """
    low, high = np.minimum(start, end), np.maximum(start, end)
    first, last = np.ceil(low - 0.5).astype(np.int64), np.floor(high - 0.5).astype(np.int64)
    times = np.where(high > low, np.maximum(last - first + 1, 0), 0)
    segment, place = steps(times)
    knot = first[segment] + place
    return segment, (knot + 0.5 - start[segment]) / (end - start)[segment], knot


def _on_curve(source: LocalSource, start: Floats, end: Floats, axis: Ints, plane: Floats, share: Floats) -> Floats:
    """Return the shares (n,) of chords whose feet on the curve lie in planes across ``axis``, from those of chords."""
    row = np.arange(len(share))
    before, missed_before = np.zeros(len(share)), plane - start[row, axis]
    for _ in range(CROSSING_STEPS):
        missed = plane - source.closest_point(_at(start, end, share)).points[row, axis]
        with np.errstate(all="ignore"):
            following = share + missed * (share - before) / (missed_before - missed)
        before, missed_before = share, missed
        moving = np.isfinite(following) & (np.abs(missed) > source.noise)
        share = np.where(moving, np.clip(following, 0.0, 1.0), share)
    return share


def _at(start: Floats, end: Floats, share: Floats) -> Floats:
    return start + share[:, None] * (end - start)


def _split_segments(mesh: SampleMesh, segment: Ints, share: Floats, points: Floats | None = None) -> SampleMesh:
    """Return the mesh with segments parted at ``share`` (n,), ascending in each; ``segment`` (n,) ascends too."""
    start, end = (mesh.vertices[mesh.cells[:, k]] for k in range(2))
    points = _at(start[segment], end[segment], share) if points is None else points
    number = len(mesh.vertices) + np.arange(len(points))
    first = np.searchsorted(segment, np.arange(len(mesh.cells)))
    parts = np.bincount(segment, minlength=len(mesh.cells))
    starts = np.insert(number, first, mesh.cells[:, 0])
    ends = np.insert(number, first + parts, mesh.cells[:, 1])
    return replace(mesh, vertices=np.concatenate([mesh.vertices, points]), cells=np.stack([starts, ends], axis=1))
