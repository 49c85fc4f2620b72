"""Triangles of dual contouring made a surface beside its creases: short edges, flaps, doubled triangles."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import norms
from cpmkit.meshing.contouring.contour_edges import Edges, border_of, edges_of
from cpmkit.meshing.contouring.rim_test import RimTest
from cpmkit.protocols import Bools, Floats, Ints

#: Edges of three triangles or more that are shorter than this share of the lattice's spacing are drawn together.
SHORT_EDGE = 0.35
#: Triangles beside such edges that are lower than this share of their longest side lose their shortest one.
NO_HEIGHT = 0.02
#: Rounds of drawing together and of removing flaps: each looks at what the one before has left.
MOST_ROUNDS = 20


def without_short_edges(source: LocalSource, vertices: Floats, cells: Ints, spacing: float) -> tuple[Floats, Ints]:
    """Return vertices and triangles with edges drawn together that make sheets meet wrongly.

    They are the short ones of three triangles or more, and the shortest ones of triangles without area beside such.
    """
    for _ in range(MOST_ROUNDS):
        edges = edges_of(cells)
        length = norms(vertices[edges.ends[:, 1]] - vertices[edges.ends[:, 0]])
        short = (edges.count > 2) & (length < SHORT_EDGE * spacing)
        short[_shortest_of_flat(vertices, cells, edges, length)] = True
        if not short.any():
            break
        chosen = np.flatnonzero(short)
        ends = edges.ends[chosen[shortest_apart(edges.ends[chosen], length[chosen], len(vertices))]]
        vertices = vertices.copy()
        vertices[ends[:, 0]] = source.closest_point(vertices[ends].mean(axis=1)).points
        cells = collapsed(cells, ends, len(vertices))
    return vertices, cells


def _shortest_of_flat(vertices: Floats, cells: Ints, edges: Edges, length: Floats) -> Ints:
    """Return the shortest edges of triangles without area that have an edge of three or more."""
    rows = np.flatnonzero((edges.count > 2)[edges.of].any(axis=1))
    of, corners = edges.of[rows], vertices[cells[rows]]
    double = norms(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    flat = double < NO_HEIGHT * length[of].max(axis=1) ** 2
    return np.asarray(of[np.arange(len(of)), np.argmin(length[of], axis=1)][flat])


def shortest_apart(ends: Ints, length: Floats, count: int) -> Ints:
    """Return edges, each the shortest at both of its ends."""
    order = np.argsort(length, kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    least = np.full(count, len(order))
    np.minimum.at(least, ends, rank[:, None])
    return np.flatnonzero((least[ends] == rank[:, None]).all(axis=1))


def collapsed(cells: Ints, ends: Ints, count: int) -> Ints:
    """Return the triangles with the second of ``ends`` (k, 2) replaced by the first, and of equal ones an odd one."""
    number = np.arange(count)
    number[ends[:, 1]] = ends[:, 0]
    cells = number[cells]
    cells = cells[(cells != np.roll(cells, 1, axis=1)).all(axis=1)]
    _, first, times = np.unique(np.sort(cells, axis=1), axis=0, return_index=True, return_counts=True)
    return np.ascontiguousarray(cells[np.sort(first[times % 2 == 1])])


def without_flaps(rims: RimTest, vertices: Floats, cells: Ints) -> Ints:
    """Return the triangles without those that hang on a crease, or on one edge, with an open edge off rims."""
    from cpmkit.meshing.contouring.repair_kernels import remove_flaps

    edges = edges_of(cells)
    on_rim = np.zeros(len(edges.count), dtype=bool)
    known = np.zeros(len(edges.count), dtype=bool)
    alive = np.ones(len(cells), dtype=bool)
    for _ in range(MOST_ROUNDS):
        _note_rims(rims, vertices, cells, edges, on_rim, known, alive)
        candidates = np.flatnonzero(alive & (edges.count == 1)[edges.of].any(axis=1))
        if not remove_flaps(candidates, edges.of, edges.count, on_rim.copy(), alive):
            break
    return np.ascontiguousarray(cells[alive])


def _note_rims(
    rims: RimTest, vertices: Floats, cells: Ints, edges: Edges, on_rim: Bools, known: Bools, alive: Bools
) -> None:
    """Mark the open edges that lie on rims, of those that are not known yet."""
    border = border_of(vertices, cells[alive], Edges(edges.ends, edges.of[alive], edges.count))
    border = border.take(~known[border.edge])
    on_rim[border.edge] = rims.of_border(vertices, border)
    known[border.edge] = True
