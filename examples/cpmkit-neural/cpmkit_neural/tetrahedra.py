"""Triangles between the nodes of a lattice at which values change their sign: marching tetrahedra."""

from itertools import permutations

import numpy as np

from cpmkit.plugin import Floats, Ints

#: Of a tetrahedron with so many negative corners, which come first: the edges at which its triangles have corners.
CUT_EDGES = {
    1: [[(0, 1), (0, 2), (0, 3)]],
    2: [[(0, 2), (0, 3), (1, 3)], [(0, 2), (1, 3), (1, 2)]],
    3: [[(0, 3), (1, 3), (2, 3)]],
}


def zero_triangles(values: Floats) -> tuple[Floats, Ints]:
    """Return vertices (v, 3), in cells of the lattice of ``values`` (n0, n1, n2), and triangles (m, 3) between them.

    Each cell is cut into six tetrahedra along its diagonal, so that those of neighbours match.
    """
    flat, shape = values.ravel(), values.shape
    first = np.indices([n - 1 for n in shape]).reshape(3, -1)
    edges = []
    for path in permutations(np.eye(3, dtype=np.int64)):
        corners = [first + step[:, None] for step in np.cumsum([np.zeros(3, dtype=np.int64), *path], axis=0)]
        nodes = np.stack([np.ravel_multi_index(tuple(corner), shape) for corner in corners], axis=1)
        negative = flat[nodes] < 0
        nodes = np.take_along_axis(nodes, np.argsort(~negative, axis=1, kind="stable"), axis=1)
        for count, cut in CUT_EDGES.items():
            edges.append(nodes[negative.sum(axis=1) == count][:, np.array(cut)].reshape(-1, 3, 2))
    pairs = np.sort(np.concatenate(edges).reshape(-1, 2), axis=1)
    keys, triangles = np.unique(pairs[:, 0] * flat.size + pairs[:, 1], return_inverse=True)
    low, high = np.divmod(keys, flat.size)
    share = (flat[low] / (flat[low] - flat[high]))[:, None]
    ends = [np.stack(np.unravel_index(end, shape), axis=1) for end in (low, high)]
    vertices: Floats = (1.0 - share) * ends[0] + share * ends[1]
    return vertices, triangles.reshape(-1, 3).astype(np.int64)
