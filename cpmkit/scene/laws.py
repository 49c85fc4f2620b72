"""The standard laws of conditions, which forms discretise; forms know no class of conditions.

Every condition has one of these laws. A law on one side is ``alpha du/db + beta u = datum`` with b the conormal out of
that side; terms that depend on the solution (lambda u, a nonlinear flux) are not part of it.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import InputError
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.types import Bools, Floats

#: Step of the finite differences that replace a derivative, as a share of the value.
SLOPE_DIFFERENCE_SHARE = 1e-6


class _Law:
    """Base class of laws.

    Attributes
    ----------
    families : tuple of str
        The families of equations that accept it.
    needs : str
        Why other families do not accept it, a predicate for a sentence on a condition.
    """

    families: ClassVar[tuple[str, ...]] = ("steady", "time", "eigen", "coupled")
    needs: ClassVar[str] = "says nothing of Lap u"


@dataclass(frozen=True, eq=False)
class Value(_Law):
    """u = datum; in a biharmonic problem Lap u = 0 too."""

    datum: Data
    alpha: ClassVar[float] = 0.0
    beta: ClassVar[float] = 1.0
    families: ClassVar[tuple[str, ...]] = ("steady", "time", "eigen", "biharmonic", "coupled")


@dataclass(frozen=True, eq=False)
class Support(Value):
    """u = datum and Lap u = laplacian."""

    laplacian: Data = 0.0
    families: ClassVar[tuple[str, ...]] = ("biharmonic",)
    needs: ClassVar[str] = "gives a Lap u that only a biharmonic problem takes"


@dataclass(frozen=True, eq=False)
class Flux(_Law):
    """du/db = datum."""

    datum: Data
    alpha: ClassVar[float] = 1.0
    beta: ClassVar[float] = 0.0
    families: ClassVar[tuple[str, ...]] = ("steady", "time", "eigen", "biharmonic", "coupled")


@dataclass(frozen=True, eq=False)
class Mixed(_Law):
    """alpha du/db + beta u = datum, with a number alpha other than zero and a number or function of points beta."""

    alpha: float
    beta: float | Callable[..., Any]
    datum: Data


@dataclass(frozen=True, eq=False)
class Spectral(_Law):
    """du/db = lambda u with the unknown eigenvalue lambda."""

    alpha: ClassVar[float] = 1.0
    beta: ClassVar[float] = 0.0
    datum: ClassVar[float] = 0.0
    families: ClassVar[tuple[str, ...]] = ("eigen",)
    needs: ClassVar[str] = "has a lambda that only an eigenvalue problem seeks"


@dataclass(frozen=True, eq=False)
class Nonlinear(_Law):
    """du/db = flux(u), or flux(u, points); Newton's method starts where u is ``guess``."""

    flux: Callable[..., Any]
    slope: Callable[..., Any] | None = None
    guess: float = 1.0
    alpha: ClassVar[float] = 1.0
    beta: ClassVar[float] = 0.0
    datum: ClassVar[float] = 0.0
    families: ClassVar[tuple[str, ...]] = ("steady",)
    needs: ClassVar[str] = "needs a steady equation"

    def flux_at(self, values: Floats, points: Floats) -> Floats:
        """Return the flux (n,) where u is ``values`` (n,), at ``points`` (n, d).

        Raises
        ------
        InputError
            If the function does not return (n,) finite numbers.
        """
        return _call(self.flux, values, points)

    def slope_at(self, values: Floats, points: Floats) -> Floats:
        """Return the flux's derivative (n,) with respect to u, by finite differences if no ``slope`` is given."""
        if self.slope is not None:
            return _call(self.slope, values, points)
        size = np.abs(values)
        step = SLOPE_DIFFERENCE_SHARE * np.maximum(size, size.max(initial=0.0) or 1.0)
        ahead, behind = (_call(self.flux, values + sign * step, points) for sign in (1, -1))
        return np.asarray((ahead - behind) / (2 * step))


@dataclass(frozen=True, eq=False)
class Interface(_Law):
    """Coupling of both sides: ``u_left - u_right = jump + resistance * flow``, ``k_left u_b + k_right u_b = flux``.

    ``left`` and ``right`` are the conductivities k, None for the equation's; the flow is from left to right.
    """

    jump: Data
    flux: Data
    resistance: float = 0.0
    left: Data | None = None
    right: Data | None = None


#: A law on one side.
OneSided = Value | Flux | Mixed | Spectral | Nonlinear
#: The law of a condition.
Law = OneSided | Interface


def data_of(law: Law) -> list[tuple[str, Data]]:
    """Return the names and values of the data of a law; none where they depend on the solution."""
    if isinstance(law, Interface):
        return [("jump", law.jump), ("flux", law.flux)]
    if isinstance(law, Support):
        return [("value", law.datum), ("Laplacian", law.laplacian)]
    return [] if isinstance(law, (Spectral, Nonlinear)) else [("datum", law.datum)]


def law_of_laplacian(law: Law) -> Law:
    """Return the law of Lap u in a biharmonic problem with the law of u: a value, or zero flux."""
    return Value(law.laplacian if isinstance(law, Support) else 0.0) if isinstance(law, Value) else Flux(0.0)


def is_zero_neumann(law: Law) -> bool:
    """Return True if the law is a zero flux."""
    return isinstance(law, Flux) and not callable(law.datum) and not np.any(np.asarray(law.datum, dtype=object))


def beta_at(law: OneSided, points: Floats, label: str) -> Floats:
    """Return beta (n,) at ``points`` (n, d) of the boundary, in the scene's coordinates."""
    return evaluate_data(law.beta, points, 1, f"beta of {label}")[:, 0]


def fixes_constant(law: Law, points: Floats, label: str) -> Bools:
    """Return True (n,) at the ``points`` (n, d) of the boundary where the law determines the constant part of u."""
    if isinstance(law, (Interface, Nonlinear)):
        return np.full(len(points), isinstance(law, Nonlinear))
    return np.asarray(beta_at(law, points, label) != 0)


def is_dissipative(law: Law) -> bool:
    """Return True if a law is known to be dissipative: it makes no eigenvalue of the operator negative."""
    if isinstance(law, Mixed):
        return not callable(law.beta) and law.alpha * law.beta >= 0
    return isinstance(law, (Value, Flux))


def _call(function: Callable[..., object], values: Floats, points: Floats) -> Floats:
    """Return a flux or its derivative (n,), a function of values, or of values and points."""
    parameters = inspect.signature(function).parameters.values()
    several = sum(parameter.default is parameter.empty for parameter in parameters) > 1
    fluxes = np.asarray(function(values, points) if several else function(values), dtype=np.float64)
    fluxes = np.broadcast_to(fluxes, values.shape) if fluxes.ndim == 0 else fluxes
    if fluxes.shape != values.shape or not np.isfinite(fluxes).all():
        raise InputError(
            f"a nonlinear flux must return {len(values)} finite numbers for as many values, got shape {fluxes.shape}"
            f"{'' if np.isfinite(fluxes).all() else ' with NaN or infinity'}."
        )
    return fluxes
