"""The Galerkin form, as the families of equations see it: splines on the lattice, integrals over samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar
from weakref import WeakKeyDictionary

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.at_state import AtState
from cpmkit.forms.contract import StateFlux
from cpmkit.forms.dispersion import QUADRATIC_SPLINES, Dispersion
from cpmkit.forms.free_constants import free_pieces
from cpmkit.forms.galerkin.coefficients import Coefficients
from cpmkit.forms.galerkin.conditions.crossings import of_crossings, of_tips
from cpmkit.forms.galerkin.conditions.held import held, loops_of
from cpmkit.forms.galerkin.conditions.sides import side_moments
from cpmkit.forms.galerkin.conditions.terms import ConditionTerms, condition_terms
from cpmkit.forms.galerkin.conditions.through import flux_through
from cpmkit.forms.galerkin.definiteness import surely_definite
from cpmkit.forms.galerkin.facing import Turned, turned
from cpmkit.forms.galerkin.fitting import check_unknowns_fit
from cpmkit.forms.galerkin.hierarchy.levels import levels_of
from cpmkit.forms.galerkin.options import FAMILIES, GalerkinOptions
from cpmkit.forms.galerkin.sample_mesh import Bend
from cpmkit.forms.galerkin.sampling import sample
from cpmkit.forms.galerkin.space.energy import conductivity, load
from cpmkit.forms.galerkin.space.floor import floored_stiffness
from cpmkit.forms.galerkin.space.parted import part, pieces
from cpmkit.forms.galerkin.space.space import space_of
from cpmkit.forms.galerkin.space.splines import derivative_rows
from cpmkit.forms.galerkin.telling import TURNED_SHARE, of_space, of_turning
from cpmkit.forms.galerkin.work import GalerkinWork
from cpmkit.forms.options import Options
from cpmkit.linear.levels import Level
from cpmkit.linear.operators import Border, CsrOperator
from cpmkit.manifold.abilities import advice_of, has_finite_feet
from cpmkit.protocols import Floats, Operator, Progress, Side, Stiffness, no_progress
from cpmkit.scene.data import Data
from cpmkit.scene.equations import Terms
from cpmkit.scene.scene import Scene
from cpmkit.scene.state_diffusivity import StateDiffusivity

if TYPE_CHECKING:
    from cpmkit.linear.report import SolveReport

#: By what the difference from twice the spacing is divided, by how cells follow the manifold between their vertices.
ERROR_DIVISORS: dict[Bend, float] = {"flat": 2.5, "normals": 2.5, "feet": 6.0}
#: The same of eigenvalues: at order 4 on smooth sources the difference is 15 times the error (measured: 13 to 17).
EIGENVALUE_DIVISORS: dict[Bend, float] = {**ERROR_DIVISORS, "feet": 12.0}


@dataclass(frozen=True, eq=False)
class GalerkinOperator(CsrOperator):
    """A, with the terms of the conditions that are in it, and whether c u fixes the constants by itself."""

    conditions: ConditionTerms | None = None
    fixed: bool = False


@dataclass(frozen=True, eq=False)
class Galerkin(Coefficients):
    """A scene on splines of the lattice; unknowns are coefficients, and nobody outside reads them.

    Attributes
    ----------
    scene : Scene
        What is discretised.
    options : Options
        How.
    sampled : SampledScene
        The manifold as samples, its boundaries as facets between them.
    space : Space
        The splines over these.
    """

    form: ClassVar[str] = "galerkin"
    work_record: ClassVar[type] = GalerkinWork
    dispersion: ClassVar[Dispersion] = QUADRATIC_SPLINES
    cannot: ClassVar[Mapping[str, str]] = {
        "second Laplacian": "use the form 'collocation'",
        "explicit steps": "use scheme 'newmark' or 'implicit', or the form 'collocation'",
    }

    @property
    def multigrid(self) -> bool:
        """Whether systems are surely positive."""
        return surely_definite(self.scene)

    def check_factor_fits(self) -> None:
        """Refuse a factorisation that the memory of this process cannot hold."""
        check_unknowns_fit(self.sampled.surface, self.size, self.spacing, "direct")

    def restated(self, scene: Scene) -> Galerkin:
        """Return the same splines for a scene that differs in its equation and its data alone."""
        check(scene, self.options)
        one = self.sampled
        laws = held(scene, one.boundary, one.left, one.surface, one.lattice)
        return replace(self, scene=scene, sampled=replace(one, held=laws))

    # Equations

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
        matrix = self._tips.bordered(floored_stiffness(self.space, a, self._strength, c, holding), a, c)
        conditions = self._conditions(terms.diffusivity, a, holding)
        if conditions.held:
            matrix = (matrix + conditions.matrix).tocsr()
        return GalerkinOperator(matrix, True, conditions, fixed=c is not None and bool(np.all(c > 0)))

    def free_constants(self, stiffness: Stiffness) -> Border | None:
        """Return the pieces on which a constant is free, with means over them; None where there is none."""
        assert isinstance(stiffness, GalerkinOperator)
        return None if stiffness.fixed else free_pieces(stiffness, self.mass, self._tips.splines)

    def _conditions(self, diffusivity: Any, a: Floats | None = None, holding: Floats | None = None) -> ConditionTerms:
        """Return the terms of the conditions where the diffusivity is ``a`` at all samples, 1 unless given."""
        one, logarithms, along = self.sampled, np.zeros(self.space.parting.size), None
        if a is not None:
            means = conductivity(self.space, a)
            varies = means.min() < means.max()
            logarithms = load(self.space, np.log(means)[:, None])[:, 0] if varies else np.log(means[0]) * self._areas
        if a is not None and a.ndim == 3:
            patch = self.space.parting.patch[one.interior :]
            along = partial(derivative_rows, self.space.parting, patch, one.boundary.points)
        given = self._beside_boundaries(diffusivity) if isinstance(diffusivity, AtState) else diffusivity
        where = (one.held, one.boundary, one.left, self._boundary_rows, self._areas)
        terms = condition_terms(*where, given, logarithms, one.lattice, along)
        if holding is not None:  # penalties are a over the width, which is so much wider as a is above what holds
            held = self._conditions(AtState(diffusivity.holding, diffusivity.u), holding)
            terms = replace(terms, widths=terms.widths * terms.a / held.a)
        return self._tips.read_by(terms)

    def load(self, f: Data, time: float | None = None) -> Floats:
        """Return the integrals of f times each spline, (n, channels)."""
        return self._integrals(self.read(f, "the right-hand side f", time, self.channels))

    def data(self, stiffness: Stiffness, time: float | None = None, of: str = "value") -> Floats:
        """Return what the conditions' data add to b, (n, channels)."""
        del of  # a second Laplacian is refused
        assert isinstance(stiffness, GalerkinOperator)
        conditions = self._with_own_data(stiffness)
        return conditions.load(self.channels, time) if conditions.held else np.zeros((self.size, self.channels))

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

    def flux(self, u: Floats, boundary: str | int, side: Side | None, time: float | None) -> Floats | None:
        """Return the integrals of du/db by the residual of the weak form; None on a rim without samples of its own.

        Of a tensor A, b the conormal, that of the derivative along A b / (b . A b).
        """
        one, names = self.sampled, [boundary.name for boundary in self.scene.boundaries]
        samples = one.boundary
        if boundary in names:
            chosen = (samples.owner == names.index(str(boundary))) & ~samples.extends & (one.left == (side == "left"))
        else:
            chosen = (samples.owner < 0) & (samples.half >= 0)
            if isinstance(boundary, int):
                rows = np.flatnonzero(chosen)
                chosen[rows] = loops_of(samples.take(rows), one.surface, self.spacing) == boundary
            if not chosen.any():  # nothing flows out of a rim where nothing is given
                return np.zeros(u.shape[1]) if self.scene.has_tensor else None
        return flux_through(self._own_conditions(u), u, chosen, time)

    def _own_conditions(self, u: Floats) -> ConditionTerms:
        """Return the conditions with the diffusivity of the scene's own problem, whose solution is u."""
        diffusivity = self.scene.problem.terms().diffusivity
        if isinstance(diffusivity, StateDiffusivity):
            diffusivity = AtState(diffusivity.at, u)
            return self._conditions(diffusivity, self._diffusivity(diffusivity))
        if not self._kept_conditions:
            self._kept_conditions.append(self._conditions(diffusivity, self._diffusivity(diffusivity)))
        return self._kept_conditions[0]

    @cached_property
    def _kept_conditions(self) -> list[ConditionTerms]:
        return []

    def boundary_mass(self, stiffness: Stiffness) -> CsrOperator | None:
        """Return the integrals over boundaries where du/db = lambda u stands; None where it stands nowhere."""
        assert isinstance(stiffness, GalerkinOperator)
        assert stiffness.conditions is not None
        matrix = stiffness.conditions.boundary_mass
        return None if matrix is None else CsrOperator(matrix, symmetric=True)

    def levels(self, operator: Operator) -> Sequence[Level]:
        """Return the prolongations from lattices of twice the spacing, four times, and so on."""
        del operator  # the splines alone
        return self._levels

    @cached_property
    def _levels(self) -> Sequence[Level]:
        return self._tips.on_levels(levels_of(self.space.parting, self.space.parting.patch[self.sampled.interior :]))

    # Fluxes that depend on the solution

    @property
    def state_fluxes(self) -> Sequence[StateFlux]:
        """Where conditions' fluxes depend on u."""
        return self._conditions(1.0).state_fluxes

    def linearized(self, seen: Sequence[Floats]) -> Galerkin:
        """Return this with the fluxes replaced by their tangents at u = ``seen``."""
        laws = self._conditions(1.0).linearized(seen).held
        return replace(self, sampled=replace(self.sampled, held=laws))

    # Telling

    def warnings(self, missed: float = 0.0) -> tuple[str, ...]:
        """Return what a reader of any solution should know."""
        del missed
        return self._told

    @cached_property
    def _told(self) -> tuple[str, ...]:
        one, parting = self.sampled, self.space.parting
        cuts = parting.patch[one.interior :]
        source = advice_of(one.surface.source, one.lattice.spacing).warnings
        rounding = one.lattice.lost_digits(one.surface.bounds, not one.surface.shift.any())
        at_points = [text for tell in (of_crossings, of_tips) for text in tell(self.scene, one.mesh, one.lattice)]
        resolved = (*of_space(parting, pieces(parting), one.lattice, cuts), *of_turning(self.turned, one.lattice))
        return (*source, *rounding, *one.told, *at_points, *resolved)

    @cached_property
    def turned(self) -> Turned:
        """How much of the manifold lies on splines under which it turns: thin, folded or creased on this lattice."""
        return turned(self.space, self.sampled.mesh, self._areas)

    def error_divisor(self) -> float:
        """Return 6 on smooth sources, 2.5 on meshes, 1 where curves end (unless singular) and S is thin or folded.

        At order 3 the difference is 7 times the error; were the order 2 there, the estimate would be half the error. On
        meshes, where orders are lower, 2.5 brought it between a half and three times the true one in 87 of 100 cases.
        """
        return 1.0 if self._slow else ERROR_DIVISORS[self.sampled.bend]

    def eigenvalue_divisor(self) -> float:
        """Return 12 on smooth sources, where eigenvalues are of order 4, and else what functions have."""
        return 1.0 if self._slow else EIGENVALUE_DIVISORS[self.sampled.bend]

    @property
    def _slow(self) -> bool:
        ends = bool(self.sampled.mesh.extends.any()) and not self.sampled.singular
        return ends or self.turned.share > TURNED_SHARE

    def work(self, operator: Operator, report: SolveReport | None) -> GalerkinWork:
        """Return what the space holds and what the solve did."""
        return GalerkinWork(
            self.size,
            len(self.sampled.samples),
            len(self.space.parting.cells),
            self.sampled.queries,
            operator.nonzeros,
            report.operator_applications if report else 0,
        )

    def describe(self) -> dict[str, Any]:
        """Return the form's options, and the lattice's origin."""
        return {
            "form": self.options.form,
            "form_reason": self.options.reason,
            **self.options.own.as_dict(),
            "origin": self.sampled.lattice.origin.tolist(),
        }

    def arrays(self) -> dict[str, Any]:
        """Return the options of the lattice, the nodes of the splines, and where the left of boundaries is."""
        given = {**self.options.as_dict(), "origin": self.sampled.lattice.origin}
        made = {"nodes": self.space.parting.nodes, "sides": self._sides}
        return {**{name: np.array(value) for name, value in given.items()}, **made}

    @cached_property
    def _sides(self) -> Floats:
        return side_moments(self.sampled.boundary, self.sampled.left, len(self.scene.boundaries))

    def differs_from(self, saved: Mapping[str, Any]) -> str:
        """Compare the nodes of the splines, and where the left of boundaries is."""
        sides, own = saved.get("sides", self._sides), self._sides
        if sides.shape == own.shape and np.any(np.sum(sides * own, axis=(1, 2)) < 0):
            return "left and right of its boundaries are others"
        return "" if np.array_equal(self.space.parting.nodes, saved["nodes"]) else "its nodes are others"


