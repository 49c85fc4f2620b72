"""The sectors of a solid around the facets of its closed oriented mesh, in which cells may lie upon each other.

A boundary inside a solid is covered by two cells of the mesh, with opposite normals. Around a facet, a vertex of
segments or an edge of triangles, the cells bound sectors of the solid: one where the boundary ends, two in its interior
or where it ends on the skin, four where two boundaries cross. Two cells are connected if they bound one sector.
"""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.vector_algebra import dots, unit
from cpmkit.mesh.mesh import Mesh
from cpmkit.runtime.index_sets import connected_components
from cpmkit.types import Bools, Floats, Ints


def sector_facets(mesh: Mesh) -> tuple[Ints, Bools]:
    """Return the number (m, k) of the sector at the facet opposite to each corner of the cells, and whether it is open.

    ``mesh`` has flat cells: segments with the inside on their left, or triangles counterclockwise from outside. A
    sector is open, (m, k), if the cell that follows around its facet has its inside on the other side.
    """
    numbers = mesh.connectivity.facet_numbers
    angles, is_ahead = _angles(mesh)
    order = np.lexsort([is_ahead.ravel(), angles.ravel(), numbers.ravel()])
    facet, ahead = numbers.ravel()[order], is_ahead.ravel()[order]
    counts = np.bincount(facet, minlength=mesh.connectivity.facet_count)
    rank = np.arange(len(order))
    first = (np.cumsum(counts) - counts)[facet]
    following = np.where(rank + 1 < first + counts[facet], rank + 1, first)
    before = np.empty_like(rank)
    before[following] = rank
    sectors, is_open = np.empty_like(order), np.zeros(len(order), dtype=bool)
    sectors[order] = np.where(ahead, rank, before)
    is_open[order] = np.where(ahead, ahead[following], ~ahead[before])
    return sectors.reshape(numbers.shape), is_open.reshape(numbers.shape)


def crossed_vertices(mesh: Mesh) -> Ints:
    """Return the vertices (k,) at which triangles cross: the orders of triangles around edges contradict each other.

    On a small sphere around a vertex triangles are arcs between the points of edges. The orders of arcs around points
    give the outlines of the regions between them, whose number follows from Euler's formula if no arcs cross.
    """
    numbers, cells = mesh.connectivity.facet_numbers, mesh.cells
    angles, is_ahead = _angles(mesh)
    order = np.lexsort([angles.ravel(), numbers.ravel()])
    counts = np.bincount(numbers.ravel(), minlength=mesh.connectivity.facet_count)
    ends = np.cumsum(counts)
    following = np.append(order[1:], 0)
    following[ends[counts > 0] - 1] = order[(ends - counts)[counts > 0]]
    ahead, pairs = is_ahead.ravel(), []
    (cell, corner), (other, other_corner) = np.divmod(order, 3), np.divmod(following, 3)
    for k in (1, 2):
        at, match = (corner + k) % 3, (other_corner + 1) % 3
        match = np.where(cells[other, match] == cells[cell, at], match, (other_corner + 2) % 3)
        pairs.append(np.stack([6 * cell + 2 * at + ahead[order], 6 * other + 2 * match + ~ahead[following]], axis=1))
    links, vertex = np.concatenate(pairs), np.repeat(cells.ravel(), 2)

    def count(ends: Ints, of: Ints) -> Ints:
        """Return the number (v,) of connected components of the elements ``of`` (n,) each vertex."""
        total, label = connected_components(len(of), ends)
        at = np.empty(total, dtype=np.int64)
        at[label] = of
        return np.bincount(at, minlength=len(mesh.vertices))

    edges, arcs = (np.bincount(each.ravel(), minlength=len(mesh.vertices)) for each in (mesh.edges.ends, cells))
    return np.flatnonzero(count(links, vertex) != 2 * count(links // 2, cells.ravel()) - edges + arcs)


def _angles(mesh: Mesh) -> tuple[Floats, Bools]:
    """Return the angle (m, k) of each cell around the facet opposite to each corner, and whether its inside is ahead.

    Ahead is the direction of growing angles, which is the same for all cells at a facet.
    """
    corners = mesh.vertices[mesh.cells]
    if mesh.dim == 2:  # the facet opposite to the first corner is the end, from which the left is behind
        away = corners - corners[:, ::-1]
        return np.arctan2(away[..., 1], away[..., 0]), np.broadcast_to([False, True], away.shape[:2])
    tail, head = np.roll(mesh.cells, -1, axis=1), np.roll(mesh.cells, -2, axis=1)
    is_turned = tail > head
    start = np.where(is_turned, head, tail)
    along = unit(mesh.vertices[np.where(is_turned, tail, head)] - mesh.vertices[start])
    # two axes normal to the edge, the same for all cells at it
    axis = np.eye(3)[np.abs(along).argmin(axis=-1)]
    first = unit(np.cross(along, axis))
    away = corners - mesh.vertices[start]
    return np.arctan2(dots(away, np.cross(along, first)), dots(away, first)), is_turned
