"""The Galerkin form, as the families of equations see it: splines on the lattice, integrals over samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar
from weakref import WeakKeyDictionary

import numpy as np

from cpmkit.errors import InputError, SceneError
from cpmkit.forms.contract import StateFlux
from cpmkit.forms.free_constants import free_pieces
from cpmkit.forms.galerkin.conditions.crossings import of_crossings, of_tips
from cpmkit.forms.galerkin.conditions.held import held, loops_of
from cpmkit.forms.galerkin.conditions.sides import side_moments
from cpmkit.forms.galerkin.conditions.terms import ConditionTerms, condition_terms
from cpmkit.forms.galerkin.conditions.through import flux_through
from cpmkit.forms.galerkin.definiteness import surely_definite
from cpmkit.forms.galerkin.facing import Turned, turned
from cpmkit.forms.galerkin.fitting import check_unknowns_fit
from cpmkit.forms.galerkin.hierarchy.levels import levels_of
from cpmkit.forms.galerkin.locating import DIFFERENCE_SPACINGS
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.projection import Projection
from cpmkit.forms.galerkin.reading import Reader
from cpmkit.forms.galerkin.sample_mesh import Bend
from cpmkit.forms.galerkin.sampling import sample
from cpmkit.forms.galerkin.space.energy import STRENGTHS, Strength, load, mass, stiffness, values_at_samples
from cpmkit.forms.galerkin.space.floor import floored_stiffness
from cpmkit.forms.galerkin.space.parted import part, pieces
from cpmkit.forms.galerkin.space.space import space_of
from cpmkit.forms.galerkin.space.splines import derivative_rows, value_rows
from cpmkit.forms.galerkin.telling import TURNED_SHARE, of_space, of_turning
from cpmkit.forms.options import Options
from cpmkit.linear.levels import Level
from cpmkit.linear.operators import Border, CsrOperator
from cpmkit.manifold.abilities import advice_of, has_finite_feet
from cpmkit.manifold.tangent_space import project_tangent
from cpmkit.protocols import Floats, Operator, Progress, Side, Stiffness, no_progress
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.equations import Terms
from cpmkit.scene.scene import Scene

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from cpmkit.linear.report import SolveReport

#: The families of equations that the form carries.
CARRIED_FAMILIES = ("steady", "time", "eigen")
#: By what the difference from twice the spacing is divided, by how cells follow the manifold between their vertices.
ERROR_DIVISORS: dict[Bend, float] = {"flat": 2.5, "normals": 2.5, "feet": 6.0}
#: The same of eigenvalues: at order 4 on smooth sources the difference is 15 times the error (measured: 13 to 17).
EIGENVALUE_DIVISORS: dict[Bend, float] = {**ERROR_DIVISORS, "feet": 12.0}

#: Data are not resolved, but jump, where the nearest splines are farther from them than this share of their range.
UNRESOLVED_SHARE = 0.1


@dataclass(frozen=True)
class GalerkinWork:
    """Machine-independent measures of a solve.

    Attributes
    ----------
    unknowns, samples, patches : int
        Of the space of splines.
    closest_point_queries : int
        Of the manifold and its boundaries.
    nonzeros : int
        Stored entries of the matrix.
    operator_applications : int
        Products with it.
    """

    unknowns: int
    samples: int
    patches: int
    closest_point_queries: int
    nonzeros: int
    operator_applications: int

    def as_dict(self) -> dict[str, Any]:
        """Return the measures as plain values."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class GalerkinOperator(CsrOperator):
    """A, with the terms of the conditions that are in it, and whether c u fixes the constants by itself."""

    conditions: ConditionTerms | None = None
    fixed: bool = False


