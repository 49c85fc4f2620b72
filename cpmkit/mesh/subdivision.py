"""Subdivision until no edge is long: segments in equal parts and at knot planes, triangles by halving their edges.

Needles are triangles with one short edge and two long ones, as in meshes of machine parts. Halving k times would leave
3^k pieces as slender as the needle; needles are cut across at once into 2^(k + 1) - 1 pieces of better shape. Their
long edges are divided where halving would divide them, and all these vertices are created beforehand, so that
neighbouring triangles, which are halved later, use the same vertices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cpmkit.grid.lattice import find_codes
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots
from cpmkit.mesh.mesh import Edges, Mesh
from cpmkit.types import Bools, Floats, Ints

#: An edge is long if it is longer than ``length`` by more than this share: more than the tolerance for needles, so that
#: the triangles on both sides of an edge agree whether a half of it is long.
SAME_LENGTH_SHARE = 1e-8
#: A triangle is a needle if its longest edge is longer than so many times its shortest edge and the wanted length.
NEEDLE_EDGES = 2.0
#: Rounding of the logarithm to base 2 of an edge's length over the wanted one: no further halving for a rounding.
ROUNDED_LEVEL = 1e-9
#: Crossings nearer to an end of their segment, or to each other, than this share of it are omitted.
SAME_CROSSING_SHARE = 1e-6


def subdivide(mesh: Mesh, length: float) -> Mesh:
    """Return the mesh with no edge longer than ``length``: triangles by halving edges, segments in equal parts.

    Neighbours share the midpoints of edges. Both halves of an edge on a boundary lie on the boundary, in its direction.
    Needles are cut across first; then all edges that are too long are halved at once, until none is left.
    ``mesh``: flat cells. ``length``: longest edge, in the unit of the vertices.
    """
    assert mesh.midpoints is None
    if mesh.manifold_dim == 1:
        ends = mesh.vertices[mesh.cells]
        parts = np.maximum(np.ceil(mesh.edge_lengths / length), 1).astype(np.int64)
        segment, place = expand_counts(parts - 1)
        share = (place + 1) / parts[segment]
        return split_segments(mesh, segment, _interpolate(ends[segment, 0], ends[segment, 1], share))
    mesh, halves = split_needles(mesh, length)
    longest = float(length) * (1 + SAME_LENGTH_SHARE)
    return halve_long_edges(mesh, lambda mesh: mesh.edge_lengths > longest, halves)


def halve_long_edges(mesh: Mesh, is_long: Callable[[Mesh], Bools], halves: tuple[Ints, Ints] | None = None) -> Mesh:
    """Return the triangles with edges halved at their midpoints until ``is_long`` marks no edge (e,) of the mesh.

    ``halves`` are edges whose midpoints are vertices of the mesh already, because a needle beside them was cut: the
    ascending codes (k,) of the edges (:func:`_edge_codes`), and their midpoints (k,).
    """
    while (long := is_long(mesh)).any():
        ends = mesh.edges.ends
        middle = np.full(len(ends), -1)
        if halves is not None:
            at = find_codes(halves[0], _edge_codes(ends[long]))
            middle[long] = np.where(at >= 0, np.append(halves[1], -1)[at], -1)
        new = long & (middle < 0)
        middle[new] = len(mesh.vertices) + np.arange(new.sum())
        mesh = halve_edges(mesh, middle, mesh.vertices[ends[new]].mean(axis=1))
    return mesh


def halve_edges(mesh: Mesh, middle: Ints, points: Floats) -> Mesh:
    """Return the mesh of flat triangles with chosen edges halved, and with them the facets on boundaries.

    ``middle`` (e,): the vertex at the midpoint of each edge, -1 for edges that stay whole.
    ``points`` (k, d): positions of the new vertices: the vertices in ``middle`` that the mesh does not have yet.
    """
    from cpmkit.mesh import mesh_kernels

    vertices = np.concatenate([mesh.vertices, points])
    cells = mesh_kernels.split_triangles(np.ascontiguousarray(mesh.cells), mesh.edges.of_cells, middle, vertices)
    middle_of_cut = np.append(middle, -1)[mesh.cut_edges]
    times = np.where(middle_of_cut >= 0, 2, 1)
    is_halved = np.flatnonzero(middle_of_cut >= 0)
    cut = np.repeat(mesh.cut, times, axis=0)
    second = np.cumsum(times)[is_halved] - 1
    cut[second - 1, 1] = cut[second, 0] = middle_of_cut[is_halved]
    owner, beyond_tip = np.repeat(mesh.owner, times), np.repeat(mesh.beyond_tip, times)
    return Mesh(vertices, cells, mesh.midpoints, cut, owner, beyond_tip)


def inherit_shares(edges: Edges, middle: Ints, share: Floats, of: Edges) -> Floats:
    """Return the height factor (f,) of each edge (:attr:`~cpmkit.mesh.mesh.CurvatureSupport.share`) after halving.

    Both halves of an edge have its factor. An edge between two midpoints has the factor of the edge to which it is
    parallel, an edge from a midpoint to the opposite corner the lesser of the factors of the two edges at that corner.
    ``edges``, ``of``: the edges before and after halving. ``share`` (e,): the factors before.
    ``middle`` (e,): the vertex at the midpoint of each edge, -1 if it stayed whole; these follow the old vertices.
    """
    if (share == 1.0).all():
        return np.ones(len(of.ends))
    halved = np.flatnonzero(middle >= 0)
    first = int(middle[halved].min(initial=of.ends.max() + 1))
    parent = edges.ends[halved[np.argsort(middle[halved])]]  # (k, 2) of the vertices from ``first`` on
    count = np.int64(first)
    low, high = np.sort(edges.ends, axis=1).T
    order = np.argsort(low * count + high)
    codes = (low * count + high)[order]

    def between(a: Ints, b: Ints) -> Floats:
        """Return the shares of the edges between vertices a and b."""
        return share[order[np.searchsorted(codes, np.minimum(a, b) * count + np.maximum(a, b))]]

    low, high = np.sort(of.ends, axis=1).T  # new vertices have the highest numbers
    inherited = np.empty(len(low))
    new = (low >= first).astype(int) + (high >= first)
    inherited[new == 0] = between(low[new == 0], high[new == 0])
    corner, ends = low[new == 1], parent[high[new == 1] - first]
    is_half = (ends == corner[:, None]).any(axis=1)
    across = np.where(is_half[:, None], ends, corner[:, None])
    inherited[new == 1] = np.minimum(between(across[:, 0], ends[:, 1]), between(across[:, 1], ends[:, 0]))
    a, b = parent[low[new == 2] - first], parent[high[new == 2] - first]
    shared = np.where((a[:, :1] == b).any(axis=1), a[:, 0], a[:, 1])
    inherited[new == 2] = between(a.sum(axis=1) - shared, b.sum(axis=1) - shared)
    return inherited


@dataclass(frozen=True, eq=False)
class _DividedEdges:
    """Edges divided into equal parts, with consecutive numbers of the vertices between the parts."""

    ends: Ints  #: (e, 2)
    levels: Ints  #: (e,): each edge has 2^levels parts.
    first: Ints  #: (e,): the first of the vertices between the parts.

    def vertex(self, edge: Ints, place: Ints) -> Ints:
        """Return the vertices (k,) at ``place`` (k,) of edges ``edge`` (k,), in parts counted from the first end."""
        last = 2 ** self.levels[edge]
        inside = np.where(place == last, self.ends[edge, 1], self.first[edge] + place - 1)
        return np.asarray(np.where(place == 0, self.ends[edge, 0], inside), dtype=np.int64)

    def halvings(self) -> tuple[Ints, Ints]:
        """Return ascending codes (:func:`_edge_codes`) and midpoint vertices, both (k,), of divided edges."""
        codes, midpoints = [], []
        for level in range(int(self.levels.max())):
            edges = np.flatnonzero(self.levels > level)
            row, place = expand_counts(np.full(len(edges), 2**level))
            edge = edges[row]
            step = 2 ** (self.levels[edge] - level)
            ends = [self.vertex(edge, (place + k) * step) for k in range(2)]
            codes.append(_edge_codes(np.stack(ends, axis=1)))
            midpoints.append(self.vertex(edge, place * step + step // 2))
        order = np.argsort(np.concatenate(codes))
        return np.concatenate(codes)[order], np.concatenate(midpoints)[order]


def split_needles(mesh: Mesh, length: float) -> tuple[Mesh, tuple[Ints, Ints] | None]:
    """Return the mesh with needles cut across, and the edges that this halved, as :func:`halve_long_edges` takes them.

    The length of a piece is between half and all of the larger of ``length`` and the needle's short edge. If there is
    no needle, the mesh and None are returned.
    """
    from cpmkit.mesh import mesh_kernels

    lengths_of_cells = mesh.lengths_of_cells
    width = np.maximum(lengths_of_cells.min(axis=1), length)
    needles = np.flatnonzero(lengths_of_cells.max(axis=1) > NEEDLE_EDGES * width)
    if not len(needles):
        return mesh, None
    edges, lengths = mesh.edges, mesh.edge_lengths
    tip = lengths_of_cells[needles].argmin(axis=1)
    long_sides = edges.of_cells[needles[:, None], (tip[:, None] + [2, 1]) % 3]
    is_divided = np.zeros(len(lengths), dtype=bool)
    is_divided[long_sides] = True
    levels = np.where(is_divided, _halving_counts(lengths / length), 0)
    parts = 2 ** _halving_counts(lengths[long_sides] / width[needles, None])
    counts = 2**levels - 1
    divided = _DividedEdges(edges.ends, levels, len(mesh.vertices) + np.cumsum(counts) - counts)
    edge, place = expand_counts(counts)
    share = ((place + 1) / (counts[edge] + 1))[:, None]
    between = (1 - share) * mesh.vertices[edges.ends[edge, 0]] + share * mesh.vertices[edges.ends[edge, 1]]
    vertices = np.concatenate([mesh.vertices, between])
    corners = np.take_along_axis(mesh.cells[needles], (tip[:, None] + np.arange(3)) % 3, 1)
    pieces = mesh_kernels.cut_needles(corners, long_sides, parts, edges.ends, 2**levels, divided.first, vertices)
    cells = np.concatenate([np.delete(mesh.cells, needles, axis=0), pieces])
    split = replace(mesh, vertices=vertices, cells=cells)
    return _divide_boundary_facets(split, divided, mesh.cut_edges), divided.halvings()


def _divide_boundary_facets(mesh: Mesh, divided: _DividedEdges, on_cut: Ints) -> Mesh:
    """Return the mesh with the facets in ``mesh.cut`` divided; ``on_cut`` (c,) are their edges, -1 if no edge."""
    times = np.where(on_cut >= 0, 2 ** divided.levels[on_cut], 1)
    row, place = expand_counts(times)
    edge, is_backward = on_cut[row], (divided.ends[on_cut, 0] != mesh.cut[:, 0])[row]
    places = np.stack([place, place + 1], axis=1)
    places = np.where(is_backward[:, None], times[row][:, None] - places, places)
    cut = np.stack([divided.vertex(edge, places[:, k]) for k in range(2)], axis=1)
    cut[edge < 0] = mesh.cut[row[edge < 0]]
    return replace(mesh, cut=cut, owner=mesh.owner[row], beyond_tip=mesh.beyond_tip[row])


def _halving_counts(ratios: Floats) -> Ints:
    """Return the numbers (e,) of halvings that edges with these ``ratios`` (e,) to the wanted length need."""
    return np.asarray(np.ceil(np.log2(np.maximum(ratios, 1.0)) - ROUNDED_LEVEL), dtype=np.int64)


def _edge_codes(ends: Ints) -> Ints:
    """Return an integer (e,) that identifies each of the edges ``ends`` (e, 2), whatever its direction."""
    return np.asarray((ends.min(axis=1) << 32) | ends.max(axis=1), dtype=np.int64)


def expand_counts(counts: Ints) -> tuple[Ints, Ints]:
    """Return the numbers (r,) of n items, each repeated ``counts`` (n,) times, and the rank (r,) of each from 0."""
    row = np.repeat(np.arange(len(counts)), counts)
    return row, np.arange(len(row)) - (np.cumsum(counts) - counts)[row]


def split_at_knot_planes(mesh: Mesh, spacing: float, source: LocalSource | None = None) -> Mesh:
    """Return the mesh with segments split at the knot planes of the splines, x = (k + 1/2) spacing along any axis.

    Without splits the samples of a segment would lie in several lattice cells, and errors would not fall with the
    spacing.

    ``mesh``: flat segments. ``spacing``: h, in the unit of the vertices.
    ``source``: the curve: if given, the split points are where the curve crosses the planes, else where its chords do.
    """
    assert mesh.midpoints is None
    assert mesh.manifold_dim == 1
    start, end = (mesh.vertices[mesh.cells[:, k]] for k in range(2))
    crossings = [_half_integer_crossings(start[:, axis] / spacing, end[:, axis] / spacing) for axis in range(mesh.dim)]
    axis = np.repeat(np.arange(mesh.dim), [len(segment) for segment, _, _ in crossings])
    segment, share, knot = (np.concatenate(parts) for parts in zip(*crossings, strict=True))
    plane = spacing * (knot + 0.5)
    if source is not None:
        share = _shares_on_curve(source, start[segment], end[segment], axis, plane, share)
    order = np.lexsort((share, segment))
    segment, share, axis, plane = segment[order], share[order], axis[order], plane[order]
    repeated = (np.diff(segment, prepend=-1) == 0) & (np.diff(share, prepend=-1.0) < SAME_CROSSING_SHARE)
    valid = ~repeated & (share > SAME_CROSSING_SHARE) & (share < 1 - SAME_CROSSING_SHARE)
    segment, share, axis, plane = segment[valid], share[valid], axis[valid], plane[valid]
    points = _interpolate(start[segment], end[segment], share)
    if source is not None:
        points = source.closest_point(points).points
    points[np.arange(len(points)), axis] = plane
    return split_segments(mesh, segment, points)


def _half_integer_crossings(start: Floats, end: Floats) -> tuple[Ints, Floats, Ints]:
    """Return the crossings of segments with half-integers k + 1/2: segment, share of its length, and k, each (n,).

    ``start`` and ``end`` (m,) are coordinates of the segments' ends along one axis, in spacings.
    """
    low, high = np.minimum(start, end), np.maximum(start, end)
    first, last = np.ceil(low - 0.5).astype(np.int64), np.floor(high - 0.5).astype(np.int64)
    segment, place = expand_counts(np.where(high > low, np.maximum(last - first + 1, 0), 0))
    knot = first[segment] + place
    return segment, (knot + 0.5 - start[segment]) / (end - start)[segment], knot


def _shares_on_curve(
    source: LocalSource, start: Floats, end: Floats, axis: Ints, plane: Floats, share: Floats
) -> Floats:
    """Return the share (n,) of each chord at which its closest point on the curve lies in a plane, by secants.

    A plane is where coordinate ``axis`` (n,) equals ``plane`` (n,). The iteration starts from ``share`` (n,), where the
    chords from ``start`` to ``end`` (n, d) cross the planes.
    """
    row = np.arange(len(share))
    before, error_before = np.zeros(len(share)), plane - start[row, axis]
    for _ in range(6):
        error = plane - source.closest_point(_interpolate(start, end, share)).points[row, axis]
        with np.errstate(all="ignore"):
            following = share + error * (share - before) / (error_before - error)
        before, error_before = share, error
        improves = np.isfinite(following) & (np.abs(error) > source.noise)
        share = np.where(improves, np.clip(following, 0.0, 1.0), share)
    return share


def _interpolate(start: Floats, end: Floats, share: Floats) -> Floats:
    """Return the points (n, d) at the ``share`` (n,) of the way from ``start`` to ``end``, both (n, d)."""
    return start + share[:, None] * (end - start)


def split_segments(mesh: Mesh, segment: Ints, points: Floats) -> Mesh:
    """Return the mesh with each ``segment`` (n,) split at one of ``points`` (n, d); a segment may occur repeatedly."""
    new = len(mesh.vertices) + np.arange(len(points))
    cells = divide_segments(mesh.vertices, mesh.cells, segment, new, points)
    return replace(mesh, vertices=np.concatenate([mesh.vertices, points]), cells=cells)


def divide_segments(vertices: Floats, segments: Ints, segment: Ints, new: Ints, points: Floats) -> Ints:
    """Return segments (s, 2) between ``vertices`` (v, d), some split.

    The segments numbered ``segment`` (k,) are split at the new vertices ``new`` (k,) at ``points`` (k, d).
    """
    a, b = vertices[segments[segment]].transpose(1, 0, 2)
    order = np.lexsort((dots(points - a, b - a) / dots(b - a, b - a), segment))
    segment, new = segment[order], new[order]
    first = np.searchsorted(segment, np.arange(len(segments)))
    parts = np.bincount(segment, minlength=len(segments))
    return np.stack([np.insert(new, first, segments[:, 0]), np.insert(new, first + parts, segments[:, 1])], axis=1)
