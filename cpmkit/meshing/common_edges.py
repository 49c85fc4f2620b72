"""Two surfaces of quadratic triangles with common vertices and edges along the curves (chains) where they meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.grid.lattice import find_codes
from cpmkit.manifold.vector_algebra import norms
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.contouring.curve_graph import near_chords
from cpmkit.meshing.quadratic_surface import edge_midpoints, edge_numbers, split_edges, with_edge_midpoints
from cpmkit.runtime.index_sets import connected_components
from cpmkit.types import Floats, Ints

#: Vertices of two chains are the same if they are nearer than this share of an edge.
SAME_VERTEX_SHARE = 0.3
#: A point of one chain belongs to the other if it is nearer than this share of the longest edge of both.
SAME_CHAIN_SHARE = 0.3


@dataclass(frozen=True, eq=False)
class ChainedMeshes:
    """Two meshes with the same vertices and edges where they meet."""

    base: Mesh
    parent: Ints  #: (m,): the original triangle of the base that contains each triangle.
    other: Mesh
    other_parent: Ints  #: (n,): the same for the other mesh.
    number: Ints  #: (v,): the vertex of the base that each vertex of the other mesh is, -1 for none.
    chain: Ints  #: (k, 2): the common edges, by vertices of the other mesh.


def match_chains(base: Mesh, base_chain: Ints, other: Mesh, chain: Ints) -> ChainedMeshes | Floats:
    """Return two meshes in which the edges ``chain`` (k, 2) of the ``other`` mesh are edges of the ``base`` too.

    ``base_chain`` (n, 2) are the edges of the base along the same curves; both chains are split at each other's
    vertices. If the chains follow different curves, points (k, 3) where they differ are returned instead.
    """
    parent, other_parent = np.arange(len(base.cells)), np.arange(len(other.cells))
    number = _same_vertices(base, base_chain, other, np.unique(chain))
    while len(free := np.setdiff1d(chain, np.flatnonzero(number >= 0))):
        edge, share = _nearest_edges(other.vertices[free], base, base_chain)
        if (edge < 0).any():
            return np.asarray(other.vertices[free[edge < 0]])
        rows = first_of_each(edge, np.abs(share - 0.5))
        number[free[rows]] = len(base.vertices) + np.arange(len(rows))
        base, base_chain, parts = _split_chain(base, base_chain, edge[rows], share[rows])
        parent = parent[parts]
    while True:
        missing = np.flatnonzero(edge_numbers(base, number[chain]) < 0)
        edge, vertex = _vertices_between(base, base_chain, number[chain[missing]], number)
        if not len(edge):
            break
        ends = base.vertices[number[chain[missing[edge]]]]
        before, after = norms(base.vertices[vertex, None] - ends).T
        share = before / (before + after)
        rows = first_of_each(edge, np.abs(share - 0.5))
        other, chain, parts = _split_chain(other, chain, missing[edge[rows]], share[rows])
        other_parent, number = other_parent[parts], np.concatenate([number, vertex[rows]])
    if len(missing):
        return np.asarray(other.vertices[chain[missing, 0]])
    return ChainedMeshes(base, parent, _with_chain_of(other, chain, number, base), other_parent, number, chain)


def _same_vertices(base: Mesh, base_chain: Ints, other: Mesh, vertices: Ints) -> Ints:
    """Return the vertex of the ``base_chain`` at the same place as each vertex (v,) of the other mesh, -1 for none.

    Only the ``vertices`` (k,) can have one. A vertex of the base is matched with the nearest of them.
    """
    number = np.full(len(other.vertices), -1)
    edge, share = _nearest_edges(other.vertices[vertices], base, base_chain)
    away = np.minimum(share, 1 - share)
    near = np.flatnonzero((edge >= 0) & (away < SAME_VERTEX_SHARE))
    same = base_chain[edge[near], (share[near] > 0.5).astype(int)]
    rows = first_of_each(same, away[near])
    number[vertices[near[rows]]] = same[rows]
    return number


def _vertices_between(base: Mesh, base_chain: Ints, ends: Ints, number: Ints) -> tuple[Ints, Ints]:
    """Return rows (k,) of ``ends`` (n, 2), and vertices (k,) of the ``base_chain`` between the two ends of the row.

    ``ends`` are pairs of vertices of the base that have a match in the other mesh, as all vertices in ``number`` (v,)
    have; the vertices between have none.
    """
    is_taken = np.zeros(len(base.vertices), dtype=bool)
    is_taken[number[number >= 0]] = True
    taken = is_taken[base_chain]
    _, label = connected_components(len(base.vertices), base_chain[~taken.any(axis=1)])
    link = base_chain[taken.sum(axis=1) == 1]
    is_first = is_taken[link[:, 0]]
    at, free = np.where(is_first, link[:, 0], link[:, 1]), np.where(is_first, link[:, 1], link[:, 0])
    order = np.lexsort((at, label[free]))
    at, part = at[order], label[free][order]
    twice = np.flatnonzero(part[1:] == part[:-1])
    twice = twice[np.bincount(part, minlength=len(base.vertices))[part[twice]] == 2]
    pairs = np.sort(np.stack([at[twice], at[twice + 1]], axis=1), axis=1)
    codes, first = np.unique(pairs[:, 0] * len(base.vertices) + pairs[:, 1], return_index=True)
    wanted = np.sort(ends, axis=1)
    found = find_codes(codes, wanted[:, 0] * len(base.vertices) + wanted[:, 1])
    rows = np.flatnonzero(found >= 0)
    of_part = np.full(len(base.vertices), -1)
    of_part[part[twice[first[found[rows]]]]] = rows
    v = np.setdiff1d(np.unique(base_chain), number)
    v = v[of_part[label[v]] >= 0]
    return of_part[label[v]], v


def _with_chain_of(other: Mesh, chain: Ints, number: Ints, base: Mesh) -> Mesh:
    """Return the ``other`` mesh with the vertices and midpoints of its ``chain`` (k, 2) at those of the ``base``."""
    vertices, at = other.vertices.copy(), np.flatnonzero(number >= 0)
    vertices[at] = base.vertices[number[at]]
    shift = (vertices - other.vertices)[other.edges.ends].sum(axis=1) / 2
    midpoints = edge_midpoints(other) + shift
    midpoints[edge_numbers(other, chain)] = edge_midpoints(base)[edge_numbers(base, number[chain])]
    return with_edge_midpoints(other.with_same_cells(vertices=vertices), midpoints)


def _nearest_edges(points: Floats, mesh: Mesh, chain: Ints) -> tuple[Ints, Floats]:
    """Return the row (n,) of the edge of a ``chain`` (k, 2) nearest to each point, and the share (n,); -1 if far."""
    a, b = mesh.vertices[chain].transpose(1, 0, 2)
    edge, share = np.full(len(points), -1), np.zeros(len(points))
    if not len(points) or not len(chain):
        return edge, share
    reach = SAME_CHAIN_SHARE * float(norms(b - a).max())
    row, chord, distance, at = near_chords(points, a, b, reach)
    order = np.lexsort((distance, row))
    order = order[distance[order] <= reach]
    best = order[np.unique(row[order], return_index=True)[1]]
    edge[row[best]], share[row[best]] = chord[best], at[best]
    return edge, share


def first_of_each(edge: Ints, rank: Floats) -> Ints:
    """Return, for each number that occurs in ``edge`` (n,), the row with the least ``rank`` (n,)."""
    order = np.lexsort((rank, edge))
    return order[np.unique(edge[order], return_index=True)[1]]


def _split_chain(mesh: Mesh, chain: Ints, rows: Ints, shares: Floats) -> tuple[Mesh, Ints, Ints]:
    """Return the mesh with edges ``rows`` (k,) of a ``chain`` split, the chain, and the parents (m,) of triangles.

    They are split at ``shares`` (k,) of their lengths, which are limited to keep off the ends.
    """
    new, least = len(mesh.vertices) + np.arange(len(rows)), SAME_VERTEX_SHARE / 2
    split, parent = split_edges(mesh, chain[rows], np.clip(shares, least, 1 - least))
    halves = [np.stack([chain[rows, 0], new], axis=1), np.stack([new, chain[rows, 1]], axis=1)]
    return split, np.concatenate([np.delete(chain, rows, axis=0), *halves]), parent
