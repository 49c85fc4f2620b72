"""The standard laws: what may hold on a side of a boundary, in the few shapes that forms translate into equations.

Forms know these and no class of conditions; every condition tells which of them it is. A law on one side reads
``alpha du/db + beta u = datum`` with b the conormal out of that side, where what depends on the solution itself (lambda
u, a nonlinear flux) counts as zero until it is known.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import InputError
from cpmkit.protocols import Bools, Floats
from cpmkit.scene.data import Data, evaluate_data

#: Step of the differences that replace a slope, as a share of the value.
SLOPE_DIFFERENCE_SHARE = 1e-6


class _Standard:
    """What every law tells of itself.

    Attributes
    ----------
    families : tuple of str
        The families of equations that take it.
    needs : str
        Why others do not: the predicate of a sentence on a condition.
    """

    families: ClassVar[tuple[str, ...]] = ("steady", "time", "eigen", "coupled")
    needs: ClassVar[str] = "says nothing of Lap u"


@dataclass(frozen=True, eq=False)
class Value(_Standard):
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
class Flux(_Standard):
    """du/db = datum."""

    datum: Data
    alpha: ClassVar[float] = 1.0
    beta: ClassVar[float] = 0.0
    families: ClassVar[tuple[str, ...]] = ("steady", "time", "eigen", "biharmonic", "coupled")


@dataclass(frozen=True, eq=False)
class Mixed(_Standard):
    """alpha du/db + beta u = datum, alpha a number other than zero, beta a number or a callable of points."""

    alpha: float
    beta: float | Callable[..., Any]
    datum: Data


@dataclass(frozen=True, eq=False)
class Spectral(_Standard):
    """du/db = lambda u, lambda being the eigenvalue that is sought."""

    alpha: ClassVar[float] = 1.0
    beta: ClassVar[float] = 0.0
    datum: ClassVar[float] = 0.0
    families: ClassVar[tuple[str, ...]] = ("eigen",)
    needs: ClassVar[str] = "has a lambda that only an eigenvalue problem seeks"


@dataclass(frozen=True, eq=False)
class Nonlinear(_Standard):
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
            If the function returns anything but (n,) finite numbers.
        """
        return _called(self.flux, values, points)

    def slope_at(self, values: Floats, points: Floats) -> Floats:
        """Return the flux's derivative (n,) with respect to u, by differences where no slope is given."""
        if self.slope is not None:
            return _called(self.slope, values, points)
        size = np.abs(values)
        step = SLOPE_DIFFERENCE_SHARE * np.maximum(size, size.max(initial=0.0) or 1.0)
        ahead, behind = (_called(self.flux, values + sign * step, points) for sign in (1, -1))
        return np.asarray((ahead - behind) / (2 * step))


@dataclass(frozen=True, eq=False)
class Interface(_Standard):
    """Both sides coupled: ``u_left - u_right = jump + resistance * flow``, ``k_left u_b + k_right u_b = flux``.

    ``left`` and ``right`` are the conductivities k, None for the problem's; the flow is that from left to right.
    """

    jump: Data
    flux: Data
    resistance: float = 0.0
    left: Data | None = None
    right: Data | None = None


#: What holds on one side, whatever holds on the other.
OneSided = Value | Flux | Mixed | Spectral | Nonlinear
#: What a condition may be.
Law = OneSided | Interface


def data_of(law: Law) -> list[tuple[str, Data]]:
    """Return the data of a law and what each is; none where they depend on the solution."""
    if isinstance(law, Interface):
        return [("jump", law.jump), ("flux", law.flux)]
    if isinstance(law, Support):
        return [("value", law.datum), ("Laplacian", law.laplacian)]
    return [] if isinstance(law, (Spectral, Nonlinear)) else [("datum", law.datum)]


def law_of_laplacian(law: Law) -> Law:
    """Return the law that holds for Lap u in a biharmonic problem where ``law`` holds for u: a value, or no flux."""
    return Value(law.laplacian if isinstance(law, Support) else 0.0) if isinstance(law, Value) else Flux(0.0)


def is_zero_neumann(law: Law) -> bool:
    """Tell whether nothing flows through: the flux is zero everywhere."""
    return isinstance(law, Flux) and not callable(law.datum) and not np.any(np.asarray(law.datum, dtype=object))


def beta_at(law: OneSided, points: Floats, label: str) -> Floats:
    """Return beta (n,) at ``points`` (n, d) of the boundary, in the scene's coordinates."""
    return evaluate_data(law.beta, points, 1, f"beta of {label}")[:, 0]


def fixes_constant(law: Law, points: Floats, label: str) -> Bools:
    """Tell at which ``points`` (n, d) of the boundary a law does not hold for u + constant if it does for u, (n,)."""
    if isinstance(law, (Interface, Nonlinear)):
        return np.full(len(points), isinstance(law, Nonlinear))
    return np.asarray(beta_at(law, points, label) != 0)


def is_dissipative(law: Law) -> bool:
    """Tell whether a law surely takes nothing from the operator's sign: no eigenvalue falls below zero by it."""
    if isinstance(law, Mixed):
        return not callable(law.beta) and law.alpha * law.beta >= 0
    return isinstance(law, (Value, Flux))


def _called(function: Callable[..., object], values: Floats, points: Floats) -> Floats:
    """Return a flux or its slope (n,), of values alone or of values and points."""
    parameters = inspect.signature(function).parameters.values()
    several = sum(parameter.default is parameter.empty for parameter in parameters) > 1
    found = np.asarray(function(values, points) if several else function(values), dtype=np.float64)
    found = np.broadcast_to(found, values.shape) if found.ndim == 0 else found
    if found.shape != values.shape or not np.isfinite(found).all():
        raise InputError(
            f"a nonlinear flux must return {len(values)} finite numbers for as many values, got shape {found.shape}"
            f"{'' if np.isfinite(found).all() else ' with NaN or infinity'}."
        )
    return found
