"""Cutting a mesh along its boundaries: new vertices, and the facets seen from the cells beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.mesh.mesh import Edges, HalfFacets, Mesh, edges_of, edges_on_cut
from cpmkit.protocols import Floats, Ints


def cut_corners(mesh: Mesh, edges: Edges | None = None) -> Ints:
    """Return (m, k) the vertex that each corner of each cell has once the mesh is cut along its boundaries.

    Corners of triangles are one vertex if one comes from one to the other over edges that no boundary lies on; an
    edge of three triangles or more joins them all. Of segments all corners at a place are one vertex, and each is its
    own where a boundary lies. Tips, junctions, rims and one-sided surfaces need no case of their own. The ``edges`` of
    triangles are found if they are not given.
    """
    if mesh.manifold_dim == 1:
        apart = np.zeros(len(mesh.vertices), dtype=bool)
        apart[mesh.cut] = True
        own = len(mesh.vertices) + np.arange(mesh.cells.size).reshape(mesh.cells.shape)
        numbers = np.unique(np.where(apart[mesh.cells], own, mesh.cells), return_inverse=True)[1]
        return np.asarray(numbers.reshape(mesh.cells.shape), dtype=np.int64)
    from cpmkit.mesh import mesh_kernels

    edges = edges_of(mesh) if edges is None else edges
    barred = np.zeros(len(edges.ends), dtype=bool)
    barred[edges_on_cut(mesh, edges)] = True
    corners: Ints = mesh_kernels.join_corners(np.ascontiguousarray(mesh.cells), edges.of_cells, barred)
    return corners


def has_cut_corners(mesh: Mesh, corners: Ints) -> bool:
    """Tell whether a vertex of the mesh is several of its ``corners``, not one by another number."""
    return bool(corners.max(initial=-1) + 1 > np.count_nonzero(np.bincount(mesh.cells.ravel())))


def half_facets(mesh: Mesh, edges: Edges | None = None) -> HalfFacets:
    """Return the facets on boundaries, once for each cell beside them, and those of one cell alone: the rim.

    Of several boundaries on one facet the first in ``mesh.cut`` is named. The ``edges`` of triangles are found if they
    are not given.
    """
    if mesh.manifold_dim == 1:
        facets, count, on_cut = mesh.cells[:, ::-1], len(mesh.vertices), mesh.cut[:, 0]
    else:
        edges = edges_of(mesh) if edges is None else edges
        facets, count, on_cut = edges.of_cells, len(edges.ends), edges_on_cut(mesh, edges)
    cut = np.full(count, -1)
    cut[on_cut[::-1]] = np.arange(len(on_cut))[::-1]
    single = np.bincount(facets.ravel(), minlength=count) == 1
    cell, facet = np.nonzero(((cut >= 0) | single)[facets])
    of = cut[facets[cell, facet]]
    if mesh.manifold_dim == 1:
        along = np.where(facet == 0, 1, -1)
    else:
        starts = mesh.cells[cell, (facet + 1) % 3]
        along = np.where((of < 0) | (starts == np.append(mesh.cut[:, 0], -1)[of]), 1, -1)
    return HalfFacets(cell, facet, of, along)


@dataclass(frozen=True, eq=False)
class Rim:
    """Which rows of points lie on the rim of a mesh, and which way it ends there.

    Attributes
    ----------
    rows : (r,) int64
        Ascending.
    outward : (r, d) float64
        Along the cell, out of it, as long as the edge there.
    """

    rows: Ints
    outward: Floats

    def among(self, chosen: Ints) -> Rim:
        """Return the same of the points ``chosen`` (n,), each once."""
        at = np.searchsorted(self.rows, chosen)
        known = np.flatnonzero(np.append(self.rows, -1)[at] == chosen)
        return Rim(known, self.outward[at[known]])


def rim_of_edges(mesh: Mesh, edges: Edges) -> Rim:
    """Return which edges of triangles lie on the rim; no segment does."""
    if mesh.manifold_dim == 1:
        return Rim(np.zeros(0, dtype=np.int64), np.zeros((0, mesh.dim)))
    single = np.bincount(edges.of_cells.ravel(), minlength=len(edges.ends)) == 1
    cell, facet = np.nonzero(single[edges.of_cells])
    a, b, c = (mesh.vertices[mesh.cells[cell, (facet + k) % 3]] for k in range(3))
    way = c - b
    across = b - a
    across = across - (dots(across, way) / np.maximum(dots(way, way), np.finfo(float).tiny))[:, None] * way
    rows = edges.of_cells[cell, facet]
    order = np.argsort(rows)
    return Rim(rows[order], (norms(way)[:, None] * unit(across))[order])


def rim_of_vertices(mesh: Mesh, edges: Edges) -> Rim:
    """Return which vertices lie on the rim, with the mean of their edges' outward vectors."""
    if mesh.manifold_dim == 1:
        single = np.bincount(mesh.cells.ravel(), minlength=len(mesh.vertices)) == 1
        cell, end = np.nonzero(single[mesh.cells])
        ends, other = mesh.cells[cell, end], mesh.cells[cell, 1 - end]
        outward = mesh.vertices[ends] - mesh.vertices[other]
    else:
        of_edges = rim_of_edges(mesh, edges)
        ends = edges.ends[of_edges.rows].ravel()
        outward = np.repeat(of_edges.outward, 2, axis=0)
    rows, place = np.unique(ends, return_inverse=True)
    times = np.bincount(place, minlength=len(rows))
    sums = [np.bincount(place, outward[:, k], minlength=len(rows)) for k in range(mesh.dim)]
    return Rim(rows, np.stack(sums, axis=1) / np.maximum(times, 1)[:, None])


