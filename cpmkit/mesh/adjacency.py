"""Adjacency of cells: facets on boundaries and rims, the sides of cells, unwelded seams, and the repair of meshes.

A repair welds vertices, removes repeated cells, and separates cells that share only a vertex.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.vector_algebra import dots, nearest_shares, norms, unit
from cpmkit.mesh.mesh import Mesh
from cpmkit.types import Bools, Floats, Ints

#: A rim edge lies on another rim edge if its midpoint is nearer to that edge than this share of its length.
SEAM_EDGE_SHARE = 0.05
#: Sides of cells are computed up to so many spacings from a boundary: points are compared with nearby samples only.
SIDE_REACH_SPACINGS = 2.0


@dataclass(frozen=True, eq=False)
class HalfFacets:
    """Half facets, pairs of a cell and one of its facets, for all facets on boundaries and on the rim.

    A facet on a boundary occurs once for each cell beside it.
    """

    #: cell, facet (n,): the number of the cell, and that of the corner of the cell to which the facet is opposite.
    cell: Ints
    facet: Ints
    cut: Ints  #: (n,): the row of the facet in ``mesh.cut``; -1 on a rim where no boundary lies.
    #: (n,): +1 if the cell traverses the facet in the direction of ``mesh.cut``, or no boundary lies there, -1 if in
    #: the reverse direction; on a curve +1 for a cell that ends there, -1 for a cell that starts there.
    along: Ints


def cut_corners(mesh: Mesh) -> Ints:
    """Return the vertex (m, k) of each corner of each cell once the mesh is cut at the facets in ``mesh.cut``.

    Corners of triangles at one vertex stay one vertex if a path over edges that are not cut connects the triangles; an
    edge of three triangles or more connects all of them. Corners of segments at one vertex stay one vertex, unless it
    is cut: then each corner becomes a separate vertex. Tips, junctions, rims and one-sided surfaces are no special
    case.
    """
    if mesh.manifold_dim == 1:
        on_boundary = np.zeros(len(mesh.vertices), dtype=bool)
        on_boundary[mesh.cut] = True
        separate = len(mesh.vertices) + np.arange(mesh.cells.size).reshape(mesh.cells.shape)
        numbers = np.unique(np.where(on_boundary[mesh.cells], separate, mesh.cells), return_inverse=True)[1]
        return np.asarray(numbers.reshape(mesh.cells.shape), dtype=np.int64)
    from cpmkit.mesh import mesh_kernels

    cells = np.ascontiguousarray(mesh.cells)
    return np.asarray(mesh_kernels.join_corners(cells, mesh.edges.of_cells, mesh.edge_is_cut))


def has_cut_corners(mesh: Mesh, corners: Ints) -> bool:
    """Return whether cutting splits some vertex into several, given the vertices ``corners`` (m, k) after cutting."""
    return bool(corners.max(initial=-1) + 1 > np.count_nonzero(np.bincount(mesh.cells.ravel())))


def half_facets(mesh: Mesh) -> HalfFacets:
    """Return the facets in ``mesh.cut``, once for each cell beside them, and the facets on the rim.

    If rows of ``mesh.cut`` have the same facet, the first counts; edges that no cell has do not count.
    """
    facets, count = mesh.connectivity.facet_numbers, mesh.connectivity.facet_count
    on_cut = mesh.cut[:, 0] if mesh.manifold_dim == 1 else mesh.cut_edges
    cut = np.full(count + 1, -1)  # the last entry is that of edges without a cell
    cut[on_cut[::-1]] = np.arange(len(on_cut))[::-1]
    cell, facet = np.nonzero(((cut[:-1] >= 0) | mesh.connectivity.on_rim)[facets])
    of = cut[facets[cell, facet]]
    if mesh.manifold_dim == 1:
        along = np.where(facet == 0, 1, -1)
    else:
        starts = mesh.cells[cell, (facet + 1) % 3]
        along = np.where((of < 0) | (starts == np.append(mesh.cut[:, 0], -1)[of]), 1, -1)
    return HalfFacets(cell, facet, of, along)


def facets_of_two_cells(mesh: Mesh) -> tuple[Ints, Ints]:
    """Return the facets (e,) of exactly two cells, ascending, and the two places (e, 2) of each facet, ascending.

    A place is a position in the flattened array (m, k) of the facets of cells.
    """
    from cpmkit.runtime.index_sets import inverse_index

    numbers = np.ascontiguousarray(mesh.connectivity.facet_numbers).ravel()
    starts, places = inverse_index(numbers, mesh.connectivity.facet_count)
    facets = np.flatnonzero(np.diff(starts) == 2)
    return facets, places[starts[facets][:, None] + np.arange(2)]


@dataclass(frozen=True, eq=False)
class Rim:
    """The edges or vertices on the rim of a mesh, and the directions out of the mesh there."""

    rows: Ints  #: (r,): numbers of the edges or vertices, ascending.
    outward: Floats  #: (r, d): vectors tangent to the cell, out of it, as long as the edge; at a vertex their mean.

    def subset(self, chosen: Ints) -> Rim:
        """Return the rim's edges or vertices among distinct ``chosen`` (n,); ``rows`` are positions in ``chosen``."""
        at = np.searchsorted(self.rows, chosen)
        rows = np.flatnonzero(np.append(self.rows, -1)[at] == chosen)
        return Rim(rows, self.outward[at[rows]])


