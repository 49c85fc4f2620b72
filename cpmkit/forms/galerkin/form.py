"""The Galerkin form: fulfils the contract of a form by a function space, quadrature samples and conditions.

Its parts, in the order of the method: the sampled scene (mesh and quadrature), the function space (dof map, splines,
energy), the conditions, and over these the reader and the coefficients, the assembly of equations, and the resolution.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.contract import Discretized, spread_rows
from cpmkit.forms.data_checks import DataAtPoints, data_warnings
from cpmkit.forms.form_records import Diagnosis, ExpectedError, FormTraits, StateFlux
from cpmkit.forms.galerkin.coefficients import SampleCoefficients
from cpmkit.forms.galerkin.conditions.boundary_sides import side_moments
from cpmkit.forms.galerkin.conditions.imposed_conditions import imposed_conditions, needs_rims
from cpmkit.forms.galerkin.equation_assembly import EquationAssembly, GalerkinOperator, multigrid_applies
from cpmkit.forms.galerkin.error_indicators import (
    difference_order,
    dispersion_of,
    single_solution_estimate,
    support_floor,
)
from cpmkit.forms.galerkin.options import GalerkinOptions, check_scene
from cpmkit.forms.galerkin.resolution import LatticeResolution, Resolution
from cpmkit.forms.galerkin.scene_sampling import SampledScene
from cpmkit.forms.galerkin.solids.solid_reading import SolidCoefficients
from cpmkit.forms.galerkin.solids.solid_sampling import SampledSolid
from cpmkit.forms.galerkin.solution_warnings import crossing_warnings, outflow_layer_warnings, tip_warnings
from cpmkit.forms.galerkin.solve_memory import GalerkinWork, SolveMemory
from cpmkit.forms.galerkin.space.function_space import FunctionSpace
from cpmkit.forms.galerkin.space.projection_in_range import project_in_range
from cpmkit.forms.options import Options
from cpmkit.linear.multigrid.solver import Level
from cpmkit.linear.operators import CsrOperator, Operator, Stiffness, without_border
from cpmkit.linear.residuals import SolveReport
from cpmkit.manifold.abilities import integral_floor_of
from cpmkit.meshing.mesh_warnings import NOISE_FACTOR
from cpmkit.runtime.memory import release_memory
from cpmkit.scene.data import Data, Functional
from cpmkit.scene.equations import Terms
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Ints, Side, Sides, SparseMatrix


@dataclass(frozen=True, eq=False)
class Galerkin(EquationAssembly, Discretized):
    """A scene discretised on a function space; the unknowns are coefficients of splines, not values of u."""

    form: ClassVar[str] = "galerkin"
    cannot: ClassVar[Mapping[str, str]] = {
        "explicit steps": "use scheme 'newmark' or 'implicit', or the form 'collocation'"
    }

    options: Options[GalerkinOptions]  #: Options: the options of the discretisation.
    sampled: SampledScene  #: The manifold as a mesh with quadrature samples, and its boundaries as facets of the cells.
    #: The functions whose coefficients are the unknowns: splines of one spacing, refined or enriched splines.
    space: FunctionSpace
    #: How the lattice resolves the manifold. It is shared by all scenes on the same space.
    lattice_resolution: LatticeResolution = field(repr=False)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.space.size

    @property
    def spacing(self) -> float:
        """Spacing of the lattice, in the scene's unit."""
        return self.sampled.lattice.spacing

    @property
    def traits(self) -> FormTraits:
        """Properties for solvers and families, with degree 3 as advice on smooth surfaces without boundary samples."""
        sampled = self.sampled
        closed = not self.scene.boundaries and not len(sampled.boundary)
        smooth = closed and sampled.mesh.manifold_dim == 2 and sampled.geometry == "closest_point"
        return FormTraits(
            iterative_solver="multigrid" if multigrid_applies(self.scene) else "direct",
            dispersion=dispersion_of(self.options.own.degree, sampled.geometry),
            work_record=GalerkinWork,
            higher_degree=3 if smooth and self.options.own.refine == "off" else None,
        )

    def check(self, solver: str) -> None:
        """Raise ResolutionError if factors of ``solver`` do not fit into memory; else compute and cache warnings."""
        cost = SolveMemory(self.scene, self.options)
        if cost.factorised_part(solver):  # the memory of other solvers was checked before the tables were made
            cost.check_fits(self.size, solver)
        self.warnings()
        release_memory()

    def with_scene(self, scene: Scene) -> Galerkin:
        """Return the form on the same space for a scene that differs in its equation and its data only.

        Raises SceneError if the form cannot solve the scene, or if its velocity or a condition on the edge needs
        samples on rims that were not made; errors of conditions are those of :func:`imposed_conditions`.
        """
        check_scene(scene, self.options)
        sampled, reads_rims = self.sampled, scene.problem.terms().conservative or needs_rims(scene)
        if reads_rims and np.any(sampled.half.cut < 0) and not np.any(sampled.boundary.on_rim):
            raise SceneError(
                "what flows through the edge, by a condition or a conservative velocity, is read at samples there, "
                "which this scene was prepared without; prepare it with this problem and these conditions."
            )
        conditions = imposed_conditions(scene, sampled.boundary, sampled.left, sampled.surface, sampled.lattice)
        return replace(self, scene=scene, conditions=conditions)

    @property
    def constant(self) -> Floats:
        """(n, 1) the unknowns of the function 1."""
        return self.space.constant

    @property
    def mass(self) -> CsrOperator:
        """M, the integrals of products of functions; singular, as some splines are zero at all samples."""
        return self.space.mass

    def weighted_mass(self, values: Floats) -> SparseMatrix:
        """Return the integrals (n, n) of c u v, with the ``values`` (p,) of c at the samples.

        Raises SceneError if singular functions are among the unknowns.
        """
        return self.space.weighted_mass(self.coefficients.append_boundary_samples(values))

    def boundary_mass(self, stiffness: Any) -> CsrOperator | None:
        """Return the integrals (n, n) of a u v over boundaries and rims with du/db = lambda u; None if none have it."""
        matrix = stiffness.conditions.boundary_mass
        return None if matrix is None else CsrOperator(matrix, symmetric=True)

    def levels(self, operator: Operator) -> Sequence[Level]:
        """Return multigrid levels of ``operator``: refined splines, lattices of 2h, 4h, ... that resolve its waves."""
        inner, plain = without_border(operator), self.space.plain_levels
        usable = inner.usable_levels(plain, self.spacing) if isinstance(inner, GalerkinOperator) else plain
        return [*self.space.refined_levels, *usable]

    def load(self, f: Data, time: float | None = None) -> Floats:
        """Return the integrals (n, channels) of ``f`` at ``time`` times each function, upwinded for a velocity."""
        if isinstance(f, Functional):
            return f.loads(self, time)
        values = self.data_at_points(f, "the right-hand side f", time, self.scene.channels)
        loads = self.space.load(values)
        if self.scene_advection is not None:
            self.scene_advection.add_load(values, loads)
        return loads

    def gradient_load(self, values: Floats) -> Floats:
        """Return the integrals (n,) of vectors (p, d) at the samples times the tangential gradient of each function."""
        return self.space.gradient_load(values)

    def condition_load(self, stiffness: Stiffness, time: float | None = None, of: str = "value") -> Floats:
        """Return the load (n, channels) of the conditions' data at ``time``, on u or with ``of="laplacian"`` on -Lap u.

        ``stiffness`` is an operator of this space; its coefficients and penalties are used, with this scene's data.
        """
        terms = self.terms_with_scene_data(stiffness)
        if not terms.conditions:
            return np.zeros((self.size, self.scene.channels))
        if of == "laplacian":
            return -terms.for_laplacian.load(self.scene.channels, time)
        return terms.load(self.scene.channels, time)

    @property
    def state_fluxes(self) -> Sequence[StateFlux]:
        """The samples on boundaries at which the flux of a condition depends on u, for each such condition."""
        return self.condition_terms(Terms()).state_fluxes

    def linearise(self, seen: Sequence[Floats]) -> Galerkin:
        """Return the form with each flux of :attr:`state_fluxes` linearised at its values (k,) of u in ``seen``."""
        terms = self.condition_terms(Terms()).linearise(seen)
        return replace(self, conditions=terms.conditions)

    @property
    def points(self) -> Floats:
        """(p, d) the samples of the manifold in the scene's coordinates, read-only, cached while in use."""
        return self.coefficients.points

    @property
    def point_weights(self) -> Floats:
        """(p,) the quadrature weights of the samples."""
        return self.sampled.samples.weights[: self.sampled.interior]

    def some_points(self, count: int) -> tuple[Ints, Floats]:
        """Return the numbers (k,) and positions (k, d) of at most ``count`` samples, evenly spread over all."""
        rows = spread_rows(self.sampled.interior, count)
        if isinstance(self.coefficients, SolidCoefficients):
            rows = self.coefficients.inside[spread_rows(len(self.coefficients.inside), count)]
        return rows, self.sampled.lattice.to_scene(self.sampled.samples.points_at(rows))

    def at_points(self, u: Floats, rows: Ints | None = None) -> Floats:
        """Return the values (k, channels) of u (n, channels) at the samples, or at the samples ``rows`` (k,)."""
        return self.space.values_at_samples(u, rows)

    def project(self, values: Floats, start: Floats | None = None, time: float | None = None) -> Floats:
        """Return the unknowns (n, channels) of stabilised L2 projections of ``values`` (p, channels) at the samples.

        ``start`` (n, channels) are the unknowns of a first approximation; the projection of the rest is added to them.
        ``time`` is unused.
        """
        del time  # no unknown represents data of a condition
        return (
            self.space.project(values) if start is None else start + self.space.project(values - self.at_points(start))
        )

    def data_at_points(self, data: Any, label: str, time: float | None = None, channels: int | None = 1) -> Floats:
        """Return ``data`` (p, channels) at ``time`` at samples, each on its cell's side; ``label`` is for errors."""
        return self.coefficients.at_points(data, label, time, channels)

    def interpolate(
        self, data: Data, label: str, time: float = 0.0, in_range: bool = False, step: float = 0.0
    ) -> Floats:
        """Return the unknowns (n, channels) of the L2 projections of ``data``, or with ``in_range`` without overshoots.

        See :func:`project_in_range`. Data are those at ``time``, called ``label`` in errors; ``step`` is unused.
        """
        values = self.data_at_points(data, label, time, self.scene.channels)
        return project_in_range(self.space, values) if in_range else self.space.project(values)

    def inner(self, u: Floats, v: Floats) -> Floats:
        """Return the means (k, m) over the manifold of the products of u's columns (n, k) with v's (n, m)."""
        return np.asarray(u.T @ self.mass.apply(v) / self.sampled.samples.weights.sum())

    def evaluation_matrix(self, points: Any, side: Sides = None) -> SparseMatrix:
        """Return the matrix (k, n) that evaluates u on ``side`` at the manifold's points nearest to ``points`` (k, d).

        Raises InputError if a point is not finite or over three spacings away, or a side is not one of the scene's.
        """
        return self.coefficients.evaluation_matrix(points, side)

    def gradient(self, u: Floats, points: Any = None, side: Sides = None) -> Floats:
        """Return the tangential gradient (k, channels, d) of u at ``points`` (k, d), L2 projected.

        At the samples, for ``points`` None, it is not projected. Raises InputError as :meth:`evaluation_matrix`.
        """
        if points is None:
            return self.space.gradients_at_samples(u)
        return self.coefficients.gradient(u, points, side)

    def conormal_derivative(
        self, u: Floats, points: Any, boundary: str | None = None, side: Side | None = None
    ) -> Floats:
        """Return du/db (k, channels), b out of ``side``, at ``points`` (k, d) of ``boundary``, of the edge if None.

        For a tensor A it is the derivative along A b / (b . A b). Raises InputError for points or sides not accepted.
        """
        return self.coefficients.conormal_derivative(u, points, boundary, side, self.scene)

    def signed_distance(self, name: str, points: Any) -> Floats:
        """Return the distances (k,) of ``points`` (k, d) from the boundary ``name``, positive on its left.

        NaN past its open ends, and everywhere if it has no left. Raises InputError for points or names not accepted.
        """
        return self.coefficients.signed_distance(name, points)

    @cached_property
    def resolution(self) -> Resolution:
        """How the lattice resolves the manifold, and the layers of the equation."""
        return Resolution(self.scene, self.conditions, self.coefficients, self.lattice_resolution)

    def warnings(self) -> tuple[str, ...]:
        """Return warnings that hold for any solution."""
        return self._warnings

    @cached_property
    def _warnings(self) -> tuple[str, ...]:
        """The warnings on the source, boundaries, what the lattice does not resolve, unresolved layers and data."""
        mesh, lattice = self.sampled.mesh, self.sampled.lattice
        source, resolved = self.lattice_resolution.warnings
        at = [lattice.to_scene(self.sampled.boundary.points[condition.rows]) for condition in self.conditions]
        on_skin = isinstance(self.sampled, SampledSolid)
        normals = [
            self.sampled.boundary.conormals[condition.rows] if on_skin else None for condition in self.conditions
        ]
        data = [
            DataAtPoints(f"the {name} of {condition.label}", data, points, across)
            for condition, points, across in zip(self.conditions, at, normals, strict=True)
            for name, data in condition.law.data
        ]
        vertices = 0 if on_skin else len(mesh.vertices)
        return (
            *source,
            *crossing_warnings(self.scene, mesh, lattice),
            *tip_warnings(self.scene, mesh, lattice),
            *resolved,
            *(outflow_layer_warnings(self.terms_of_scene) if self.scene_advection is not None else ()),
            *self.resolution.tensor_layer_warnings(),
            *data_warnings(self, data, self.space.finest_spacing, vertices, self.coefficients.data_points),
        )

    def diagnosis(
        self, coarser: Discretized | None = None, ratio: float = 2.0, difference: float = 0.0, eigenvalues: bool = False
    ) -> Diagnosis:
        """Return a record of the order of the error, of reasons for slow convergence, and of unresolved parts.

        The parameters are those of :meth:`cpmkit.forms.contract.Discretized.diagnosis`.
        """
        other, degree = coarser.resolution if isinstance(coarser, Galerkin) else None, self.options.own.degree
        return Diagnosis(
            difference_order(self.resolution, degree, ratio, other, difference, eigenvalues),
            self.resolution.slow_convergence_reason(other),
            unresolved_share=self.lattice_resolution.single_unknown_share,
            ties=self.sampled.lattice.to_scene(self.sampled.ties),
        )

    def estimate(self, u: Floats) -> ExpectedError | None:
        """Return an estimate of the error of u by :func:`single_solution_estimate`; None also for refined splines."""
        is_refined = self.space.dof_map is not self.space.base_dof_map
        return None if is_refined else single_solution_estimate(self.resolution, u)

    def source_error(self, difference: float | None = None) -> float:
        """Return the error, a share of u's range, that the source leaves; ``difference``: see :func:`support_floor`."""
        sampled = self.sampled
        noise = NOISE_FACTOR * sampled.surface.noise / self.spacing
        error = max(integral_floor_of(self.scene.surface, self.spacing), noise)
        if sampled.geometry != "normals":
            return error
        return max(error, support_floor(sampled.surface, float(sampled.samples.weights.sum()), difference))

    def work(self, operator: Operator, report: SolveReport | None) -> GalerkinWork:
        """Return the measures of the work of a solve; ``report`` is None where none was made."""
        return GalerkinWork(
            self.size,
            len(self.sampled.samples),
            len(self.space.dof_map.cells),
            self.sampled.queries,
            operator.nonzeros,
            report.operator_applications if report else 0,
        )

    def describe(self) -> dict[str, Any]:
        """Return the options, origin of the lattice, number of ties, and description of the space, as plain values."""
        return {
            "form": self.options.form,
            "form_reason": self.options.reason,
            **self.options.own.as_dict(),
            "origin": self.sampled.lattice.origin.tolist(),
            "ties": len(self.sampled.ties),
            **self.space.describe(),
        }

    @property
    def _side_moments(self) -> Floats:
        """The :func:`side_moments` of the boundaries, by which a form is compared with a saved form."""
        return side_moments(self.sampled.boundary, self.sampled.left, len(self.scene.boundaries))

    def arrays(self) -> dict[str, Any]:
        """Return the options, the origin of the lattice, the arrays of the space, and the boundaries' side moments."""
        options = {**self.options.as_dict(), "origin": self.sampled.lattice.origin}
        arrays = {name: np.array(value) for name, value in options.items()}
        return {**arrays, **self.space.arrays(), "sides": self._side_moments}

    def differs_from(self, saved: Mapping[str, Any]) -> str:
        """Return in words how the form of arrays ``saved`` differs, in sides of boundaries or space; empty if equal."""
        sides, saved_sides = self._side_moments, saved.get("sides", self._side_moments)
        if saved_sides.shape == sides.shape and np.any(np.sum(saved_sides * sides, axis=(1, 2)) < 0):
            return "left and right of its boundaries are others"
        return self.space.differs_from(saved)


def galerkin(scene: Scene, options: Options[GalerkinOptions], sampled: SampledScene, space: FunctionSpace) -> Galerkin:
    """Return the Galerkin form of a ``sampled`` scene on the function ``space`` over its samples."""
    coefficients = SampleCoefficients(sampled, space)
    if isinstance(sampled, SampledSolid):
        coefficients = SolidCoefficients(sampled, space)
    resolution = LatticeResolution(sampled, space)
    return Galerkin(scene, sampled.conditions, coefficients, options, sampled, space, resolution)
