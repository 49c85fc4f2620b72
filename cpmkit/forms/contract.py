"""The contract of a form, a way to discretise a scene: operators, values at points, diagnosis.

With A the operator of an equation's terms, M the mass matrix of the form, and b the load of the right-hand side and of
the conditions, a steady problem is ``A u = b``, a problem in time ``M u' = -A u + b``, and an eigenvalue problem
``A u = lambda B u``. Families of equations know only :class:`Discretized`; a form knows no family and no other form.

A new form implements the abstract members. The other members have defaults that are right wherever the form knows the
problem through A alone, or raise SceneError (InputError where they evaluate u) because the form lacks the ability.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from cpmkit.errors import InputError, SceneError
from cpmkit.forms import form_records
from cpmkit.forms.data_checks import Imbalance, balanced_solution, free_pieces
from cpmkit.linear.operators import Border, Bordered, Operator, Stiffness
from cpmkit.linear.residuals import SolveReport
from cpmkit.manifold.abilities import integral_floor_of
from cpmkit.runtime.arrays import as_points
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.equations import Terms
from cpmkit.scene.laws import Spectral
from cpmkit.scene.scene import Scene
from cpmkit.types import Bools, Floats, Ints, Side, Sides, SparseMatrix

if TYPE_CHECKING:
    from cpmkit.solution.display_mesh import DisplayMesh


#: Number of points that are evaluated at a time, which bounds the memory of their rows.
EVALUATION_CHUNK_POINTS = 1 << 17


class FormOperators(ABC):
    """The unknowns of a form, and the matrices and loads of equations and conditions."""

    #: Name of the form, for reports.
    form: ClassVar[str]
    #: Abilities that the form lacks, by name, each with the advice that the error gives.
    cannot: ClassVar[Mapping[str, str]] = {
        "eigenvalues at boundaries": "use another form",
        "fluxes that depend on u": "use another form",
        "second Laplacian": "use another form",
        "diffusivity that is a tensor": "use another form",
        "diffusivity that depends on u": "use another form",
        "coupled channels": "use another form",
        "explicit steps": "use scheme 'newmark' or 'implicit', or another form",
    }

    scene: Scene

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of unknowns, n."""

    @property
    @abstractmethod
    def spacing(self) -> float:
        """Mesh width, in the scene's unit of length."""

    @property
    def traits(self) -> form_records.FormTraits:
        """The properties of the form that solvers, families and saved files read; by default ``FormTraits()``."""
        return form_records.FormTraits()

    def check(self, solver: str) -> None:
        """Raise if the form cannot solve the problem by the linear solver named ``solver``; by default never raise.

        Raises InputError, SceneError, or ResolutionError if memory does not suffice or the spacing is too coarse, with
        a spacing that would do.
        """

    def with_scene(self, scene: Scene) -> Self:
        """Return the form, on the same unknowns, for a ``scene`` that differs only in its equation and data."""
        return replace(self, scene=scene)  # type: ignore[type-var]

    @property
    def constant(self) -> Floats:
        """(n, 1) the unknowns of the function 1, whatever the conditions; by default ones."""
        return np.ones((self.size, 1))

    @property
    def mass(self) -> Operator | None:
        """The mass matrix M; None where it is the identity."""
        return None

    @property
    def mass_in_time(self) -> Operator | None:
        """The mass matrix M of equations in time; differs from :attr:`mass` where :attr:`mass` is singular."""
        return self.mass

    @abstractmethod
    def stiffness(self, terms: Terms) -> Stiffness:
        """Return the operator A (n, n) of the terms of an equation, and of the conditions.

        Raises InputError if a coefficient is not accepted, ResolutionError if the spacing is too coarse for it.
        """

    def advection(self, field: form_records.StateDependentCoefficient) -> Operator:
        """Return the integrals (n, n) of ``u (w . grad v)``, v a test function, for Newton tangents.

        ``field`` gives the vectors w (k, d) at k points. By default raises SceneError.
        """
        raise missing_ability_error(self, "diffusivity that depends on u")

    def weighted_mass(self, values: Floats) -> SparseMatrix:
        """Return the integrals (n, n) of c u v, c = ``values`` (p,) at :attr:`points`; by default raise SceneError."""
        raise missing_ability_error(self, "coupled channels")

    def boundary_mass(self, stiffness: Stiffness) -> Any:
        """Return the matrix B (n, n) of Steklov conditions, with a method ``apply``; None without such conditions.

        ``stiffness`` is A. By default raises SceneError if the scene has such conditions.
        """
        if any(isinstance(condition.law, Spectral) for condition in self.scene.conditions):
            raise missing_ability_error(self, "eigenvalues at boundaries")

    def levels(self, operator: Operator) -> Sequence[Any]:
        """Return multigrid levels of ``operator``, fine to coarse, each with its prolongation; empty by default."""
        return ()

    @abstractmethod
    def load(self, f: Data, time: float | None = None) -> Floats:
        """Return the load (n, channels) of the right-hand side ``f``; ``time`` is None for problems without time."""

    @abstractmethod
    def condition_load(self, stiffness: Stiffness, time: float | None = None, of: str = "value") -> Floats:
        """Return the load (n, channels) of conditions' data on u, or with ``of="laplacian"`` on -Lap u, at ``time``.

        ``stiffness`` is the operator A in which the conditions are; ``time`` is None for problems without time.
        """

    @property
    def state_fluxes(self) -> Sequence[form_records.StateFlux]:
        """The parts of boundaries on which the flux depends on u; by default raises SceneError."""
        raise missing_ability_error(self, "fluxes that depend on u")

    def linearise(self, seen: Sequence[Floats]) -> Self:
        """Return the form with each of :attr:`state_fluxes` linearised at its u (k,) in ``seen``; itself by default."""
        return self

    def free_constants(self, stiffness: Stiffness) -> Border | None:
        """Return the pieces (indicators and means) where u + constant solves A u = b if u does; None if none."""
        return free_pieces(stiffness, lambda: self.mass)

    def closed_component_means(self) -> SparseMatrix | None:
        """Return the matrix (k, n) of means over the k pieces that no flux leaves; None, the default, if unknown."""
        return None


