"""Boundaries that couple their two sides: what flows through depends on how far u differs from one to the other.

With k du/db the flow into each side, their sum q given and phi from left to right, the weak form gains

    int q (v_left + v_right) / 2 - phi (v_left - v_right),    phi = (u_left - u_right - jump) / R.

Along curves of a surface R is a hundred thousandth of an edge over the diffusivity where there is no resistance:
what that leaves of a jump is less than linear elements see.
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
from cpmkit_fem.assembly import mass_over
from cpmkit_fem.cell_mesh import CellMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Resistance of a contact that has none, times the diffusivity, as a share of an edge.
NO_RESISTANCE_EDGES = 1e-5


@dataclass(frozen=True, eq=False)
class Tie:
    """Facets on both sides of a boundary that one law couples.

    Attributes
    ----------
    law : Interface
        What holds.
    mesh : CellMesh
        That is cut along the boundary.
    edges : (e, c) int64
        Facets on the left, as places among ``left``.
    left, right : (k,) int64
        Vertices on the left, and those at the same points on the right; at ends of the boundary the same.
    what : str
        Named in errors.
    place : ClosestPointSource
        The boundary, at whose feet data are asked.
    """

    law: Interface
    mesh: CellMesh
    edges: Ints
    left: Ints
    right: Ints
    what: str
    place: ClosestPointSource

    @property
    def holds_jump(self) -> bool:
        """Whether the jump is given at unknowns of its own, those of ``right``, and there is nothing to conduct."""
        return self.mesh.manifold_dim == 1 and not self.law.resistance

    @property
    def on(self) -> Ints:
        """(k,) the unknowns whose values are given where the jump is held."""
        return self.right

    @property
    def off(self) -> Floats:
        """(k,) how far the places of the data are from these, as of parts of the rim: not at all."""
        return np.zeros(len(self.right))

    def values(self, channels: int, time: float | None) -> Floats:
        """Return the jumps (k, channels)."""
        return self._given(self.law.jump, channels, time)

    @cached_property
    def points(self) -> Floats:
        """(k, d) where data are asked for the vertices."""
        return self.place.closest_point(self.mesh.nodes[self.left]).points

    def stiffness(self, a: Floats) -> csr_array:
        """Return the integrals (v, v) of ``(u_left - u_right) (v_left - v_right) / R``, ``a`` (v,) the diffusivity."""
        return self._difference.T @ self._mass(self._conductance(a)) @ self._difference

    def load(self, a: Floats, channels: int, time: float | None) -> Floats:
        """Return what the law's data add to b (v, channels)."""
        flux = self._given(self.law.flux, channels, time)
        added = self._mean.T @ (self._mass(np.ones(len(self.left))) @ flux)
        if not self.holds_jump:
            added += self._difference.T @ (self._mass(self._conductance(a)) @ self.values(channels, time))
        return np.asarray(added)

    def _given(self, data: Data, channels: int, time: float | None) -> Floats:
        return evaluate_data(data, self.points, channels, self.what, time)

    def _conductance(self, a: Floats) -> Floats:
        """Return 1 / R (k,)."""
        if self.law.resistance:
            return np.full(len(self.left), 1.0 / self.law.resistance)
        return np.maximum(a[self.left], a[self.right]) / (NO_RESISTANCE_EDGES * self.mesh.mean_edge)

    def _mass(self, weight: Floats) -> csr_array:
        return mass_over(self.mesh.nodes[self.left], self.edges, weight, self.mesh.manifold_dim - 1, self.mesh.degree)

    @cached_property
    def _difference(self) -> csr_array:
        return self._of_sides(1.0, -1.0)

    @cached_property
    def _mean(self) -> csr_array:
        return self._of_sides(0.5, 0.5)

    def _of_sides(self, left: float, right: float) -> csr_array:
        from scipy.sparse import csr_array

        count = len(self.left)
        entries = np.repeat([left, right], count)
        rows, columns = np.tile(np.arange(count), 2), np.concatenate([self.left, self.right])
        return csr_array((entries, (rows, columns)), shape=(count, len(self.mesh.nodes)))


def ties_of(scene: Scene, mesh: CellMesh, cut: CutMesh | None) -> Sequence[Tie]:
    """Return the boundaries whose law couples their sides.

    Raises
    ------
    SceneError
        If a boundary has one side alone somewhere, as on the surface's rim, or is a point.
    """
    found = []
    for number, boundary in enumerate(scene.boundaries):
        law = boundary.condition("left").law
        if cut is None or not isinstance(law, Interface):
            continue
        on, what = cut.owner == number, f"boundary {boundary.name!r}"
        edges = mesh.with_midpoints(cut.edges[on & cut.left])
        left, own = np.unique(edges, return_inverse=True)
        others = np.unique(mesh.with_midpoints(cut.edges[on & ~cut.left]))
        right, missing = _across(mesh.nodes, left, others)
        if number in cut.points or missing.any() or len(others) != len(left) or not len(edges):
            raise SceneError(
                f"{what} couples two sides, and has one alone on this mesh, or three and more; end it off the rim and "
                "junctions, or give conditions of one side."
            )
        found.append(Tie(law, mesh, own.reshape(edges.shape), left, right, what, boundary.source))
    return found


def _across(vertices: Floats, left: Ints, right: Ints) -> tuple[Ints, Bools]:
    """Return for each of ``left`` (k,) the one of ``right`` at the same point, and which have none."""
    places = {point.tobytes(): int(vertex) for point, vertex in zip(vertices[right], right, strict=True)}
    found = np.array([places.get(point.tobytes(), -1) for point in vertices[left]], dtype=np.int64)
    return found, found < 0
