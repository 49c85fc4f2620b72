"""Equations and conditions as matrices and loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Self
from weakref import WeakKeyDictionary

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.form_records import StateDependentCoefficient, StateFlux
from cpmkit.forms.free_constants import free_pieces
from cpmkit.forms.galerkin.advection import outward_speed
from cpmkit.forms.galerkin.coefficients import Coefficients
from cpmkit.forms.galerkin.conditions.condition_terms import ConditionTerms, condition_terms, flux_through
from cpmkit.forms.galerkin.conditions.imposed_conditions import rim_loops
from cpmkit.forms.galerkin.galerkin_operator import GalerkinOperator, build_operator
from cpmkit.forms.galerkin.space.energy import conductivity, load_against_slopes, mass, stiffness_with_floor
from cpmkit.linear.operators import Border, CsrOperator, with_diagonal
from cpmkit.linear.protocols import Stiffness
from cpmkit.runtime.caches import state_without_cached
from cpmkit.scene.data import Data
from cpmkit.scene.diffusivities import StateDiffusivity
from cpmkit.scene.equations import Terms
from cpmkit.scene.functionals import TestedRightSide
from cpmkit.types import Floats, Side

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class EquationAssembly(Coefficients):
    """The part of the form that makes operators and right-hand sides."""

    __getstate__ = state_without_cached

    def stiffness(self, terms: Terms) -> GalerkinOperator:
        """Return A: the energy of u over the samples, what holds the rest of u, c u v, and the conditions' terms.

        Raises
        ------
        InputError
            If the diffusivity is not positive, or not definite on tangents.
        """
        a = self._diffusivity(terms.diffusivity)
        c = self._at_samples(terms.c, "the factor c") if callable(terms.c) or terms.c else None
        holding = self._holding(terms.diffusivity)
        matrix = self._floored_stiffness(a, None if terms.lumped else c, holding)
        if terms.lumped and c is not None:
            matrix = with_diagonal(matrix, self._loads(c[:, None])[:, 0])
        carried = self._carried_for(terms)
        if carried is not None:
            matrix = carried.added_to(matrix, self._strength)
        matrix = self._tips.bordered(matrix, a, c)
        conditions = self._conditions(terms, a, holding)
        if conditions.held:
            matrix = (matrix + conditions.matrix).tocsr()
        if terms.conservative:
            matrix = (matrix + conditions.carried_out).tocsr()
        return build_operator(matrix, conditions, conductivity(self.space, a), c, carried)

    def _floored_stiffness(self, a: Floats, c: Floats | None, holding: Floats | None) -> csr_array:
        """Return the splines' stiffness of ``a`` and mass of ``c`` at the samples, with the floor."""
        return stiffness_with_floor(self.space, a, self._strength, c, holding)

    @cached_property
    def _mass_in_time(self) -> CsrOperator:
        upstream = None if self._carried is None else self._carried.mass_upstream()
        matrix = self._projection.matrix
        return CsrOperator(matrix, True) if upstream is None else CsrOperator((matrix + upstream).tocsr())

    def free_constants(self, stiffness: Stiffness) -> Border | None:
        """Return the pieces on which a constant is free, with means over them; None where there is none.

        Raises
        ------
        SceneError
            If a conservative velocity leaves a solution free that is no constant.
        """
        assert isinstance(stiffness, GalerkinOperator)
        if stiffness.carried is not None and stiffness.carried.conservative:
            self._check_held(stiffness)
            return None
        return None if stiffness.fixed else free_pieces(stiffness, lambda: self.mass, self._tips.splines)

    def _check_held(self, stiffness: GalerkinOperator) -> None:
        """Refuse an equation in divergence form that nothing flows out of: its total is free, or f has no solution."""
        turned = CsrOperator(stiffness.to_csr().T.tocsr())
        if free_pieces(turned, lambda: self.mass, self._tips.splines) is not None:
            raise SceneError(
                "Nothing fixes the size of the solution on a piece of the manifold: a conservative velocity carries "
                "nothing out of it, and c is zero there; give c above zero, or a value somewhere."
            )

    def _conditions(self, terms: Terms, a: Floats | None = None, holding: Floats | None = None) -> ConditionTerms:
        """Return the terms of the conditions where the diffusivity is ``a`` at all samples, 1 unless given."""
        one, diffusivity, along = self.sampled, terms.diffusivity, None
        logarithms = np.zeros(len(self._areas))
        if a is not None:
            means = conductivity(self.space, a)
            varies = means.min() < means.max()
            logarithms = self._loads(np.log(means)[:, None])[:, 0] if varies else np.log(means[0]) * self._areas
        if a is not None and a.ndim == 3:
            patch = self.space.dof_map.patch[one.interior :]
            along = partial(self._derivative_rows, patch, one.boundary.points)
        given = (
            self._beside_boundaries(diffusivity) if isinstance(diffusivity, StateDependentCoefficient) else diffusivity
        )
        where = (one.held, one.boundary, one.left, self._boundary_rows, self._areas)
        found = condition_terms(*where, given, logarithms, one.lattice, along, self._boundary_spacings)
        if terms.velocity is not None:
            found = replace(found, speed_out=outward_speed(terms.velocity, one.boundary, one.lattice))
        if holding is not None:  # penalties are a over the width, which is so much wider as a is above what holds
            held = self._conditions(
                Terms(diffusivity=StateDependentCoefficient(diffusivity.holding, diffusivity.u)), holding
            )
            found = replace(found, widths=found.widths * found.a / held.a)
        return self._tips.read_by(found)

    def load(self, f: Data, time: float | None = None) -> Floats:
        """Return the integrals of f times each spline, (n, channels)."""
        if isinstance(f, TestedRightSide):
            return f.loads(self, time)
        values = self.data_at_points(f, "the right-hand side f", time, self.channels)
        loads = self._integrals(values)
        if self._carried is not None:
            self._carried.add_load(values, loads)
        return loads

    def weighted_mass(self, values: Floats) -> csr_array:
        """Return the integrals (n, n) of c u v, c with ``values`` (p,) at the samples."""
        if len(self._tips):
            raise SceneError("tips='singular' takes no channels that are tied to each other; use tips='extended'.")
        return mass(self.space, self._and_on_boundaries(values))

    def gradient_load(self, values: Floats) -> Floats:
        """Return the integrals (n,) of vectors (p, d) at the samples times the tangential gradient of each spline."""
        loads = load_against_slopes(self.space, values)
        if not len(self._tips):
            return loads
        weighted = self.point_weights[:, None] * values
        own = sum(rows.T @ weighted[:, axis] for axis, rows in enumerate(self._tips.slopes_inside))
        return np.concatenate([loads, own])

    def condition_load(self, stiffness: Stiffness, time: float | None = None, of: str = "value") -> Floats:
        """Return what the conditions' data add to b, (n, channels)."""
        assert isinstance(stiffness, GalerkinOperator)
        conditions = self._with_own_data(stiffness)
        if not conditions.held:
            return np.zeros((self.size, self.channels))
        if of == "laplacian":
            return -conditions.of_laplacian.load(self.channels, time)
        return conditions.load(self.channels, time)

    def _with_own_data(self, stiffness: GalerkinOperator) -> ConditionTerms:
        """Return an operator's conditions with the data of this scene: it may have been made for other data."""
        kept = self._conditions_by_operator
        if stiffness not in kept:
            assert stiffness.conditions is not None
            own = stiffness.conditions.held is self.sampled.held
            kept[stiffness] = stiffness.conditions if own else replace(stiffness.conditions, held=self.sampled.held)
        return kept[stiffness]

    @cached_property
    def _conditions_by_operator(self) -> WeakKeyDictionary[GalerkinOperator, ConditionTerms]:
        return WeakKeyDictionary()

    def _own_conditions(self, u: Floats) -> ConditionTerms:
        """Return the conditions with the diffusivity of the scene's own problem, whose solution is u."""
        terms = self.scene.problem.terms()
        if isinstance(terms.diffusivity, StateDiffusivity):
            at = StateDependentCoefficient(terms.diffusivity.at, u)
            return self._conditions(replace(terms, diffusivity=at), self._diffusivity(at))
        return self._conditions_of_scene

    @cached_property
    def _conditions_of_scene(self) -> ConditionTerms:
        """The conditions with the diffusivity of the scene's own problem, where it does not depend on u."""
        terms = self.scene.problem.terms()
        return self._conditions(terms, self._diffusivity(terms.diffusivity))

    def flux(self, u: Floats, boundary: str | int, side: Side | None, time: float | None) -> Floats | None:
        """Return the integrals of du/db by the residual of the weak form; None on a rim without samples of its own.

        Of a tensor A, b the conormal, that of the derivative along A b / (b . A b).
        """
        one, names = self.sampled, [boundary.name for boundary in self.scene.boundaries]
        if boundary in names:
            self.sides({str(boundary): side})  # type: ignore[dict-item]
        samples = one.boundary
        if boundary in names:
            chosen = (
                (samples.owner == names.index(str(boundary))) & ~samples.beyond_tip & (one.left == (side == "left"))
            )
        else:
            chosen = (samples.owner < 0) & (samples.half >= 0)
            if isinstance(boundary, int):
                rows = np.flatnonzero(chosen)
                chosen[rows] = rim_loops(samples.take(rows), one.surface, self.spacing) == boundary
            if not chosen.any():  # nothing flows out of a rim where nothing is given
                return np.zeros(u.shape[1]) if self.scene.has_tensor else None
        return flux_through(self._own_conditions(u), u, chosen, time)

    def boundary_mass(self, stiffness: Stiffness) -> CsrOperator | None:
        """Return the integrals over boundaries where du/db = lambda u stands; None where it stands nowhere."""
        assert isinstance(stiffness, GalerkinOperator)
        assert stiffness.conditions is not None
        matrix = stiffness.conditions.boundary_mass
        return None if matrix is None else CsrOperator(matrix, symmetric=True)

    @property
    def state_fluxes(self) -> Sequence[StateFlux]:
        """Where conditions' fluxes depend on u."""
        return self._conditions(Terms()).state_fluxes

    def linearise(self, seen: Sequence[Floats]) -> Self:
        """Return this with the fluxes replaced by their tangents at u = ``seen``."""
        laws = self._conditions(Terms()).linearise(seen).held
        return replace(self, sampled=replace(self.sampled, held=laws))