class FormValues(FormOperators):
    """Conversion between unknowns and values at the points of a form, and evaluation anywhere on the manifold."""

    @property
    @abstractmethod
    def points(self) -> Floats:
        """(p, d) the points, read-only, at which the form evaluates u and data, in the scene's coordinates."""

    @property
    def point_weights(self) -> Floats | None:
        """(p,) quadrature weights of :attr:`points`; None where the points are no quadrature points."""
        return None

    def some_points(self, count: int) -> tuple[Ints, Floats]:
        """Return the numbers (k,) and positions (k, d) of ``count`` of the form's points, spread evenly, or of all."""
        rows = spread_rows(len(self.points), count)
        return rows, self.points[rows]

    @abstractmethod
    def at_points(self, u: Floats, rows: Ints | None = None) -> Floats:
        """Return the values (p, channels) of u (n, channels) at the points, or (k, channels) at the points ``rows``."""

    @abstractmethod
    def project(self, values: Floats, start: Floats | None = None, time: float | None = None) -> Floats:
        """Return the unknowns (n, channels) whose values at the points are nearest to ``values`` (p, channels).

        ``start`` (n, channels) are the unknowns that are returned where values at the points do not determine them.
        ``time`` is the time of the conditions' data, by default the start of the problem.
        """

    #: The former name of :meth:`project`.
    put_back = DeprecatedMember("project")

    def data_at_points(self, data: Any, label: str, time: float | None = None, channels: int | None = 1) -> Floats:
        """Return the values (p, channels) of ``data`` of the scene at :attr:`points` and ``time``.

        ``label`` is their name in errors; ``channels`` None means as many as the data have.
        """
        return evaluate_data(data, self.points, channels, label, time)

    def interpolate(
        self, data: Data, label: str, time: float = 0.0, in_range: bool = False, step: float = 0.0
    ) -> Floats:
        """Return the unknowns (n, channels) that represent ``data`` at ``time`` and satisfy the conditions.

        ``label`` is the name of the data in errors; ``time`` is also that of the conditions' data. Two arguments are
        ignored by default. ``in_range``: whether the unknowns stay within the range of data that the spacing does not
        resolve. ``step``: if above 0, ``data`` are rates du/dt, and the conditions' data are difference quotients over
        this step.
        """
        return self.project(self.data_at_points(data, label, time, self.scene.channels), time=time)

    def reaction_load(self, function: Callable[[Floats, Floats], Floats], u: Floats) -> Floats:
        """Return the load (n, channels) of the right-hand side ``function(values, points)``.

        The arguments of the function are the values (p, channels) of ``u`` (n, channels) at the points (p, d) of the
        form, and these points; it returns numbers (p, channels).
        """
        values = function(self.at_points(u), self.points)
        return self.load(lambda _: values)

    @abstractmethod
    def inner(self, u: Floats, v: Floats) -> Floats:
        """Return the means (k, m) over the manifold of the products of u's columns (n, k) with v's (n, m)."""

    @abstractmethod
    def evaluation_matrix(self, points: Floats, side: Sides = None) -> SparseMatrix:
        """Return the matrix (k, n) that evaluates u at the manifold's points nearest to ``points`` (k, d).

        Points are in the scene's coordinates. ``side`` is the side from which points on boundaries are read, for all or
        by name; None leaves it to the form. Raises InputError if a point is not finite or too far from the manifold, or
        a side is not one of the scene's.
        """

    #: The former name of :meth:`evaluation_matrix`.
    rows = DeprecatedMember("evaluation_matrix")

    def evaluate(self, u: Floats, points: Any, side: Sides = None) -> Floats:
        """Return the values (k, channels) of u (n, channels) at ``points`` (k, d); see :meth:`evaluation_matrix`."""
        at = as_points(points, self.scene.surface.dim)
        starts = range(0, max(len(at), 1), EVALUATION_CHUNK_POINTS)
        parts = (at[start : start + EVALUATION_CHUNK_POINTS] for start in starts)
        return np.concatenate([self.evaluation_matrix(part, side) @ u for part in parts])

    def gradient(self, u: Floats, points: Any = None, side: Sides = None) -> Floats:
        """Return the tangential gradient (k, channels, d) of u at ``points`` (k, d), by default at :attr:`points`.

        ``side`` is as in :meth:`evaluation_matrix`. Raises InputError unless the form overrides it.
        """
        raise InputError(f"the form {self.form!r} evaluates no gradients.")

    def conormal_derivative(
        self, u: Floats, points: Any, boundary: str | None = None, side: Side | None = None
    ) -> Floats:
        """Return du/db (k, channels), b outwards, at the points of a boundary's side nearest to ``points`` (k, d).

        b is the conormal, out of ``side``. Without a ``boundary`` the edge is meant. By default raises InputError.
        """
        place = "the edge" if boundary is None else f"boundary {boundary!r}"
        raise InputError(f"the form {self.form!r} evaluates no flux through {place}.")

    def flux(
        self,
        u: Floats,
        boundary: str | int,
        side: Side | None,
        time: float | None,
        where: Callable[[Floats], Bools] | None = None,
    ) -> Floats | None:
        """Return the integrals (channels,) of du/db, b outwards, at ``time`` over a side of a boundary or the edge.

        ``boundary`` is a name, the number of a loop of the edge, or "edge"; ``side`` is None for the edge. ``where``
        selects the points (n, d) of a part. Returns None, the default, where a quadrature of
        :meth:`conormal_derivative` is as good.
        """
        return None

    def signed_distance(self, name: str, points: Any) -> Floats:
        """Return the signed distances (k,) of ``points`` (k, d) from boundary ``name``, positive on its left.

        NaN where a point has no side. By default raises InputError.
        """
        raise InputError(f"the form {self.form!r} knows no sides of boundary {name!r}.")

    def display_mesh(self, u: Floats) -> DisplayMesh | None:
        """Return the form's mesh with u (n, channels) at its vertices; None to use the surface's, cut at boundaries."""
        return None


