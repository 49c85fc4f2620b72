"""Dual contouring: a vertex for each connected piece of the surface in a cell, a quadrilateral for each crossing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.meshing.contouring.connectedness import FLAT_COSINE, FLAT_SINE, connected_on_surface
from cpmkit.meshing.contouring.contour_edges import edge_table
from cpmkit.meshing.contouring.contour_nodes import LatticeNodes
from cpmkit.meshing.contouring.edge_crossings import Crossings
from cpmkit.types import Floats, Ints

#: Eigenvalues of a sum of projections below this share of the largest one are noise: their directions are not used.
LEAST_EIGENVALUE = 0.12


@dataclass(frozen=True, eq=False)
class DualVertices:
    """Vertices on the surface, and the four vertices in the cells around each crossing.

    Attributes
    ----------
    points, normals : (v, 3) float64
        The vertices, and unit normals there of either sign.
    around : (c, 4) int64
        The vertices in the cells around the lattice edge of each crossing, in cyclic order.
    """

    points: Floats
    normals: Floats
    around: Ints


def dual_vertices(source: LocalSource, nodes: LatticeNodes, crossings: Crossings) -> DualVertices:
    """Return a vertex for each group of crossings of one cell's edges that are connected on the surface in the cell."""
    cells = _cells_around(nodes, crossings)
    order = np.argsort(cells.ravel(), kind="stable")
    member, sorted_cells = order // 4, cells.ravel()[order]
    start = np.append(np.flatnonzero(np.diff(sorted_cells, prepend=-1)), len(order)).astype(np.int64)
    group = _connected_groups(source, nodes, crossings, start, member, sorted_cells)
    roots, piece = np.unique(group, return_inverse=True)
    around = np.empty(len(order), dtype=np.int64)
    around[order] = piece
    vertex, normals = _least_squares_vertices(nodes, sorted_cells[roots], crossings, member, piece)
    return DualVertices(source.closest_point(vertex).points, normals, around.reshape(-1, 4))


def _cells_around(nodes: LatticeNodes, crossings: Crossings) -> Ints:
    """Return the codes (c, 4) of the cells around the lattice edge of each crossing, in cyclic order."""
    strides = nodes.codes.strides
    u, v = strides[(crossings.axis + 1) % 3], strides[(crossings.axis + 2) % 3]
    return np.asarray(nodes.codes.encode(crossings.node)[:, None] - np.stack([0 * u, u, u + v, v], axis=1))


def _connected_groups(
    source: LocalSource, nodes: LatticeNodes, crossings: Crossings, start: Ints, member: Ints, cells: Ints
) -> Ints:
    """Return the group (k,) of each entry: entries of one cell whose crossings are connected in it have one group.

    An entry is a pair of a cell and a crossing of one of its edges; a group is named by one of its entries.

    Parameters
    ----------
    source, nodes, crossings
    start : (cells + 1,) int64
        The first entry of each cell, and the number of entries.
    member, cells : (k,) int64
        The crossing of each entry, and the code of its cell.
    """
    from cpmkit.meshing.contouring.contouring_kernels import nearest_pairs, unite, unite_flat

    points, normals = crossings.points, crossings.normals
    # Crossings are known to this share of the spacing, and to so many times the noise of closest points.
    position_error = max(2e-3 * nodes.spacing, 4.0 * source.noise)
    group = np.arange(len(member))
    unite_flat(start, member, points, normals, FLAT_SINE, FLAT_COSINE, position_error, group)
    pairs = np.empty((0, 2), dtype=np.int64)
    pairs = np.empty((nearest_pairs(start, member, points, group, pairs), 2), dtype=np.int64)
    nearest_pairs(start, member, points, group, pairs)
    i, j = member[pairs].T
    margin = 0.02 * nodes.spacing  # creases on a cell's faces connect what the cell holds
    low = (nodes.position_of(nodes.codes.decode(cells)) - margin)[pairs[:, 0]]
    box = low, low + (nodes.spacing + 2 * margin)
    connected = connected_on_surface(source, points[i], points[j], normals[i], normals[j], position_error, box)
    unite(np.ascontiguousarray(pairs[connected, 0]), np.ascontiguousarray(pairs[connected, 1]), group)
    return group


