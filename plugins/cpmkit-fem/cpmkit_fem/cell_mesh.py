"""Tetrahedra of a solid, triangles of a surface or segments of a curve, with the nodes of their elements."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints
from cpmkit_fem.elements import EDGES_OF, shape_at
from cpmkit_fem.surface_mapping import jacobians, measure_and_pseudoinverse

#: A triangle whose doubled area is below this share of its longest edge squared has no gradient in float64; of a
#: tetrahedron, six times the volume and the edge cubed.
FLAT_SHARE = 1e-12


@dataclass(frozen=True, eq=False)
class CellMesh:
    """Cells of one kind in a solid or on a surface or a curve; each node is in use.

    Attributes
    ----------
    nodes : (n, d) float64
        The corners of the cells, of degree 2 then the midpoints of their edges.
    cells : (m, c) int64
        The nodes of each: its corners, of degree 2 then midpoints in the order of :data:`EDGES_OF`.
    manifold_dim : int
        3 for tetrahedra, 2 for triangles, 1 for segments.
    degree : int
        Of the functions, 1 or 2.
    curved : bool
        Whether midpoints may lie off the chords.
    """

    nodes: Floats
    cells: Ints
    manifold_dim: int
    degree: int = 1
    curved: bool = False

    @property
    def corners(self) -> Ints:
        """(m, k) the corners of each cell."""
        return self.cells[:, : self.manifold_dim + 1]

    @cached_property
    def edges(self) -> Ints:
        """(e, 2) the corners, ascending, of each edge of the mesh, each edge once."""
        return np.unique(np.sort(self.corners[:, EDGES_OF[self.manifold_dim]].reshape(-1, 2), axis=1), axis=0)

    @cached_property
    def facets(self) -> tuple[Ints, Ints, Ints]:
        """The facets' nodes (f, c), as elements of one dimension less; the cells (f,) of each; a corner opposite it."""
        k = self.manifold_dim + 1
        around = (np.arange(k)[:, None] + np.arange(1, k)) % k
        facets, opposite = self.corners[:, around].reshape(-1, k - 1), self.corners.ravel()
        order = np.sort(facets, axis=1)
        _, first, count = np.unique(order, axis=0, return_index=True, return_counts=True)
        return self.facet_nodes(facets[first]), count, opposite[first]

    def facet_nodes(self, facets: Ints) -> Ints:
        """Return the nodes (f, c) of facets that are given by their corners (f, k - 1); each edge is one of the mesh.

        Of degree 2 the midpoints of the edges, in the order of :data:`EDGES_OF`, follow the corners.
        """
        if self.degree == 1 or facets.shape[1] == 1:
            return facets
        keys, nodes = self._midpoints
        pairs = facets[:, EDGES_OF[facets.shape[1] - 1]]
        found = nodes[np.searchsorted(keys, self._edge_keys(pairs.reshape(-1, 2)))]
        return np.concatenate([facets, found.reshape(pairs.shape[:2])], axis=1)

    @cached_property
    def _midpoints(self) -> tuple[Ints, Ints]:
        """The keys (e,) of the edges, ascending, and the node (e,) at the midpoint of each."""
        pairs, nodes = self.corners[:, EDGES_OF[self.manifold_dim]], self.cells[:, self.manifold_dim + 1 :]
        keys, first = np.unique(self._edge_keys(pairs.reshape(-1, 2)), return_index=True)
        return keys, nodes.ravel()[first]

    def _edge_keys(self, pairs: Ints) -> Ints:
        """Return (e,) a number for each pair of nodes ``pairs`` (e, 2), the same in either order."""
        low, high = np.sort(pairs, axis=1).T
        return np.asarray(low * len(self.nodes) + high)

    @property
    def mean_edge(self) -> float:
        """The mean length of an edge."""
        return float(np.mean(edge_lengths(self.nodes, self.edges)))

    @cached_property
    def longest_edges(self) -> Floats:
        """(m,) the longest edge of each cell."""
        longest: Floats = np.max(
            [edge_lengths(self.nodes, self.corners[:, pair]) for pair in EDGES_OF[self.manifold_dim]], axis=0
        )
        return longest

    def check_cells(self) -> None:
        """Raise InputError if the mesh has no cells, or has triangles without area or tetrahedra without volume."""
        if not len(self.cells):
            raise InputError("backend='fem' needs triangles with three different corners, got none; take a finer mesh.")
        if self.manifold_dim == 1:
            return
        flat = np.flatnonzero(~(self.measures > FLAT_SHARE * self.longest_edges**self.manifold_dim))
        if len(flat):
            cells, size = ("triangles", "an area") if self.manifold_dim == 2 else ("tetrahedra", "a volume")
            raise InputError(
                f"backend='fem' needs {cells} with {size}, got {len(flat)} of {len(self.cells)} without, the first "
                f"at {self.nodes[self.corners[flat[0], 0]].tolist()}; repair the mesh, or use backend='cpm'."
            )

    @property
    def measures(self) -> Floats:
        """(m,) k! times the length, area or volume of each cell with straight edges, k its dimension."""
        vertex = shape_at(self.manifold_dim, 1, np.zeros((self.manifold_dim, 1)))
        with np.errstate(invalid="ignore"):  # of cells without a measure
            return measure_and_pseudoinverse(jacobians(self.nodes, self.corners, vertex))[0][:, 0]


def edge_lengths(nodes: Floats, pairs: Ints) -> Floats:
    """Return the distances (e,) between the two ``nodes`` (n, d) of each of ``pairs`` (e, 2)."""
    found: Floats = np.linalg.norm(nodes[pairs[:, 1]] - nodes[pairs[:, 0]], axis=1)
    return found
