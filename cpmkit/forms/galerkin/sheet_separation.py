"""Separation of sheets of the manifold that lie close together, however small the gap between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.manifold.abilities import HasGivenMesh
from cpmkit.manifold.local_source import LocalSource
from cpmkit.mesh.mesh import CellGeometry, Mesh
from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Two vertices are the same if they are nearer than this share of the mesh's size.
SAME_SIZE_SHARE = 1e-12
#: Paths are followed up to this multiple of the distance of the farthest corner, plus so many spacings.
PATH_FACTOR, PATH_SPACINGS = 2.0, 2.0
#: Distance, in spacings, of a point from the flat cell that contains it: rounding.
ON_CELL_SPACINGS = 1e-8
#: A path around the end of a slit is longer than a path on the sheet itself; at the end by less than this, in spacings.
LONGER_SPACINGS = 0.25


@dataclass(frozen=True, eq=False)
class SheetSeparation:
    """The cells of the manifold, used to assign points to sheets.

    Flat cells are the manifold, so that a point has distance zero from its cell. Curved cells only approximate it:
    there the source names its own triangle or segment that contains the point, and the point lies on the sheet from
    which the paths over edges of cells to the corners of that triangle are shortest.

    Attributes
    ----------
    mesh : Mesh
        The mesh of the manifold.
    geometry : "flat", "closest_point" or "normals"
        How the cells follow the manifold between the vertices of the mesh.
    source : LocalSource
        The manifold.
    spacing : float
        Spacing h of the lattice.
    """

    mesh: Mesh
    geometry: CellGeometry
    source: LocalSource
    spacing: float

    @property
    def known(self) -> bool:
        """Whether sheets can be separated: cells are flat, or the source has a mesh of its own."""
        return self.geometry == "flat" or isinstance(self.source.source, HasGivenMesh)

    def scores(self, points: Floats, element: Ints | None, cells: Ints, group: Ints) -> tuple[Floats, float]:
        """Return scores (k, q) of ``cells`` near points, least on the point's own sheet, and a significant difference.

        The score of a flat cell is its distance from the point. Otherwise it is the length of the paths from the point
        over the group of the cell to the corners of the source's own element, the same for all cells of a group.

        Parameters
        ----------
        points : (k, d) float64
        element : (k,) int64, optional
            The source's triangle or segment that contains each point, as in :class:`ClosestPoints`.
        cells : (k, q) int64
            Cells near each point.
        group : (k, q) int64
            The number of the group of each cell, -1 for cells that are left out.
        """
        from cpmkit.forms.galerkin.locator_kernels import distances_to_cells, path_lengths_to_corners

        corners = self.mesh.cells[cells]
        if self.geometry == "flat":
            distance = distances_to_cells(points, self.mesh.vertices, corners)
            return np.where(group >= 0, distance, np.inf), ON_CELL_SPACINGS * self.spacing
        if element is None:
            return np.zeros(cells.shape), np.inf
        ends = self._corners_of(element)
        offsets = self.mesh.vertices[ends] - points[:, None]
        farthest = np.where(ends >= 0, np.sqrt((offsets**2).sum(axis=2)), 0.0).max(axis=1)
        reach = PATH_FACTOR * farthest + PATH_SPACINGS * self.spacing
        graph, arguments = self._vertex_graph, (points, corners, group, ends, reach, self.mesh.vertices)
        return path_lengths_to_corners(*arguments, graph.indptr, graph.indices), LONGER_SPACINGS * self.spacing

    def _corners_of(self, element: Ints) -> Ints:
        """Return the vertices (k, c) of the mesh at the corners of the source's own cells ``element`` (k,), as numbers.

        -1 stands for a corner at which the mesh has no vertex.
        """
        vertices, cells = self._given_mesh
        places = vertices[cells[element]]
        size = float(np.ptp(self.mesh.vertices, axis=0).max())
        distance, at = self._tree.query(places, distance_upper_bound=max(SAME_SIZE_SHARE * size, np.finfo(float).tiny))
        return np.where(np.isfinite(distance), at, -1)

    @cached_property
    def _given_mesh(self) -> tuple[Floats, Ints]:
        """The vertices, relative to the origin of the lattice, and the cells of the source's own mesh."""
        assert isinstance(self.source.source, HasGivenMesh)
        vertices, cells = self.source.source.given_mesh
        return vertices - self.source.shift, cells

    @cached_property
    def _tree(self) -> Any:
        """The k-d tree of the vertices of the mesh."""
        from scipy.spatial import cKDTree

        return cKDTree(self.mesh.vertices)

    @cached_property
    def _vertex_graph(self) -> csr_array:
        """(v, v) adjacency matrix of the vertices, with an entry for each two that share an edge."""
        from scipy.sparse import coo_array

        cells, k = self.mesh.cells, self.mesh.cells.shape[1]
        first = np.concatenate([cells[:, i] for i in range(k) for j in range(k) if i != j])
        second = np.concatenate([cells[:, j] for i in range(k) for j in range(k) if i != j])
        count = len(self.mesh.vertices)
        return coo_array((np.ones(len(first), dtype=np.int8), (first, second)), shape=(count, count)).tocsr()
