"""Holes of a triangulation that are no rims of the surface are filled."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.vectors import norms
from cpmkit.meshing.contouring.contour_edges import border_of, edges_of
from cpmkit.meshing.contouring.rim_test import RimTest
from cpmkit.protocols import Bools, Floats, Ints

#: Holes of so many edges at most are filled, if at most this share of the edges lies on rims, by triangles whose
#: centres are so near to the surface, in spacings.
MOST_HOLE_EDGES, MOST_ON_RIM, NEAR_SURFACE = 80, 1 / 3, 1.0


def without_holes(rims: RimTest, vertices: Floats, cells: Ints) -> tuple[Ints, int]:
    """Return the triangles with holes filled by triangles of least area, and how many holes those were."""
    from cpmkit.meshing.contouring.repair_kernels import least_area

    border = border_of(vertices, cells, edges_of(cells))
    on_rim = rims.of_border(vertices, border)
    fillings = []
    for loop in _loops(border.ends, on_rim, len(vertices)):
        fillings.append(loop[least_area(np.ascontiguousarray(vertices[loop]))])
    if not fillings:
        return cells, 0
    centres = vertices[np.concatenate(fillings)].mean(axis=1)
    near = norms(rims.source.closest_point(centres).points - centres) <= NEAR_SURFACE * rims.spacing
    last = np.cumsum([len(filling) for filling in fillings])
    kept = [f for f, n in zip(fillings, np.split(near, last[:-1]), strict=True) if n.all()]
    return np.concatenate([cells, *kept]), len(kept)


def _loops(ends: Ints, on_rim: Bools, count: int) -> list[Ints]:
    """Return the vertices of each closed border of few edges, mostly off rims, in their order round it."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(ends), dtype=np.int8), tuple(ends.T)), shape=(count, count))
    pieces, label = connected_components(graph, directed=False)
    size = np.bincount(label[ends[:, 0]], minlength=pieces)
    rim = np.bincount(label[ends[:, 0]], on_rim, minlength=pieces)
    wanted = (size > 2) & (size <= MOST_HOLE_EDGES) & (rim <= MOST_ON_RIM * size)
    degree = np.bincount(ends.ravel(), minlength=count)
    wanted[label[(degree > 0) & (degree != 2)]] = False
    return [_in_order(ends[label[ends[:, 0]] == piece]) for piece in np.flatnonzero(wanted)]


def _in_order(ends: Ints) -> Ints:
    """Return the vertices of one closed loop of edges."""
    beside: dict[int, list[int]] = {}
    for a, b in ends.tolist():
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    loop = [int(ends[0, 0]), int(ends[0, 1])]
    while len(loop) < len(ends):
        first, second = beside[loop[-1]]
        loop.append(second if first == loop[-2] else first)
    return np.array(loop, dtype=np.int64)
