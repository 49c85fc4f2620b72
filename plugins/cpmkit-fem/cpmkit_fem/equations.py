"""Finite elements as the families of equations see them: matrices, right-hand sides, conditions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from cpmkit.plugin import (
    Border,
    CsrOperator,
    Data,
    Floats,
    InputError,
    Mixed,
    Nonlinear,
    SceneError,
    Spectral,
    StateFlux,
    Stiffness,
    Terms,
    Value,
)
from cpmkit_fem.assembly import gathered, lump_mass, stiffness_and_mass
from cpmkit_fem.on_nodes import OnNodes
from cpmkit_fem.operator import VertexOperator, diagonal_matrix, pinned_operator, zero_pinned_rows
from cpmkit_fem.rim import RimPart


@dataclass(frozen=True, eq=False)
class Equations(OnNodes):
    """The assembled equations of a scene on the nodes of a mesh: stiffness, loads, and conditions."""

    def stiffness(self, terms: Terms) -> VertexOperator:
        """Return A, the integrals of a grad u . grad v + c u v, and over the rim of a beta / alpha u v, and the ties.

        The rim stands for its parts and sides of boundaries whose law has alpha and beta. Rows and columns of pinned
        nodes are those of a diagonal matrix. Raise SceneError if there is a velocity. Raise InputError if a diffusivity
        is not above zero, or a lumped mass is of degree 2.
        """
        if terms.velocity is not None:
            kind = self.scene.problem.kind
            raise SceneError(f"backend='fem' takes no velocity, got the kind {kind!r} with one; use backend='cpm'.")
        if terms.lumped and self.mesh.degree == 2:
            raise InputError("a lumped mass is one of degree 1, got degree=2, whose row sums are zero; use degree=1.")
        if callable(terms.capacity) or terms.capacity != 1:
            raise SceneError("backend='fem' has u_t without a capacity; divide the other terms by it.")
        a, c = (
            self.data_at_points(*one)[:, 0]
            for one in ((terms.diffusivity, "the diffusivity"), (terms.c, "the factor c"))
        )
        if np.any(a <= 0):
            raise InputError(f"the diffusivity must be above zero, got {a.min():g}.")
        matrix, mass = a[0] * self.laplacian, c[0] * self.mass_matrix
        if callable(terms.diffusivity) or callable(terms.c):
            matrix, mass = stiffness_and_mass(self.mesh.nodes, self.mesh.cells, a, c, self.mesh.degree)
        matrix = (matrix + (lump_mass(mass) if terms.lumped else mass)).tocsr()
        for tie in self.ties:
            if not tie.prescribes_jump:
                matrix = (matrix + tie.stiffness(a)).tocsr()
        rims = [part.facet_mass(a[part.edges] / part.law.alpha) for part in self._flows]
        for part in self._flows:
            if isinstance(part.law, Mixed):
                beta = part.facet_data(part.law.beta, 1, None).reshape(part.edges.shape)
                matrix = (matrix + part.mass(a[part.edges] * beta / part.law.alpha)).tocsr()
        fixed = not callable(terms.c) and bool(terms.c)
        return pinned_operator(self.matrix_of_unknowns(matrix), self.pins.vertices, rims, fixed, a)

    @property
    def _flows(self) -> list[RimPart]:
        """The parts on which du/db is in the law."""
        return [part for part in self.rim if not isinstance(part.law, Value)]

    def load(self, f: Data, time: float | None = None) -> Floats:
        """Return the integrals (n, channels) of f v, ``f`` interpolated between nodes at ``time``; zero at pins."""
        b = self.load_of_unknowns(
            self.mass_matrix @ self.data_at_points(f, "the right-hand side f", time, self.scene.channels)
        )
        b[self.pins.vertices] = 0.0
        return b

    def condition_load(self, stiffness: Stiffness, time: float | None = None, of: str = "value") -> Floats:
        """Return the load (n, channels) of the conditions' data at ``time``: fluxes, jumps and prescribed values.

        ``stiffness`` is an answer of :meth:`stiffness`; ``of`` is ignored.
        """
        del of  # a second Laplacian is refused
        assert isinstance(stiffness, VertexOperator)
        b = np.zeros((self.size, self.scene.channels))
        for part, rim in zip(self._flows, stiffness.rims, strict=True):
            b += rim @ part.facet_data(part.law.datum, self.scene.channels, time)
        for tie in self.ties:
            b += tie.load(stiffness.diffusivity, self.scene.channels, time)
        b = self.load_of_unknowns(b)
        b[self.pins.vertices] = 0.0
        return np.asarray(b - stiffness.coupling @ self.pins.values(time))

    def boundary_mass(self, stiffness: Stiffness) -> CsrOperator | None:
        """Return integrals of a u v over the parts of the rim with the law du/db = lambda u; None if there are none."""
        assert isinstance(stiffness, VertexOperator)
        pairs = zip(self._flows, stiffness.rims, strict=True)
        spectral = [gathered(rim, part.edges, self.size) for part, rim in pairs if isinstance(part.law, Spectral)]
        if not spectral:
            return None
        return CsrOperator(
            zero_pinned_rows(self.matrix_of_unknowns(sum(spectral[1:], spectral[0])), self.pins.vertices, columns=True),
            symmetric=True,
        )

    def free_constants(self, stiffness: Stiffness) -> Border | None:
        """Return indicators and means of the pieces on which A leaves a constant undetermined; None if none."""
        assert isinstance(stiffness, VertexOperator)
        border = None if stiffness.fixed else super().free_constants(stiffness)
        if border is None or self.change is None:
            return border
        weights = (border.indicator.T @ self._mass).tocsr()  # M has no columns at jumps that are given
        measure = np.asarray((weights @ border.indicator).sum(axis=1)).ravel()
        return replace(border, mean=diagonal_matrix(1 / measure) @ weights)

    # Fluxes that depend on the solution

    @property
    def state_fluxes(self) -> Sequence[StateFlux]:
        """The parts whose flux depends on the solution."""
        return [part for part in self.rim if isinstance(part.law, Nonlinear)]

    def linearise(self, seen: Sequence[Floats]) -> Self:
        """Return the form with each nonlinear flux replaced by its tangent at ``seen``.

        ``seen`` holds u (k,) at the vertices of each of :attr:`state_fluxes`, in their order.
        """
        values = iter(seen)
        rim = [part.linearise(next(values)) if isinstance(part.law, Nonlinear) else part for part in self.rim]
        return replace(self, rim=rim)
