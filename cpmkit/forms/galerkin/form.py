"""The Galerkin form, as the families of equations see it: splines on the lattice, integrals over samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.form_records import Diagnosis, ExpectedError, FormTraits
from cpmkit.forms.galerkin.conditions.boundary_sides import side_moments
from cpmkit.forms.galerkin.conditions.imposed_conditions import impose_conditions
from cpmkit.forms.galerkin.equations import EquationAssembly
from cpmkit.forms.galerkin.error_orders import (
    DISPERSION_OF_DEGREE,
    EIGENVALUE_DIVISORS,
    ERROR_DIVISORS,
    difference_order,
    on_curved_cells,
)
from cpmkit.forms.galerkin.galerkin_cost import check_unknowns_fit, factorised_share
from cpmkit.forms.galerkin.galerkin_operator import levels_resolving_waves, multigrid_applies
from cpmkit.forms.galerkin.galerkin_work import GalerkinWork
from cpmkit.forms.galerkin.levels import coarser_levels
from cpmkit.forms.galerkin.mesh_warnings import NOISE_FACTOR
from cpmkit.forms.galerkin.normal_alignment import NormalSpread
from cpmkit.forms.galerkin.options import FAMILIES, GalerkinOptions
from cpmkit.forms.galerkin.quadrature.samples import QuantisedSamples, Samples
from cpmkit.forms.galerkin.scene_sampling import sample_scene
from cpmkit.forms.galerkin.shared import cached_on_space
from cpmkit.forms.galerkin.single_solution_estimate import single_solution_estimate
from cpmkit.forms.galerkin.slow_convergence import (
    layer_spacings,
    slow_convergence_reason,
    support_floor,
    tensor_layer_warnings,
)
from cpmkit.forms.galerkin.solution_warnings import (
    crossing_warnings,
    outflow_layer_warnings,
    resolution_warnings,
    tip_warnings,
    turning_warnings,
)
from cpmkit.forms.galerkin.space.dof_map import DofMap, build_dof_map, connected_pieces
from cpmkit.forms.galerkin.space.spline_space import build_spline_space
from cpmkit.forms.options import Options
from cpmkit.forms.unresolved_data import DataAtPoints, unresolved_data
from cpmkit.linear.multigrid.cycle import Level
from cpmkit.linear.protocols import Operator
from cpmkit.manifold.abilities import has_finite_feet, integral_floor_of, warnings_of
from cpmkit.runtime.memory import release_memory
from cpmkit.scene.diffusivities import StateDiffusivity
from cpmkit.scene.laws import Nonlinear, data_of
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Progress, no_progress

if TYPE_CHECKING:
    from cpmkit.forms.contract import Discretized
    from cpmkit.linear.solve_report import SolveReport


@dataclass(frozen=True, eq=False)
class Galerkin(EquationAssembly):
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
    cannot: ClassVar[Mapping[str, str]] = {
        "explicit steps": "use scheme 'newmark' or 'implicit', or the form 'collocation'",
    }

    @property
    def traits(self) -> FormTraits:
        """Multigrid for systems that are surely positive, and waves; factors for others; dispersion by degree."""
        dispersion = DISPERSION_OF_DEGREE[self.options.own.degree]
        return FormTraits(
            iterative_solver="multigrid" if multigrid_applies(self.scene) else "direct",
            dispersion=on_curved_cells(dispersion) if self.sampled.geometry == "closest_point" else dispersion,
            work_record=GalerkinWork,
            higher_degree=3 if self._is_smooth_and_closed and self.options.own.refine == "off" else None,
        )

    @property
    def _is_smooth_and_closed(self) -> bool:
        """Whether the manifold is a closed surface with cells from closest points, without boundaries."""
        sampled = self.sampled
        on_surface = sampled.mesh.manifold_dim == 2 and sampled.geometry == "closest_point"
        return on_surface and not self.scene.boundaries and not len(sampled.boundary)

    def with_scene(self, scene: Scene) -> Galerkin:
        """Return the same splines for a scene that differs in its equation and its data alone."""
        check(scene, self.options)
        one = self.sampled
        if scene.problem.terms().conservative and np.any(one.half.cut < 0) and not np.any(one.boundary.owner < 0):
            raise SceneError(
                "what a conservative velocity carries out through the edge is read at samples there, which this scene "
                "was prepared without; prepare it with this problem."
            )
        laws = impose_conditions(scene, one.boundary, one.left, one.surface, one.lattice)
        return replace(self, scene=scene, sampled=replace(one, held=laws))

    def check(self, solver: str) -> None:
        """Refuse factors that do not fit into memory; make the warnings before matrices take memory."""
        factors = factorised_share(self.scene, solver)
        if factors:  # what others need was checked before the tables
            check_unknowns_fit(self.sampled.surface, self.size, self.spacing, solver, factors, self.options.own.degree)
        self.warnings()
        release_memory()

    # Levels

    def levels(self, operator: Operator) -> Sequence[Level]:
        """Return the prolongations from lattices of twice the spacing, four times, and so on; all resolve A's waves."""
        return levels_resolving_waves(self._levels, operator, self.spacing)

    @cached_on_space
    def _levels(self) -> Sequence[Level]:
        return self._tips.on_levels(
            coarser_levels(self.space.dof_map, self.space.dof_map.patch[self.sampled.interior :])
        )

    @property
    def finest_spacing(self) -> float:
        """The smallest spacing of any level."""
        return self.spacing

    # Telling

    @property
    def _first_dof_map(self) -> DofMap:
        """The parting on the lattice itself, by which pieces and copies are told."""
        return self.space.dof_map

    def warnings(self) -> tuple[str, ...]:
        """Return what a reader of any solution should know."""
        return self._told

    @cached_property
    def _told(self) -> tuple[str, ...]:
        one, (before, after) = self.sampled, self._told_of_lattice
        at_points = [
            text for tell in (crossing_warnings, tip_warnings) for text in tell(self.scene, one.mesh, one.lattice)
        ]
        layers = () if self._carried is None else outflow_layer_warnings(self._conditions_of_scene)
        return (
            *before,
            *at_points,
            *after,
            *layers,
            *tensor_layer_warnings(self),
            *unresolved_data(self, self.condition_data(), self.finest_spacing),
        )

    def condition_data(self) -> list[DataAtPoints]:
        """Return the data of conditions at the samples on boundaries and rims."""
        one = self.sampled
        return [
            DataAtPoints(f"the {name} of {held.what}", data, one.lattice.to_scene(one.boundary.points[held.rows]))
            for held in one.held
            for name, data in data_of(held.law)
        ]

    @cached_on_space
    def _told_of_lattice(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """What is told of the source and the samples, and of how the lattice resolves them, whatever the equation."""
        one, dof_map = self.sampled, self._first_dof_map
        cuts = dof_map.patch[one.interior :]
        source = warnings_of(one.surface.source, one.lattice.spacing)
        rounding = one.lattice.rounding_warnings(one.surface.bounds, not one.surface.shift.any())
        of_pieces = resolution_warnings(dof_map, connected_pieces(dof_map), one.lattice, cuts, one.geometry)
        resolved = (*of_pieces, *turning_warnings(self.turned, one.lattice))
        return (*source, *rounding, *one.told), resolved

    @cached_property
    def _unresolved_share(self) -> float:
        """The share of the patches whose piece of the manifold has one unknown."""
        dof_map = self._first_dof_map
        count, piece = connected_pieces(dof_map)
        size = np.bincount(piece, minlength=count)
        return float(np.mean(size[piece[dof_map.unknowns[:, 0]]] == 1)) if count > 1 else 0.0

    @property
    def turned(self) -> NormalSpread:
        """How much of the manifold lies on splines under which it turns: thin, folded or creased on this lattice."""
        return self._areas_and_turned[1]

    def source_error(self, difference: float | None = None) -> float:
        """Return what the source leaves in integrals, its noise, or a lift that a mesh does not support."""
        one = self.sampled
        noise = NOISE_FACTOR * one.surface.noise / self.spacing
        left = max(integral_floor_of(self.scene.surface, self.spacing), noise)
        if one.geometry != "normals":
            return left
        return max(left, support_floor(one.surface, float(one.samples.weights.sum()), difference))

    def diagnosis(
        self,
        coarser: Discretized | None = None,
        ratio: float = 2.0,
        difference: float = 0.0,
        eigenvalues: bool = False,
    ) -> Diagnosis:
        """Return the order that divides differences by 2.7 to 7 on smooth sources, by 2.5 on meshes, by less if slow.

        Of degree 2 at twice the spacing; on smooth sources by 1.1 to 2.8 of degree 1, by 5.4 to 14 of degree 3 and of
        eigenvalues. At order 3 the difference is 7 times the error; with order 2 the estimate would be half the error.
        """
        divisors = EIGENVALUE_DIVISORS if eigenvalues else ERROR_DIVISORS
        return Diagnosis(
            difference_order(self, divisors[self.options.own.degree], ratio, coarser, difference),
            self.slow if coarser is None else slow_convergence_reason(self, coarser),
            unresolved_share=self._unresolved_share,
        )

    def estimate(self, u: Floats) -> ExpectedError | None:
        """Return about the error by third differences of the splines' coefficients."""
        return single_solution_estimate(self, u)

    @cached_property
    def layer_spacings(self) -> float:
        """How wide layers beside conditions are, in spacings; infinite where there can be none."""
        return layer_spacings(self)

    @cached_property
    def slow(self) -> str:
        """Why the error may fall slowly, in words."""
        return slow_convergence_reason(self)

    def work(self, operator: Operator, report: SolveReport | None) -> GalerkinWork:
        """Return what the space holds and what the solve did."""
        return GalerkinWork(
            self.size,
            len(self.sampled.samples),
            len(self.space.dof_map.cells),
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
        made = {"nodes": self._first_dof_map.nodes, "sides": self._sides}
        return {**{name: np.array(value) for name, value in given.items()}, **made}

    @cached_on_space
    def _sides(self) -> Floats:
        return side_moments(self.sampled.boundary, self.sampled.left, len(self.scene.boundaries))

    def differs_from(self, saved: Mapping[str, Any]) -> str:
        """Compare the nodes of the splines, and where the left of boundaries is."""
        sides, own = saved.get("sides", self._sides), self._sides
        if sides.shape == own.shape and np.any(np.sum(sides * own, axis=(1, 2)) < 0):
            return "left and right of its boundaries are others"
        return "" if np.array_equal(self._first_dof_map.nodes, saved["nodes"]) else "its nodes are others"


def check(scene: Scene, options: Options[GalerkinOptions]) -> None:
    """Refuse, before anything is built, what the form does not carry.

    Raises
    ------
    SceneError
        With what to do instead.
    """
    problem, surface = scene.problem, scene.surface
    if problem.family not in FAMILIES:
        raise SceneError(f"the form {options.form!r} does not yet carry {problem.kind!r}; use form='collocation'.")
    if problem.terms().velocity is not None and options.own.tips == "singular":
        raise SceneError(
            "tips='singular' takes no velocity: what u is like at the end of a boundary that is flown past is not "
            "known; use tips='extended'."
        )
    if problem.terms().velocity is not None and scene.has_tensor:
        raise SceneError(
            f"the form {options.form!r} takes no velocity beside a diffusivity that is a tensor; give one that is a "
            "number or a function that returns numbers."
        )
    if options.own.refine == "auto":
        check_refined(scene, options)
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


def check_refined(scene: Scene, options: Options[GalerkinOptions]) -> None:
    """Refuse what splines of several levels do not carry.

    Raises
    ------
    SceneError
        With what to do instead.
    """
    problem, terms = scene.problem, scene.problem.terms()
    reasons = {
        "no channels that are tied to each other": problem.family == "coupled",
        f"steady problems, got {problem.kind!r}: others move what asks for finer splines": problem.family != "steady",
        "surfaces, got a curve: a smaller spacing costs little there": scene.surface.manifold_dim == 1,
        "no velocity: upwinding goes by one spacing": terms.velocity is not None,
        "no diffusivity that is a tensor or depends on u": scene.has_tensor
        or isinstance(terms.diffusivity, StateDiffusivity),
        "no conditions that depend on u": any(isinstance(one.law, Nonlinear) for one in scene.conditions),
        f"splines of degree 2, got degree={options.own.degree}": options.own.degree != 2,
        "tips='extended' alone: the ends of boundaries are refined": options.own.tips == "singular",
    }
    for reason, holds in reasons.items():
        if holds:
            raise SceneError(f"refine='auto' takes {reason}; use refine='off'.")


def discretize(scene: Scene, options: Options[GalerkinOptions], progress: Progress = no_progress) -> Galerkin:
    """Discretise a scene on splines of one level; ``progress`` is told the stage and the share of it that is done.

    Raises
    ------
    InputError, SceneError, ResolutionError
        If the lattice's origin, a boundary or the spacing does not fit.
    """
    check(scene, options)
    sampled = sample_scene(scene, options, progress)
    progress("space", 0.0)
    dof_map = build_dof_map(
        sampled.samples.points, sampled.corners, options.spacing, sampled.samples.cell, options.own.degree
    )
    assert isinstance(sampled.samples, Samples)
    sampled = replace(
        sampled, samples=QuantisedSamples.of(sampled.samples, dof_map)
    )  # what they were made of is let go
    made = Galerkin(scene, options, sampled, build_spline_space(dof_map, sampled.samples))
    release_memory()
    progress("space", 1.0)
    return made
