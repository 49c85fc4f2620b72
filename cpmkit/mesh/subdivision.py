"""Splitting cells until no edge is long."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.grid.lattice import find
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import norms
from cpmkit.mesh.mesh import Edges, Mesh
from cpmkit.types import Floats, Ints

#: A crossing nearer to an end of its segment than this share of it, or to another crossing, is none of its own.
SAME_CROSSING_SHARE = 1e-6
#: Secant steps from the chord to the place where a curve crosses a knot plane.
CROSSING_STEPS = 6


def split_equally(mesh: Mesh, length: float) -> Mesh:
    """Return segments in parts no longer than ``length``."""
    ends = mesh.vertices[mesh.cells]
    parts = np.maximum(np.ceil(norms(ends[:, 1] - ends[:, 0]) / length), 1).astype(np.int64)
    segment, place = expand_counts(parts - 1)
    return _split_segments(mesh, segment, (place + 1) / parts[segment])


def expand_counts(counts: Ints) -> tuple[Ints, Ints]:
    """Return each row as often as ``counts`` (n,) says, and how often it was returned before."""
    row = np.repeat(np.arange(len(counts)), counts)
    return row, np.arange(len(row)) - (np.cumsum(counts) - counts)[row]


def split_at_knot_planes(mesh: Mesh, spacing: float, source: LocalSource | None = None) -> Mesh:
    """Return segments that end where they cross a knot plane, x = (k + 1/2) spacing along any axis.

    Without it samples of one segment lie in several lattice cells, and the error does not fall with the spacing.

    Parameters
    ----------
    mesh : Mesh
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
    segment, place = expand_counts(times)
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


def _split_segments(mesh: Mesh, segment: Ints, share: Floats, points: Floats | None = None) -> Mesh:
    """Return the mesh with segments parted at ``share`` (n,), ascending in each; ``segment`` (n,) ascends too."""
    start, end = (mesh.vertices[mesh.cells[:, k]] for k in range(2))
    points = _at(start[segment], end[segment], share) if points is None else points
    number = len(mesh.vertices) + np.arange(len(points))
    first = np.searchsorted(segment, np.arange(len(mesh.cells)))
    parts = np.bincount(segment, minlength=len(mesh.cells))
    starts = np.insert(number, first, mesh.cells[:, 0])
    ends = np.insert(number, first + parts, mesh.cells[:, 1])
    return replace(mesh, vertices=np.concatenate([mesh.vertices, points]), cells=np.stack([starts, ends], axis=1))


#: A triangle is a needle if its longest edge is longer than so many times its shortest, and than the length wanted.
NEEDLE_EDGES = 2.0
#: Edges as many times as long as wanted as a power of two, but for rounding, need no further halving.
ROUNDED_LEVEL = 1e-9


@dataclass(frozen=True, eq=False)
class Halves:
    """Edges whose middles are vertices already: sorted codes (k,) of their ends, and the middles (k,)."""

    codes: Ints
    middles: Ints

    def of(self, ends: Ints) -> Ints:
        """Return (e,) the vertices in the middles of edges (e, 2), -1 where none is made."""
        at = find(self.codes, _code(ends))
        return np.where(at >= 0, np.append(self.middles, -1)[at], -1)


@dataclass(frozen=True, eq=False)
class _Parted:
    """Edges (e, 2) in 2^levels parts (e,); the first vertex between them is ``first`` (e,)."""

    ends: Ints
    levels: Ints
    first: Ints

    def vertex(self, edge: Ints, place: Ints) -> Ints:
        """Return (k,) the vertex at ``place`` (k,) of edges (k,), counted from their first end."""
        last = 2 ** self.levels[edge]
        inside = np.where(place == last, self.ends[edge, 1], self.first[edge] + place - 1)
        return np.asarray(np.where(place == 0, self.ends[edge, 0], inside), dtype=np.int64)


