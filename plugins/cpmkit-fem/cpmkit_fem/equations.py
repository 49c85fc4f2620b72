"""Finite elements as the families of equations see them: matrices, right-hand sides, conditions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from cpmkit.plugin import (
    Border,
    CsrOperator,
    CutMesh,
    Data,
    Discretized,
    Floats,
    InputError,
    Ints,
    Mixed,
    Nonlinear,
    Scene,
    SceneError,
    Spectral,
    StateFlux,
    Stiffness,
    Terms,
    Value,
)
from cpmkit_fem.assembly import lumped, stiffness_and_mass
from cpmkit_fem.cell_mesh import CellMesh
from cpmkit_fem.contacts import change_of
from cpmkit_fem.elements import in_parts
from cpmkit_fem.nearest import pinned_vertices
from cpmkit_fem.operator import VertexOperator, pinned_operator, without
from cpmkit_fem.pins import Pins, pins_of
from cpmkit_fem.rim import RimPart, rim_of
from cpmkit_fem.sides import on_own_side, sides_of
from cpmkit_fem.ties import Tie, ties_of

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class Equations(Discretized):
    """A scene on a mesh, with functions that are polynomials on each cell: unknowns are values at nodes.

    Attributes
    ----------
    scene : Scene
        What is discretised.
    mesh : CellMesh
        Of the surface or curve.
    cut : CutMesh or None
        What lies on boundaries; None where there are none, or vertices near them are pinned.
    rim : sequence of RimPart
        Its rim and the sides of boundaries, by condition.
    ties : sequence of Tie
        The boundaries that couple their sides.
    pins : Pins
        The vertices whose values are given.
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
    libraries: ClassVar[tuple[str, ...]] = ("cpmkit", "cpmkit-fem", "scikit-fem", "numpy", "scipy")
    cannot: ClassVar[Mapping[str, str]] = {
        "second Laplacian": "use backend='cpm'",
        "diffusivity that is a tensor": "use backend='cpm'",
        "diffusivity that depends on u": "use backend='cpm'",
        "explicit steps": "use scheme 'newmark' or 'implicit', or backend='cpm'",
    }
    #: Factors of a matrix of triangles are sparse enough for every mesh.
    factorise_up_to: ClassVar[float] = np.inf

    @property
    def vertices(self) -> Floats:
        """(v, d) the nodes of the mesh: its vertices, of degree 2 then the midpoints of its edges."""
        return self.mesh.nodes

    @cached_property
    def faces(self) -> Ints:
        """(m, k) triangles, k = 3, or segments, k = 2, between them; of degree 2 four or two to a cell."""
        return in_parts(self.mesh.cells, self.mesh.manifold_dim, self.mesh.degree)

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.vertices)

    @cached_property
    def spacing(self) -> float:
        """The mean length of a cell's side."""
        corners = self.vertices[self.mesh.corners]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())

    @cached_property
    def points(self) -> Floats:
        """(v, d) the nodes; on boundaries a little on their own side, for data that differ on the two."""
        return on_own_side(self.scene, self.mesh, self.cut)

    def restated(self, scene: Scene) -> Self:
        """Return the same mesh and matrices with another scene, whose conditions have other data at most."""
        pairs = zip(scene.boundaries, self.scene.boundaries, strict=True)
        if scene.edge is self.scene.edge and all(first is second for first, second in pairs):
            return replace(self, scene=scene, pins=replace(self.pins, channels=scene.channels))
        rim = conditions_of(scene, self.mesh, self.cut)
        ties = ties_of(scene, self.mesh, self.cut)
        return replace(self, scene=scene, rim=rim, ties=ties, pins=pins_of(rim, ties, scene.channels))

    @cached_property
    def mass(self) -> CsrOperator:
        """M, with no rows at pinned vertices, and columns there only where data, and so their values, move in time."""
        moves = self.data_move
        return CsrOperator(without(self._mass, self.pins.vertices, columns=not moves), symmetric=not moves)

    @cached_property
    def _mass(self) -> csr_array:
        return self.changed(self.mass_matrix)

    @cached_property
    def change(self) -> csr_array | None:
        """T (n, n), with values at nodes ``T u`` and T its own inverse; None where unknowns are these values."""
        return change_of(self.ties, self.size)

    def changed(self, matrix: csr_array) -> csr_array:
        """Return ``T' matrix T``: a form of values at nodes as one of unknowns."""
        return matrix if self.change is None else (self.change.T @ matrix @ self.change).tocsr()

    def tested(self, b: Floats) -> Floats:
        """Return ``T' b``: what is tested by functions at nodes, as by the unknowns'."""
        return b if self.change is None else np.asarray(self.change.T @ b)

    def exchanged(self, values: Floats) -> Floats:
        """Return ``T values``: the unknowns of values at nodes, and the reverse."""
        return values if self.change is None else np.asarray(self.change @ values)

    def stiffness(self, terms: Terms) -> VertexOperator:
        """Return A, the integrals of a grad u . grad v + c u v, and over the rim of a beta / alpha u v.

        Raises
        ------
        SceneError
            If there is a velocity.
        InputError
            If a diffusivity is not above zero.
        """
        if terms.velocity is not None:
            kind = self.scene.problem.kind
            raise SceneError(f"backend='fem' takes no velocity, got the kind {kind!r} with one; use backend='cpm'.")
        if terms.lumped and self.mesh.degree == 2:
            raise InputError("a lumped mass is one of degree 1, got degree=2, whose row sums are zero; use degree=1.")
        a, c = (self.read(*one)[:, 0] for one in ((terms.diffusivity, "the diffusivity"), (terms.c, "the factor c")))
        if np.any(a <= 0):
            raise InputError(f"the diffusivity must be above zero, got {a.min():g}.")
        matrix, mass = a[0] * self.laplacian, c[0] * self.mass_matrix
        if callable(terms.diffusivity) or callable(terms.c):
            matrix, mass = stiffness_and_mass(self.mesh.nodes, self.mesh.cells, a, c, self.mesh.degree)
        matrix = (matrix + (lumped(mass) if terms.lumped else mass)).tocsr()
        for tie in self.ties:
            if not tie.holds_jump:
                matrix = (matrix + tie.stiffness(a)).tocsr()
        rims = [part.mass(a / part.law.alpha) for part in self._flows]
        for part in self._flows:
            if isinstance(part.law, Mixed):
                beta = part.given(part.law.beta, 1, None)[:, 0]
                matrix = (matrix + part.mass(a * beta / part.law.alpha)).tocsr()
        fixed = not callable(terms.c) and bool(terms.c)
        return pinned_operator(self.changed(matrix), self.pins.vertices, rims, fixed, a)

    @property
    def _flows(self) -> list[RimPart]:
        """The parts on which du/db is in the law."""
        return [part for part in self.rim if not isinstance(part.law, Value)]

    def load(self, f: Data, time: float | None = None) -> Floats:
        """Return the integrals of f v, f linear between the vertices; none at pinned vertices."""
        b = self.tested(self.mass_matrix @ self.read(f, "the right-hand side f", time, self.channels))
        b[self.pins.vertices] = 0.0
        return b

    def data(self, stiffness: Stiffness, time: float | None = None, of: str = "value") -> Floats:
        """Return the integrals of the fluxes' data over the rim, and what the given values add to b."""
        del of  # a second Laplacian is refused
        assert isinstance(stiffness, VertexOperator)
        b = np.zeros((self.size, self.channels))
        for part, rim in zip(self._flows, stiffness.rims, strict=True):
            b += rim @ part.given(part.law.datum, self.channels, time)
        for tie in self.ties:
            b += tie.load(stiffness.diffusivity, self.channels, time)
        b = self.tested(b)
        b[self.pins.vertices] = 0.0
        return np.asarray(b - stiffness.coupling @ self.pins.values(time))

    def boundary_mass(self, stiffness: Stiffness) -> CsrOperator | None:
        """Return the integrals of a u v over the parts of the rim where du/db = lambda u; None where there are none."""
        assert isinstance(stiffness, VertexOperator)
        pairs = zip(self._flows, stiffness.rims, strict=True)
        spectral = [rim for part, rim in pairs if isinstance(part.law, Spectral)]
        if not spectral:
            return None
        return CsrOperator(
            without(self.changed(sum(spectral[1:], spectral[0])), self.pins.vertices, columns=True), symmetric=True
        )

    def free_constants(self, stiffness: Stiffness) -> Border | None:
        """Return the pieces on which a constant is free, with means over them; None where there is none."""
        assert isinstance(stiffness, VertexOperator)
        return None if stiffness.fixed else super().free_constants(stiffness)

    # Fluxes that depend on the solution

    @property
    def state_fluxes(self) -> Sequence[StateFlux]:
        """The parts whose flux depends on the solution."""
        return [part for part in self.rim if isinstance(part.law, Nonlinear)]

    def linearized(self, seen: Sequence[Floats]) -> Self:
        """Return the form with the fluxes' tangents."""
        values = iter(seen)
        rim = [part.linearized(next(values)) if isinstance(part.law, Nonlinear) else part for part in self.rim]
        return replace(self, rim=rim)


def conditions_of(scene: Scene, mesh: CellMesh, cut: CutMesh | None) -> Sequence[RimPart]:
    """Return the parts of the rim and the sides of boundaries, each with its law."""
    if cut is None:
        return [*pinned_vertices(scene, mesh), *rim_of(scene, mesh, np.zeros((0, mesh.manifold_dim), dtype=np.int64))]
    return [*sides_of(scene, mesh, cut), *rim_of(scene, mesh, cut.edges)]
