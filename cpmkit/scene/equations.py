"""Steady linear equations on the manifold, and the base class of all equations.

All are written with -Lap, so that diffusion is a positive operator: ``laplace`` -Lap u = 0, ``poisson``
-Lap u = f, ``screened`` -Lap u + c u = f with c > 0, ``elliptic`` -div(a grad u) + v . grad u + c u = f,
``helmholtz`` -Lap u - k^2 u = f.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Self, TypeVar

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.plugins import check_accepted
from cpmkit.runtime.arrays import not_negative, number, positive
from cpmkit.scene.conditions import Condition
from cpmkit.scene.data import Data, ScalarData, TensorData, replace_formulas
from cpmkit.scene.diffusivities import as_diffusivity


class EquationFamily:
    """Type that marks the kind of an equation's solution: a single function, unless it is a derived class."""


class EigenFamily(EquationFamily):
    """Type that marks equations solved by eigenvalues and eigenfunctions."""


class TimeFamily(EquationFamily):
    """Type that marks equations whose solution depends on the time."""


if TYPE_CHECKING:
    from typing_extensions import TypeVar as Defaulted

    #: Marks the kind of an equation's solution; type variables have a default for type checkers, and since Python 3.13.
    Family = Defaulted("Family", covariant=True, bound=EquationFamily, default=EquationFamily)
else:
    Family = TypeVar("Family")

#: A vector field: a function of points (n, d) that returns (n, d), or one number or formula for each coordinate.
VectorField = Callable[..., Any] | list[Any] | tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class Terms:
    """Terms of a linear equation ``-div(diffusivity grad u) + velocity . grad u + c u = f``."""

    f: Data = 0.0  #: Right-hand side.
    c: Any = 0.0  #: Factor of u, a number or a function.
    diffusivity: Any = 1.0  #: Factor of grad u in the flux: a number, a tensor (d, d), or a function.
    velocity: VectorField | None = None  #: Velocity that transports u.
    conservative: bool = False  #: Whether the advection term is div(velocity u).
    capacity: ScalarData = 1.0  #: Factor of u_t in equations in time.
    lumped: bool = False  #: Whether the matrix of c u is lumped, a diagonal matrix.

    def __str__(self) -> str:
        """Return the equation as a formula."""
        a = self.diffusivity
        varies = callable(a) or np.ndim(a) > 0
        second = "-div(a grad u)" if varies else "-Lap u" if a == 1 else f"-{a:g} Lap u"
        first = "" if self.velocity is None else " + div(v u)" if self.conservative else " + v . grad u"
        zeroth = " + c u" if callable(self.c) else f" {'+' if self.c > 0 else '-'} {abs(self.c):g} u" if self.c else ""
        return f"{second}{first}{zeroth} = f"


def _check_scalar(value: ScalarData, label: str) -> ScalarData:
    """Return ``value`` unchanged if it is a function, else as a float.

    Raises InputError if it is neither a function nor a finite number; ``label`` is its name in the message.
    """
    try:
        return value if callable(value) else number(value, label)
    except InputError as error:
        raise InputError(
            f"{label} must be a finite number or a function of points such as ck.VertexData(surface, values), got "
            f"{shown(value)}."
        ) from error


#: A number above zero, and a number above or equal to it.
Positive = float
NotNegative = float
#: Functions that check and convert the fields of equations, by the declared type of the field: they take the value and
#: its name in messages, and return the value to store.
CHECKS: dict[str, Callable[[Any, str], Any]] = {
    "ScalarData": _check_scalar,
    "TensorData": as_diffusivity,
    "Positive": positive,
    "NotNegative": not_negative,
}


@dataclass(frozen=True, eq=False)
class Equation(Generic[Family]):
    """Base class of equations."""

    kind: ClassVar[str]
    #: Name of the solver: "steady", "time", "eigen", "coupled" or "biharmonic".
    family: ClassVar[str] = "steady"
    #: The largest number of unknowns for the direct solver, as a multiple of that for a single definite system.
    factorise_up_to: ClassVar[float] = 1.0
    #: The same multiple in a form with multigrid; None if it is equal.
    factorise_beside_multigrid: ClassVar[float | None] = None
    #: Advice in the error message about a condition that is not accepted.
    accepted: ClassVar[str] = "use Dirichlet, Neumann or Robin"

    def __new__(cls, *_: Any, **keys: Any) -> Self:
        """Return an equation whose fields are not set yet; raise SceneError for a key that is none of its fields."""
        parameters = dict(inspect.signature(cls.__init__).parameters) if keys else {}
        if all(each.kind is not each.VAR_KEYWORD for each in parameters.values()):
            check_accepted(cls.__name__, keys, [*parameters][1:])
        return super().__new__(cls)

    def __post_init__(self) -> None:
        """Replace formulas by functions, and check the fields by their declared types.

        Raises InputError if a field is not accepted, or the equation is conservative without a velocity; SceneError if
        a formula does not parse.
        """
        replace_formulas(self, self.kind)
        for member in fields(self):
            if str(member.type) in CHECKS:
                value = CHECKS[str(member.type)](getattr(self, member.name), f"{member.name} of {self.kind}")
                object.__setattr__(self, member.name, value)
        conservative = getattr(self, "conservative", False)
        if not isinstance(conservative, bool):
            raise InputError(f"conservative of {self.kind} must be True or False, got {shown(conservative)}.")
        if conservative and getattr(self, "velocity", None) is None:
            raise InputError(
                f"conservative of {self.kind} is about a velocity, and there is none; give one, or leave it out."
            )

    def terms(self) -> Terms:
        """Return the terms of the equation, or of its spatial part if it has a time derivative.

        They are the fields of the same names; a field ``kappa`` is the diffusivity.
        """
        own = {"diffusivity" if name == "kappa" else name: value for name, value in vars(self).items()}
        return Terms(**{member.name: own[member.name] for member in fields(Terms) if member.name in own})

    @property
    def start_time(self) -> float | None:
        """Time of the initial data; None for equations without time."""
        return getattr(self, "t0", None)

    def direct_solver_limit(self, multigrid: bool) -> float:
        """Return the largest number of unknowns for the direct solver, in units of that for a single definite system.

        ``multigrid`` is True for a form with multigrid, to which the direct solver is then compared.
        """
        factor = self.factorise_beside_multigrid if multigrid else None
        return self.factorise_up_to if factor is None else factor

    def __str__(self) -> str:
        return str(self.terms())

    def check_conditions(self, conditions: Sequence[tuple[str, Condition]]) -> None:
        """Raise SceneError for the first of ``conditions``, pairs (label in messages, condition), not accepted."""
        for label, condition in conditions:
            refusal = condition.refusal(self)
            if refusal:
                raise SceneError(f"{label}: {condition.kind!r} {refusal}; {self.accepted}.")

    def data(self) -> list[tuple[str, Data]]:
        """Return pairs (name in messages, data) of f and the initial data, which may have a value for each channel."""
        initial = {"initial": "the initial data", "initial_rate": "the initial rate"}
        own = [(label, getattr(self, name)) for name, label in initial.items() if hasattr(self, name)]
        return [("the right-hand side f", self.terms().f), *own]