def split_needles(mesh: Mesh, length: float) -> tuple[Mesh, Halves]:
    """Return the mesh with its needles cut across in pieces as long as wide, or as ``length``, and what that halved."""
    from cpmkit.mesh import subdivision_kernels

    sides = subdivision_kernels.shortest_and_longest(mesh.vertices, np.ascontiguousarray(mesh.cells))
    least, most = sides.T
    width = np.maximum(least, length)
    needle = np.flatnonzero(most > NEEDLE_EDGES * width)
    if not len(needle):
        return mesh, Halves(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    edges = mesh.edges
    lengths = mesh.edge_lengths
    lead = lengths[edges.of_cells[needle]].argmin(axis=1)
    chains = edges.of_cells[needle[:, None], (lead[:, None] + [2, 1]) % 3]
    chosen = np.zeros(len(lengths), dtype=bool)
    chosen[chains] = True
    levels = np.where(chosen, _levels(lengths / length), 0)
    wanted = _levels(lengths[chains] / width[needle, None])
    counts = 2**levels - 1
    parted = _Parted(edges.ends, levels, len(mesh.vertices) + np.cumsum(counts) - counts)
    vertices = np.concatenate([mesh.vertices, _points(mesh.vertices, edges.ends, counts)])
    corners = np.take_along_axis(mesh.cells[needle], (lead[:, None] + np.arange(3)) % 3, 1)
    pieces = subdivision_kernels.cut_across(corners, chains, 2**wanted, edges.ends, 2**levels, parted.first, vertices)
    cells = np.concatenate([np.delete(mesh.cells, needle, axis=0), pieces])
    cut = replace(mesh, vertices=vertices, cells=cells)
    return _with_parted_cut(cut, parted, mesh.cut_edges), _halves(parted)


def _levels(shares: Floats) -> Ints:
    """Return how often edges so many times as long as wanted are halved."""
    return np.asarray(np.ceil(np.log2(np.maximum(shares, 1.0)) - ROUNDED_LEVEL), dtype=np.int64)


def _points(vertices: Floats, ends: Ints, counts: Ints) -> Floats:
    edge, place = expand_counts(counts)
    share = ((place + 1) / (counts[edge] + 1))[:, None]
    return np.asarray((1 - share) * vertices[ends[edge, 0]] + share * vertices[ends[edge, 1]])


def _with_parted_cut(mesh: Mesh, parted: _Parted, on_cut: Ints) -> Mesh:
    """Return the mesh with the edges in ``mesh.cut`` in parts; ``on_cut`` (c,) are their numbers, -1 if none."""
    times = np.where(on_cut >= 0, 2 ** parted.levels[on_cut], 1)
    row, place = expand_counts(times)
    edge, backward = on_cut[row], (parted.ends[on_cut, 0] != mesh.cut[:, 0])[row]
    places = np.stack([place, place + 1], axis=1)
    places = np.where(backward[:, None], times[row][:, None] - places, places)
    cut = np.stack([parted.vertex(edge, places[:, k]) for k in range(2)], axis=1)
    cut[edge < 0] = mesh.cut[row[edge < 0]]
    return replace(mesh, cut=cut, owner=mesh.owner[row], beyond_tip=mesh.beyond_tip[row])


def _halves(parted: _Parted) -> Halves:
    """Return the middles of all halves, quarters and so on of the edges."""
    codes, middles = [], []
    for level in range(int(parted.levels.max())):
        edges = np.flatnonzero(parted.levels > level)
        row, place = expand_counts(np.full(len(edges), 2**level))
        edge = edges[row]
        step = 2 ** (parted.levels[edge] - level)
        ends = [parted.vertex(edge, (place + k) * step) for k in range(2)]
        codes.append(_code(np.stack(ends, axis=1)))
        middles.append(parted.vertex(edge, place * step + step // 2))
    order = np.argsort(np.concatenate(codes))
    return Halves(np.concatenate(codes)[order], np.concatenate(middles)[order])


def _code(ends: Ints) -> Ints:
    return np.asarray((ends.min(axis=1) << 32) | ends.max(axis=1), dtype=np.int64)


#: An edge is long if it is longer than wanted by more than this share: more than what needles leave unparted, so that
#: the triangles on both sides of an edge agree whether a half of it is long.
SAME_LENGTH_SHARE = 1e-8


def subdivide(mesh: Mesh, length: float) -> Mesh:
    """Return the mesh with its edges halved until none is longer than ``length``; segments are cut in equal parts.

    Neighbours share the middles of their edges. Both halves of an edge on a boundary lie on it, in its direction. The
    edges that are halved are the longest of their triangles, so that angles stay what they were.

    Parameters
    ----------
    mesh : Mesh
        Of flat cells.
    length : float
        In the unit of the vertices.
    """
    assert mesh.midpoints is None
    if mesh.manifold_dim == 1:
        return split_equally(mesh, length)
    from cpmkit.mesh import subdivision_kernels

    mesh, halves = split_needles(mesh, length)
    longest = float(length) * (1 + SAME_LENGTH_SHARE)
    short: list[Ints] = []
    while True:  # what has a long edge is split with all that share the edge; the rest is done
        long = subdivision_kernels.with_long_edges(mesh.vertices, mesh.cells, longest)
        if not short and not long.any():
            return mesh  # these very cells: what is kept of them serves again
        short.append(mesh.cells[~long])
        if not long.any():
            return replace(mesh, cells=np.concatenate(short))
        mesh = replace(mesh, cells=mesh.cells[long])
        edges = mesh.edges
        middle = np.full(len(edges.ends), -1)
        long = subdivision_kernels.long_edges(mesh.vertices, edges.ends, longest)
        middle[long] = halves.of(edges.ends[long])
        new = long & (middle < 0)
        middle[new] = len(mesh.vertices) + np.arange(new.sum())
        mesh = halve_edges(mesh, middle, mesh.vertices[edges.ends[new]].mean(axis=1))


def halve_edges(mesh: Mesh, middle: Ints, points: Floats) -> Mesh:
    """Return triangles with their edges halved at the vertices ``middle`` (e,), -1 where one stays whole.

    ``points`` (k, d) are those vertices that the mesh does not have yet.
    """
    from cpmkit.mesh import subdivision_kernels

    vertices = np.concatenate([mesh.vertices, points])
    cells = subdivision_kernels.split(np.ascontiguousarray(mesh.cells), mesh.edges.of_cells, middle, vertices)
    on_cut = mesh.cut_edges
    return _with_halved_cut(replace(mesh, vertices=vertices, cells=cells), np.append(middle, -1)[on_cut])


def _with_halved_cut(mesh: Mesh, middle: Ints) -> Mesh:
    """Return the mesh with those edges on boundaries halved that have a vertex ``middle`` (c,), not -1."""
    times = np.where(middle >= 0, 2, 1)
    halved = np.flatnonzero(middle >= 0)
    cut = np.repeat(mesh.cut, times, axis=0)
    second = np.cumsum(times)[halved] - 1
    cut[second - 1, 1] = cut[second, 0] = middle[halved]
    return replace(mesh, cut=cut, owner=np.repeat(mesh.owner, times), beyond_tip=np.repeat(mesh.beyond_tip, times))


def inherit_shares(edges: Edges, middle: Ints, share: Floats, of: Edges) -> Floats:
    """Return the shares of the edges ``of`` a mesh whose ``edges``, with each its ``share`` (e,), were halved.

    Both halves of an edge have its share, an edge between two middles that of the edge it is parallel to, one from a
    middle to the opposite corner the lesser of those of the two other edges there.
    """
    if (share == 1.0).all():
        return np.ones(len(of.ends))
    whole = np.flatnonzero(middle >= 0)
    first = int(middle[whole].min(initial=of.ends.max() + 1))
    parent = edges.ends[whole[np.argsort(middle[whole])]]  # (k, 2) of the vertices from ``first`` on
    count = np.int64(first)
    low, high = np.sort(edges.ends, axis=1).T
    order = np.argsort(low * count + high)
    codes = (low * count + high)[order]

    def between(one: Ints, other: Ints) -> Floats:
        """Return the share of the edge between each vertex and another."""
        return share[order[np.searchsorted(codes, np.minimum(one, other) * count + np.maximum(one, other))]]

    low, high = np.sort(of.ends, axis=1).T  # vertices that were added have the highest numbers
    found = np.empty(len(low))
    new = (low >= first).astype(int) + (high >= first)
    found[new == 0] = between(low[new == 0], high[new == 0])
    corner, ends = low[new == 1], parent[high[new == 1] - first]
    is_half = (ends == corner[:, None]).any(axis=1)
    across = np.where(is_half[:, None], ends, corner[:, None])
    found[new == 1] = np.minimum(between(across[:, 0], ends[:, 1]), between(across[:, 1], ends[:, 0]))
    one, other = parent[low[new == 2] - first], parent[high[new == 2] - first]
    shared = np.where((one[:, :1] == other).any(axis=1), one[:, 0], one[:, 1])
    found[new == 2] = between(one.sum(axis=1) - shared, other.sum(axis=1) - shared)
    return found
