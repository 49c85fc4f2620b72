"""A scene on the nodes of a mesh: its unknowns, its conditions and its mass matrix."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from cpmkit.plugin import CsrOperator, CutMesh, Discretized, Floats, FormTraits, Ints, Scene, conditions_depend_on_time
from cpmkit_fem.cell_mesh import CellMesh, edge_lengths
from cpmkit_fem.contacts import change_of_unknowns
from cpmkit_fem.elements import EDGES_OF, split_into_linear_cells
from cpmkit_fem.nearest import pinned_parts
from cpmkit_fem.operator import zero_pinned_rows
from cpmkit_fem.pins import Pins, pins_of
from cpmkit_fem.rim import RimPart, outward_facets, rim_of
from cpmkit_fem.sides import points_on_own_side, sides_of
from cpmkit_fem.ties import Tie, ties_of
from cpmkit_fem.work import FemWork

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Matrices of tetrahedra are factorised up to so many times the usual number of unknowns.
FACTORISED_OF_SOLIDS = 10.0


@dataclass(frozen=True, eq=False)
class OnNodes(Discretized):
    """A scene on a mesh, with functions that are polynomials on each cell: unknowns are values at nodes.

    Attributes
    ----------
    scene : Scene
        The scene.
    mesh : CellMesh
        The mesh of the solid, surface or curve.
    cut : CutMesh or None
        The mesh with its edges on boundaries; None without boundaries, and where vertices near them are pinned.
    rim : sequence of RimPart
        Its rim and the sides of boundaries, by condition.
    ties : sequence of Tie
        The boundaries that couple their sides.
    pins : Pins
        The vertices with prescribed values.
    laplacian, mass_matrix : csr_array (v, v)
        The integrals of grad u . grad v and of u v.
    """

    scene: Scene
    mesh: CellMesh
    cut: CutMesh | None
    rim: Sequence[RimPart]
    ties: Sequence[Tie]
    pins: Pins
    laplacian: csr_array
    mass_matrix: csr_array

    form: ClassVar[str] = "fem"
    cannot: ClassVar[Mapping[str, str]] = {
        "second Laplacian": "use backend='cpm'",
        "diffusivity that is a tensor": "use backend='cpm'",
        "diffusivity that depends on u": "use backend='cpm'",
        "explicit steps": "use scheme 'newmark' or 'implicit', or backend='cpm'",
        "gradients": "use backend='cpm'",
    }

    @property
    def traits(self) -> FormTraits:
        """The form's traits: matrices of triangles of any size are factorised, since their factors are sparse."""
        libraries = ("cpmkit", "cpmkit-fem", "scikit-fem", "numpy", "scipy")
        limit = FACTORISED_OF_SOLIDS if self.mesh.manifold_dim == 3 else np.inf
        return FormTraits(factorise_up_to=limit, work_record=FemWork, libraries=libraries)

    @property
    def vertices(self) -> Floats:
        """(v, d) the nodes of the mesh: its vertices, of degree 2 then the midpoints of its edges."""
        return self.mesh.nodes

    @cached_property
    def faces(self) -> Ints:
        """(m, k) triangles, k = 3, or segments, k = 2, between them; of degree 2 four or two to a cell.

        Of a solid in space those of its boundary, with normals out of it.
        """
        mesh = self.mesh
        if mesh.manifold_dim < 3:
            return split_into_linear_cells(mesh.cells, mesh.manifold_dim, mesh.degree)
        return split_into_linear_cells(outward_facets(mesh), 2, mesh.degree)

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.vertices)

    @cached_property
    def spacing(self) -> float:
        """The mean length of a cell's edges; an edge of two cells counts twice."""
        pairs = self.mesh.corners[:, EDGES_OF[self.mesh.manifold_dim]]
        return float(edge_lengths(self.vertices, pairs.reshape(-1, 2)).mean())

    @cached_property
    def points(self) -> Floats:
        """(n, d) the nodes; those on boundaries moved a little to their own side, where both sides' data may differ."""
        return points_on_own_side(self.scene, self.mesh, self.cut)

    @cached_property
    def point_weights(self) -> Floats | None:
        """(n,) the weights of nodes for integrals over a solid in space; None for others, whose mesh is drawn."""
        return np.asarray(self.mass_matrix.sum(axis=1)).ravel() if self.mesh.manifold_dim == 3 else None

    def with_scene(self, scene: Scene) -> Self:
        """Return this form for ``scene``, of the same geometry, with the same matrices and new conditions' data.

        Its boundaries must be as many, in the same order.
        """
        pairs = zip(scene.boundaries, self.scene.boundaries, strict=True)
        if scene.edge is self.scene.edge and all(first is second for first, second in pairs):
            return replace(self, scene=scene, pins=replace(self.pins, channels=scene.channels))
        rim = conditions_of(scene, self.mesh, self.cut)
        ties = ties_of(scene, self.mesh, self.cut)
        return replace(self, scene=scene, rim=rim, ties=ties, pins=pins_of(rim, ties, scene.channels))

    @cached_property
    def mass(self) -> CsrOperator:
        """The mass matrix with zero rows at pinned vertices; their columns stay only where data depend on time."""
        moves = conditions_depend_on_time(self.scene)
        return CsrOperator(zero_pinned_rows(self._mass, self.pins.vertices, columns=not moves), symmetric=not moves)

    @cached_property
    def _mass(self) -> csr_array:
        return self.matrix_of_unknowns(self.mass_matrix)

    @cached_property
    def change(self) -> csr_array | None:
        """T (n, n), with values at nodes ``T u`` and T its own inverse; None where unknowns are these values."""
        return change_of_unknowns(self.ties, self.size)

    def matrix_of_unknowns(self, matrix: csr_array) -> csr_array:
        """Return ``T' matrix T`` (n, n): a bilinear form of values at nodes as a form of the unknowns."""
        return matrix if self.change is None else (self.change.T @ matrix @ self.change).tocsr()

    def load_of_unknowns(self, b: Floats) -> Floats:
        """Return ``T' b`` (n, channels): a load of the nodes' test functions as a load of the unknowns'."""
        return b if self.change is None else np.asarray(self.change.T @ b)

    def change_variables(self, values: Floats) -> Floats:
        """Return ``T values`` (n, channels): unknowns from values at nodes, or the reverse: T is its own inverse."""
        return values if self.change is None else np.asarray(self.change @ values)


def conditions_of(scene: Scene, mesh: CellMesh, cut: CutMesh | None) -> Sequence[RimPart]:
    """Return parts of the rim and the sides of boundaries, or pinned vertices if ``cut`` is None, each with its law."""
    if cut is None:
        return [*pinned_parts(scene, mesh), *rim_of(scene, mesh, np.zeros((0, mesh.manifold_dim), dtype=np.int64))]
    return [*sides_of(scene, mesh, cut), *rim_of(scene, mesh, cut.edges)]
