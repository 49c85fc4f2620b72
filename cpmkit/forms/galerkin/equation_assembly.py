"""Matrices and loads of an equation with the conditions of its scene, and their properties that solvers need."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from cpmkit.errors import InputError, SceneError
from cpmkit.forms.data_checks import free_pieces
from cpmkit.forms.form_records import StateDependentCoefficient
from cpmkit.forms.galerkin.advection import (
    Advection,
    JoinedAdvection,
    convection_matrix,
    outward_speed,
    upwinded_levels,
)
from cpmkit.forms.galerkin.coefficients import SampleCoefficients
from cpmkit.forms.galerkin.conditions.condition_terms import ConditionTerms, condition_terms
from cpmkit.forms.galerkin.conditions.imposed_conditions import ImposedCondition, conditions_with_law, rim_loops
from cpmkit.forms.galerkin.space.energy import scalar_coefficient
from cpmkit.linear.multigrid.solver import Level
from cpmkit.linear.operators import Border, CsrOperator, Operator, plus_diagonal
from cpmkit.runtime.memory import state_without_cached
from cpmkit.scene.diffusivities import StateDiffusivity
from cpmkit.scene.edge_conditions import EdgeLoopError
from cpmkit.scene.equations import Terms
from cpmkit.scene.laws import Flux, Mixed, Spectral
from cpmkit.scene.scene import Scene
from cpmkit.types import Bools, Floats, Ints, Side, SparseMatrix

#: Largest k h of a multigrid level (6.3 nodes a wavelength), and of the first level. On spheres and tori of 20 to 90
#: thousand unknowns iterations are 15 to 18 for k h up to 1, as without waves, 19 to 25 at 1.6 and more where k is
#: larger, 34 to 62 at 2, and 150 are not enough at 3.2.
MOST_RADIANS, MOST_RADIANS_OF_FIRST = 1.0, 1.6


@dataclass(frozen=True, eq=False)
class GalerkinOperator(CsrOperator):
    """The operator A, with those of its properties that solvers need."""

    conditions: ConditionTerms | None = None  #: The terms of the conditions that A contains.
    fixed: bool = False  #: Whether c u alone determines constants, as c is positive everywhere.
    waves: float = 0.0  #: The largest squared wavenumber k^2 = -c / a; 0 if c is nowhere negative.
    #: least, lowest: The smallest diffusivity a, and the smallest c.
    least: float = 1.0
    lowest: float = 0.0
    advection: Advection | JoinedAdvection | None = None  #: The terms of a velocity.
    #: The factor of the advection in this operator, which may be the sum of a mass and a multiple of A.
    share: float = 1.0

    def scaled_plus_mass(self, factor: float, mass: Operator | None = None) -> CsrOperator:
        """Return ``M + factor A``, with M the ``mass``, by default the identity."""
        shifted = super().scaled_plus_mass(factor, mass)
        if self.advection is None:
            return shifted
        return replace(self, matrix=shifted.matrix, share=factor * self.share)

    def minus_shifted_mass(self, shift: float, mass: Operator | None = None) -> CsrOperator:
        """Return ``A - shift M``, with M the ``mass``, by default the identity, without its conditions and advection.

        The solutions of its systems are waves if the shift is above the smallest c.
        """
        plain, lowest = super().minus_shifted_mass(shift, mass), self.lowest - shift
        waves = max(-lowest, 0.0) / self.least
        return GalerkinOperator(
            plain.matrix,
            plain.symmetric,
            waves > 0,
            self.symmetric_pattern,
            waves=waves,
            least=self.least,
            lowest=lowest,
        )

    def usable_levels(self, levels: Sequence[Level], spacing: float) -> Sequence[Level]:
        """Return the ``levels``, the first of which has twice the ``spacing``, up to the last that resolves the waves.

        Without waves all levels are returned, with a velocity all with the upwinding that they need.
        """
        if self.advection is not None:
            return upwinded_levels(levels, self.advection.upwinding_matrix(self.share))
        if not self.waves:
            return levels
        radians = [self.waves**0.5 * spacing * 2 ** (number + 1) for number in range(len(levels))]
        most = max(MOST_RADIANS, min(radians[0], MOST_RADIANS_OF_FIRST)) if radians else MOST_RADIANS
        return levels[: sum(radian <= most for radian in radians)]


def build_galerkin_operator(
    matrix: SparseMatrix, conditions: ConditionTerms, a: Floats, c: Floats | None, advection: Advection | None = None
) -> GalerkinOperator:
    """Return the operator of a ``matrix`` (n, n), with its properties from the coefficients of the equation.

    The diffusivity ``a`` and the factor ``c`` of u are (q,), at all samples, or (1,); ``c`` is None for zero.
    """
    waves = 0.0 if c is None else max(float((-c / a).max()), 0.0)
    fixed = c is not None and bool((c > 0).all())
    lowest = 0.0 if c is None else float(c.min())
    symmetric = advection is None
    properties = conditions, fixed, waves, float(a.min()), lowest, advection
    return GalerkinOperator(matrix, symmetric, symmetric and waves > 0, not symmetric, *properties)


def multigrid_applies(scene: Scene) -> bool:
    """Return whether multigrid solves the systems of a scene: they are surely positive, or their solutions are waves.

    Eigenvalue problems are solved with a shift, which lies below all eigenvalues unless the user asks for those near a
    number, or conditions or c may make eigenvalues negative. Solutions are waves for equations with c below zero, and
    for eigenvalues near a given number, unless a condition contains the eigenvalue.
    """
    problem: Any = scene.problem
    laws = [condition.law for condition in scene.conditions]
    if problem.family != "eigen":
        return True
    if not all(law.is_dissipative or isinstance(law, Spectral) for law in laws):
        return False
    if not any(isinstance(law, Spectral) for law in laws):
        return True
    return problem.near is None and not callable(problem.c) and bool(np.all(np.asarray(problem.c) >= 0))


@dataclass(frozen=True, eq=False)
class EquationAssembly:
    """The part of the form that assembles the equation of a scene, and other equations with the same conditions."""

    scene: Scene  #: The scene with the equation.
    #: The conditions with their laws, and the samples at which each is imposed.
    conditions: tuple[ImposedCondition, ...]
    #: Evaluates the coefficients at the samples; contains the samples and the function space.
    coefficients: SampleCoefficients = field(repr=False)
    #: (k,): the samples on the edge that lie on other members of a union, so that the flux enters those members.
    junction_edge: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64), repr=False, kw_only=True)

    __getstate__ = state_without_cached

    def stiffness(self, terms: Terms) -> GalerkinOperator:
        """Return the matrix A of diffusion, stabilised, of c u v, of advection, and of the terms of the conditions.

        Raises InputError if the diffusivity is not positive (definite on tangents) or the velocity is not (n, d),
        SceneError if a condition gives a conductivity that differs from the diffusivity.
        """
        space, coefficients = self.coefficients.space, self.coefficients
        a = coefficients.diffusivity(terms.diffusivity)
        c = coefficients.at_all_samples(terms.c, "the factor c") if callable(terms.c) or terms.c else None
        scale = coefficients.penalty_scale(terms.diffusivity)
        matrix = space.stiffness(a, None if terms.lumped else c, scale)
        if terms.lumped and c is not None:
            matrix = plus_diagonal(matrix, space.spline_loads(c[:, None])[:, 0])
        advection = self._advection_of(terms)
        if advection is not None:
            matrix = advection.matrix_with_advection(matrix, space.stabilisation)
        matrix = space.extend_matrix(matrix, a, c)
        is_own = advection is not None and advection is self.scene_advection  # then warnings need the same terms
        conditions = self.terms_of_scene if is_own else self.condition_terms(terms, a, scale)
        if conditions.conditions:
            matrix = (matrix + conditions.matrix).tocsr()
        if terms.conservative:
            matrix = (matrix + conditions.outflow_matrix).tocsr()
        return build_galerkin_operator(matrix, conditions, scalar_coefficient(space.splines, a), c, advection)

    @cached_property
    def mass_in_time(self) -> CsrOperator:
        """M + h^2 S with the upwinding of b du/dt; M is the mass matrix, S the stabilisation, b the capacity.

        Raises InputError if the capacity is not above zero.
        """
        space, advection = self.coefficients.space, self.scene_advection
        capacity = self.coefficients.at_all_samples(self.scene.problem.terms().capacity, "the capacity")
        if capacity.min() <= 0:
            raise InputError(f"the capacity must be above zero everywhere, got {capacity.min():.3g}.")
        matrix = space.projection_matrix if (capacity == 1).all() else space.stabilised_mass(capacity)
        if advection is None or not advection.upwinding.any():
            return CsrOperator(matrix, True)
        upwinding = convection_matrix(advection.space, (advection.upwinding * capacity)[:, None] * advection.velocity)
        return CsrOperator((matrix + upwinding).tocsr())

    def advection(self, field: StateDependentCoefficient) -> CsrOperator:
        """Return the matrix (n, n) of the integrals of u (w . grad v), with w (p, d) the ``field`` at the samples.

        The integrals of u (w . b) v over boundaries with a flux or Robin condition, b the conormal, are subtracted,
        since the flux through the boundary changes with u as the flux inside does.
        """
        matrix = convection_matrix(self.coefficients.space.splines, self.coefficients.evaluate_at_state(field))
        slope_rows = [condition.rows for condition in conditions_with_law(self.conditions, Flux, Mixed)]
        if slope_rows:
            rows = np.concatenate(slope_rows)
            boundary = self.coefficients.sampled.boundary
            w = self.coefficients.side_coefficient(field)(self.coefficients.sampled.lattice.to_scene(boundary.points))
            through = boundary.weights * np.einsum("bd,bd->b", w, boundary.conormals)
            values = self.coefficients.boundary_rows[0][rows]
            matrix = (matrix - values.T @ (values * through[rows, None])).tocsr()
        return CsrOperator(self.coefficients.space.extend_matrix(matrix, None, None))

    @cached_property
    def scene_advection(self) -> Advection | None:
        """The advection of the scene's own equation; None without a velocity."""
        terms = self.scene.problem.terms()
        return None if terms.velocity is None else self.coefficients.advection_at_samples(terms)

    def _advection_of(self, terms: Terms) -> Advection | None:
        """Return the advection of ``terms``, cached if they are the scene's own; None without a velocity."""
        scene_terms = self.scene.problem.terms()
        names = "velocity", "diffusivity", "c", "conservative"
        if all(getattr(terms, name) is getattr(scene_terms, name) for name in names):
            return self.scene_advection
        return None if terms.velocity is None else self.coefficients.advection_at_samples(terms)

    def condition_terms(self, terms: Terms, a: Floats | None = None, scale: Floats | None = None) -> ConditionTerms:
        """Return the matrices and loads of the conditions for the terms of an equation.

        ``a`` is the diffusivity at all samples, (q,), (q, d, d) or (1,), by default 1; ``scale`` (q,) the coefficient
        that penalties are proportional to, by default ``a``.
        """
        sampled, space, diffusivity, along = self.coefficients.sampled, self.coefficients.space, terms.diffusivity, None
        logarithms = np.zeros(len(space.spline_integrals))
        patch = space.dof_map.patch[sampled.interior :]
        if a is not None:
            means = scalar_coefficient(space.splines, a)
            varies = means.min() < means.max()
            logarithms = (
                space.spline_loads(np.log(means)[:, None])[:, 0]
                if varies
                else np.log(means[0]) * space.spline_integrals
            )
            if a.ndim == 3:
                along = partial(space.spline_derivative_rows, patch, sampled.boundary.points)
        depends_on_u = isinstance(diffusivity, StateDependentCoefficient)
        data = self.coefficients.side_coefficient(diffusivity) if depends_on_u else diffusivity
        samples = sampled.boundary, sampled.left, self.coefficients.boundary_rows, space.spline_integrals
        spacings = space.spacing / space.dof_map.magnification(patch)
        made = condition_terms(self.conditions, *samples, data, logarithms, sampled.lattice, along, spacings)
        if terms.velocity is not None:
            made = replace(made, outward_speed=outward_speed(terms.velocity, sampled.boundary, sampled.lattice))
        if scale is not None:  # penalties are a over the width: the width is enlarged by a over the scale
            state = StateDependentCoefficient(diffusivity.penalty_coefficient, diffusivity.u)
            scaled = self.condition_terms(Terms(diffusivity=state), scale)
            made = replace(made, widths=made.widths * made.a / scaled.a)
        return space.extend_conditions(made)

    def terms_with_scene_data(self, stiffness: Any) -> ConditionTerms:
        """Return the condition terms of an operator, perhaps of another scene, with this scene's data; cached."""
        cache = self._terms_by_operator
        if stiffness not in cache:
            terms = stiffness.conditions
            same = terms.conditions is self.conditions
            cache[stiffness] = terms if same else replace(terms, conditions=self.conditions)
        return cache[stiffness]

    @cached_property
    def _terms_by_operator(self) -> WeakKeyDictionary[GalerkinOperator, ConditionTerms]:
        """The cache of :meth:`terms_with_scene_data`."""
        return WeakKeyDictionary()

    def terms_of_solution(self, u: Floats) -> ConditionTerms:
        """Return the condition terms with the diffusivity of the scene's equation at its solution ``u`` (n, 1)."""
        terms = self.scene.problem.terms()
        if isinstance(terms.diffusivity, StateDiffusivity):
            state = StateDependentCoefficient(terms.diffusivity.evaluate, u)
            return self.condition_terms(replace(terms, diffusivity=state), self.coefficients.diffusivity(state))
        return self.terms_of_scene

    @cached_property
    def terms_of_scene(self) -> ConditionTerms:
        """The condition terms with the diffusivity of the scene's equation, which does not depend on u."""
        terms = self.scene.problem.terms()
        return self.condition_terms(terms, self.coefficients.diffusivity(terms.diffusivity))

    def flux(
        self,
        u: Floats,
        boundary: str | int,
        side: Side | None,
        time: float | None,
        where: Callable[[Floats], Bools] | None = None,
    ) -> Floats | None:
        """Return the integrals (channels,) of du/db over a side of a boundary, a loop of the rim or the whole rim.

        ``boundary`` is the name of a boundary, or the number of a loop; any other name means the rim. ``where`` selects
        samples by their points (k, d). The integrals follow from the residual of ``u`` (n, channels) in the weak form
        with data at ``time``. They are None if the eigenvalue is a factor of the flux, and on rims without samples (0
        if A is a tensor). For a tensor A, du/db is the derivative along A b / (b . A b), b the conormal outwards.
        Raises InputError if the boundary has no such ``side``, or a loop is missing or on other members of a union.
        """
        sampled, samples = self.coefficients.sampled, self.coefficients.sampled.boundary
        names = [boundary.name for boundary in self.coefficients.boundaries]
        if boundary in names:
            self.coefficients.sides({str(boundary): side})  # type: ignore[dict-item]
            number = names.index(str(boundary))
            chosen = (samples.owner == number) & ~samples.beyond_tip & (sampled.left == (side == "left"))
        else:
            chosen = samples.on_rim
            if isinstance(boundary, int):
                rows = np.flatnonzero(chosen)
                loops = rim_loops(samples.take(rows), sampled.surface, self.coefficients.space.spacing)
                if len(rows) and boundary not in loops:
                    numbers = np.unique(loops[loops >= 0]).tolist()
                    named = "its loops are {loops}" if numbers else "its source gives no loop a number"
                    raise EdgeLoopError(f"The edge has no loop {{loop}}; {named}.", boundary, (), numbers)
                chosen[rows] = loops == boundary
            if chosen.any() and chosen[self.junction_edge].sum() == chosen.sum():
                raise InputError(
                    "the edge lies on another member of the union, which its flux enters; in a steady problem from "
                    "which nothing flows out elsewhere, it is the integral of c u - f over that member."
                )
            if not chosen.any():  # nothing flows out of a rim without a condition
                return np.zeros(u.shape[1]) if self.scene.has_tensor else None
        if where is not None:
            rows = np.flatnonzero(chosen)
            chosen[rows] = where(sampled.lattice.to_scene(samples.points[rows]))
        return self.terms_of_solution(u).flux(u, chosen, time)

    def free_constants(self, stiffness: Any) -> Border | None:
        """Return the pieces of the manifold where constants solve A u = 0, with means over the pieces; None if none.

        Raises SceneError if a conservative velocity leaves another function undetermined.
        """
        space = self.coefficients.space
        return free_constants_of(stiffness, lambda: space.mass, space.spline_count)


def free_constants_of(stiffness: Any, mass: Callable[[], Operator], count: int) -> Border | None:
    """Return the pieces where constants solve A u = 0, and means over them; None if there are none.

    The first ``count`` unknowns are coefficients of splines. Raises SceneError if a conservative velocity leaves
    another function undetermined.
    """
    if stiffness.advection is not None and stiffness.advection.conservative:
        transposed = CsrOperator(stiffness.to_csr().T.tocsr())
        if free_pieces(transposed, mass, count) is not None:
            raise SceneError(
                "Nothing fixes the size of the solution on a piece of the manifold: a conservative velocity "
                "carries nothing out of it, and c is zero there; give c above zero, or a value somewhere."
            )
        return None
    return None if stiffness.fixed else free_pieces(stiffness, mass, count)
