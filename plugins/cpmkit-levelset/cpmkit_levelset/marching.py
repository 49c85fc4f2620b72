"""Where the values on a lattice change sign: each cell is cut into simplices, and each of them by a plane."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from cpmkit.plugin import Floats, Ints
from cpmkit_levelset.sampling import SampleLattice

#: A crossing nearer to a node than this share of its edge is at the node: rounding of values that are zero there.
NODE_SHARE = 1e-9


def marching_simplices(lattice: SampleLattice) -> tuple[Floats, Ints]:
    """Return vertices (v, d) near the zero set, one on each crossed edge of a simplex, and cells (m, d) between them.

    A cell of the lattice is cut into d! simplices along its diagonal (Kuhn), so that the pieces of neighbours match.
    Crossings at a node are one vertex, and cells with two of them are left out: their area is zero. The order of a
    cell's vertices has no meaning.
    """
    positive = lattice.values > 0
    corners = _crossed_cells(positive)
    pairs = []
    for path in permutations(range(positive.ndim)):
        steps = np.zeros((positive.ndim + 1, positive.ndim), dtype=np.int64)
        for k, axis in enumerate(path):
            steps[k + 1 :, axis] += 1
        nodes = np.ravel_multi_index(tuple((corners[:, None] + steps).transpose(2, 0, 1)), positive.shape)
        pairs.append(_cut_edges(nodes, positive.ravel()[nodes]))
    edges = np.concatenate(pairs)
    d = positive.ndim
    # one number an edge: rows are sorted ten times slower
    ends, count = _merge_at_nodes(lattice, np.sort(edges, axis=2)), positive.size
    numbers = ends[..., 0] * count + ends[..., 1]
    numbers = numbers[(numbers != np.roll(numbers, 1, axis=1)).all(axis=1)]
    crossed, cells = np.unique(numbers, return_inverse=True)
    return _edge_crossings(lattice, np.stack(np.divmod(crossed, count), axis=1)), cells.reshape(-1, d).astype(np.int64)


def _crossed_cells(positive: np.ndarray) -> Ints:
    """Return (m, d) the first corners of the cells with corners of both signs; ``positive`` (n0, n1[, n2]) is bool."""
    count = np.zeros([n - 1 for n in positive.shape], dtype=np.int8)
    for corner in np.ndindex(*[2] * positive.ndim):
        count += positive[tuple(slice(c, n - 1 + c) for c, n in zip(corner, positive.shape, strict=True))]
    return np.argwhere((count > 0) & (count < 2**positive.ndim))


def _cut_edges(nodes: Ints, positive: np.ndarray) -> Ints:
    """Return (m, d, 2): for each piece of the zero set in simplices, the pairs of nodes between which its corners lie.

    ``nodes`` (k, d + 1) are the corners of simplices, ``positive`` (k, d + 1) the signs there. Two triangles cut a
    tetrahedron with two corners of each sign.
    """
    d = nodes.shape[1] - 1
    order = np.argsort(positive, axis=1, kind="stable")
    sorted_nodes = np.take_along_axis(nodes, order, axis=1)
    negatives = d + 1 - positive.sum(axis=1)
    pieces = []
    for count, alone in ((1, 0), (d, d)):
        some = sorted_nodes[negatives == count]
        others = np.delete(some, alone, axis=1)
        pieces.append(np.stack([np.broadcast_to(some[:, [alone]], others.shape), others], axis=2))
    if d == 3:
        a, b, c, e = sorted_nodes[negatives == 2].T
        corners = [np.stack(pair, axis=1) for pair in ((a, c), (a, e), (b, e), (b, c))]
        pieces += [np.stack([corners[i] for i in triangle], axis=1) for triangle in ((0, 1, 2), (0, 2, 3))]
    return np.concatenate(pieces)


def _merge_at_nodes(lattice: SampleLattice, edges: Ints) -> Ints:
    """Return crossed ``edges`` (m, d, 2), with that node at both ends where the crossing is at a node."""
    values = np.abs(lattice.values.ravel()[edges])
    at_node = values < NODE_SHARE * values.sum(axis=2, keepdims=True)
    for end in (0, 1):
        edges = np.where(at_node[..., end, None], edges[..., end, None], edges)
    return edges


def _edge_crossings(lattice: SampleLattice, edges: Ints) -> Floats:
    """Return (v, d) where the linear interpolant between the ends of ``edges`` (v, 2) vanishes, or their one node."""
    ends = [np.stack(np.unravel_index(edges[:, k], lattice.values.shape), axis=1) for k in (0, 1)]
    first, second = (lattice.values.ravel()[edges[:, k]] for k in (0, 1))
    at_node = edges[:, 0] == edges[:, 1]
    share = np.where(at_node, 0.0, first / np.where(at_node, 1.0, first - second))[:, None]
    crossings: Floats = lattice.lower + lattice.spacing * ((1.0 - share) * ends[0] + share * ends[1])
    return crossings
