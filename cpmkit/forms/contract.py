"""What a form is: a way of discretising a scene, and all that the families of equations may ask of it.

With A the operator of an equation's terms, M the form's mass, and b what the right-hand side and the conditions add,
a steady problem is ``A u = b``, one in time ``M u' = -A u + b``, one of eigenvalues ``A u = lambda B u``. Families are
written over :class:`Discretized` alone, and know no form; a form knows no family, and no other form.

A form of one's own overrides what is abstract. Everything else has an answer that is right wherever A is all that the
form knows of the problem, and is overridden where it knows more.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.forms.at_state import AtState
from cpmkit.forms.dispersion import SECOND_ORDER, Dispersion
from cpmkit.forms.expected import ExpectedError
from cpmkit.forms.free_constants import defects_of, free_pieces
from cpmkit.forms.imbalance import Imbalance
from cpmkit.forms.options import Options
from cpmkit.linear.operators import Border, Bordered
from cpmkit.manifold.abilities import advice_of
from cpmkit.protocols import SIDES, Floats, Ints, Operator, Side, Sides, Stiffness
from cpmkit.scene.data import Data, evaluate_data, takes_time
from cpmkit.scene.equations import Terms
from cpmkit.scene.laws import Spectral, takes_nothing
from cpmkit.scene.scene import Scene

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from cpmkit.forms.unresolved_data import DataAtPoints
    from cpmkit.linear.solve_report import SolveReport
    from cpmkit.mesh.display_mesh import DisplayMesh


class MeasuredWork(Protocol):
    """What a solve cost, in units that no machine changes."""

    @property
    def unknowns(self) -> int:
        """Size of the system."""

    def as_dict(self) -> dict[str, Any]:
        """Return all measures as plain values."""


@dataclass(frozen=True)
class PlainWork:
    """The measures that every form has: unknowns, numbers stored, products with A of all channels together."""

    unknowns: int
    nonzeros: int
    operator_applications: int

    def as_dict(self) -> dict[str, Any]:
        """Return the measures as plain values."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class SteadyResult:
    """A steady solution as the form hands it out.

    Attributes
    ----------
    values : (n, channels) float64
        Of mean zero on pieces where a constant is free.
    imbalances : tuple of Imbalance
        What did not balance, piece by piece, and what was done about it.
    missed : float
        The largest relative error of a mean, whether or not it was put right.
    warnings : tuple of str
        What else a reader should know than the imbalances' own sentences.
    queries : int
        Closest point queries that it took.
    seconds : mapping
        What it took, by stage.
    """

    values: Floats
    imbalances: tuple[Imbalance, ...] = ()
    missed: float = 0.0
    warnings: tuple[str, ...] = ()
    queries: int = 0
    seconds: Mapping[str, float] = field(default_factory=dict)


class StateFlux(Protocol):
    """Points at which a condition's flux depends on the solution there."""

    @property
    def guess(self) -> float:
        """Value of u at which Newton's method starts."""

    @property
    def points(self) -> Floats:
        """(k, d) where u is read."""

    def read(self, u: Floats, /) -> Floats:
        """Return u (k,) there, from the unknowns (n, 1)."""

    def grows(self, seen: Floats, /) -> bool:
        """Tell whether the flux changes with u where u is ``seen``: if not, it fixes no constant."""


