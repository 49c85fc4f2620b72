"""What borders on a rim is moved onto it, and triangles that fold over there are drawn together."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.meshing.contouring.contour_edges import Border, border_of, edges_of
from cpmkit.meshing.contouring.repair import MOST_ROUNDS, collapsed, shortest_apart
from cpmkit.meshing.contouring.rim_test import RimTest
from cpmkit.protocols import Bools, Floats, Ints

#: How far beyond a border its rim is looked for, in spacings, one round after another.
RIM_REACHES = (1.2, 1.2, 2.0)
#: Triangles between points of rims whose centres are so far off the surface, in spacings, are no part of it; those
#: that are lower than this share of their longest side have no area.
BRIDGE_OFF, NO_HEIGHT = 0.1, 1e-3
#: Neighbours beside a rim fold over if their directions from their edge have a cosine above this; edges of them that
#: are shorter than this, in spacings, are drawn together.
FOLD_COSINE, FOLD_EDGE = 0.8, 1.0
#: Vertices of borders so near to each other, in spacings, lie at one place.
SAME_PLACE = 2e-3


def onto_rims(rims: RimTest, vertices: Floats, cells: Ints) -> tuple[Floats, Bools]:
    """Return the vertices, those beside rims moved onto them, and which (v,) lie on a rim now."""
    edges, moved, on_rim = edges_of(cells), vertices.copy(), np.zeros(len(vertices), dtype=bool)
    for reach in RIM_REACHES:
        border = border_of(moved, cells, edges)  # anew: what was moved points the others better
        outward, across = np.zeros_like(vertices), np.zeros_like(vertices)
        for end in range(2):
            np.add.at(outward, border.ends[:, end], border.conormals)
            across[border.ends[:, end]] = border.across(moved)
        outward = unit(outward)
        left = np.flatnonzero((outward != 0).any(axis=1) & ~on_rim)
        way = np.full(len(left), reach * rims.spacing)
        feet, found = rims.beyond(moved[left], outward[left], across[left], way)
        moved[left[found]], on_rim[left[found]] = feet[found], True
    return moved, on_rim


def rim_edges(border: Border, on_rim: Bools) -> Ints:
    """Return which border edges lie on a rim: those with both ends there."""
    return np.flatnonzero(on_rim[border.ends].all(axis=1))


def without_bridges(rims: RimTest, vertices: Floats, cells: Ints, on_rim: Bools) -> Ints:
    """Return the triangles without those between three points of rims that leave the surface or have no area.

    The latter go where they are open: they lie along one rim.
    """
    while True:
        rows = np.flatnonzero(on_rim[cells].all(axis=1))
        corners = vertices[cells[rows]]
        centres = corners.mean(axis=1)
        off = norms(rims.source.closest_point(centres).points - centres) > BRIDGE_OFF * rims.spacing
        longest = norms(corners - np.roll(corners, 1, axis=1)).max(axis=1)
        edges = edges_of(cells)
        is_open = (edges.count[edges.of[rows]] == 1).any(axis=1)
        off |= is_open & (_areas(vertices, cells[rows]) < NO_HEIGHT * longest**2)
        if not off.any():
            return cells
        cells = np.ascontiguousarray(np.delete(cells, rows[off], axis=0))


def without_folds(vertices: Floats, cells: Ints, on_rim: Bools, spacing: float) -> tuple[Ints, Floats]:
    """Return the triangles with those that fold over beside a rim drawn together, and the centres (k, 3) of those left.

    Of two neighbours that fold over the smaller one loses its shortest edge; a vertex on the rim stays.
    """
    for _ in range(MOST_ROUNDS):
        first, second = _folds(vertices, cells, on_rim)
        if not len(first):
            break
        smaller = np.unique(np.where(_areas(vertices, cells[first]) < _areas(vertices, cells[second]), first, second))
        ends, length = _edges_of_cells(vertices, cells, smaller)
        short = length < FOLD_EDGE * spacing
        if not short.any():
            break
        chosen = ends[short][shortest_apart(ends[short], length[short], len(vertices))]
        swap = on_rim[chosen[:, 1]] & ~on_rim[chosen[:, 0]]
        cells = collapsed(cells, np.where(swap[:, None], chosen[:, ::-1], chosen), len(vertices))
    return cells, vertices[cells[_folds(vertices, cells, on_rim)[0]]].mean(axis=1)


def joined_at_corners(vertices: Floats, cells: Ints, spacing: float) -> Ints:
    """Return the triangles with vertices of borders at one place made one, where two border edges run between such.

    A corner of a rim draws several vertices to itself.
    """
    from scipy.spatial import cKDTree

    edges = edges_of(cells)
    ends = edges.ends[edges.count == 1]
    border = np.unique(ends)
    pairs = border[cKDTree(vertices[border]).query_pairs(SAME_PLACE * spacing, output_type="ndarray")]
    place = np.arange(len(vertices))
    np.minimum.at(place, pairs.max(axis=1), pairs.min(axis=1))
    line, count = np.unique(np.sort(place[ends], axis=1), axis=0, return_inverse=True, return_counts=True)[1:]
    doubled = np.isin(pairs, ends[count[line.ravel()] == 2]).all(axis=1)
    return collapsed(cells, np.sort(pairs[doubled], axis=1), len(vertices))


def _folds(vertices: Floats, cells: Ints, on_rim: Bools) -> tuple[Ints, Ints]:
    """Return the pairs of triangles that share an edge and lie on each other, with a corner on a rim."""
    edges = edges_of(cells)
    slots = np.argsort(edges.of.ravel(), kind="stable")
    start = np.cumsum(edges.count) - edges.count
    two = np.flatnonzero(edges.count == 2)
    pair = slots[start[two][:, None] + np.arange(2)]
    beside = np.flatnonzero(np.isin(pair // 3, np.flatnonzero(on_rim[cells].any(axis=1))).any(axis=1))
    two, pair = two[beside], pair[beside]
    tail, head = vertices[edges.ends[two]].transpose(1, 0, 2)
    along = unit(head - tail)
    out = [vertices[cells.ravel()[pair[:, k]]] - tail for k in range(2)]
    out = [unit(side - dots(side, along)[:, None] * along) for side in out]
    folded = np.flatnonzero(dots(out[0], out[1]) > FOLD_COSINE)
    return pair[folded, 0] // 3, pair[folded, 1] // 3


def _areas(vertices: Floats, cells: Ints) -> Floats:
    corners = vertices[cells]
    return norms(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def _edges_of_cells(vertices: Floats, cells: Ints, chosen: Ints) -> tuple[Ints, Floats]:
    """Return the shortest edge (k, 2) of each chosen triangle that pinches no border, and its length."""
    corners = cells[chosen]
    ends = corners[:, [[1, 2], [2, 0], [0, 1]]]
    length = norms(vertices[ends[..., 1]] - vertices[ends[..., 0]])
    edges = edges_of(cells)
    border = np.zeros(len(vertices), dtype=bool)
    border[edges.ends[edges.count == 1]] = True
    pinches = border[ends].all(axis=2) & (edges.count[edges.of[chosen]] > 1)
    length = np.where(pinches, np.inf, length)
    rows, least = np.arange(len(chosen)), np.argmin(length, axis=1)
    return ends[rows, least], length[rows, least]