def check(scene: Scene, options: Options[GalerkinOptions]) -> None:
    """Refuse, before anything is built, what the form does not carry.

    Raises
    ------
    SceneError
        With what to do instead.
    """
    problem, surface = scene.problem, scene.surface
    if problem.family not in FAMILIES or problem.terms().velocity is not None:
        raise SceneError(f"the form {options.form!r} does not yet carry {problem.kind!r}; use form='collocation'.")
    orders = [one.order for one in scene.conditions if one.order is not None]
    if orders:
        raise SceneError(
            f"conditions of the form {options.form!r} have no order, got order={orders[0]}; leave it out, or use "
            "form='collocation'."
        )
    if surface.manifold_dim not in range(1, surface.dim):
        raise SceneError(
            f"the form {options.form!r} takes curves and surfaces of one dimension, got a manifold of dimension "
            f"{surface.manifold_dim} in {surface.dim}D; use form='collocation'."
        )
    if has_finite_feet(surface):
        raise SceneError(
            f"the form {options.form!r} integrates over the manifold, and closest points on this one are single "
            "samples; fit a surface to them, or use form='collocation'."
        )


def discretize(scene: Scene, options: Options[GalerkinOptions], progress: Progress = no_progress) -> Galerkin:
    """Discretise a scene on splines; ``progress`` is told the stage and the share of it that is done.

    Raises
    ------
    InputError, SceneError, ResolutionError
        If the lattice's origin, a boundary or the spacing does not fit.
    """
    check(scene, options)
    sampled = sample(scene, options, progress)
    progress("space", 0.0)
    parting = part(sampled.samples.points, sampled.corners, options.spacing, sampled.samples.cell)
    made = Galerkin(scene, options, sampled, space_of(parting, sampled.samples))
    progress("space", 1.0)
    return made