@dataclass(frozen=True, eq=False)
class Poisson(Equation):
    """-Lap u = f.

    Parameters
    ----------
    f : number, text, sequence, or callable
        Right-hand side: a number, a formula such as ``"x*y"``, one entry for each channel, or a function of points
        (n, d).
    """

    f: Data
    kind: ClassVar[str] = "poisson"


@dataclass(frozen=True, eq=False)
class Laplace(Equation):
    """-Lap u = 0."""

    # King et al. (2024), eq. 20.
    kind: ClassVar[str] = "laplace"


@dataclass(frozen=True, eq=False)
class ScreenedPoisson(Equation):
    """-Lap u + c u = f with c > 0.

    Parameters
    ----------
    f : number, sequence, or callable
        Right-hand side, as for :class:`Poisson`.
    c : float
        Above zero, in the unit of length to the power -2.
    lumped : bool
        Whether the mass matrix of c u is replaced by its row sums, so that a solution that decays within a spacing (c
        of the order of spacing to the power -2) does not become negative. In the collocation form it is diagonal.

    Raises
    ------
    InputError
        If ``c`` is not above zero.
    """

    f: Data
    c: Positive = 1.0
    lumped: bool = False
    # King et al. (2024), eq. 19; with c = 1 / t, eq. 23.
    kind: ClassVar[str] = "screened"


@dataclass(frozen=True, eq=False)
class Elliptic(Equation):
    """-div(a grad u) + v . grad u + c u = f: diffusion, advection and a linear reaction.

    Parameters
    ----------
    f : number, sequence, or callable
        Right-hand side, as for :class:`Poisson`.
    diffusivity : number, symmetric tensor, or callable
        a, above zero; a callable of points (n, d) returns (n,). A tensor, positive definite on the tangent space, is a
        (d, d) array, d lists of d numbers or callables, or a callable that returns (n, d, d); its normal part is
        ignored. With a tensor, du/db is the derivative along a b / (b . a b), and b . a b times it the conormal flux.
    velocity : callable, optional
        v, a function of points (n, d) that returns vectors (n, d) tangential to the manifold.
    c : number or callable
        Factor of u; with negative values the problem may have no solution, or several.
    conservative : bool
        Whether the advection term is div(v u), which conserves the integral of u; in the Galerkin form.

    Raises
    ------
    InputError
        If a diffusivity is a number not above zero or a tensor of another shape or not symmetric, c is neither a finite
        number nor a function, or the equation is conservative without a velocity.

    Examples
    --------
    On a circle whose lower half conducts better, cut at a point.

    >>> import cpmkit as ck
    >>> cut = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), left=ck.Dirichlet(1), right=ck.Dirichlet(0))
    >>> better_below = ck.Elliptic(diffusivity=lambda points: 5.5 - 4.5 * points[:, 1])
    >>> scene = ck.Scene(ck.source("analytic.circle"), better_below, [cut])
    >>> bool(0.5 < ck.solve(scene, spacing=0.05).evaluate([[-1, 0]])[0] < 1)
    True
    """

    f: Data = 0.0
    diffusivity: TensorData = 1.0
    velocity: VectorField | None = None
    c: ScalarData = 0.0
    conservative: bool = False
    kind: ClassVar[str] = "elliptic"


@dataclass(frozen=True, eq=False)
class Helmholtz(Equation):
    """-Lap u - k^2 u = f: driven standing waves.

    For k^2 near an eigenvalue of -Lap the solution is large, and for an eigenvalue there is none.

    Parameters
    ----------
    f : number, sequence, or callable
        Right-hand side, as for :class:`Poisson`.
    wavenumber : float
        k, above zero: 2 pi over the wavelength.

    Raises
    ------
    InputError
        If the wavenumber is not above zero.
    """

    f: Data
    wavenumber: Positive
    kind: ClassVar[str] = "helmholtz"
    factorise_up_to: ClassVar[float] = 10.0
    factorise_beside_multigrid: ClassVar[float | None] = 1.0

    def terms(self) -> Terms:
        """Return the terms of -Lap u + c u = f with c = -wavenumber^2."""
        return Terms(self.f, -self.wavenumber * self.wavenumber)
