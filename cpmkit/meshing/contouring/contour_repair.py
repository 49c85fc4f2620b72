"""Repair of a dual triangulation away from rims: short edges, flaps, holes, and sheets that share edges.

Edges of four triangles at which two sheets cross stay; at all others the sheets are separated.
"""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.meshing.contour_edges import (
    EdgeTable,
    collapse_edges,
    double_areas,
    edge_ends,
    edge_table,
    halve_edges,
    open_edges,
    shortest_at_both_ends,
)
from cpmkit.meshing.contouring.contour_rims import RimTest
from cpmkit.runtime.index_sets import connected_components
from cpmkit.types import Bools, Floats, Ints


def collapse_short_edges(source: LocalSource, vertices: Floats, cells: Ints, spacing: float) -> tuple[Floats, Ints]:
    """Return vertices (v, 3) and triangles (m, 3), with edges collapsed at which sheets are connected wrongly.

    Collapsed are edges of three triangles or more that are shorter than .35 times the ``spacing`` of the contouring
    lattice, and the shortest edges of triangles without area beside edges of three or more. The remaining vertex is
    the closest point of the edge's midpoint; vertices keep their numbers.
    """
    for _ in range(20):  # a limit; each round treats the result of the round before
        edges = edge_table(cells)
        length = norms(vertices[edges.ends[:, 1]] - vertices[edges.ends[:, 0]])
        is_short = (edges.count > 2) & (length < 0.35 * spacing)
        rows = np.flatnonzero((edges.count > 2)[edges.of_cells].any(axis=1))
        of_cells = edges.of_cells[rows]
        degenerate = double_areas(vertices, cells[rows]) < 0.02 * length[of_cells].max(axis=1) ** 2
        is_short[of_cells[np.arange(len(rows)), np.argmin(length[of_cells], axis=1)][degenerate]] = True
        if not is_short.any():
            break
        short = np.flatnonzero(is_short)
        ends = edges.ends[short[shortest_at_both_ends(edges.ends[short], length[short], len(vertices))]]
        vertices = vertices.copy()
        vertices[ends[:, 0]] = source.closest_point(vertices[ends].mean(axis=1)).points
        cells = collapse_edges(cells, ends, len(vertices))
    return vertices, cells


def remove_flaps(rims: RimTest, vertices: Floats, cells: Ints) -> Ints:
    """Return the triangles (k, 3) that are left when flaps are removed one after the other.

    A flap has two open edges off rims; or an edge of three triangles or more, and one open edge off rims or two open.
    """
    from cpmkit.meshing.contouring.contouring_kernels import remove_flap_triangles

    edges = edge_table(cells)
    on_rim = np.zeros(len(edges.count), dtype=bool)
    known = np.zeros(len(edges.count), dtype=bool)
    alive = np.ones(len(cells), dtype=bool)
    for _ in range(20):  # a limit; each round treats the result of the round before
        border = open_edges(vertices, cells[alive], EdgeTable(edges.ends, edges.of_cells[alive], edges.count))
        border = border.take(~known[border.edge])
        on_rim[border.edge] = rims.of_edges(vertices, border)
        known[border.edge] = True
        candidates = np.flatnonzero(alive & (edges.count == 1)[edges.of_cells].any(axis=1))
        if not remove_flap_triangles(candidates, edges.of_cells, edges.count, on_rim.copy(), alive):
            break
    return np.ascontiguousarray(cells[alive])


def fill_holes(rims: RimTest, vertices: Floats, cells: Ints) -> Ints:
    """Return the triangles (k, 3), followed by triangles of least area, of any orientation, that fill holes off rims.

    A hole is filled if all centres of its triangles are within a spacing of the surface.
    """
    from cpmkit.meshing.contouring.contouring_kernels import least_area_triangles

    border = open_edges(vertices, cells, edge_table(cells))
    on_rim = rims.of_edges(vertices, border)
    loops = _hole_loops(border.ends, on_rim, len(vertices))
    fillings = [loop[least_area_triangles(np.ascontiguousarray(vertices[loop]))] for loop in loops]
    if not fillings:
        return cells
    centres = vertices[np.concatenate(fillings)].mean(axis=1)
    is_close = norms(rims.source.closest_point(centres).points - centres) <= rims.spacing
    last = np.cumsum([len(filling) for filling in fillings])
    accepted = [filling for filling, ok in zip(fillings, np.split(is_close, last[:-1]), strict=True) if ok.all()]
    return np.concatenate([cells, *accepted])