def rim_of_edges(mesh: Mesh) -> Rim:
    """Return the rim edges of triangles, with outward vectors perpendicular to the edges; segments have none."""
    if mesh.manifold_dim == 1:
        return Rim(np.zeros(0, dtype=np.int64), np.zeros((0, mesh.dim)))
    edges = mesh.edges
    cell, facet = np.nonzero(mesh.connectivity.on_rim[edges.of_cells])
    a, b, c = (mesh.vertices[mesh.cells[cell, (facet + k) % 3]] for k in range(3))
    along, across = c - b, b - a
    across = across - (dots(across, along) / np.maximum(dots(along, along), np.finfo(float).tiny))[:, None] * along
    rows = edges.of_cells[cell, facet]
    order = np.argsort(rows)
    return Rim(rows[order], (norms(along)[:, None] * unit(across))[order])


def rim_of_vertices(mesh: Mesh) -> Rim:
    """Return the vertices on the rim, each with the mean of the outward vectors of its edges on the rim.

    For segments these are the ends of the curve, with the vectors of the last segments.
    """
    if mesh.manifold_dim == 1:
        cell, end = np.nonzero(mesh.connectivity.on_rim[mesh.cells])
        ends, other = mesh.cells[cell, end], mesh.cells[cell, 1 - end]
        outward = mesh.vertices[ends] - mesh.vertices[other]
    else:
        of_edges = rim_of_edges(mesh)
        ends = mesh.edges.ends[of_edges.rows].ravel()
        outward = np.repeat(of_edges.outward, 2, axis=0)
    rows, place = np.unique(ends, return_inverse=True)
    times = np.bincount(place, minlength=len(rows))
    sums = [np.bincount(place, outward[:, k], minlength=len(rows)) for k in range(mesh.dim)]
    return Rim(rows, np.stack(sums, axis=1) / np.maximum(times, 1)[:, None])


def seam_midpoints(mesh: Mesh, half: HalfFacets) -> Floats:
    """Return the midpoints (k, d) of rim edges of triangles that lie on another rim edge, without a common vertex.

    Such seams are not welded: nothing flows across them. Rim edges on boundaries are left out; an edge is compared with
    the four others with the nearest midpoints. ``half``: the half facets of this mesh.
    """
    from scipy.spatial import cKDTree

    rim = np.flatnonzero(half.cut < 0)
    if mesh.manifold_dim != 2 or len(rim) < 2:
        return np.zeros((0, mesh.dim))
    ends = mesh.cells[half.cell[rim, None], (half.facet[rim, None] + [1, 2]) % 3]
    a, b = mesh.vertices[ends].transpose(1, 0, 2)
    middle, length = 0.5 * (a + b), norms(b - a)
    others = cKDTree(middle).query(middle, min(5, len(rim)))[1]
    start, along, x = a[others], (b - a)[others], middle[:, None]
    t = nearest_shares(x - start, along)
    gap = norms(x - start - t[..., None] * along)
    disjoint = (ends[:, None, :, None] != ends[others][:, :, None, :]).all(axis=(2, 3))
    return np.asarray(middle[(disjoint & (gap < SEAM_EDGE_SHARE * length[:, None])).any(axis=1)])


#: Vertices nearer to each other than this share of the largest side of the mesh's box are welded: an exact comparison
#: fails under noise of 1e-7, and a seam that is not welded acts as a cut.
WELDED_SIZE_SHARE = 1e-6


@dataclass(frozen=True)
class RepairReport:
    """Number of repairs of each kind."""

    welded: int  #: Vertices merged with another vertex at the same place.
    doubled: int  #: Cells removed because they named a vertex twice after welding, or had the corners of another cell.
    fans: int  #: Vertices added to separate sets of cells that met in a vertex but share no edge.


def repair(mesh: Mesh) -> tuple[Mesh, RepairReport]:
    """Return the mesh with vertices welded, and triangles connected only over shared edges, and a report.

    Triangles that share only a vertex are separated: heat would flow through the point where two spheres touch. Curves
    stay connected where several segments meet. Cells that are degenerate or repeated after welding, and unused
    vertices, are left out. ``mesh`` is flat, without boundaries.
    """
    vertex_of, cells, report = repaired_cells(mesh)
    return Mesh.of(mesh.vertices[vertex_of], cells), report


