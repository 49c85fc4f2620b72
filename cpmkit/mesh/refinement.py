"""Halving the long edges of a mesh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.mesh.cells import edges_of, padded, with_corners
from cpmkit.mesh.cut import rotated
from cpmkit.protocols import Floats, Ints

#: The corners of the pieces of a triangle (a, b, c) by the number of its long edges, among a, b, c (0 to 2)
#: and the middles of ab, bc, ca (3 to 5). Of one long edge it is ab, of two they are ab and bc.
PIECES_BY_LONG_EDGES = {
    0: [(0, 1, 2)],
    1: [(0, 3, 2), (3, 1, 2)],
    2: [(3, 1, 4), (0, 3, 4), (0, 4, 2)],
    3: [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)],
}


def refine(attributes: Floats, cells: Ints, dim: int, longest: float) -> tuple[Floats, Ints]:
    """Return the mesh with every edge halved until none is longer than ``longest``.

    Parameters
    ----------
    attributes : (v, w) float64
        The first ``dim`` columns are positions; the middle of an edge has the mean of all columns.
    cells : (m, k) int64
        Triangles, segments and points; shorter rows end in -1.
    dim : int
        2 or 3.
    longest : float
        In the unit of the positions.

    Returns
    -------
    attributes, cells
        The given vertices come first; neighbours share the middles of their edges.
    """
    parts = []
    for corners, halve in ((3, _halved_triangles), (2, _halved_segments)):
        attributes, part = _refined(attributes, with_corners(cells, corners), halve, dim, longest)
        parts.append(part)
    return attributes, padded([*parts, with_corners(cells, 1)])


def _refined(
    attributes: Floats, cells: Ints, halve: Callable[[Ints, Ints], Ints], dim: int, longest: float
) -> tuple[Floats, Ints]:
    """Refine cells that all have the same number of corners."""
    while True:
        edges, cell_edges = edges_of(cells, len(attributes))
        a, b = edges.T
        long = np.linalg.norm(attributes[b, :dim] - attributes[a, :dim], axis=1) > longest
        if not long.any():
            return attributes, cells
        middle = np.where(long, len(attributes) + np.cumsum(long) - 1, -1)
        cells = halve(cells, middle[cell_edges])
        attributes = np.concatenate([attributes, (attributes[a[long]] + attributes[b[long]]) / 2])


def _halved_segments(cells: Ints, middles: Ints) -> Ints:
    long = middles[:, 0] >= 0
    (a, b), p = cells[long].T, middles[long, 0]
    return np.concatenate([cells[~long], np.stack([a, p], axis=1), np.stack([p, b], axis=1)])


def _halved_triangles(cells: Ints, middles: Ints) -> Ints:
    """``middles`` (m, 3) holds the vertex in the middle of each edge, -1 where the edge stays."""
    long = middles >= 0
    # Turn each triangle so that its long edges come first and the others last.
    first = np.where(long.sum(axis=1) == 1, long.argmax(axis=1), long.argmin(axis=1) + 1)
    corners, halves = rotated(cells, middles, first)
    vertices = np.concatenate([corners, halves]).T
    parts = [
        vertices[long.sum(axis=1) == count][:, piece]
        for count, pieces in PIECES_BY_LONG_EDGES.items()
        for piece in pieces
    ]
    return np.concatenate(parts)
