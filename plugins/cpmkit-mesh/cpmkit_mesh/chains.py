"""Edges of a mesh ordered to chains, which end where a number of edges other than two meet, and loops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class Chains:
    """Paths along edges, one after the other, the longest first.

    Attributes
    ----------
    vertices : (k,) int64
        The vertices along each chain; a vertex where several chains meet is in each of them. A closed chain does not
        repeat its first vertex.
    chain : (k,) int64
        The number of the chain of each entry of ``vertices``, ascending.
    closed : (c,) bool
        Whether each chain leads back to its first vertex.
    """

    vertices: Ints
    chain: Ints
    closed: Bools

    def __len__(self) -> int:
        return len(self.closed)

    def take(self, number: int) -> Chains:
        """Return chain ``number`` alone."""
        vertices = self.vertices[self.chain == number]
        return Chains(vertices, np.zeros(len(vertices), dtype=np.int64), self.closed[[number]])

    def segments(self) -> Ints:
        """Return (m, 2) positions in ``vertices`` of the start and the end of each segment, closing ones included."""
        first, last = _chain_bounds(self.chain)
        after = np.arange(len(self.vertices)) + 1
        after[last] = first
        leads_on = np.ones(len(self.vertices), dtype=bool)
        leads_on[last[~self.closed]] = False
        return np.stack([np.flatnonzero(leads_on), after[leads_on]], axis=1)

    def ends(self) -> Ints:
        """Return (k,) for each entry of ``vertices`` 0 where an open chain starts, 1 where it ends, -1 elsewhere."""
        first, last = _chain_bounds(self.chain)
        ends = np.full(len(self.vertices), -1)
        ends[first[~self.closed]], ends[last[~self.closed]] = 0, 1
        return ends


def order_chains(edges: Ints, positions: Floats) -> Chains:
    """Return ``edges`` (m, 2), m > 0, no two of them equal, as chains that end at branches and free ends, and loops.

    They are pairs of rows of ``positions`` (n, d), by which the longest chain is the first. The direction of a chain is
    that of most of its edges, from their first vertex to their second.
    """
    node, vertex = _split_at_branches(edges)
    path, place, forward = _order_nodes(node, len(vertex))
    length = np.bincount(path[node[:, 0]], np.linalg.norm(positions[edges[:, 1]] - positions[edges[:, 0]], axis=1))
    agreement = np.bincount(path[node[:, 0]], forward)
    place = np.where(agreement[path] < 0, -place, place)
    rank = np.empty(len(length), dtype=np.int64)
    rank[np.argsort(-length, kind="stable")] = np.arange(len(length))
    order = np.lexsort((place, rank[path]))
    chain, vertices = rank[path][order], vertex[order]
    first, last = _chain_bounds(chain)
    closed = vertices[first] == vertices[last]
    listed = np.ones(len(vertices), dtype=bool)
    listed[last[closed]] = False
    return Chains(vertices[listed], chain[listed], closed)


def components(node: Ints, count: int) -> Ints:
    """Return (count,) the number of the connected component of each node of a graph with edges ``node`` (m, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(node)), node.T), shape=(count, count))
    return connected_components(links, directed=False)[1].astype(np.int64)


def _split_at_branches(edges: Ints) -> tuple[Ints, Ints]:
    """Return the nodes (m, 2) of the edges in a graph of simple paths, and the vertex (n,) that each node represents.

    A vertex is one node where two of ``edges`` (m, 2) meet, and one node for each edge otherwise. A loop is split at
    its lowest vertex, between the end of one edge and the start of the next where they follow each other.
    """
    half = edges.T.ravel()  # the starts of all edges, then their ends
    joined = np.bincount(half)[half] == 2
    name = np.where(joined, half, half.max() + 1 + np.arange(len(half)))
    used, node = np.unique(name, return_inverse=True)
    part = components(node.reshape(2, -1).T, len(used))
    is_loop = np.bincount(part[node[: len(edges)]]) == np.bincount(part)
    cut = np.flatnonzero(is_loop[part[node]])
    cut = cut[np.lexsort((-cut, half[cut], part[node[cut]]))]
    cut = cut[np.unique(part[node[cut]], return_index=True)[1]]
    node[cut] = len(used) + np.arange(len(cut))
    vertex = np.empty(len(used) + len(cut), dtype=np.int64)
    vertex[node] = half
    return node.reshape(2, -1).T, vertex


def _order_nodes(node: Ints, count: int) -> tuple[Ints, Ints, Ints]:
    """Return the path and the position along it of each node (n,), and 1 or -1 for each edge (m,) along or against it.

    ``node`` (m, 2) are the edges of simple paths between ``count`` nodes.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    path = components(node, count)
    ends = np.flatnonzero(np.bincount(node.ravel(), minlength=count) == 1)
    start = ends[np.unique(path[ends], return_index=True)[1]]
    links = coo_array((np.ones(len(node)), node.T), shape=(count, count)).tocsr()
    place = dijkstra(links, directed=False, indices=start, unweighted=True, min_only=True).astype(np.int64)
    return path, place, place[node[:, 1]] - place[node[:, 0]]


def _chain_bounds(chain: Ints) -> tuple[Ints, Ints]:
    """Return (c,) and (c,) the positions of the first and the last entry of each number in ``chain``, ascending."""
    first = np.flatnonzero(np.diff(chain, prepend=-1))
    return first, np.r_[first[1:], len(chain)] - 1