def has_distinct_vertices(mesh: Mesh) -> bool:
    """Return whether no two vertices would be welded: then a mesh of parts of repaired cells needs no repair."""
    return bool((_welded_vertices(mesh.vertices) == np.arange(len(mesh.vertices))).all())


def repaired_cells(mesh: Mesh) -> tuple[Ints, Ints, RepairReport]:
    """Return ``vertex_of`` (v,), ``cells`` (n, k) and a report of the mesh that :func:`repair` returns.

    Vertex i of the repaired mesh is a copy of vertex ``vertex_of[i]`` of ``mesh``.
    """
    place = _welded_vertices(mesh.vertices)
    cells = place[mesh.cells]
    corners = np.sort(cells, axis=1)
    remaining = np.asarray((np.diff(corners, axis=1) > 0).all(axis=1))
    order = np.lexsort(corners.T)  # of repeated cells the first stays
    remaining[order[1:][(np.diff(corners[order], axis=0) == 0).all(axis=1)]] = False
    welded = Mesh.of(mesh.vertices, np.ascontiguousarray(cells[remaining]))
    corners = cut_corners(welded)
    vertex_of = np.empty(int(corners.max(initial=-1)) + 1, dtype=np.int64)
    vertex_of[corners] = welded.cells
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[vertex_of] = True
    report = RepairReport(
        welded=int((place != np.arange(len(place))).sum()),
        doubled=len(mesh.cells) - len(welded.cells),
        fans=len(vertex_of) - int(used.sum()),
    )
    return vertex_of, corners, report


def box_size(vertices: Floats) -> float:
    """Return the largest side of the bounding box of vertices (v, d), v > 0."""
    return max(float(np.ptp(column)) for column in vertices.T)  # ten times as fast as over the first axis


def _welded_vertices(vertices: Floats) -> Ints:
    """Return for each vertex (v,) the first of those linked to it by steps up to ``WELDED_SIZE_SHARE`` of the box."""
    from cpmkit.mesh import mesh_kernels

    tolerance = WELDED_SIZE_SHARE * box_size(vertices) if len(vertices) else 0.0
    direction = np.array([0.4619, 0.7253, 0.5104])[: vertices.shape[1]]  # few vertices of a mesh differ only across it
    along = vertices @ (direction / np.linalg.norm(direction))
    first: Ints = mesh_kernels.merge_near_vertices(np.ascontiguousarray(vertices), along, np.argsort(along), tolerance)
    return first


@dataclass(frozen=True, eq=False)
class CellSides:
    """The side of each boundary on which cells lie, propagated from half facets over shared vertices of the cut mesh.

    Around a tip the two sides meet: a cell there has the side that is propagated to it first, or none.
    """

    corners: Ints  #: (m, k): the vertices of the cells after cutting.
    places: Floats  #: (m, d): a point of each cell.
    spacing: float  #: Spacing h of the lattice.
    half: HalfFacets  #: Facets on boundaries, seen from the cells beside them.
    owner: Ints  #: (n,): the number of the boundary on which each half facet lies, -1 on rims and past tips.
    left: Bools  #: (n,): whether each half facet is on its boundary's left.

    def of_boundary(self, number: int) -> Ints:
        """Return the side (m,) of each cell: 1 on the left of boundary ``number``, -1 on its right, else 0.

        The side is 0 for cells farther than `SIDE_REACH_SPACINGS` from the cells beside the boundary, for cells that no
        chain of cells within that distance joins to them, and for cells with as many corners on the left as on the
        right.
        """
        from scipy.spatial import cKDTree

        sides, rows = np.zeros(len(self.corners), dtype=np.int64), np.flatnonzero(self.owner == number)
        if not len(rows):
            return sides
        reach, k = SIDE_REACH_SPACINGS * self.spacing, self.corners.shape[1]
        tree = cKDTree(self.places[self.half.cell[rows]])
        within = np.flatnonzero(np.isfinite(tree.query(self.places, distance_upper_bound=reach)[0]))
        sign = np.where(self.left[rows], 1, -1)
        of_corner = np.zeros(int(self.corners.max()) + 1, dtype=np.int64)
        ends = (self.half.facet[rows, None] + np.arange(1, k)) % k
        np.add.at(of_corner, self.corners[self.half.cell[rows, None], ends], sign[:, None])
        of_corner = np.sign(of_corner)
        sides[self.half.cell[rows]] = sign
        corners, known = self.corners[within], -1
        while known < (count := int(np.count_nonzero(sides))):
            known = count
            sides[within] = np.where(sides[within] == 0, np.sign(of_corner[corners].sum(axis=1)), sides[within])
            sums = np.zeros(len(of_corner), dtype=np.int64)
            np.add.at(sums, corners, sides[within, None])
            of_corner = np.where(of_corner == 0, np.sign(sums), of_corner)
        return sides
