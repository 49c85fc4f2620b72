"""Charts: separation of parts of the manifold that are near in space but not along the manifold, and share splines.

The two sides of a U-turn sharper than the spacing (a fold), of a slot, or of a neck (voids) share splines, although a
path along the manifold from one to the other is much longer than their distance. There the manifold is divided into
charts. All of a chart is visible from one of its cells. The mesh is cut between charts; ties keep u continuous there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.chart_kernels import facing_groups, flood_charts, path_lengths
from cpmkit.forms.galerkin.dof_map import DofMap, build_dof_map, build_patches, cell_codes
from cpmkit.forms.galerkin.rim_corners import reentrant_corners
from cpmkit.linear.operators import matrix_of_rows
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.mesh.adjacency import facets_of_two_cells, rim_of_edges
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.creases import join_small_parts
from cpmkit.runtime.index_sets import inverse_index
from cpmkit.types import Bools, Floats, Ints

#: Cells are grouped by cubes of this share of the spacing: smaller features need no charts of their own.
GROUP_SHARE = 1 / 3
#: The mean of the unit normals under a spline without folds is at least so long.
LEAST_MEAN_NORMAL = 0.85
#: Folds are sought up to the first distance, in spacings (a U-turn of radius 1: errors of .06 percent with 1.8, .005
#: with 2.1), voids between rims up to the second.
FOLD_SPACINGS, VOID_SPACINGS = 2.1, 3.0
#: Two points are near in space but not along the manifold if the path there is longer than their distance times a
#: factor, for folds of curves and surfaces (opposite points of circles and tubes have 1.57). With 2 in place of 2.7
#: organic meshes have 10 to 40 percent more unknowns at 3,000 to 6,000, without a gain on the whole; with 2.9 a U-turn
#: of radius 1 is not found.
FOLD_FACTORS = {1: 2.0, 2: 2.7}
#: For voids: the same factor (right angles have 1.41), and by how many spacings the path must be longer as well. For
#: folds and voids: the least length of the path, in spacings.
VOID_FACTOR, VOID_SPACINGS_MORE, LEAST_PATH_SPACINGS = 1.3, 0.1, 0.3
#: Charts begin at folds first, the sharpest ones, then at voids with the longest paths (up to this, in spacings).
LONGEST_PATH_SPACINGS = 6.0
#: A chart reaches up to so many spacings from its first cell.
REACH_SPACINGS = 7.0
#: A chart below this area, in squared spacings, by degree, joins a neighbour. With 1 the first eigenvalue of a bridge
#: .1 spacings wide has an error of 31 percent, with .05 of 2.5. Charts of .05 and degree 3, with 64 unknowns a patch,
#: leave eigenvalues of the wrong sign on organic meshes in 5 of 24 positions.
LEAST_AREAS = {1: 0.05, 2: 0.05, 3: 0.25}
#: Largest degree with sectors around reentrant corners: with degree 3 iterations grow by half, to 185 at combs.
LARGEST_SECTOR_DEGREE = 2


@dataclass(frozen=True, eq=False)
class CellGroups:
    """Connected cells of a mesh in cubes of `GROUP_SHARE` spacings, and which of them touch."""

    of_cell: Ints  #: (m,): the group of each cell of the mesh.
    patch: Ints  #: (g,): the patch that contains each group.
    centres: Floats  #: (g, d): the mean of the centres of their cells.
    #: (g, d): the mean of the oriented normals of triangles, or tangents of segments, of length one; zero if none is.
    directions: Floats
    touching: Ints  #: (t, 2): pairs of groups whose cells share a vertex.


@dataclass(frozen=True, eq=False)
class RimEdges:
    """The edges of triangles on rims of a surface; none on curves."""

    cell: Ints  #: (r,): the triangle of each edge.
    ends: Floats  #: (r, 2, d): the ends of each edge.
    outward: Floats  #: (r, d): vectors out of the triangles, in their planes, normal to the edges and as long.

    @classmethod
    def of(cls, mesh: Mesh) -> RimEdges:
        """Return the edges on the rims of a mesh."""
        rim, cell_of = rim_of_edges(mesh), np.zeros(len(mesh.edges.ends), dtype=np.int64)
        cell_of[mesh.edges.of_cells] = np.arange(len(mesh.cells))[:, None]
        return cls(cell_of[rim.rows], mesh.vertices[mesh.edges.ends[rim.rows]], rim.outward)


def chart_facets(mesh: Mesh, corners: Ints, spacing: float, degree: int) -> tuple[Ints, bool]:
    """Return the facets (c, k - 1), as vertices, between charts of a mesh cut at boundaries and creases, and a flag.

    The flag says whether charts were cut at voids, at whose corners u is singular, and not at folds alone. ``corners``
    (m, k) are the vertices of cells after cutting. ``spacing`` is h, about twice the longest edge; ``degree`` is that
    of the splines.
    """
    facets, sides, chart, has_voids = _charts(mesh, corners, spacing, degree)
    chosen = facets[chart[sides[:, 0]] != chart[sides[:, 1]]]
    return chosen[:, None] if mesh.manifold_dim == 1 else np.asarray(mesh.edges.ends[chosen]), has_voids


def _charts(mesh: Mesh, corners: Ints, spacing: float, degree: int) -> tuple[Ints, Ints, Ints, bool]:
    """Return the facets (e,) between two cells with charts, these cells (e, 2), the chart (m,) of any cell, and a flag.

    Facets are numbers of edges or vertices. A cell without a chart has -1. The arguments and the flag are those of
    :func:`chart_facets`.
    """
    none = np.zeros(0, dtype=np.int64), np.zeros((0, 2), dtype=np.int64), np.full(len(mesh.cells), -1), False
    centres, vectors = mesh.vertices[mesh.cells].mean(axis=1), _measure_vectors(mesh)
    dof_map = build_dof_map(centres, corners, spacing)
    has_folds, rims = _reads_folded_unknown(dof_map, vectors), RimEdges.of(mesh)
    if not (has_folds.any() or len(rims.cell)):
        return none
    codes = cell_codes(centres, GROUP_SHARE * spacing)
    of_cell, roots, touching = build_patches(codes, corners, np.arange(len(corners)))
    means = _sums(of_cell, centres) / np.bincount(of_cell)[:, None]
    groups = CellGroups(of_cell, dof_map.patch[roots], means, unit(_sums(of_cell, vectors)), touching)
    pairs, scores, is_fold = near_pairs(groups, rims, dof_map, has_folds, mesh.manifold_dim)
    if not len(pairs):
        return none
    patches = np.unique(groups.patch[pairs], axis=0)
    reads = matrix_of_rows(np.ones(dof_map.unknowns.shape), dof_map.unknowns, dof_map.size)
    marked = np.zeros(dof_map.size, dtype=bool)  # unknowns that both patches of a pair read
    marked[reads[patches[:, 0]].multiply(reads[patches[:, 1]]).tocsr().indices] = True
    score = np.zeros(len(groups.centres))
    np.maximum.at(score, pairs, scores[:, None])
    reach = spacing if degree <= LARGEST_SECTOR_DEGREE else 0.0
    sector, is_near = reentrant_corners(mesh, rim_of_edges(mesh)).sectors(centres, reach)
    zone = np.flatnonzero(is_near | marked[dof_map.unknowns].any(axis=1)[dof_map.patch])
    seeds = zone[np.argsort(-score[groups.of_cell[zone]], kind="stable")]
    facets, places = facets_of_two_cells(mesh)
    is_open = ~np.isin(facets, mesh.cut[:, 0] if mesh.manifold_dim == 1 else mesh.cut_edges)
    facets, sides = facets[is_open], places[is_open] // mesh.cells.shape[1]
    of_sector = sides[sector[sides[:, 0]] == sector[sides[:, 1]]]
    (starts, others), directions = _neighbours(of_sector, len(centres)), unit(vectors)
    reach, normals = REACH_SPACINGS * spacing, directions[rims.cell]
    chart = flood_charts(seeds, centres, directions, starts, others, rims.ends, normals, reach)
    within = (chart[sides] >= 0).all(axis=1)
    facets, sides = facets[within], sides[within]
    if mesh.manifold_dim == 2:
        least = LEAST_AREAS[degree] * spacing**2
        chart = join_small_parts(chart, norms(vectors), sides, mesh.edge_lengths[facets], least)
    return facets, sides, chart, not is_fold.all()


def _measure_vectors(mesh: Mesh) -> Floats:
    """Return oriented normals (m, d) of triangles, or tangents of segments, with the measures of the cells as lengths.

    A vector is zero beside a facet over which cells cannot be oriented.
    """
    corners = mesh.vertices[mesh.cells]
    last = corners[:, -1] - corners[:, 0]
    vectors = last if mesh.manifold_dim == 1 else 0.5 * np.cross(corners[:, 1] - corners[:, 0], last)
    return np.asarray(vectors * mesh.winding[:, None])


def _reads_folded_unknown(dof_map: DofMap, vectors: Floats) -> Bools:
    """Return whether (p,) each patch reads an unknown on whose support the directions ``vectors`` (m, d) spread."""
    sums = _sums(dof_map.patch, np.concatenate([norms(vectors)[:, None], vectors], axis=1))
    of_unknowns = _sums(dof_map.unknowns.ravel(), sums.repeat(dof_map.unknowns.shape[1], axis=0))
    is_folded = norms(of_unknowns[:, 1:]) < LEAST_MEAN_NORMAL * of_unknowns[:, 0]
    return np.asarray(is_folded[dof_map.unknowns].any(axis=1))


def _sums(number: Ints, values: Floats) -> Floats:
    """Return the sums (g, c) of the rows of ``values`` (m, c) with the same ``number`` (m,)."""
    return np.stack([np.bincount(number, column) for column in values.T], axis=1)


def near_pairs(
    groups: CellGroups, rims: RimEdges, dof_map: DofMap, has_folds: Bools, manifold_dim: int
) -> tuple[Ints, Floats, Bools]:
    """Return the pairs (k, 2) of groups that are near in space but not along the manifold, scores and kinds of pairs.

    Charts begin at the pairs with the highest scores (k,). A kind (k,) is True for a fold between the groups, False for
    a void. Folds are sought among the patches where ``has_folds`` (p,).
    """
    h, centres, directions, patches = dof_map.spacing, groups.centres, groups.directions, len(dof_map.cells)
    unknowns, readers = dof_map.unknowns, inverse_index(dof_map.unknowns.ravel(), dof_map.size)
    members = inverse_index(groups.patch, patches)
    folds = facing_groups(has_folds, unknowns, readers, members, centres, directions, FOLD_SPACINGS * h, manifold_dim)
    at_rims, number = np.unique(groups.of_cell[rims.cell], return_inverse=True)
    middles = _sums(number, rims.ends.mean(axis=1)) / np.bincount(number)[:, None]
    outward, members = unit(_sums(number, rims.outward)), inverse_index(groups.patch[at_rims], patches)
    voids = facing_groups(
        np.ones(patches, dtype=bool), unknowns, readers, members, middles, outward, VOID_SPACINGS * h, 0
    )
    pairs, is_fold = np.concatenate([folds, at_rims[voids]]), np.arange(len(folds) + len(voids)) < len(folds)
    void_limits = VOID_FACTOR * _distances(middles, voids) + VOID_SPACINGS_MORE * h
    distances = _distances(centres, pairs)
    limits = np.concatenate([FOLD_FACTORS[manifold_dim] * distances[: len(folds)], void_limits])
    limits = np.maximum(limits, LEAST_PATH_SPACINGS * h)
    longest = np.where(is_fold, limits, np.maximum(limits, LONGEST_PATH_SPACINGS * h))
    starts, others = _neighbours(groups.touching, len(centres))
    steps = norms(centres[others] - centres.repeat(np.diff(starts), axis=0))
    order = np.lexsort(pairs.T[::-1])
    paths = np.empty(len(pairs))
    paths[order] = path_lengths(pairs[order], distances[order], longest[order], starts, others, steps, centres)
    opposite = 1.0 - dots(directions[pairs[:, 0]], directions[pairs[:, 1]])
    scores = np.where(is_fold, LONGEST_PATH_SPACINGS + opposite, np.minimum(paths / h, LONGEST_PATH_SPACINGS))
    is_far = paths > limits
    return pairs[is_far], scores[is_far], is_fold[is_far]


def _distances(points: Floats, pairs: Ints) -> Floats:
    """Return the distances (k,) between the two ``points`` (n, d) of each of ``pairs`` (k, 2)."""
    return norms(points[pairs[:, 1]] - points[pairs[:, 0]])


def _neighbours(pairs: Any, count: int) -> tuple[Ints, Any]:
    """Return row starts (count + 1,) and neighbours (2 t,) of ``count`` nodes of a graph with edges ``pairs``."""
    flat = np.ascontiguousarray(pairs).ravel()
    starts, places = inverse_index(flat, count)
    return starts, flat[places ^ 1]
