"""Splitting needles: triangles with one short edge and two long ones, as meshes of machine parts have them.

Halving their edges again and again would leave 3^k pieces, all as slender as the needle. They are cut across at once,
into 2^(k + 1) - 1 pieces of better shape. Where a long edge is parted is where halving parts it, and all those vertices
are made beforehand, so that triangles that come to them later find them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.grid.lattice import find
from cpmkit.mesh.edges import edges_of, edges_on_cut
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.mesh.segments import steps
from cpmkit.protocols import Floats, Ints

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


def split_needles(mesh: SampleMesh, length: float) -> tuple[SampleMesh, Halves]:
    """Return the mesh with its needles cut across in pieces as long as wide, or as ``length``, and what that halved."""
    from cpmkit.mesh import subdivision_kernels

    sides = subdivision_kernels.shortest_and_longest(mesh.vertices, np.ascontiguousarray(mesh.cells))
    least, most = sides.T
    width = np.maximum(least, length)
    needle = np.flatnonzero(most > NEEDLE_EDGES * width)
    if not len(needle):
        return mesh, Halves(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    edges = edges_of(mesh)
    lengths = edges.lengths(mesh.vertices)
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
    return _with_parted_cut(cut, parted, edges_on_cut(mesh, edges)), _halves(parted)


def _levels(shares: Floats) -> Ints:
    """Return how often edges so many times as long as wanted are halved."""
    return np.asarray(np.ceil(np.log2(np.maximum(shares, 1.0)) - ROUNDED_LEVEL), dtype=np.int64)


def _points(vertices: Floats, ends: Ints, counts: Ints) -> Floats:
    edge, place = steps(counts)
    share = ((place + 1) / (counts[edge] + 1))[:, None]
    return np.asarray((1 - share) * vertices[ends[edge, 0]] + share * vertices[ends[edge, 1]])


def _with_parted_cut(mesh: SampleMesh, parted: _Parted, on_cut: Ints) -> SampleMesh:
    """Return the mesh with the edges in ``mesh.cut`` in parts; ``on_cut`` (c,) are their numbers, -1 if none."""
    times = np.where(on_cut >= 0, 2 ** parted.levels[on_cut], 1)
    row, place = steps(times)
    edge, backward = on_cut[row], (parted.ends[on_cut, 0] != mesh.cut[:, 0])[row]
    places = np.stack([place, place + 1], axis=1)
    places = np.where(backward[:, None], times[row][:, None] - places, places)
    cut = np.stack([parted.vertex(edge, places[:, k]) for k in range(2)], axis=1)
    cut[edge < 0] = mesh.cut[row[edge < 0]]
    return replace(mesh, cut=cut, owner=mesh.owner[row], extends=mesh.extends[row])


def _halves(parted: _Parted) -> Halves:
    """Return the middles of all halves, quarters and so on of the edges."""
    codes, middles = [], []
    for level in range(int(parted.levels.max())):
        edges = np.flatnonzero(parted.levels > level)
        row, place = steps(np.full(len(edges), 2**level))
        edge = edges[row]
        step = 2 ** (parted.levels[edge] - level)
        ends = [parted.vertex(edge, (place + k) * step) for k in range(2)]
        codes.append(_code(np.stack(ends, axis=1)))
        middles.append(parted.vertex(edge, place * step + step // 2))
    order = np.argsort(np.concatenate(codes))
    return Halves(np.concatenate(codes)[order], np.concatenate(middles)[order])


def _code(ends: Ints) -> Ints:
    return np.asarray((ends.min(axis=1) << 32) | ends.max(axis=1), dtype=np.int64)
