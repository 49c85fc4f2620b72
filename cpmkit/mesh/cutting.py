"""Cutting a mesh along its boundaries: new vertices, and the facets seen from the cells beside them."""

from __future__ import annotations

import numpy as np

from cpmkit.mesh.edges import Edges, edges_of, edges_on_cut
from cpmkit.mesh.mesh import HalfFacets, SampleMesh
from cpmkit.protocols import Ints


def corners_of(mesh: SampleMesh, edges: Edges | None = None) -> Ints:
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
    from cpmkit.mesh import edges_kernels

    edges = edges_of(mesh) if edges is None else edges
    barred = np.zeros(len(edges.ends), dtype=bool)
    barred[edges_on_cut(mesh, edges)] = True
    corners: Ints = edges_kernels.join_corners(np.ascontiguousarray(mesh.cells), edges.of_cells, barred)
    return corners


def is_cut(mesh: SampleMesh, corners: Ints) -> bool:
    """Tell whether a vertex of the mesh is several of its ``corners``, not one by another number."""
    return bool(corners.max(initial=-1) + 1 > np.count_nonzero(np.bincount(mesh.cells.ravel())))


def half_facets(mesh: SampleMesh, edges: Edges | None = None) -> HalfFacets:
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
