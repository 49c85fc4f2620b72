"""Specks of a triangulation: what closest points make beside a part that is about as thin as the lattice's cells."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.vectors import norms
from cpmkit.meshing.contouring.edges import edges_of
from cpmkit.protocols import Floats, Ints

#: Pieces with less area than this, in squares of the lattice's spacing, are specks: splines that saw them alone would
#: have a value of their own there, and none where there is no area at all (an ellipsoid 10 : 10 : 1 at spacings of its
#: thickness has some of up to .02; a sphere of a tenth of a spacing, which is found by chance alone, has .13).
SPECK_AREA = 0.1


def without_specks(vertices: Floats, cells: Ints, spacing: float) -> tuple[Ints, int]:
    """Return the triangles (m, 3) of pieces with an area, all of them where no piece has one, and how many have none.

    Pieces are what hangs together by vertices (v, 3).
    """
    return _without(vertices, cells, cells, spacing)


def without_hanging_specks(vertices: Floats, cells: Ints, spacing: float) -> Ints:
    """Return the triangles without pieces that have no area and hang on others by vertices alone."""
    return _without(vertices, cells, edges_of(cells).of, spacing)[0]


def _without(vertices: Floats, cells: Ints, links: Ints, spacing: float) -> tuple[Ints, int]:
    piece, areas = _pieces(vertices, cells, links)
    speck = areas < SPECK_AREA * spacing**2
    if speck.all():
        return cells, 0
    return np.ascontiguousarray(cells[~speck[piece]]), int(speck.sum())


def areas_of_pieces(vertices: Floats, cells: Ints) -> Floats:
    """Return the area of each piece, of those that hang together by vertices (v, 3)."""
    return _pieces(vertices, cells, cells)[1]


def _pieces(vertices: Floats, cells: Ints, links: Ints) -> tuple[Ints, Floats]:
    """Return the piece of each triangle, and the area of each, of those with common ``links`` (m, 3)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ends = np.concatenate([links[:, :2], links[:, 1:]])
    size = int(links.max(initial=-1)) + 1
    graph = coo_array((np.ones(len(ends), dtype=np.int8), tuple(ends.T)), shape=(size, size))
    label = connected_components(graph, directed=False)[1][links[:, 0]]
    piece = np.unique(label, return_inverse=True)[1]
    corners = vertices[cells]
    area = 0.5 * norms(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    return piece.astype(np.int64), np.asarray(np.bincount(piece, area), dtype=np.float64)
