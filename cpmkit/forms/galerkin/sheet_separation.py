"""On which of several sheets beside one another a point of the manifold lies, however small the gap between them."""

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

#: Vertices nearer than this share of the mesh's size are one.
SAME_SIZE_SHARE = 1e-12
#: Ways are followed as far as so many times the distance of the farthest corner, and so many spacings more.
WAY_FACTOR, WAY_SPACINGS = 2.0, 2.0
#: A point of flat cells is off the cell that holds it by rounding alone: by less than so many spacings.
ON_CELL_SPACINGS = 1e-8
#: A way around the end of a slit is longer than one on the sheet itself; by less than so many spacings, at the end.
LONGER_SPACINGS = 0.25


@dataclass(frozen=True, eq=False)
class SheetSeparation:
    """The cells of the manifold, which tell sheets apart.

    Flat cells are the manifold, so that a point lies on the cell at no distance. Curved ones come near it only: there
    the source names its own triangle or segment that holds the point, and the sheet is that from which the ways along
    the cells' edges to the corners of this one are shortest.

    Attributes
    ----------
    mesh : Mesh
    bend : "flat", "closest_point" or "normals"
        How its cells follow the manifold.
    source : LocalSource
        The manifold.
    spacing : float
        h, of the lattice.
    """

    mesh: Mesh
    geometry: CellGeometry
    source: LocalSource
    spacing: float

    @property
    def known(self) -> bool:
        """Whether sheets can be told apart."""
        return self.geometry == "flat" or isinstance(self.source.source, HasGivenMesh)

    def scores(self, points: Floats, element: Ints | None, cells: Ints, group: Ints) -> tuple[Floats, float]:
        """Return how far (k, q) the groups of ``cells`` (k, q) are from ``points`` (k, d), and which excess counts.

        ``element`` (k,) as of :class:`ClosestPoints`; ``group`` (k, q) is -1 for cells that are left out.
        """
        from cpmkit.forms.galerkin.locator_kernels import distances_to_cells, ways_to_corners

        corners = self.mesh.cells[cells]
        if self.geometry == "flat":
            apart = distances_to_cells(points, self.mesh.vertices, corners)
            return np.where(group >= 0, apart, np.inf), ON_CELL_SPACINGS * self.spacing
        if element is None:
            return np.zeros(cells.shape), np.inf
        ends = self._ends(element)
        away = self.mesh.vertices[ends] - points[:, None]
        farthest = np.where(ends >= 0, np.sqrt((away**2).sum(axis=2)), 0.0).max(axis=1)
        reach = WAY_FACTOR * farthest + WAY_SPACINGS * self.spacing
        graph = self._edges
        ways = ways_to_corners(*(points, corners, group, ends, reach, self.mesh.vertices), graph.indptr, graph.indices)
        return ways, LONGER_SPACINGS * self.spacing

    def _ends(self, element: Ints) -> Ints:
        """Return the vertices (k, c) of the mesh that are the corners of the source's own cells, -1 where none is."""
        vertices, cells = self._given
        places = vertices[cells[element]]
        size = float(np.ptp(self.mesh.vertices, axis=0).max())
        distance, at = self._tree.query(places, distance_upper_bound=max(SAME_SIZE_SHARE * size, np.finfo(float).tiny))
        return np.where(np.isfinite(distance), at, -1)

    @cached_property
    def _given(self) -> tuple[Floats, Ints]:
        assert isinstance(self.source.source, HasGivenMesh)
        vertices, cells = self.source.source.given_mesh
        return vertices - self.source.shift, cells

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.mesh.vertices)

    @cached_property
    def _edges(self) -> csr_array:
        """Which vertices share an edge."""
        from scipy.sparse import coo_array

        cells, k = self.mesh.cells, self.mesh.cells.shape[1]
        first = np.concatenate([cells[:, i] for i in range(k) for j in range(k) if i != j])
        second = np.concatenate([cells[:, j] for i in range(k) for j in range(k) if i != j])
        count = len(self.mesh.vertices)
        return coo_array((np.ones(len(first), dtype=np.int8), (first, second)), shape=(count, count)).tocsr()