def _least_squares_vertices(
    nodes: LatticeNodes, cells: Ints, crossings: Crossings, member: Ints, piece: Ints
) -> tuple[Floats, Floats]:
    """Return the point (v, 3) nearest to the tangent planes of each group's crossings, and a unit normal (v, 3) there.

    Least squares about the mean of the crossings. Directions of small eigenvalues stay at the mean. Points that leave
    their cell by more than a tenth of its side are clipped.

    Parameters
    ----------
    nodes, crossings
    cells : (v,) int64
        The code of the cell of each group.
    member, piece : (k,) int64
        The crossing and the group of each entry.
    """
    count = len(cells)
    share = 1.0 / np.bincount(piece, minlength=count)
    points, n = crossings.points[member], crossings.normals[member]

    def mean(values: Floats) -> Floats:
        """Return the mean (v,) of ``values`` (k,) over the entries of each group."""
        return np.asarray(np.bincount(piece, values, minlength=count) * share)

    centre = np.stack([mean(points[:, k]) for k in range(3)], axis=1)
    height = ((points - centre[piece]) * n).sum(axis=1)
    matrix = np.stack([np.stack([mean(n[:, i] * n[:, j]) for j in range(3)], axis=1) for i in range(3)], axis=1)
    side = np.stack([mean(n[:, k] * height) for k in range(3)], axis=1)
    step, axes = solve_truncated(matrix, side)
    low = nodes.position_of(nodes.codes.decode(cells))
    margin = 0.1 * nodes.spacing
    vertex = np.clip(centre + step, low - margin, low + nodes.spacing + margin)
    return vertex, np.ascontiguousarray(axes[:, :, -1])


def solve_truncated(matrix: Floats, side: Floats) -> tuple[Floats, Floats]:
    """Return solutions (n, d) of symmetric systems without their small eigenvalues, and the eigenvectors (n, d, d).

    ``matrix`` is (n, d, d), the right-hand ``side`` (n, d).
    """
    values, axes = np.linalg.eigh(matrix)
    used = values >= LEAST_EIGENVALUE * values[:, -1:]
    part = np.einsum("vki,vk->vi", axes, side) * np.where(used, 1.0 / np.where(used, values, 1.0), 0.0)
    return np.asarray(np.einsum("vki,vi->vk", axes, part)), axes


def dual_triangles(source: LocalSource, dual: DualVertices) -> Ints:
    """Return the triangles (m, 3) into which the quadrilaterals around all crossings are split.

    Quadrilaterals are split along the diagonal whose midpoint is nearer to the surface, planar ones along the shorter.
    """
    quads = _without_doubles(dual.around)
    corners, normals = dual.points[quads], dual.normals[quads]
    first, second = 0.5 * (corners[:, 0] + corners[:, 2]), 0.5 * (corners[:, 1] + corners[:, 3])
    excess = norms(corners[:, 0] - corners[:, 2]) - norms(corners[:, 1] - corners[:, 3])
    edges = np.roll(corners, -1, axis=1) - corners
    rise = np.maximum(np.abs(dots(edges, normals)), np.abs(dots(edges, np.roll(normals, -1, axis=1))))
    curved = np.flatnonzero((rise > 0.1 * norms(edges)).any(axis=1))
    if len(curved):
        misses = [norms(x - source.closest_point(x).points) for x in (first[curved], second[curved])]
        excess[curved] = misses[0] - misses[1]
    turned = np.where((excess > 0)[:, None], np.roll(quads, -1, axis=1), quads)
    return np.ascontiguousarray(turned[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3))


def _without_doubles(quads: Ints) -> Ints:
    """Return the quadrilaterals (q, 4), with at most one of several on the same four vertices.

    Two on the same vertices enclose a part thinner than a cell, and can be left out. One is kept where another sheet
    ends at their edges, since that sheet would be cut off.
    """
    ordered = np.sort(quads, axis=1)
    _, first, same, count = np.unique(ordered, axis=0, return_index=True, return_inverse=True, return_counts=True)
    several, single = quads[first[count > 1]], quads[count[same.ravel()] == 1]
    single_edges = edge_table(single)
    ends = np.sort(np.stack([several, np.roll(several, -1, axis=1)], axis=-1), axis=-1)
    odd = single_edges.ends[single_edges.count % 2 == 1]
    size = int(quads.max(initial=0)) + 1
    needed = np.isin(ends @ [size, 1], odd @ [size, 1]).any(axis=1) | (count[count > 1] % 2 == 1)
    return np.concatenate([single, several[needed]])