@dataclass(frozen=True, eq=False)
class Galerkin(Reader):
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

    @property
    def size(self) -> int:
        """Number of splines, copies counted, and of singular functions behind them."""
        return self.space.parting.size + len(self._tips)

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

    @property
    def mass(self) -> CsrOperator:
        """M, the integrals of products of splines; singular, for splines that no sample sees have none."""
        return self._mass

    @cached_property
    def _mass(self) -> CsrOperator:
        return CsrOperator(self._tips.bordered(mass(self.space, 1.0), None, np.ones(1)), symmetric=True)

    @property
    def mass_in_time(self) -> CsrOperator:
        """M + h^2 S: with M alone, systems of short steps are as badly conditioned as h^2 over the step is large.

        S vanishes on constants: totals are those of M. The errors of heat and waves are the same, measured.
        """
        return self._mass_in_time

    @cached_property
    def _mass_in_time(self) -> CsrOperator:
        return CsrOperator(self._projection.matrix, symmetric=True)

    def stiffness(self, terms: Terms) -> GalerkinOperator:
        """Return A: the energy of u over the samples, what holds the rest of u, c u v, and the conditions' terms.

        Raises
        ------
        InputError
            If the diffusivity is not above zero.
        """
        a = self._at_samples(terms.diffusivity, "the diffusivity")
        if np.any(a <= 0):
            raise InputError(f"the diffusivity must be above zero, got {a.min():g}.")
        c = self._at_samples(terms.c, "the factor c") if callable(terms.c) or terms.c else None
        matrix = self._tips.bordered(floored_stiffness(self.space, a, self._strength, c), a, c)
        conditions = self._conditions(terms.diffusivity, a)
        if conditions.held:
            matrix = (matrix + conditions.matrix).tocsr()
        return GalerkinOperator(matrix, True, conditions, fixed=c is not None and bool(np.all(c > 0)))

    def free_constants(self, stiffness: Stiffness) -> Border | None:
        """Return the pieces on which a constant is free, with means over them; None where there is none."""
        assert isinstance(stiffness, GalerkinOperator)
        return None if stiffness.fixed else free_pieces(stiffness, self.mass, self._tips.splines)

    @property
    def _strength(self) -> Strength:
        return STRENGTHS[self.options.own.strength]

    def _at_samples(self, data: Data, what: str) -> Floats:
        """Return a coefficient (q,) at all samples, (1,) if it is a number; on boundaries their cell's first."""
        if not callable(data) and np.ndim(data) == 0:
            return evaluate_data(data, np.zeros((1, self.space.parting.dim)), 1, what)[:, 0]
        own = self.read(data, what)[:, 0]
        one = self.sampled
        first = np.searchsorted(one.samples.cell[: one.interior], one.boundary.cell)
        return np.concatenate([own, own[first]])

    def _conditions(self, diffusivity: Data, a: Floats | None = None) -> ConditionTerms:
        """Return the terms of the conditions where the diffusivity is ``a`` (q,) at all samples, 1 unless given."""
        one, rows, logarithms = self.sampled, self._boundary_rows, np.zeros(self.space.parting.size)
        if a is not None:
            varies = a.min() < a.max()
            logarithms = load(self.space, np.log(a)[:, None])[:, 0] if varies else np.log(a[0]) * self._areas
        return self._tips.read_by(
            condition_terms(one.held, one.boundary, one.left, rows, self._areas, diffusivity, logarithms, one.lattice)
        )

    @cached_property
    def _boundary_rows(self) -> tuple[csr_array, csr_array]:
        """Rows that read u, and du/db out of its own cell, at the samples on boundaries."""
        one, parting = self.sampled.boundary, self.space.parting
        patch = parting.patch[self.sampled.interior :]
        return value_rows(parting, patch, one.points), derivative_rows(parting, patch, one.points, one.conormals)

    @cached_property
    def _areas(self) -> Floats:
        """(n,) the integral of each spline over the manifold."""
        return load(self.space, np.ones((1, 1)))[:, 0]

    @cached_property
    def _totals(self) -> Floats:
        """(n,) the integral of each spline and singular function."""
        return self._integrals(np.ones((self.sampled.interior, 1)))[:, 0]

    def load(self, f: Data, time: float | None = None) -> Floats:
        """Return the integrals of f times each spline, (n, channels)."""
        return self._integrals(self.read(f, "the right-hand side f", time, self.channels))

    def _integrals(self, values: Floats) -> Floats:
        """Return the integrals (n, k) of ``values`` (p, k) at the points times each spline."""
        none = np.zeros((len(self.sampled.boundary), values.shape[1]))
        return self._tips.with_loads(load(self.space, np.concatenate([values, none])), values)

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
        """Return the integrals of du/db by the residual of the weak form; None on a rim without samples of its own."""
        one, names = self.sampled, [boundary.name for boundary in self.scene.boundaries]
        samples = one.boundary
        if boundary in names:
            chosen = (samples.owner == names.index(str(boundary))) & ~samples.extends & (one.left == (side == "left"))
        else:
            chosen = (samples.owner < 0) & (samples.half >= 0)
            if isinstance(boundary, int):
                rows = np.flatnonzero(chosen)
                chosen[rows] = loops_of(samples.take(rows), one.surface, self.spacing) == boundary
            if not chosen.any():
                return None
        diffusivity = self.scene.problem.terms().diffusivity
        terms = self._conditions(diffusivity, self._at_samples(diffusivity, "the diffusivity"))
        return flux_through(terms, u, chosen, time)

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

    # Values

    def at_points(self, u: Floats) -> Floats:
        """Return the values (p, channels) of u at the samples."""
        found = values_at_samples(self.space, u[: self._tips.splines])[: self.sampled.interior]
        return found + self._tips.inside @ u[self._tips.splines :] if len(self._tips) else found

    def put_back(self, values: Floats) -> Floats:
        """Return the splines (n, channels) nearest to ``values`` (p, channels) at the samples, in mean square.

        M alone is singular: ``(M + h^2 S) u = V' w values``, S what holds u where no sample sees it.
        """
        return self._projected(self._integrals(values))

    def interpolate_in_range(self, data: Data, what: str, time: float = 0.0) -> Floats:
        """Return the splines that stand for ``data``; of spikes and jumps those of their mean under each spline.

        The nearest splines swing by a tenth of a jump beyond both its sides, and below zero beside a spike. Means keep
        the range and the total, and spread the data as heat spreads in a time of h^2 / 4.
        """
        values = self.read(data, what, time, self.channels)
        integrals = self._integrals(values)
        u = self._projected(integrals)
        off = np.abs(self.at_points(u) - values).max(axis=0, initial=0.0)
        rough = off > UNRESOLVED_SHARE * np.ptp(values, axis=0)
        seen = np.flatnonzero(self._areas > 0)
        u[self._tips.splines :, rough] = 0.0
        u[np.ix_(seen, rough)] = integrals[np.ix_(seen, rough)] / self._areas[seen, None]
        return u

    def totals(self, u: Floats) -> Floats:
        """Return the integrals (channels,) of u over the samples."""
        return np.asarray(self._totals @ u)

    def _projected(self, integrals: Floats) -> Floats:
        return self._projection.solve(integrals)

    @cached_property
    def _projection(self) -> Projection:
        holding = stiffness(self.space, 1.0, self._strength) - stiffness(self.space, 1.0, Strength(0.0, 0.0, 0.0))
        held = self._tips.bordered(holding, None, None)
        return Projection((self.mass.matrix + self.spacing**2 * held).tocsr())

    def gradient(self, u: Floats, points: Any, side: Any = None) -> Floats:
        """Return the tangential gradient (k, channels, d), projected on the splines: 2 to 6 times better than raw."""
        splines = u[: self._tips.splines]
        raw = np.stack([rows @ splines for rows in self._slopes()], axis=-1)
        integrals = self._integrals(raw.reshape(len(raw), -1))
        rows, feet, cells = self.reading_rows(points, side)
        found = np.asarray(rows @ self._projected(integrals)).reshape(-1, u.shape[1], self.space.parting.dim)
        if len(self._tips):
            read = [slopes @ u[self._tips.splines :] for slopes in self._tips.gradients(feet.points, cells)]
            found = found + np.stack(read, axis=-1)
        step = DIFFERENCE_SPACINGS * self.spacing
        channels = [project_tangent(self.sampled.surface, feet, one, step) for one in found.transpose(1, 0, 2)]
        return np.stack(channels, axis=1) if channels else found

    def gradient_rows(self, points: Any, side: Any = None) -> tuple[csr_array, ...]:
        """Return the d matrices (k, n) that read the same; all splines take part, so that they are full."""
        from scipy.sparse import csr_array

        one, dim = self.sampled, self.space.parting.dim
        rows, feet, cells = self.reading_rows(points, side)
        tested = self._projected(rows.T.toarray())
        weighted = one.samples.weights[: one.interior, None] * self.at_points(tested)
        raw = np.stack([(slopes.T @ weighted).T for slopes in self._slopes()])
        axes = [np.tile(axis, (len(feet), 1)) for axis in np.eye(dim)]
        step = DIFFERENCE_SPACINGS * self.spacing
        tangential = np.stack([project_tangent(one.surface, feet, axis, step) for axis in axes])
        if len(self._tips):
            own = np.stack([slopes.toarray() for slopes in self._tips.gradients(feet.points, cells)])
            raw = np.concatenate([raw, own], axis=2)
        return tuple(csr_array(np.einsum("dk,dkn->kn", tangential[:, :, i], raw)) for i in range(dim))

    def _slopes(self) -> Iterator[csr_array]:
        """Yield the d matrices (p, n) that read the tangential gradient at the samples, as it is.

        One at a time, and none is kept: each has 27 entries a sample, more than all else of a solution.
        """
        one, parting = self.sampled, self.space.parting
        at, normals = one.samples.points[: one.interior], one.samples.normals[: one.interior]
        tangential = np.eye(parting.dim) - np.einsum("qcd,qce->qde", normals, normals)
        for axis in range(parting.dim):
            yield derivative_rows(parting, parting.patch[: len(at)], at, tangential[:, axis])

    def inner(self, u: Floats, v: Floats) -> Floats:
        """Return the means (k, m) over the manifold of the products of u's columns with v's."""
        return np.asarray(u.T @ self.mass.apply(v) / self.sampled.samples.weights.sum())

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
    if problem.family not in CARRIED_FAMILIES or problem.terms().velocity is not None:
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