#: A rim's edge whose middle is nearer than this share of its length to an edge of another rim lies on it.
SEAM_EDGE_SHARE = 0.05
#: So many of the nearest edges of rims are looked at.
NEIGHBOURS = 5


def seam_midpoints(mesh: Mesh, half: HalfFacets) -> Floats:
    """Return the middles (k, d) of edges of rims of triangles that lie on edges they share no vertex with.

    Parameters
    ----------
    mesh : SampleMesh
    half : HalfFacets
        Of this mesh.
    """
    from scipy.spatial import cKDTree

    rim = np.flatnonzero(half.cut < 0)
    if mesh.manifold_dim != 2 or len(rim) < 2:
        return np.zeros((0, mesh.dim))
    ends = mesh.cells[half.cell[rim, None], (half.facet[rim, None] + [1, 2]) % 3]
    a, b = mesh.vertices[ends].transpose(1, 0, 2)
    middle, length = 0.5 * (a + b), norms(b - a)
    near = cKDTree(middle).query(middle, min(NEIGHBOURS, len(rim)))[1]
    start, along, x = a[near], (b - a)[near], middle[:, None]
    t = np.clip(dots(x - start, along) / np.maximum(dots(along, along), np.finfo(float).tiny), 0.0, 1.0)
    gap = norms(x - start - t[..., None] * along)
    apart = (ends[:, None, :, None] != ends[near][:, :, None, :]).all(axis=(2, 3))
    return np.asarray(middle[(apart & (gap < SEAM_EDGE_SHARE * length[:, None])).any(axis=1)])


def winding_of(mesh: Mesh, edges: Edges | None = None) -> Any:
    """Return (m,) int8: 1 or -1 for each cell, by which neighbours are wound alike, and 0 beside where they are not.

    The ``edges`` of triangles are found if they are not given.
    """
    from cpmkit.mesh.mesh_kernels import wound_alike

    if mesh.manifold_dim == 1:
        facets, count = mesh.cells[:, ::-1], len(mesh.vertices)
    else:
        edges = edges_of(mesh) if edges is None else edges
        facets, count = edges.of_cells, len(edges.ends)
    return wound_alike(np.ascontiguousarray(mesh.cells), np.ascontiguousarray(facets, dtype=np.int64), count)
