"""Edges that several leaves of a triangulation share: only leaves that belong together keep their corners in common."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.meshing.contouring.contour_edges import Edges, edges_of, split_fans
from cpmkit.protocols import Bools, Floats, Ints

#: Four leaves are two sheets that cross if all angles between them are above this, in degrees, and the points at this
#: share of the way to their apexes lie on the surface to that share of their heights.
CROSSING_ANGLE, CROSSING_AT, CROSSING_OFF = 35.0, 0.3, 0.04
#: Or if all leaves go through to the other side, to this share of the way.
THROUGH_OFF = 0.2
#: Rounds of parting: each looks at the edges that the one before has left or made.
MOST_ROUNDS = 6


def parted_leaves(source: LocalSource, vertices: Floats, cells: Ints) -> tuple[Floats, Ints]:
    """Return vertices and triangles with corners of their own for each fan.

    Of edges of four triangles that are no crossing of two sheets only the leaves of a pair keep their corners in
    common. Where the ends stay joined by another way, the edge of one pair is halved.
    """
    for _ in range(MOST_ROUNDS):
        edges = edges_of(cells)
        edge, order, gaps, crossing = _leaves(source, vertices, cells, edges)
        shifted = gaps[:, 0] + gaps[:, 2] > gaps[:, 1] + gaps[:, 3]
        order = np.where(shifted[:, None], np.roll(order, -1, axis=1), order)
        edge, pairs = edge[~crossing], order[~crossing].reshape(-1, 2, 2)
        cells, copied = split_fans(cells, edges, edge, pairs)
        vertices, cells = _halved(source, vertices[copied], cells, pairs)
        if not len(edge):
            break
    return vertices, cells


def crowded_edges(source: LocalSource, vertices: Floats, cells: Ints, edges: Edges) -> Ints:
    """Return the edges of four triangles or more but for those at which two sheets cross."""
    edge, _, _, crossing = _leaves(source, vertices, cells, edges)
    return np.setdiff1d(np.flatnonzero(edges.count > 3), edge[crossing])


def _leaves(source: LocalSource, vertices: Floats, cells: Ints, edges: Edges) -> tuple[Ints, Ints, Floats, Bools]:
    """Return the edges of four triangles, the slots (k, 4) of their leaves in turn, the angles between, and crossings.

    A slot is three times the number of a triangle and the number of its edge.
    """
    edge, slots = _of_four(edges)
    if not len(edge):
        return edge, slots, np.zeros((0, 4)), np.zeros(0, dtype=bool)
    angle, order = _round_edges(vertices, cells, edges, edge, slots)
    gaps = np.diff(angle, axis=1, append=angle[:, :1] + 2 * np.pi)
    crossing = (gaps > np.radians(CROSSING_ANGLE)).all(axis=1)
    crossing[crossing] = _on_surface(source, vertices, cells, edges, edge[crossing], order[crossing])
    rest = np.flatnonzero(~crossing)
    crossing[rest] = _go_through(source, vertices, cells, edges, edge[rest], order[rest])
    return edge, order, gaps, crossing


def _of_four(edges: Edges) -> tuple[Ints, Ints]:
    """Return the edges of four triangles, and the slots (k, 4) of these, three a triangle."""
    edge = np.flatnonzero(edges.count == 4)
    order = np.argsort(edges.of.ravel(), kind="stable")
    start = np.cumsum(edges.count) - edges.count
    return edge, order[start[edge][:, None] + np.arange(4)]


def _round_edges(vertices: Floats, cells: Ints, edges: Edges, edge: Ints, slots: Ints) -> tuple[Floats, Ints]:
    """Return the angles (k, 4) of the leaves round their edges, ascending, and the slots in that order."""
    tail, head = vertices[edges.ends[edge]].transpose(1, 0, 2)
    along = unit(head - tail)
    out = vertices[cells.ravel()[slots]] - tail[:, None]
    out = out - dots(out, along[:, None])[..., None] * along[:, None]
    first = unit(out[:, 0])[:, None]
    angle = np.arctan2(dots(out, np.cross(along, first[:, 0])[:, None]), dots(out, first)) % (2 * np.pi)
    order = np.argsort(angle, axis=1)
    return np.take_along_axis(angle, order, axis=1), np.take_along_axis(slots, order, axis=1)


def _on_surface(source: LocalSource, vertices: Floats, cells: Ints, edges: Edges, edge: Ints, slots: Ints) -> Bools:
    """Return whether the surface goes from these edges (k,) towards all four apexes."""
    middle = vertices[edges.ends[edge]].mean(axis=1)[:, None]
    towards = vertices[cells.ravel()[slots]] - middle
    points = (middle + CROSSING_AT * towards).reshape(-1, 3)
    off = norms(source.closest_point(points).points - points).reshape(-1, 4)
    return np.asarray((off <= CROSSING_OFF * norms(towards)).all(axis=1))


def _go_through(source: LocalSource, vertices: Floats, cells: Ints, edges: Edges, edge: Ints, slots: Ints) -> Bools:
    """Return whether the surface goes on straight beyond these edges (k,) from all four leaves, in two sheets."""
    if not len(edge):
        return np.zeros(0, dtype=bool)
    middle = vertices[edges.ends[edge]].mean(axis=1)[:, None]
    along = unit(np.diff(vertices[edges.ends[edge]], axis=1)[:, 0])[:, None]
    out = vertices[cells.ravel()[slots]] - middle
    out = out - dots(out, along)[..., None] * along
    way = norms(out).max(axis=1)[:, None]
    out = unit(out.reshape(-1, 3)).reshape(-1, 4, 3)
    points = (middle[:, :, None] + way[..., None, None] * np.stack([out, -out], axis=2)).reshape(-1, 3)
    off = norms(source.closest_point(points).points - points).reshape(-1, 8)
    sheets = norms(np.cross(out, out[:, :1])).max(axis=1) > np.sin(np.radians(CROSSING_ANGLE))
    return np.asarray(sheets & (off <= THROUGH_OFF * way).all(axis=1))


def _halved(source: LocalSource, vertices: Floats, cells: Ints, pairs: Ints) -> tuple[Floats, Ints]:
    """Return vertices, triangles with the edges of the second of ``pairs`` halved where both still share it."""
    ends = [np.sort(_ends(cells, pairs[:, k, 0]), axis=1) for k in range(2)]
    rows = np.flatnonzero((ends[0] == ends[1]).all(axis=1))
    split = pairs[rows, 1]
    once = np.unique(split.ravel() // 3, return_counts=True)
    single = np.isin(split // 3, once[0][once[1] == 1]).all(axis=1)
    split = split[single]
    new = len(vertices) + np.arange(len(split))
    middle = vertices[_ends(cells, split[:, 0])].mean(axis=1)
    vertices = np.concatenate([vertices, source.closest_point(middle).points])
    cell, corner = np.divmod(split, 3)
    apex, a, b = (cells[cell, (corner + k) % 3] for k in range(3))
    tip = np.repeat(new[:, None], 2, axis=1)
    halves = [np.stack([apex, a, tip], axis=-1), np.stack([apex, tip, b], axis=-1)]
    kept = np.delete(cells, cell.ravel(), axis=0)
    return vertices, np.concatenate([kept, *(half.reshape(-1, 3) for half in halves)])


def _ends(cells: Ints, slots: Ints) -> Ints:
    cell, corner = np.divmod(slots, 3)
    return np.stack([cells[cell, (corner + 1) % 3], cells[cell, (corner + 2) % 3]], axis=1)