class Discretized(ABC):
    """A scene on the unknowns of one form, made once, for many equations and right-hand sides."""

    #: The form's name, for reports.
    form: ClassVar[str]
    #: Whether :meth:`at_points` and :meth:`evaluate` say the same at :attr:`points`.
    one_reading: ClassVar[bool] = False
    #: What :meth:`work` returns.
    work_record: ClassVar[type] = PlainWork
    #: Distributions whose versions a summary names.
    libraries: ClassVar[tuple[str, ...]] = ("cpmkit", "numpy", "scipy")
    #: What the form cannot do, by name, and what to do instead: families ask before they start.
    cannot: ClassVar[Mapping[str, str]] = {
        "eigenvalues at boundaries": "use the form 'collocation'",
        "fluxes that depend on u": "use the form 'collocation'",
        "second Laplacian": "use the form 'collocation'",
        "diffusivity that is a tensor": "use form='galerkin'",
        "diffusivity that depends on u": "use form='galerkin'",
        "coupled channels": "use form='galerkin'",
        "explicit steps": "use scheme 'newmark' or 'implicit', or the form 'collocation'",
    }

    #: How many times more unknowns than of the form ``collocation`` a factorisation is worth.
    factorise_up_to: ClassVar[float] = 1.0

    scene: Scene

    # What there is

    @property
    def finest_spacing(self) -> float:
        """The smallest spacing anywhere, where there are several."""
        return self.spacing

    @property
    def dispersion(self) -> Dispersion:
        """How well it carries waves."""
        return SECOND_ORDER

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of unknowns, n."""

    @property
    @abstractmethod
    def spacing(self) -> float:
        """How fine it is, in the scene's unit of length."""

    @property
    @abstractmethod
    def points(self) -> Floats:
        """(p, d) the points of the manifold at which the form knows values: in the scene's coordinates."""

    @property
    def points_in_use(self) -> Floats:
        """(p, d) the same for reading alone: one array, where a form makes its points anew each time."""
        return self.points

    @property
    def lattice_options(self) -> Options[Any] | None:
        """With which the scene was discretised, and can be at another spacing: ``options``; None without a lattice."""
        options = getattr(self, "options", None)  # a form's own field: a property here would be taken for its default
        return options if isinstance(options, Options) else None

    @property
    def channels(self) -> int:
        """Number of right-hand sides that are solved together."""
        return self.scene.channels

    @property
    def constant(self) -> Floats:
        """(n, 1) the unknowns of the function 1, conditions left aside."""
        return np.ones((self.size, 1))

    @property
    def mass(self) -> Operator | None:
        """M; None where it is the identity."""
        return None

    @property
    def mass_in_time(self) -> Operator | None:
        """M of equations in time, where that of integrals leaves some unknowns without a rate."""
        return self.mass

    def check(self) -> None:
        """Refuse, before anything is solved, what the form is known to get wrong.

        Raises
        ------
        InputError, SceneError, ResolutionError
            In one sentence.
        """

    def check_solver_fits(self, solver: str) -> None:
        """Refuse what a solver makes beside the tables, factors above all, that the memory of this process cannot hold.

        Raises
        ------
        ResolutionError
            With the spacing that would fit.
        """

    def restated(self, scene: Scene) -> Self:
        """Return the same unknowns with another scene, which differs in its equation and its data alone."""
        return replace(self, scene=scene)  # type: ignore[type-var]

    def require(self, ability: str) -> None:
        """Refuse an ability that the form lacks.

        Raises
        ------
        SceneError
            With what to do instead.
        """
        if ability in self.cannot:
            raise SceneError(
                f"the form {self.form!r} has no {ability}, which {self.scene.problem.kind!r} needs; "
                f"{self.cannot[ability]}."
            )

    @property
    def explicit_steps(self) -> bool:
        """Whether waves may go in explicit steps."""
        return "explicit steps" not in self.cannot

    # Equations

    @abstractmethod
    def stiffness(self, terms: Terms) -> Stiffness:
        """Return A of an equation's terms, the conditions' own part included.

        Raises
        ------
        InputError, ResolutionError
            If a coefficient is not what is accepted, or the spacing is too coarse for it.
        """

    def transport(self, field: AtState) -> Operator:
        """Return the integrals of u (w . grad v), w (k, d) given at a state: what of a flux changes with u itself."""
        self.require("diffusivity that depends on u")
        raise InputError(f"the form {self.form!r} carries nothing along a field.")

    @abstractmethod
    def load(self, f: Data, time: float | None = None) -> Floats:
        """Return what the right-hand side ``f`` adds to b at ``time``, (n, channels)."""

    def mass_of(self, values: Floats) -> csr_array:
        """Return the integrals (n, n) of c u v, c with ``values`` (p,) at :attr:`points`."""
        self.require("coupled channels")
        raise InputError(f"the form {self.form!r} ties no channels to each other.")

    def load_against_slopes(self, values: Floats) -> Floats:
        """Return the integrals (n,) of the vectors ``values`` (p, d) at :attr:`points` times each spline's gradient."""
        raise InputError(f"the form {self.form!r} takes no divergence as a right-hand side; use form='galerkin'.")

    @abstractmethod
    def data(self, stiffness: Stiffness, time: float | None = None, of: str = "value") -> Floats:
        """Return what the data of the conditions add to b (n, channels), those of u, or ``of`` -Lap u: "laplacian"."""

    @property
    def data_move(self) -> bool:
        """Whether data of the conditions depend on the time."""
        return any(takes_time(data) for one in self.scene.conditions for _, data in one.data())

    def boundary_mass(self, stiffness: Stiffness) -> Any:
        """Return B where conditions of Steklov stand, with ``apply``; None where there are none."""
        if any(isinstance(one.law, Spectral) for one in self.scene.conditions):
            self.require("eigenvalues at boundaries")

    @property
    def multigrid(self) -> bool:
        """Whether A is symmetric for the scene's equation, and :meth:`levels` hands out coarser ones."""
        return False

    @property
    def iterative_solver(self) -> str:
        """The solver of systems too large to be factorised quickly; "direct" where no other one serves."""
        return "multigrid" if self.multigrid else "reference"

    def levels(self, operator: Operator) -> Sequence[Any]:
        """Return coarser levels for a multigrid, transfers and operators; none here."""
        return ()

    # Values

    @property
    def point_weights(self) -> Floats | None:
        """What of the manifold stands for each of :attr:`points`, (p,); None where it is the same for all."""
        return None

    @abstractmethod
    def at_points(self, u: Floats) -> Floats:
        """Return the values (p, channels) of u (n, channels) at :attr:`points`."""

    @property
    def point_count(self) -> int:
        """How many :attr:`points` there are."""
        return len(self.points)

    def some_points(self, rows: Ints) -> Floats:
        """Return the :attr:`points` (k, d) of these numbers (k,)."""
        return self.points[rows]

    def at_some_points(self, u: Floats, rows: Ints) -> Floats:
        """Return the values (k, channels) of u at the :attr:`points` of these numbers (k,)."""
        return self.at_points(u)[rows]

    def slopes_at_points(self, u: Floats) -> Floats:
        """Return the tangential gradients (p, channels, d) of u (n, channels) at :attr:`points`."""
        return self.gradient(u, self.points)

    @abstractmethod
    def project(self, values: Floats) -> Floats:
        """Return the unknowns (n, channels) that have ``values`` (p, channels) at :attr:`points`, or nearly so."""

    def with_values(self, u: Floats, values: Floats, time: float) -> Floats:
        """Return u (n, channels) moved to ``values`` (p, channels) at :attr:`points`, or as near as :meth:`project`.

        What of u the points do not see stays; where the values are those of u, all of it.
        """
        del time  # of forms whose unknowns hold the conditions' data
        return u + self.project(values - self.at_points(u))

    def load_of(self, function: Callable[[Floats, Floats], Floats], u: Floats) -> Floats:
        """Return what ``function(values (p, channels), points (p, d))`` of u adds to b, (n, channels)."""
        values = function(self.at_points(u), self.points)
        return self.load(lambda _: values)

    def read(self, data: Any, what: str, time: float | None = None, channels: int | None = 1) -> Floats:
        """Return a coefficient of the equation at :attr:`points`, (p, channels)."""
        return evaluate_data(data, self.points, channels, what, time)

    def interpolate(self, data: Data, what: str, time: float = 0.0) -> Floats:
        """Return the unknowns (n, channels) that stand for ``data`` at ``time``, the conditions considered."""
        return self.project(self.read(data, what, time, self.channels))

    def interpolate_in_range(self, data: Data, what: str, time: float = 0.0) -> Floats:
        """Return the same, within the range of data that the spacing does not resolve: heat then stays there."""
        return self.interpolate(data, what, time)

    def interpolate_rate(self, data: Data, what: str, step: float) -> Floats:
        """Return the unknowns' rates (n, channels) at the start, those of the conditions' data taken over ``step``."""
        return self.project(self.read(data, what, self.scene.problem.start_time, self.channels))

    @abstractmethod
    def inner(self, u: Floats, v: Floats) -> Floats:
        """Return the means (k, m) over the manifold of the products of u's columns (n, k) with v's (n, m)."""

    def totals(self, u: Floats) -> Floats | None:
        """Return the integrals (channels,) of u over the manifold; None where the form knows no exact ones."""
        return None

    @abstractmethod
    def rows(self, points: Floats, side: Sides = None) -> csr_array:
        """Return the matrix (k, n) that reads u at the manifold's points nearest to ``points`` (k, d)."""

    def gradient_rows(self, points: Floats, side: Sides = None) -> tuple[csr_array, ...]:
        """Return the d matrices (k, n) that read the tangential gradient of u, a coordinate each."""
        raise InputError(f"the form {self.form!r} reads no gradients.")

    def evaluate(self, u: Floats, points: Any, side: Sides = None, time: float | None = None) -> Floats:
        """Return the values (k, channels) at the manifold's points nearest to ``points`` (k, d)."""
        return np.asarray(self.rows(points, side) @ u)

    def gradient(self, u: Floats, points: Any, side: Sides = None) -> Floats:
        """Return the tangential gradient (k, channels, d)."""
        return np.stack([rows @ u for rows in self.gradient_rows(points, side)], axis=-1)

    def sides(self, side: Sides) -> Mapping[str, Side]:
        """Return the side that is asked for, by the boundary's name.

        Raises
        ------
        InputError
            If it names no boundary, or is neither left nor right.
        """
        names = [boundary.name for boundary in self.scene.boundaries]
        wanted = side if isinstance(side, Mapping) else {name: side for name in names if side is not None}
        for name, one in wanted.items():
            if name not in names or one not in SIDES:
                raise InputError(
                    f"side must be 'left' or 'right' of one of the boundaries {names}, got {shown(one)} of {name!r}."
                )
        return wanted

    def outflow(self, u: Floats, boundary: str, side: Side, points: Any) -> Floats:
        """Return du/db (k, channels), b out of ``side``, at the points of a boundary nearest to ``points``."""
        raise InputError(f"the form {self.form!r} tells no flux through boundary {boundary!r}.")

    def rim_outflow(self, u: Floats, points: Floats) -> Floats:
        """Return du/db (k, channels), b outwards, at ``points`` of the edge."""
        raise InputError(f"the form {self.form!r} tells no flux through the edge.")

    def flux(self, u: Floats, boundary: str | int, side: Side | None, time: float | None) -> Floats | None:
        """Return the integrals (channels,) of du/db over a side of a boundary, or a loop of the rim, or ``"edge"``.

        None where the form has no better way than to read du/db at points.
        """
        del u, boundary, side, time
        return None

    # Fluxes that depend on the solution

    @property
    def state_fluxes(self) -> Sequence[StateFlux]:
        """Where conditions' fluxes depend on the solution."""
        self.require("fluxes that depend on u")
        return ()

    def linearized(self, seen: Sequence[Floats]) -> Self:
        """Return this with the fluxes replaced by their tangents at u = ``seen`` (k,) for each of the fluxes."""
        return self

    # Pieces, constants, signs

    def free_constants(self, stiffness: Stiffness) -> Border | None:
        """Return the pieces on which a constant is free, with means over them; None where there is none."""
        return free_pieces(stiffness, lambda: self.mass)

    def means_without_flux(self) -> csr_array | None:
        """Return the means (k, n) over pieces that nothing flows out of, where the form tells them exactly enough."""
        return None

    def indefinite(self, stiffness: Stiffness) -> tuple[str, int]:
        """Return a sentence where A has an eigenvalue of the wrong sign, and the products that it took to look.

        Raises
        ------
        ResolutionError
            Where that makes solutions worthless.
        """
        return "", 0

    def surely_positive(self) -> bool:
        """Tell whether the continuous operator surely has no eigenvalue below zero."""
        terms = self.scene.problem.terms()
        if terms.velocity is not None or float(self.read(terms.c, "the factor c").min(initial=0.0)) < 0:
            return False
        return all(takes_nothing(one.law) for one in self.scene.conditions)

    def largest_eigenvalue(self, stiffness: Stiffness) -> float:
        """Return a bound of ``|A u| / |u|``, by Gershgorin's circles."""
        return float(abs(stiffness.to_csr()).sum(axis=1).max())

    def check_signs(self, least: float, noticed: float) -> None:
        """Refuse a ``least`` eigenvalue farther below zero than ``noticed`` where the continuous problem has none.

        Raises
        ------
        ResolutionError
            If so.
        """

    def remove_constants(self, operator: Operator, b: Floats, u: Floats) -> SteadyResult:
        """Return the solution u of ``operator u = b`` with free constants taken out and what has no solution told."""
        if not isinstance(operator, Bordered):
            return SteadyResult(u)
        return SteadyResult(*defects_of(operator, b, u, self))

    # Telling

    def condition_data(self) -> Iterable[DataAtPoints]:
        """Return the data of conditions, and the points in the scene's coordinates at which they are read."""
        return ()

    def warnings(self, missed: float = 0.0) -> tuple[str, ...]:
        """Return what a reader of any solution should know; ``missed`` is the share by which a mean was off."""
        return ()

    def cure(self) -> str:
        """Return what may help an iteration that does not converge, as the end of a sentence."""
        return ""

    def source_error(self, apart: float | None = None) -> float:
        """Return the share of the solution's range that the source alone leaves as an error, whatever the spacing.

        ``apart`` is by how much a solution differs on the flat triangles of a mesh that is read as smooth, root mean
        square as a share of its range, where that is known.
        """
        del apart
        return advice_of(self.scene.surface, self.spacing).floor

    def order_of_difference(self, ratio: float, coarser: Discretized | None = None, apart: float = 0.0) -> float:
        """Return the order p with which ``|u_h - u_rh| / (r^p - 1)`` estimates the error.

        Parameters
        ----------
        ratio : float
            Of spacings, r.
        coarser : Discretized, optional
            What u_rh is on, if it is known already.
        apart : float
            Root mean square of the difference, as a share of the solution's range.
        """
        del ratio, coarser, apart
        return 2.0

    def eigenvalue_order(self, ratio: float, coarser: Discretized | None = None, apart: float = 0.0) -> float:
        """Return the same for eigenvalues, which may converge faster than functions."""
        return self.order_of_difference(ratio, coarser, apart)

    @property
    def no_estimate(self) -> str:
        """Why no error can be estimated, in a sentence; empty where one can."""
        return ""

    def expected_error(self, u: Floats) -> ExpectedError | None:
        """Return about the error of u (unknowns, channels) from u alone, None where that is not known.

        An estimate by another solution is put right by it, and a spacing foretold where no other solution is there.
        """
        del u
        return None

    @property
    def slow(self) -> str:
        """Why errors may fall slowly with the spacing; empty where nothing says so."""
        return ""

    @property
    def unresolved(self) -> bool:
        """Whether parts of the manifold bend too sharply for the spacing, or come too near to others."""
        return False

    @property
    def unresolved_share(self) -> float:
        """About what share of the manifold lies in pieces too small for the lattice: u is one value on each."""
        return 0.0

    def slow_beside(self, coarser: Discretized) -> str:
        """Return the same where a solution on a coarser lattice is there to compare."""
        del coarser
        return self.slow

    def work(self, operator: Operator, report: SolveReport | None) -> MeasuredWork:
        """Return what a solve cost."""
        return PlainWork(self.size, operator.nonzeros, report.operator_applications if report else 0)

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """Return how the scene was discretised, as plain values."""

    def arrays(self) -> dict[str, Any]:
        """Return the arrays by which a saved solution is recognised and rebuilt; none where a mesh holds it."""
        return {}

    def differs_from(self, saved: Mapping[str, Any]) -> str:
        """Return in what a saved solution, known by its :meth:`arrays`, is of another scene; empty where in nothing."""
        return ""

    def fingerprint(self, stiffness: Stiffness) -> list[Floats]:
        """Return arrays that differ where another run in time would differ."""
        matrix = stiffness.to_csr()
        return [matrix.data, matrix.indices, matrix.indptr]

    def display_mesh(self, u: Floats) -> DisplayMesh | None:
        """Return the form's own mesh with u at its vertices; None to take the surface's, cut along the boundaries."""
        return None

    @property
    def doubled(self) -> Floats:
        """(k, d) the feet of further unknowns at nodes that several sheets of the surface share."""
        return np.zeros((0, self.scene.surface.dim))

    def signed_distance(self, name: str, points: Any) -> Floats:
        """Return the distance (k,) of ``points`` from a boundary, positive on its left; NaN where it has no side."""
        raise InputError(f"the form {self.form!r} tells no side of boundary {name!r}.")
