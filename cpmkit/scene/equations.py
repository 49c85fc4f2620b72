"""Steady linear equations on the manifold, and the base class of all equations.

All are written with -Lap, so that diffusion is a positive operator: ``laplace`` -Lap u = 0, ``poisson``
-Lap u = f, ``screened`` -Lap u + c u = f with c > 0, ``elliptic`` -div(a grad u) + v . grad u + c u = f,
``helmholtz`` -Lap u - k^2 u = f.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.runtime.arrays import number, positive
from cpmkit.scene.conditions import Condition
from cpmkit.scene.data import Data, read_formulas
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
    """Terms of a linear equation ``-div(diffusivity grad u) + velocity . grad u + c u = f``.

    Attributes
    ----------
    f : Data
        Right-hand side.
    c : number or callable
        Factor of u.
    diffusivity : number, (d, d) array or callable
        Factor of grad u in the flux.
    velocity : callable or None
        Velocity that transports u.
    conservative : bool
        Whether the advection term is div(velocity u).
    lumped : bool
        Whether the matrix of c u is lumped, a diagonal matrix.
    """

    f: Data = 0.0
    c: Any = 0.0
    diffusivity: Any = 1.0
    velocity: VectorField | None = None
    conservative: bool = False
    lumped: bool = False

    def __str__(self) -> str:
        """Return the equation as a formula."""
        a = self.diffusivity
        varies = callable(a) or np.ndim(a) > 0
        second = "-div(a grad u)" if varies else "-Lap u" if a == 1 else f"-{a:g} Lap u"
        first = "" if self.velocity is None else " + div(v u)" if self.conservative else " + v . grad u"
        zeroth = " + c u" if callable(self.c) else f" {'+' if self.c > 0 else '-'} {abs(self.c):g} u" if self.c else ""
        return f"{second}{first}{zeroth} = f"

    @property
    def fixes_constant(self) -> bool:
        """True if c may determine the constant part of u; a callable c does so on each piece where it is not zero."""
        return callable(self.c) or self.c != 0


def check_conservative(conservative: Any, velocity: VectorField | None, label: str) -> None:
    """Raise if ``conservative`` is not a bool, or is True without a velocity.

    Raises
    ------
    InputError
        In these cases; ``label`` is the name of the equation in the message.
    """
    if not isinstance(conservative, bool):
        raise InputError(f"conservative of {label} must be True or False, got {shown(conservative)}.")
    if conservative and velocity is None:
        raise InputError(f"conservative of {label} is about a velocity, and there is none; give one, or leave it out.")


def check_factor(c: Data, label: str) -> None:
    """Raise if a factor of u is neither a finite number nor a function of points.

    Raises
    ------
    InputError
        In this case; ``label`` is the name of the factor in the message.
    """
    if not callable(c):
        try:
            number(c, label)
        except InputError as error:
            raise InputError(
                f"{label} must be a finite number or a function of points such as ck.VertexData(surface, values), got "
                f"{shown(c)}."
            ) from error


@dataclass(frozen=True, eq=False)
class Equation(ABC, Generic[Family]):
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

    def __post_init__(self) -> None:
        read_formulas(self, self.kind)

    @abstractmethod
    def terms(self) -> Terms:
        """Return the terms of the equation, or of its spatial part if it has a time derivative."""

    @property
    def start_time(self) -> float | None:
        """Time of the initial data; None for equations without time."""
        return None

    def factors_up_to(self, multigrid: bool) -> float:
        """Return the largest number of unknowns for the direct solver, in units of that for a single definite system.

        ``multigrid`` says whether the form has multigrid, to which the direct solver is then compared.
        """
        factor = self.factorise_beside_multigrid if multigrid else None
        return self.factorise_up_to if factor is None else factor

    def __str__(self) -> str:
        return str(self.terms())

    def check_conditions(self, conditions: Sequence[tuple[str, Condition]]) -> None:
        """Raise if the equation does not accept one of ``conditions``, pairs of the name of a place and its condition.

        Raises
        ------
        SceneError
            For the first condition that is not accepted.
        """
        for label, condition in conditions:
            refusal = condition.refusal(self)
            if refusal:
                raise SceneError(f"{label}: {condition.kind!r} {refusal}; {self.accepted}.")

    def data(self) -> list[tuple[str, Data]]:
        """Return the data with one value for each channel, each after its name in error messages."""
        return [("the right-hand side f", self.terms().f)]


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

    def terms(self) -> Terms:
        """Return the terms of the equation."""
        return Terms(self.f)


@dataclass(frozen=True, eq=False)
class Laplace(Equation):
    """-Lap u = 0."""

    # King et al. (2024), eq. 20.
    kind: ClassVar[str] = "laplace"

    def terms(self) -> Terms:
        """Return the terms of the equation."""
        return Terms()


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
    c: float = 1.0
    lumped: bool = False
    # King et al. (2024), eq. 19; with c = 1 / t, eq. 23.
    kind: ClassVar[str] = "screened"

    def __post_init__(self) -> None:
        super().__post_init__()
        positive(self.c, "c of a screened Poisson problem")

    def terms(self) -> Terms:
        """Return the terms of the equation."""
        return Terms(self.f, float(self.c), lumped=self.lumped)


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
        If a constant diffusivity is not positive or not symmetric, or c is neither a finite number nor a function.

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
    diffusivity: Data = 1.0
    velocity: VectorField | None = None
    c: Data = 0.0
    conservative: bool = False
    kind: ClassVar[str] = "elliptic"

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "diffusivity", as_diffusivity(self.diffusivity, "diffusivity of an elliptic problem"))
        check_factor(self.c, "c of an elliptic problem")
        check_conservative(self.conservative, self.velocity, "an elliptic problem")

    def terms(self) -> Terms:
        """Return the terms of the equation."""
        return Terms(self.f, self.c, self.diffusivity, self.velocity, self.conservative)


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
    wavenumber: float
    kind: ClassVar[str] = "helmholtz"
    factorise_up_to: ClassVar[float] = 10.0
    factorise_beside_multigrid: ClassVar[float | None] = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        positive(self.wavenumber, "wavenumber of a Helmholtz problem")

    def terms(self) -> Terms:
        """Return the terms of the equation."""
        return Terms(self.f, -(float(self.wavenumber) * float(self.wavenumber)))
