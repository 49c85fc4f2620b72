"""Equations: what is solved on the manifold, and its right-hand side.

All are written with -Lap, so that every operator is positive: ``laplace`` -Lap u = 0, ``poisson``
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
from cpmkit.protocols import Floats
from cpmkit.runtime.arrays import number, positive
from cpmkit.scene.conditions import Condition
from cpmkit.scene.data import Data, evaluate_data, read_formulas
from cpmkit.scene.diffusivities import as_diffusivity


class EquationFamily:
    """Marks equations by the kind of their solution: one function, unless a derived class says otherwise."""


class EigenFamily(EquationFamily):
    """Marks equations whose solution is eigenvalues and eigenfunctions."""


class TimeFamily(EquationFamily):
    """Marks equations whose solution depends on the time."""


if TYPE_CHECKING:
    from typing_extensions import TypeVar as Defaulted

    #: Marks the kind of an equation's solution; type variables have a default for type checkers, and since Python 3.13.
    Family = Defaulted("Family", covariant=True, bound=EquationFamily, default=EquationFamily)
else:
    Family = TypeVar("Family")

#: A vector field: a function of points (n, d) that returns (n, d), or one number or formula a coordinate.
VectorField = Callable[..., Any] | list[Any] | tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class Terms:
    """``-div(diffusivity grad u) + velocity . grad u + c u = f``.

    Attributes
    ----------
    f : Data
        Right-hand side.
    c : number or callable
        Factor of u.
    diffusivity : number, (d, d) array or callable
        Factor of grad u in the flux.
    velocity : callable or None
        What carries u along.
    conservative : bool
        Whether the velocity's term is div(velocity u).
    lumped : bool
        Whether the integrals of c u v are those of c times the interpolated product: a diagonal matrix.
    """

    f: Data = 0.0
    c: Any = 0.0
    diffusivity: Any = 1.0
    velocity: VectorField | None = None
    conservative: bool = False
    lumped: bool = False

    def __str__(self) -> str:
        a = self.diffusivity
        varies = callable(a) or np.ndim(a) > 0
        second = "-div(a grad u)" if varies else "-Lap u" if a == 1 else f"-{a:g} Lap u"
        first = "" if self.velocity is None else " + div(v u)" if self.conservative else " + v . grad u"
        zeroth = " + c u" if callable(self.c) else f" {'+' if self.c > 0 else '-'} {abs(self.c):g} u" if self.c else ""
        return f"{second}{first}{zeroth} = f"

    @property
    def fixes_constant(self) -> bool:
        """True where c alone may fix the solution: a callable c fixes it on the pieces where it is not zero."""
        return callable(self.c) or self.c != 0

    def fixes_constant_at(self, points: Floats) -> bool:
        """Tell whether c alone fixes the solution on a piece of the manifold that has ``points`` (n, d) on it."""
        return self.fixes_constant and bool(np.any(evaluate_data(self.c, points, 1, "the factor c")))


def check_conservative(conservative: Any, velocity: VectorField | None, label: str) -> None:
    """Refuse ``conservative`` unless it is a flag, and unless there is a velocity where it is set.

    Raises
    ------
    InputError
        Naming ``label``.
    """
    if not isinstance(conservative, bool):
        raise InputError(f"conservative of {label} must be True or False, got {shown(conservative)}.")
    if conservative and velocity is None:
        raise InputError(f"conservative of {label} is about a velocity, and there is none; give one, or leave it out.")


def check_factor(c: Data, label: str) -> None:
    """Refuse a factor of u that is neither a finite number nor a function of points.

    Raises
    ------
    InputError
        Naming ``label``.
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
    """What every equation tells."""

    kind: ClassVar[str]
    #: Which function solves it: "steady", "time", "eigen" or "biharmonic".
    family: ClassVar[str] = "steady"
    #: How many times more unknowns than of one definite system a factorisation is worth.
    factorise_up_to: ClassVar[float] = 1.0
    #: The same where the form has a multigrid; None for the same number.
    factorise_beside_multigrid: ClassVar[float | None] = None
    #: What to give in place of a condition that is refused.
    accepted: ClassVar[str] = "use Dirichlet, Neumann or Robin"

    def __post_init__(self) -> None:
        read_formulas(self, self.kind)

    @abstractmethod
    def terms(self) -> Terms:
        """Return the terms of the equation, of its spatial part where it has a time."""

    @property
    def start_time(self) -> float | None:
        """Time at which data are read first; None where the problem has no time."""
        return None

    def factors_up_to(self, multigrid: bool) -> float:
        """Return how many times more unknowns than of one definite system a factorisation is worth."""
        beside = self.factorise_beside_multigrid if multigrid else None
        return self.factorise_up_to if beside is None else beside

    def __str__(self) -> str:
        return str(self.terms())

    def check_conditions(self, conditions: Sequence[tuple[str, Condition]]) -> None:
        """Refuse conditions, given with their places' names, that the equation does not take.

        Raises
        ------
        SceneError
            Naming the first.
        """
        for label, condition in conditions:
            refusal = condition.refusal(self)
            if refusal:
                raise SceneError(f"{label}: {condition.kind!r} {refusal}; {self.accepted}.")

    def data(self) -> list[tuple[str, Data]]:
        """Return what has channels, by the names that errors use."""
        return [("the right-hand side f", self.terms().f)]


@dataclass(frozen=True, eq=False)
class Poisson(Equation):
    """-Lap u = f.

    Parameters
    ----------
    f : number, text, sequence, or callable
        Right-hand side on the manifold: a number, a formula such as ``"x*y"``, one entry a channel, or a function of
        points (n, d).
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
        Above zero, in one over the square of the unit of length.
    lumped : bool
        Whether c u is integrated by a diagonal matrix, the row sums of the other, so that a solution that decays from
        spacing to spacing (c of the order of one over the spacing's square) does not swing below zero. Collocation has
        no other.

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
    """-div(a grad u) + v . grad u + c u = f: diffusion of variable conductivity, advection, and a reaction.

    Parameters
    ----------
    f : number, sequence, or callable
        Right-hand side, as for :class:`Poisson`.
    diffusivity : number, symmetric tensor, or callable
        a, above zero; a callable of points (n, d) returns (n,). A tensor, whose part between tangents of the manifold
        counts and is positive definite, is a (d, d) array, d lists of d numbers or callables, or a callable that
        returns (n, d, d). Beside a boundary du/db then is the derivative along a b / (b . a b): that times b . a b is
        what flows out.
    velocity : callable, optional
        v, a function of points (n, d) that returns vectors (n, d) tangential to the manifold.
    c : number or callable
        Factor of u; where it is below zero the problem may have no solution, or several.
    conservative : bool
        Whether the velocity's term is div(v u), so that what leaves one place arrives at another; in the Galerkin form.

    Raises
    ------
    InputError
        If a constant diffusivity is not above zero or not symmetric, or c neither a finite number nor a function.

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
    """-Lap u - k^2 u = f: standing waves, driven.

    Near an eigenvalue of -Lap the solution is large, and at one there is none.

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
