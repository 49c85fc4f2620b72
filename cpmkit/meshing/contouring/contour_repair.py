"""Repair of a dual triangulation away from rims: short edges, flaps and holes."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import norms
from cpmkit.meshing.contouring.contour_edges import (
    EdgeTable,
    collapse_edges,
    connected_groups,
    double_areas,
    edge_table,
    open_edges,
    shortest_at_both_ends,
)
from cpmkit.meshing.contouring.contour_rims import RimTest
from cpmkit.types import Bools, Floats, Ints

#: A limit on rounds of collapsing edges and of removing flaps; each round treats the result of the round before.
MAX_ROUNDS = 20


def collapse_short_edges(source: LocalSource, vertices: Floats, cells: Ints, spacing: float) -> tuple[Floats, Ints]:
    """Return vertices (v, 3) and triangles (m, 3), with those edges collapsed at which sheets are connected wrongly.

    These are edges of three triangles or more that are shorter than .35 spacings, and the shortest edges of triangles
    without area beside edges of three or more. The remaining vertex is the closest point of the edge's middle.
    """
    for _ in range(MAX_ROUNDS):
        edges = edge_table(cells)
        length = norms(vertices[edges.ends[:, 1]] - vertices[edges.ends[:, 0]])
        is_short = (edges.count > 2) & (length < 0.35 * spacing)
        is_short[_shortest_edges_of_degenerate(vertices, cells, edges, length)] = True
        if not is_short.any():
            break
        short = np.flatnonzero(is_short)
        ends = edges.ends[short[shortest_at_both_ends(edges.ends[short], length[short], len(vertices))]]
        vertices = vertices.copy()
        vertices[ends[:, 0]] = source.closest_point(vertices[ends].mean(axis=1)).points
        cells = collapse_edges(cells, ends, len(vertices))
    return vertices, cells


def _shortest_edges_of_degenerate(vertices: Floats, cells: Ints, edges: EdgeTable, length: Floats) -> Ints:
    """Return the shortest edges (k,) of triangles that have hardly any area and an edge of three triangles or more."""
    rows = np.flatnonzero((edges.count > 2)[edges.of_cells].any(axis=1))
    of_cells = edges.of_cells[rows]
    degenerate = double_areas(vertices, cells[rows]) < 0.02 * length[of_cells].max(axis=1) ** 2
    return np.asarray(of_cells[np.arange(len(of_cells)), np.argmin(length[of_cells], axis=1)][degenerate])


def remove_flaps(rims: RimTest, vertices: Floats, cells: Ints) -> Ints:
    """Return the triangles (k, 3) that are left when flaps are removed one after the other.

    A flap is a triangle with an open edge off rims that is attached along a single edge, or along an edge of three
    triangles or more.
    """
    from cpmkit.meshing.contouring.contouring_kernels import remove_flap_triangles

    edges = edge_table(cells)
    on_rim = np.zeros(len(edges.count), dtype=bool)
    known = np.zeros(len(edges.count), dtype=bool)
    alive = np.ones(len(cells), dtype=bool)
    for _ in range(MAX_ROUNDS):
        border = open_edges(vertices, cells[alive], EdgeTable(edges.ends, edges.of_cells[alive], edges.count))
        border = border.take(~known[border.edge])
        on_rim[border.edge] = rims.of_edges(vertices, border)
        known[border.edge] = True
        candidates = np.flatnonzero(alive & (edges.count == 1)[edges.of_cells].any(axis=1))
        if not remove_flap_triangles(candidates, edges.of_cells, edges.count, on_rim.copy(), alive):
            break
    return np.ascontiguousarray(cells[alive])


def fill_holes(rims: RimTest, vertices: Floats, cells: Ints) -> tuple[Ints, int]:
    """Return the triangles (k, 3) with holes off rims filled by triangles of least area, and the number of holes.

    A hole is filled if all centres of its triangles are within a spacing of the surface.
    """
    from cpmkit.meshing.contouring.contouring_kernels import least_area_triangles

    border = open_edges(vertices, cells, edge_table(cells))
    on_rim = rims.of_edges(vertices, border)
    loops = _hole_loops(border.ends, on_rim, len(vertices))
    fillings = [loop[least_area_triangles(np.ascontiguousarray(vertices[loop]))] for loop in loops]
    if not fillings:
        return cells, 0
    centres = vertices[np.concatenate(fillings)].mean(axis=1)
    is_close = norms(rims.source.closest_point(centres).points - centres) <= rims.spacing
    last = np.cumsum([len(filling) for filling in fillings])
    accepted = [filling for filling, ok in zip(fillings, np.split(is_close, last[:-1]), strict=True) if ok.all()]
    return np.concatenate([cells, *accepted]), len(accepted)


def _hole_loops(ends: Ints, on_rim: Bools, count: int) -> list[Ints]:
    """Return for each hole its vertices (b,) in cyclic order, from the open edges of the triangulation.

    A hole is a closed border of at most 80 open edges, a third of them on rims at most.

    Parameters
    ----------
    ends : (b, 2) int64
        The vertices of each open edge.
    on_rim : (b,) bool
        Whether each open edge lies beside a rim.
    count : int
        The number of vertices.
    """
    borders, label = connected_groups(ends[:, 0], ends[:, 1], count)
    size = np.bincount(label[ends[:, 0]], minlength=borders)
    rim = np.bincount(label[ends[:, 0]], on_rim, minlength=borders)
    is_hole = (size > 2) & (size <= 80) & (rim <= size / 3)
    degree = np.bincount(ends.ravel(), minlength=count)
    is_hole[label[(degree > 0) & (degree != 2)]] = False
    return [_order_loop(ends[label[ends[:, 0]] == border]) for border in np.flatnonzero(is_hole)]


def _order_loop(ends: Ints) -> Ints:
    """Return the vertices (b,) of one closed loop of edges ``ends`` (b, 2) in cyclic order."""
    neighbours: dict[int, list[int]] = {}
    for a, b in ends.tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    loop = [int(ends[0, 0]), int(ends[0, 1])]
    while len(loop) < len(ends):
        first, second = neighbours[loop[-1]]
        loop.append(second if first == loop[-2] else first)
    return np.array(loop, dtype=np.int64)
