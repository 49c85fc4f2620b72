"""Splitting cells: until no edge is long, and segments where they cross knot planes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.forms.galerkin.sample_mesh import SampleMesh
from cpmkit.forms.galerkin.samples.edges import Edges, edges_of, edges_on_cut
from cpmkit.manifold.local_source import LocalSource
from cpmkit.protocols import Bools, Floats, Ints

#: A crossing nearer to an end of its segment than this share of it, or to another crossing, is none of its own.
SAME_CROSSING_SHARE = 1e-6
#: Secant steps from the chord to the place where a curve crosses a knot plane.
CROSSING_STEPS = 6


def subdivided(mesh: SampleMesh, length: float) -> SampleMesh:
    """Return the mesh with its edges halved until none is longer than ``length``; segments are cut in equal parts.

    Neighbours share the middles of their edges. Both halves of an edge on a boundary lie on it, in its direction. The
    edges that are halved are the longest of their triangles, so that angles stay what they were.

    Parameters
    ----------
    mesh : SampleMesh
        Of flat cells.
    length : float
        In the unit of the vertices.
    """
    assert mesh.midpoints is None
    if mesh.manifold_dim == 1:
        ends = mesh.vertices[mesh.cells]
        parts = np.maximum(np.ceil(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / length), 1).astype(np.int64)
        segment = np.repeat(np.arange(len(parts)), parts - 1)
        place = np.arange(len(segment)) - (np.cumsum(parts - 1) - (parts - 1))[segment] + 1
        return _split_segments(mesh, segment, place / parts[segment])
    from cpmkit.forms.galerkin.samples import subdivision_kernels

    short = []
    while True:  # what has a long edge is split with all that share the edge; the rest is done
        long = subdivision_kernels.with_long_edges(mesh.vertices, mesh.cells, float(length))
        short.append(mesh.cells[~long])
        if not long.any():
            return replace(mesh, cells=np.concatenate(short))
        mesh = replace(mesh, cells=mesh.cells[long])
        edges = edges_of(mesh)
        long = subdivision_kernels.long_edges(mesh.vertices, edges.ends, float(length))
        mesh = halved(mesh, edges, long, mesh.vertices[edges.ends[long]].mean(axis=1))


def halved(mesh: SampleMesh, edges: Edges, chosen: Bools, points: Floats) -> SampleMesh:
    """Return triangles with the ``chosen`` of their edges (e,) halved at ``points`` (k, d), the new vertices."""
    from cpmkit.forms.galerkin.samples import subdivision_kernels

    middle = np.where(chosen, len(mesh.vertices) + np.cumsum(chosen) - 1, -1)
    vertices = np.concatenate([mesh.vertices, points])
    cells = subdivision_kernels.split(np.ascontiguousarray(mesh.cells), edges.of_cells, middle, vertices)
    on_cut = edges_on_cut(mesh, edges)
    return _with_halved_cut(replace(mesh, vertices=vertices, cells=cells), np.append(middle, -1)[on_cut])


def _with_halved_cut(mesh: SampleMesh, middle: Ints) -> SampleMesh:
    """Return the mesh with those edges on boundaries halved that have a vertex ``middle`` (c,), not -1."""
    times = np.where(middle >= 0, 2, 1)
    halved = np.flatnonzero(middle >= 0)
    cut = np.repeat(mesh.cut, times, axis=0)
    second = np.cumsum(times)[halved] - 1
    cut[second - 1, 1] = cut[second, 0] = middle[halved]
    return replace(mesh, cut=cut, owner=np.repeat(mesh.owner, times), extends=np.repeat(mesh.extends, times))


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
    segment = np.repeat(np.arange(len(times)), times)
    knot = first[segment] + np.arange(len(segment)) - (np.cumsum(times) - times)[segment]
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
        share = np.where(np.isfinite(following), np.clip(following, 0.0, 1.0), share)
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
