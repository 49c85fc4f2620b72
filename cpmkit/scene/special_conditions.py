"""Conditions that are not a linear relation on one side: coupled sides, nonlinear fluxes, eigenvalues, plates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from cpmkit.errors import InputError, shown
from cpmkit.runtime.arrays import not_negative, number, positive
from cpmkit.scene.conditions import Condition
from cpmkit.scene.data import Data, takes_time
from cpmkit.scene.laws import Interface, Nonlinear, Spectral, Support


@dataclass(frozen=True, eq=False)
class Transmission(Condition):
    """Coupling of both sides: ``u_left - u_right = jump + resistance * flow``, with a continuous flux.

    With k the conductivities, ``k_left du/db_left + k_right du/db_right = flux``, with each b out of its side; a
    ``flux`` above zero is a source on the boundary. The flow is the mean of ``-k_left du/db_left`` and
    ``k_right du/db_right``, from left to right. Given to a boundary as ``across``.

    Parameters
    ----------
    jump : number, sequence, or callable
        As for :class:`Dirichlet`.
    flux : number, sequence, or callable
        As for :class:`Dirichlet`.
    left, right : number or callable, optional
        Conductivities, above zero. They must be the equation's diffusivity on each side, which is the default.
    resistance : float
        Of the contact, not below zero.

    Raises
    ------
    InputError
        If a conductivity is not above zero, or the resistance below zero.

    Examples
    --------
    >>> Transmission(jump=1.0, resistance=0.5).kind
    'transmission'
    """

    jump: Data = 0.0
    flux: Data = 0.0
    left: Data | None = None
    right: Data | None = None
    resistance: float = 0.0
    kind: ClassVar[str] = "transmission"

    def __post_init__(self) -> None:
        """Raise InputError if a conductivity is not above zero or depends on t, or the resistance is below zero."""
        super().__post_init__()
        for side in ("left", "right"):
            conductivity = getattr(self, side)
            if conductivity is not None and (not callable(conductivity) or takes_time(conductivity)):
                positive(conductivity, f"{side}, a conductivity of Transmission,")
        not_negative(self.resistance, "resistance of Transmission")

    @property
    def law(self) -> Interface:
        """The law that couples both sides."""
        return Interface(self.jump, self.flux, self.resistance, self.left, self.right)


@dataclass(frozen=True, eq=False)
class Steklov(Condition):
    """du/db = lambda u with the unknown eigenvalue lambda; for eigenvalue problems only.

    Parameters
    ----------
    order : 1 or 2, optional
        Overrides the discretisation's order for this condition.

    Examples
    --------
    The eigenvalues of the unit disc, a solid in the plane, are 0, 1, 1, 2, 2, ...

    >>> import cpmkit as ck
    >>> scene = ck.Scene(ck.source("solid", of=ck.source("analytic.circle")), ck.Eigen(5), edge=ck.Steklov())
    >>> ck.solve(scene, spacing=0.05).eigenvalues.round(2) + 0.0
    array([0., 1., 1., 2., 2.])
    """

    order: int | None = None
    kind: ClassVar[str] = "steklov"
    law_kind: ClassVar[type] = Spectral


@dataclass(frozen=True, eq=False)
class SimplySupported(Condition):
    """u = value and Lap u = laplacian, for biharmonic problems only: a simply supported edge of a plate.

    Parameters
    ----------
    value, laplacian : number, sequence, or callable
        As for :class:`Dirichlet`.
    order : 1 or 2, optional
        Overrides the discretisation's order for this condition.

    Examples
    --------
    >>> SimplySupported(laplacian=2.0).kind
    'simply_supported'
    """

    value: Data = 0.0
    laplacian: Data = 0.0
    order: int | None = None
    kind: ClassVar[str] = "simply_supported"
    law_kind: ClassVar[type] = Support


@dataclass(frozen=True, eq=False)
class NonlinearFlux(Condition):
    """du/db = j(u), with b out of the side on which the condition is given: radiation, or a reaction at the wall.

    Newton's method solves it, with a Robin condition in each step. Where j increases with u there may be no solution,
    or several.

    Parameters
    ----------
    flux : callable
        j, a function of values (n,), or of values (n,) and points (n, d), that returns (n,).
    slope : callable, optional
        Its derivative, of the same arguments; finite differences by default.
    guess : float
        Value of u on the boundary at which Newton's method starts.
    order : 1 or 2, optional
        Overrides the discretisation's order for this condition.

    Raises
    ------
    InputError
        If the flux or its slope is not callable, or the guess not a finite number.

    Examples
    --------
    A bar that is heated at one end and radiates at the other; the solution is u = 2 - x.

    >>> import cpmkit as ck
    >>> bar = ck.source("analytic.segment", start=[0, 0], end=[1, 0])
    >>> ends = {0: ck.Dirichlet(2.0), 1: ck.NonlinearFlux(lambda u: -(u**4))}
    >>> ck.solve(ck.Scene(bar, ck.Laplace(), edge=ends), spacing=0.05).evaluate([[1, 0]]).round(4)
    array([1.])
    """

    flux: Callable[..., Any]
    slope: Callable[..., Any] | None = None
    guess: float = 1.0
    order: int | None = None
    kind: ClassVar[str] = "nonlinear flux"
    law_kind: ClassVar[type] = Nonlinear

    def __post_init__(self) -> None:
        """Convert the guess to a float; raise InputError if it is not finite, or flux or slope is no function."""
        for name, optional in (("flux", False), ("slope", True)):
            function = getattr(self, name)
            if not callable(function) and not (optional and function is None):
                raise InputError(
                    f"{name} of NonlinearFlux must be a function of the values of u, got {shown(function)}."
                )
        super().__post_init__()
        object.__setattr__(self, "guess", number(self.guess, "guess of NonlinearFlux"))