class Discretized(FormValues):
    """A scene on the unknowns of one form, prepared once for many equations and right-hand sides.

    Here are warnings, error estimates, the cost of a solution, and the description that recognises a saved solution.
    """

    def remove_constants(self, operator: Operator, b: Floats, u: Floats) -> tuple[Floats, tuple[Imbalance, ...]]:
        """Return the solution ``u`` of ``operator u = b`` less its means on free pieces, and the imbalances of b."""
        return balanced_solution(operator, b, u, self) if isinstance(operator, Bordered) else (u, ())

    def warnings(self) -> tuple[str, ...]:
        """Return warnings that hold for any solution."""
        return ()

    def diagnosis(
        self, coarser: Discretized | None = None, ratio: float = 2.0, difference: float = 0.0, eigenvalues: bool = False
    ) -> form_records.Diagnosis:
        """Return the order of the error, by default 2, reasons for slow convergence, and the part left unresolved.

        ``coarser`` is the form of a solution with which this one is compared, on a lattice with ``ratio`` times the
        spacing; ``difference`` is the root mean square of their difference, as a share of the range. With
        ``eigenvalues`` the order of eigenvalues is returned.
        """
        return form_records.Diagnosis()

    def estimate(self, u: Floats) -> form_records.ExpectedError | None:
        """Return an estimate of the error of u (n, channels) from u alone; None where the form has none."""
        return None

    def source_error(self, difference: float | None = None) -> float:
        """Return the error that the representation of the manifold leaves at any spacing, as a share of u's range.

        ``difference`` is the root mean square difference, as a share of the range, between the solution and that on the
        flat triangles of a mesh that is read as smooth; None if unknown. This method ignores it, and returns what the
        source states.
        """
        return integral_floor_of(self.scene.surface, self.spacing)

    def work(self, operator: Operator, report: SolveReport | None) -> form_records.MeasuredWork:
        """Return the measures of the work of a solve of ``operator``; ``report`` is None if no solver was called."""
        return form_records.PlainWork(self.size, operator.nonzeros, report.operator_applications if report else 0)

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """Return the options of the discretisation by name, as numbers, text, lists and tables."""

    def arrays(self) -> dict[str, Any]:
        """Return the arrays that are saved with a solution, and by which it is recognised and rebuilt.

        If they are empty, the unknowns are not saved: a saved solution is its display mesh with values alone.
        """
        return {}

    def differs_from(self, saved: Mapping[str, Any]) -> str:
        """Return in words how the form differs from the form with the :meth:`arrays` ``saved``; empty if equal."""
        return ""


def missing_ability_error(form: FormOperators, ability: str) -> SceneError:
    """Return the SceneError, with advice, for a problem that needs an ``ability`` that the form lacks."""
    return SceneError(
        f"the form {form.form!r} has no {ability}, which {form.scene.problem.kind!r} needs; "
        f"{form.cannot.get(ability, 'use another form')}."
    )


def require_ability(form: FormOperators, ability: str) -> None:
    """Raise SceneError, with advice, if the form lacks the ``ability``, a key of :attr:`FormOperators.cannot`."""
    if ability in form.cannot:
        raise missing_ability_error(form, ability)


def integrals(form: FormValues, u: Floats) -> Floats | None:
    """Return the integrals (channels,) of u (n, channels) over the manifold; None where the points have no weights."""
    weights = form.point_weights
    return None if weights is None else np.asarray(weights @ form.at_points(u))


def spread_rows(total: int, count: int) -> Ints:
    """Return at most ``count`` of the integers from 0 to ``total`` - 1, evenly spread: numbers of a form's points."""
    return np.linspace(0, total - 1, min(count, total)).astype(np.int64)
