"""One vertex for each piece of the surface in each cell that it crosses edges of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.meshing.contouring.crossings import Crossings
from cpmkit.meshing.contouring.joining import JoinTolerances, joined
from cpmkit.meshing.contouring.nodes import Nodes
from cpmkit.protocols import Floats, Ints

#: Of the planes through a vertex's crossings: eigenvalues below this share of the largest say nothing.
TELLING_EIGENVALUE = 0.12
#: How far a vertex may leave its cell before it goes to its foot, as a share of the cell's side.
OUTSIDE_CELL = 0.1
#: Creases this far outside a cell still join what it holds, as a share of the side: those on its faces.
BESIDE_CELL = 0.02


@dataclass(frozen=True, eq=False)
class DualVertices:
    """Vertices on the surface, and which of them stand round each crossing.

    Attributes
    ----------
    points, normals : (v, 3) float64
        The vertices, and the unit normal there.
    cell : (v,) int64
        The code of the cell of each.
    around : (c, 4) int64
        The vertices in the cells round the edge of each crossing, in their order round it.
    """

    points: Floats
    normals: Floats
    cell: Ints
    around: Ints


def dual_vertices(source: LocalSource, nodes: Nodes, found: Crossings, tolerances: JoinTolerances) -> DualVertices:
    """Return a vertex for each piece in each cell, of those crossings that hang together there."""
    cells = _cells_around(nodes, found)
    order = np.argsort(cells.ravel(), kind="stable")
    member, sorted_cells = order // 4, cells.ravel()[order]
    start = np.append(np.flatnonzero(np.diff(sorted_cells, prepend=-1)), len(order)).astype(np.int64)
    low = nodes.place(nodes.codes.decode(sorted_cells)) - BESIDE_CELL * nodes.spacing
    boxes = np.stack([low, low + (1 + 2 * BESIDE_CELL) * nodes.spacing])
    group = pieces(source, start, member, found.points, found.normals, tolerances, boxes)
    roots, piece = np.unique(group, return_inverse=True)
    around = np.empty(len(order), dtype=np.int64)
    around[order] = piece
    vertex, normals = _least_squares(nodes, sorted_cells[roots], found, member, piece, len(roots))
    points = source.closest_point(vertex).points
    return DualVertices(points, normals, sorted_cells[roots], around.reshape(-1, 4))


def _cells_around(nodes: Nodes, found: Crossings) -> Ints:
    """Return the codes (c, 4) of the cells round the edge of each crossing, in their order round it."""
    strides = nodes.codes.strides
    u, v = strides[(found.axis + 1) % 3], strides[(found.axis + 2) % 3]
    return np.asarray(nodes.codes.encode(found.node)[:, None] - np.stack([0 * u, u, u + v, v], axis=1))


def pieces(
    source: LocalSource,
    start: Ints,
    member: Ints,
    points: Floats,
    normals: Floats,
    tolerances: JoinTolerances,
    boxes: Floats,
) -> Ints:
    """Return a number (k,) that entries have in common where crossings of one cell hang together in it.

    Parameters
    ----------
    source : LocalSource
        The manifold.
    start : (cells + 1,) int64
        Where each cell's entries begin.
    member : (k,) int64
        The crossing of each entry.
    points, normals : (c, d) float64
        The crossings, and the directions that tell where they lie flat.
    tolerances : JoinTolerances
        How exactly crossings are known.
    boxes : (2, k, 3) float64
        The lowest and the highest corner of the cell of each entry.
    """
    from cpmkit.meshing.contouring.grouping_kernels import nearest_pairs, unite, unite_flat

    group = np.arange(len(member))
    unite_flat(start, member, points, normals, tolerances.sine, tolerances.cosine, tolerances.lost, group)
    pairs = np.empty((0, 2), dtype=np.int64)
    pairs = np.empty((nearest_pairs(start, member, points, group, pairs), 2), dtype=np.int64)
    nearest_pairs(start, member, points, group, pairs)
    i, j = member[pairs].T
    together = joined(
        source, points[i], points[j], normals[i], normals[j], tolerances, (boxes[0, pairs[:, 0]], boxes[1, pairs[:, 0]])
    )
    unite(np.ascontiguousarray(pairs[together, 0]), np.ascontiguousarray(pairs[together, 1]), group)
    return group


def _least_squares(
    nodes: Nodes, cells: Ints, found: Crossings, member: Ints, piece: Ints, count: int
) -> tuple[Floats, Floats]:
    """Return the points (count, 3) nearest to the planes of each piece's crossings, about their mean, and normals.

    Directions of which the planes say little are left at the mean, and points that leave their cell are clipped to it.
    """
    share = 1.0 / np.bincount(piece, minlength=count)
    points, n = found.points[member], found.normals[member]

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(piece, values, minlength=count) * share)

    centre = np.stack([mean(points[:, k]) for k in range(3)], axis=1)
    height = ((points - centre[piece]) * n).sum(axis=1)
    matrix = np.stack([np.stack([mean(n[:, i] * n[:, j]) for j in range(3)], axis=1) for i in range(3)], axis=1)
    side = np.stack([mean(n[:, k] * height) for k in range(3)], axis=1)
    values, axes = np.linalg.eigh(matrix)
    telling = values >= TELLING_EIGENVALUE * values[:, -1:]
    part = np.einsum("vki,vk->vi", axes, side) * np.where(telling, 1.0 / np.where(telling, values, 1.0), 0.0)
    low = nodes.place(nodes.codes.decode(cells))
    reach = OUTSIDE_CELL * nodes.spacing
    vertex = np.clip(centre + np.einsum("vki,vi->vk", axes, part), low - reach, low + nodes.spacing + reach)
    return vertex, np.ascontiguousarray(axes[:, :, -1])
