"""Boundaries that couple their two sides by a flux that depends on the jump of u.

With k du/db the flux into each side, their sum q prescribed and phi from left to right, the weak form gains

    int q (v_left + v_right) / 2 - phi (v_left - v_right),    phi = (u_left - u_right - jump) / R.

Along curves of a surface a contact without resistance has R = 1e-5 times an edge over the diffusivity: the remaining
jump is below the error of linear elements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import (
    Bools,
    ClosestPointSource,
    CutMesh,
    Data,
    Floats,
    Interface,
    Ints,
    Scene,
    SceneError,
    evaluate_data,
)
from cpmkit_fem.assembly import gathered, weighted_mass
from cpmkit_fem.cell_mesh import CellMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Resistance used for a contact without resistance, times the diffusivity, as a share of an edge.
NO_RESISTANCE_EDGES = 1e-5


@dataclass(frozen=True, eq=False)
class Tie:
    """Facets on both sides of a boundary whose law couples the two sides.

    Attributes
    ----------
    law : Interface
        The law of the coupling.
    mesh : CellMesh
        The mesh, cut along the boundary.
    edges : (e, c) int64
        Facets on the left: their nodes, as rows of ``left``.
    left, right : (k,) int64
        Vertices on the left, and those at the same points on the right; at an end of the boundary both are one vertex.
    label : str
        Name of the boundary in errors.
    place : ClosestPointSource
        The boundary, at whose closest points data are evaluated.
    """

    law: Interface
    mesh: CellMesh
    edges: Ints
    left: Ints
    right: Ints
    label: str
    place: ClosestPointSource

    @property
    def prescribes_jump(self) -> bool:
        """Whether the unknowns of ``right`` are prescribed jumps: at points of a curve, without a resistance."""
        return self.mesh.manifold_dim == 1 and not self.law.resistance

    @property
    def vertex_numbers(self) -> Ints:
        """(k,) the nodes whose unknowns are jumps if :attr:`prescribes_jump`."""
        return self.right

    @property
    def distances(self) -> Floats:
        """(k,) zeros: distances of the data's points from the vertices count as zero (:attr:`RimPart.distances`)."""
        return np.zeros(len(self.right))

    def jumps(self, channels: int, time: float | None) -> Floats:
        """Return the jumps u_left - u_right (k, channels) at the vertices; ``time`` is None for steady problems."""
        return self._evaluate(self.law.jump, channels, time)

    values = jumps  # prescribed ones, as Pins reads them

    @cached_property
    def points(self) -> Floats:
        """(k, d) points at which the data of the vertices are evaluated."""
        return self.place.closest_point(self.mesh.nodes[self.left]).points

    def stiffness(self, a: Floats) -> csr_array:
        """Return the integrals (n, n) of ``(u_left - u_right) (v_left - v_right) / R``, R the resistance.

        ``a`` (n,) is the diffusivity at the nodes, which scales a small R if the law has none.
        """
        return self._difference.T @ self._mass(self._conductance(a)) @ self._difference

    def load(self, a: Floats, channels: int, time: float | None) -> Floats:
        """Return the contribution (n, channels) of the law's flux and jump to the right-hand side.

        ``a`` (n,) is the diffusivity at the nodes; ``time`` is None for steady problems.
        """
        flux = self._evaluate(self.law.flux, channels, time)
        added = self._mean.T @ (self._mass(np.ones(len(self.left))) @ flux)
        if not self.prescribes_jump:
            added += self._difference.T @ (self._mass(self._conductance(a)) @ self.jumps(channels, time))
        return np.asarray(added)

    def _evaluate(self, data: Data, channels: int, time: float | None) -> Floats:
        return evaluate_data(data, self.points, channels, self.label, time)

    def _conductance(self, a: Floats) -> Floats:
        """Return 1 / R (k,) at the vertices; a zero R becomes :data:`NO_RESISTANCE_EDGES` edges over ``a`` (n,)."""
        if self.law.resistance:
            return np.full(len(self.left), 1.0 / self.law.resistance)
        return np.maximum(a[self.left], a[self.right]) / (NO_RESISTANCE_EDGES * self.mesh.mean_edge)

    def _mass(self, weight: Floats) -> csr_array:
        nodes, dim = self.mesh.nodes[self.left], self.mesh.manifold_dim - 1
        of_facets = weighted_mass(nodes, self.edges, weight[self.edges], dim, self.mesh.degree)
        return gathered(of_facets, self.edges, len(self.left))

    @cached_property
    def _difference(self) -> csr_array:
        return self._combine_sides(1.0, -1.0)

    @cached_property
    def _mean(self) -> csr_array:
        return self._combine_sides(0.5, 0.5)

    def _combine_sides(self, left: float, right: float) -> csr_array:
        """Return the matrix (k, n) of ``left`` times the value on the left plus ``right`` times that on the right."""
        from scipy.sparse import csr_array

        count = len(self.left)
        entries = np.repeat([left, right], count)
        rows, columns = np.tile(np.arange(count), 2), np.concatenate([self.left, self.right])
        return csr_array((entries, (rows, columns)), shape=(count, len(self.mesh.nodes)))


def ties_of(scene: Scene, mesh: CellMesh, cut: CutMesh | None) -> Sequence[Tie]:
    """Return the ties of the boundaries whose law couples their sides; none where the mesh is not ``cut``.

    Raise SceneError if such a boundary has only one side somewhere, as on the rim, or three, as at a junction, or is a
    point of a surface.
    """
    ties = []
    for number, boundary in enumerate(scene.boundaries):
        law = boundary.condition("left").law
        if cut is None or not isinstance(law, Interface):
            continue
        on, label = cut.owner == number, f"boundary {boundary.name!r}"
        edges = mesh.facet_nodes(cut.edges[on & cut.left])
        left, rows = np.unique(edges, return_inverse=True)
        others = np.unique(mesh.facet_nodes(cut.edges[on & ~cut.left]))
        right, missing = _match_vertices(mesh.nodes, left, others)
        if number in cut.points or missing.any() or len(others) != len(left) or not len(edges):
            raise SceneError(
                f"{label} couples two sides, and has only one on this mesh, or three and more; end it off the rim and "
                "junctions, or give conditions of one side."
            )
        ties.append(Tie(law, mesh, rows.reshape(edges.shape), left, right, label, boundary.source))
    return ties


def _match_vertices(vertices: Floats, left: Ints, right: Ints) -> tuple[Ints, Bools]:
    """Return the vertex of ``right`` at the point of each of ``left`` (k,), -1 for none, and (k,) which have none.

    Points are compared bit by bit; ``vertices`` (n, d) are positions.
    """
    places = {point.tobytes(): int(vertex) for point, vertex in zip(vertices[right], right, strict=True)}
    partners = np.array([places.get(point.tobytes(), -1) for point in vertices[left]], dtype=np.int64)
    return partners, partners < 0
