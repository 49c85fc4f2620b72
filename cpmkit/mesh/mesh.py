"""Segments or triangles on the manifold, from which samples are drawn, and their facets that lie on boundaries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from cpmkit.grid.lattice import find
from cpmkit.protocols import Bools, Floats, Ints

#: "flat": the cells are the manifold; "feet": it goes through the feet of points near them; "normals": its feet lie on
#: flat triangles, and its normals tell how it bends over them.
CellGeometry: TypeAlias = Literal["flat", "feet", "normals"]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Segments (k = 2) or triangles (k = 3) on the manifold; a facet of a cell is opposite to one of its corners.

    So facet j of a triangle is the edge from corner j + 1 to corner j + 2, that of a segment its other end.

    Attributes
    ----------
    vertices : (v, d) float64
        Relative to the lattice's origin, in the scene's unit.
    cells : (m, k) int64
        The corners of each cell.
    midpoints : (m, e, d) float64, optional
        Points of the manifold halfway along the edges of each cell: e = 3 and edge j opposite to corner j for
        triangles, e = 1 for segments. None where cells are flat.
    cut : (c, k - 1) int64
        The facets on boundaries: edges from tail to head along the boundary, or vertices of a curve.
    owner : (c,) int64
        The number of the boundary that each of these lies on.
    extends : (c,) bool
        Whether the facet goes on past a tip of its boundary, where u is continuous.
    """

    vertices: Floats
    cells: Ints
    midpoints: Floats | None
    cut: Ints
    owner: Ints
    beyond_tip: Bools

    @classmethod
    def of(cls, vertices: Floats, cells: Ints, midpoints: Floats | None = None) -> Mesh:
        """Return a mesh that no boundary cuts."""
        none = np.zeros(0, dtype=np.int64)
        return cls(vertices, cells, midpoints, none.reshape(0, cells.shape[1] - 1), none, none.astype(bool))

    @property
    def dim(self) -> int:
        """Dimension d of the space."""
        return int(self.vertices.shape[1])

    @property
    def manifold_dim(self) -> int:
        """Dimension of the manifold: 1 for segments, 2 for triangles."""
        return int(self.cells.shape[1]) - 1

    @property
    def facets(self) -> Ints:
        """(m, k, k - 1) the vertices of each cell's facets, in the cell's sense."""
        k = self.cells.shape[1]
        places = (np.arange(k)[:, None] + np.arange(1, k)) % k
        return self.cells[:, places]


@dataclass(frozen=True, eq=False)
class HalfFacets:
    """Facets seen from one cell: those on boundaries, one for each cell beside them, and those on the rim.

    Attributes
    ----------
    cell, facet : (n,) int64
        The cell, and which of its facets.
    cut : (n,) int64
        The number of the facet in ``mesh.cut``; -1 on a rim that no boundary lies on.
    along : (n,) int64
        +1 where the cell's own sense of the facet is the direction of ``mesh.cut``, -1 where it is the reverse; of a
        curve +1 for a cell that ends there, -1 for one that starts there.
    """

    cell: Ints
    facet: Ints
    cut: Ints
    along: Ints


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of a mesh, each once; those of segments are the segments.

    Attributes
    ----------
    ends : (e, 2) int64
        Their vertices.
    of_cells : (m, 3) or (m, 1) int64
        The edges of each cell; of a triangle edge j is opposite to corner j.
    """

    ends: Ints
    of_cells: Ints

    def lengths(self, vertices: Floats) -> Floats:
        """Return (e,) the distances of their ends."""
        from cpmkit.mesh import mesh_kernels

        found: Floats = mesh_kernels.lengths(np.ascontiguousarray(self.ends), np.ascontiguousarray(vertices))
        return found


def edges_of(mesh: Mesh) -> Edges:
    """Return the edges of a mesh's cells."""
    if mesh.manifold_dim == 1:
        return Edges(mesh.cells, np.arange(len(mesh.cells))[:, None])
    from cpmkit.mesh import mesh_kernels

    return Edges(*mesh_kernels.number_edges(np.ascontiguousarray(mesh.cells), len(mesh.vertices)))


def edges_on_cut(mesh: Mesh, edges: Edges) -> Ints:
    """Return (c,) the numbers that the edges of triangles in ``mesh.cut`` have among ``edges``, -1 if none."""
    if not len(mesh.cut):
        return np.zeros(0, dtype=np.int64)
    count = len(mesh.vertices)
    ends = np.sort(mesh.cut, axis=1)
    wanted, place = np.unique(ends[:, 0] * count + ends[:, 1], return_inverse=True)
    on_cut = np.zeros(count, dtype=bool)
    on_cut[ends] = True
    near = np.flatnonzero(on_cut[edges.ends].all(axis=1))
    low, high = np.sort(edges.ends[near], axis=1).T
    at = find(wanted, low * count + high)
    number = np.full(len(wanted), -1)
    number[at[at >= 0]] = near[at >= 0]
    return np.asarray(number[place.ravel()], dtype=np.int64)