def _hole_loops(ends: Ints, on_rim: Bools, count: int) -> list[Ints]:
    """Return for each hole its vertices (b,) in cyclic order, from the open edges of the triangulation.

    A hole is a closed border of at most 80 open edges, a third of them on rims at most. ``ends`` (b, 2) are vertices
    of each open edge, ``on_rim`` (b,) says whether it lies beside a rim; ``count`` is the number of vertices.
    """
    borders, label = connected_components(count, ends)
    size = np.bincount(label[ends[:, 0]], minlength=borders)
    rim = np.bincount(label[ends[:, 0]], on_rim, minlength=borders)
    is_hole = (size > 2) & (size <= 80) & (rim <= size / 3)
    degree = np.bincount(ends.ravel(), minlength=count)
    is_hole[label[(degree > 0) & (degree != 2)]] = False
    return [_order_loop(ends[label[ends[:, 0]] == border]) for border in np.flatnonzero(is_hole)]


def _order_loop(ends: Ints) -> Ints:
    """Return the vertices (b,) of one closed loop of edges ``ends`` (b, 2), in cyclic order from the first edge."""
    neighbours: dict[int, list[int]] = {}
    for a, b in ends.tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    loop = [int(ends[0, 0]), int(ends[0, 1])]
    while len(loop) < len(ends):
        first, second = neighbours[loop[-1]]
        loop.append(second if first == loop[-2] else first)
    return np.array(loop, dtype=np.int64)


#: Sheets that cross at an edge make angles above this with each other, in degrees.
CROSSING_ANGLE = 35.0


def separate_sheets(source: LocalSource, vertices: Floats, cells: Ints) -> tuple[Floats, Ints]:
    """Return vertices (v, 3) and triangles (m, 3), with sheets separated at edges of four triangles unless they cross.

    The four triangles are paired by the smaller angles between them; only the two of a pair keep common vertices.
    Where the two pairs stay connected through other triangles, the edge of one pair is halved.
    """
    for _ in range(6):  # each round treats the edges that the round before left or made
        edges = edge_table(cells)
        edge, order, gaps, crossing = _edges_of_four(source, vertices, cells, edges)
        shifted = gaps[:, 0] + gaps[:, 2] > gaps[:, 1] + gaps[:, 3]
        order = np.where(shifted[:, None], np.roll(order, -1, axis=1), order)
        edge, pairs = edge[~crossing], order[~crossing].reshape(-1, 2, 2)
        cells, copied = _split_vertices(cells, edges, edge, pairs)
        vertices, cells = _halve_common_edges(source, vertices[copied], cells, pairs)
        if not len(edge):
            break
    return vertices, cells


def crowded_edges(source: LocalSource, vertices: Floats, cells: Ints, edges: EdgeTable) -> Ints:
    """Return the numbers (k,) of ``edges`` of four triangles or more at which no two sheets cross."""
    edge, _, _, crossing = _edges_of_four(source, vertices, cells, edges)
    return np.setdiff1d(np.flatnonzero(edges.count > 3), edge[crossing])


def _edges_of_four(
    source: LocalSource, vertices: Floats, cells: Ints, edges: EdgeTable
) -> tuple[Ints, Ints, Floats, Bools]:
    """Return the edges (k,) of four triangles, slots (k, 4), angles (k, 4), and whether (k,) two sheets cross there.

    The slots, see :meth:`EdgeTable.slots_of`, are those of the triangles in their order around the edge; angle j, in
    radians, is that from triangle j to the next one in this order, the last to the first.
    """
    edge = np.flatnonzero(edges.count == 4)
    slots = edges.slots_of(edge, 4)
    if not len(edge):
        return edge, slots, np.zeros((0, 4)), np.zeros(0, dtype=bool)
    angle, slots = _angles_around(vertices, cells, edges, edge, slots)
    gaps = np.diff(angle, axis=1, append=angle[:, :1] + 2 * np.pi)
    crossing = (gaps > np.radians(CROSSING_ANGLE)).all(axis=1)
    crossing[crossing] = _reaches_apexes(source, vertices, cells, edges.ends[edge[crossing]], slots[crossing])
    rest = np.flatnonzero(~crossing)
    crossing[rest] = _continues_across(source, vertices, cells, edges.ends[edge[rest]], slots[rest])
    return edge, slots, gaps, crossing


def _angles_around(vertices: Floats, cells: Ints, edges: EdgeTable, edge: Ints, slots: Ints) -> tuple[Floats, Ints]:
    """Return ascending angles (k, 4) of the triangles at ``slots`` (k, 4) around ``edge`` (k,), and slots so sorted.

    Angles are in radians, from 0 to 2 pi, counted from the triangle at the first slot.
    """
    tail, head = vertices[edges.ends[edge]].transpose(1, 0, 2)
    along = unit(head - tail)
    outward = vertices[cells.ravel()[slots]] - tail[:, None]
    outward = outward - dots(outward, along[:, None])[..., None] * along[:, None]
    first = unit(outward[:, 0])[:, None]
    angle = np.arctan2(dots(outward, np.cross(along, first[:, 0])[:, None]), dots(outward, first)) % (2 * np.pi)
    order = np.argsort(angle, axis=1)
    return np.take_along_axis(angle, order, axis=1), np.take_along_axis(slots, order, axis=1)


