"""Records that forms and families of equations exchange: coefficients, results, measures of work, diagnoses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Protocol

from cpmkit.types import Floats

#: The first words of a form's warning that errors may be large, which an error estimate within a tolerance refutes.
LARGE_ERRORS = "Errors may be large"


@dataclass(frozen=True, eq=False)
class StateDependentCoefficient:
    """A coefficient of the equation that depends on u, with the function u at which it is evaluated.

    The form evaluates u and its gradient where it needs the coefficient.
    """

    needs_state: ClassVar[bool] = True
    #: Takes the values (k,) of u, its tangential gradients (k, d) and the points (k, d) in the scene's coordinates;
    #: returns numbers (k,), symmetric tensors (k, d, d), or, as the field of an advection, vectors (k, d).
    coefficient: Callable[[Floats, Floats, Floats], Floats]
    u: Floats  #: (n, 1): the unknowns of u.
    #: Takes the same arguments; returns numbers (k,) by which penalties and stabilisation are scaled. By default the
    #: coefficient itself, or the mean of a tensor. A Newton tangent has the function of the original coefficient.
    penalty_coefficient: Callable[[Floats, Floats, Floats], Floats] | None = None


class StateFlux(Protocol):
    """A part of a boundary on which the flux of a condition depends on u."""

    @property
    def guess(self) -> float:
        """The value of u at which Newton's method starts."""

    @property
    def points(self) -> Floats:
        """(k, d) the points at which the flux is evaluated."""

    def read(self, u: Floats, /) -> Floats:
        """Return the values (k,) at the points of the function with the unknowns ``u`` (n, 1)."""

    def grows(self, seen: Floats, /) -> bool:
        """Return whether the flux changes with u at u = ``seen`` (k,); if not, u + constant has an equal flux."""


@dataclass(frozen=True)
class Dispersion:
    """The errors of eigenvalues lambda = k^2 of -Lap at a spacing h.

    The error is about ``lambda (waves (k h)^power + bends (h / radius)^bend_power)``, radius that of curvature.
    """

    #: resolved, coarsest: k h, radians of a wave per spacing, at which eigenvalues have errors of 1 and of 2 percent;
    #: for larger k h eigenvalues after the first few cannot be distinguished.
    resolved: float
    coarsest: float
    power: int  #: Order of convergence of eigenvalues.
    #: waves, bends: Coefficients, measured on the circle and the sphere.
    waves: float
    bends: float
    bend_power: int = 2  #: Order of convergence with respect to the curvature of the manifold.

    def error(self, eigenvalue: float, spacing: float, radius: float) -> float:
        """Return the expected absolute error of ``eigenvalue`` on a manifold with this ``radius`` of curvature."""
        waves = self.waves * (eigenvalue * spacing**2) ** (self.power / 2)
        return float(eigenvalue * (waves + self.bends * (spacing / radius) ** self.bend_power))


#: The dispersion of difference formulas of second order: ten nodes a wavelength for errors of 1 percent, six for 2.
SECOND_ORDER = Dispersion(resolved=0.6, coarsest=1.0, power=2, waves=0.03, bends=0.2)


@dataclass(frozen=True)
class PlainWork:
    """Measures of work that every form has."""

    unknowns: int  #: Size of the linear system.
    nonzeros: int  #: Stored entries of the matrix.
    operator_applications: int  #: Products of the matrix with a vector, all channels counted.

    def as_dict(self) -> dict[str, Any]:
        """Return all measures by name, as numbers."""
        return asdict(self)


class MeasuredWork(Protocol):
    """Work of a solve in units that do not depend on the machine."""

    @property
    def unknowns(self) -> int:
        """Size of the linear system."""

    def as_dict(self) -> dict[str, Any]:
        """Return all measures by name, as numbers or tables of numbers."""


class FormPart(Protocol):
    """The members of one dimension in a union of several dimensions, which have a form of their own."""

    @property
    def dim(self) -> int:
        """The dimension of the members."""

    @property
    def form(self) -> Any:
        """The form of the scene on these members."""

    @property
    def unknowns(self) -> slice:
        """Their unknowns among those of the union."""

    @property
    def points(self) -> slice:
        """Their points among those of the union."""


@dataclass(frozen=True)
class FormTraits:
    """Properties of a form and the equation of its scene that solvers, families and saved files read."""

    #: The solver of systems too large for a factorisation: "multigrid", "reference", or "direct" if there is none.
    iterative_solver: str = "reference"
    factorise_up_to: float = 1.0  #: A factorisation is chosen up to so many times the usual number of unknowns.
    dispersion: Dispersion = SECOND_ORDER  #: Errors of eigenvalues and waves.
    work_record: type = PlainWork  #: The class of the record that ``work`` returns.
    #: A degree with which small errors cost less on the scene's manifold; None if no such degree is known.
    higher_degree: int | None = None
    parts: Sequence[FormPart] = ()  #: In a union of several dimensions the form of each; else empty.
    libraries: tuple[str, ...] = ("cpmkit", "numpy", "scipy")  #: Distributions whose versions a summary lists.


@dataclass(frozen=True, eq=False)
class ExpectedError:
    """An estimate of the error of a solution from that solution alone."""

    #: rms, largest (channels,): root mean square and largest error, in the solution's unit, mostly right to a factor 2.
    rms: Floats
    largest: Floats
    unresolved: bool  #: Whether u has waves or peaks that the lattice hardly resolves; errors may then be larger.
    #: Whether u is singular so that two solutions may have equal errors, and differ by less than the error.
    differences_cancel: bool = False


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """How the error of a solution falls with the spacing, and how much of the manifold the lattice does not resolve."""

    order: float = 2.0  #: The order p with which ``|u_h - u_rh| / (r^p - 1)`` estimates the error of u_h.
    slow: str = ""  #: Why the error may fall slowly with the spacing; empty without a reason.
    #: Why differences of two solutions do not measure the error, in a sentence; empty if they do.
    no_estimate: str = ""
    unresolved: bool = False  #: Whether parts of the manifold are curved too sharply, or too near to other parts.
    unresolved_share: float = 0.0  #: The share of the manifold in pieces so small that u has one value on each.
    #: (k, d): closest points of the further unknowns at nodes that several sheets of the manifold share.
    doubled: Floats | None = None
    #: (t, k, d): the k ends of each tie: a facet on no boundary where the mesh is cut and u is continuous.
    ties: Floats | None = None