def _reaches_apexes(source: LocalSource, vertices: Floats, cells: Ints, ends: Ints, slots: Ints) -> Bools:
    """Return for each edge (k,) whether the surface continues from it towards the apexes of all four triangles.

    ``ends`` (k, 2) are the vertices of the edges, ``slots`` (k, 4) their triangles.
    """
    middle = vertices[ends].mean(axis=1)[:, None]
    towards = vertices[cells.ravel()[slots]] - middle
    points = (middle + 0.3 * towards).reshape(-1, 3)
    off = norms(source.closest_point(points).points - points).reshape(-1, 4)
    return np.asarray((off <= 0.04 * norms(towards)).all(axis=1))


def _continues_across(source: LocalSource, vertices: Floats, cells: Ints, ends: Ints, slots: Ints) -> Bools:
    """Return for each edge (k,) whether the surface continues all four triangles straight across it, in two sheets.

    ``ends`` (k, 2) are the vertices of the edges, ``slots`` (k, 4) their triangles.
    """
    if not len(ends):
        return np.zeros(0, dtype=bool)
    middle = vertices[ends].mean(axis=1)[:, None]
    along = unit(np.diff(vertices[ends], axis=1)[:, 0])[:, None]
    outward = vertices[cells.ravel()[slots]] - middle
    outward = outward - dots(outward, along)[..., None] * along
    length = norms(outward).max(axis=1)[:, None]
    outward = unit(outward.reshape(-1, 3)).reshape(-1, 4, 3)
    both_ways = np.stack([outward, -outward], axis=2)
    points = (middle[:, :, None] + length[..., None, None] * both_ways).reshape(-1, 3)
    off = norms(source.closest_point(points).points - points).reshape(-1, 8)
    two_sheets = norms(np.cross(outward, outward[:, :1])).max(axis=1) > np.sin(np.radians(CROSSING_ANGLE))
    return np.asarray(two_sheets & (off <= 0.2 * length).all(axis=1))


def _split_vertices(cells: Ints, edges: EdgeTable, separated: Ints, pairs: Ints) -> tuple[Ints, Ints]:
    """Return the triangles (m, 3) with a separate vertex for each fan, and the old vertex (v,) of each new vertex.

    A fan is a set of triangles at a vertex that are connected across edges.
    ``separated`` (k,): edges across which only the triangles of a pair are in one fan; across other edges all are.
    ``pairs`` (k, 2, 2): the slots of the two pairs of each of these edges.
    """
    slots = np.argsort(edges.of_cells.ravel(), kind="stable")
    same = np.flatnonzero(np.diff(edges.of_cells.ravel()[slots]) == 0)
    same = same[~np.isin(edges.of_cells.ravel()[slots[same]], separated)]
    first, second = (np.concatenate([slots[same + k], pairs[:, :, k].ravel()]) for k in range(2))
    links = []
    for step in (1, 2):  # the corners at either end of a shared edge
        corner = first // 3 * 3 + (first + step) % 3
        matches = [second // 3 * 3 + (second + k) % 3 for k in (1, 2)]
        is_same = cells.ravel()[corner] == cells.ravel()[matches[0]]
        links.append((corner, np.where(is_same, matches[0], matches[1])))
    rows, columns = (np.concatenate(ends) for ends in zip(*links, strict=True))
    count, fan = connected_components(cells.size, np.stack([rows, columns], axis=1))
    copied = np.empty(count, dtype=np.int64)
    copied[fan] = cells.ravel()
    return fan.reshape(-1, 3), copied


def _halve_common_edges(source: LocalSource, vertices: Floats, cells: Ints, pairs: Ints) -> tuple[Floats, Ints]:
    """Return vertices and triangles, with the edge of the second pair of triangles halved if both pairs still share it.

    ``pairs`` (k, 2, 2) are the slots of the triangles of both pairs.
    """
    ends = [np.sort(edge_ends(cells, pairs[:, k, 0]), axis=1) for k in range(2)]
    split = pairs[np.flatnonzero((ends[0] == ends[1]).all(axis=1)), 1]
    touched, times = np.unique(split.ravel() // 3, return_counts=True)
    split = split[np.isin(split // 3, touched[times == 1]).all(axis=1)]
    middle = vertices[edge_ends(cells, split[:, 0])].mean(axis=1)
    new = len(vertices) + np.arange(len(split))
    vertices = np.concatenate([vertices, source.closest_point(middle).points])
    return vertices, halve_edges(cells, split.ravel(), np.repeat(new, 2))
