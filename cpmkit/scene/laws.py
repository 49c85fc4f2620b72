"""Laws: the standard relations to which conditions are reduced; discretisations use laws, and know no conditions.

Every condition has one law. A law on one side is ``alpha du/db + beta u = datum`` with b the conormal out of
that side; terms that depend on the solution (lambda u, a nonlinear flux) are not part of this relation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

from cpmkit.errors import InputError
from cpmkit.scene.data import Data, call_pointwise, central_difference, evaluate_data, is_zero
from cpmkit.types import Floats


class _Law:
    """Base class of laws."""

    #: The families of equations that accept the law.
    families: ClassVar[tuple[str, ...]] = ("steady", "time", "eigen", "coupled")
    #: Why other families do not accept it, as a predicate whose subject is the condition.
    needs: ClassVar[str] = "says nothing of Lap u"
    couples: ClassVar[bool] = False  #: Whether the law couples both sides of a boundary.
    involves_value: ClassVar[bool] = False  #: Whether it is a linear relation with u in it, not only its derivative.
    data_fields: ClassVar[dict[str, str]] = {}  #: Names of the fields that are data, with their names in messages.
    factor_fields: ClassVar[tuple[str, ...]] = ()  #: Names of the fields that are parameters other than data.

    @property
    def data(self) -> list[tuple[str, Data]]:
        """Pairs (name in messages, data); empty if the law has no data, or a flux that depends on the solution."""
        return [(label, getattr(self, name)) for name, label in self.data_fields.items()]

    @property
    def factors(self) -> tuple[Any, ...]:
        """The parameters of the law that are not data."""
        return tuple(getattr(self, name) for name in self.factor_fields)

    @property
    def of_laplacian(self) -> Law:
        """The law of Lap u in a biharmonic problem in which u has this law: zero flux, unless a subclass differs."""
        return Flux(0.0)

    @property
    def is_zero_flux(self) -> bool:
        """True if the law prescribes zero flux."""
        return False

    @property
    def is_dissipative(self) -> bool:
        """True if the law is known to be dissipative, so that it makes no eigenvalue of the operator negative."""
        return False


@dataclass(frozen=True, eq=False)
class Value(_Law):
    """The law u = datum; in a biharmonic problem also Lap u = 0."""

    datum: Data
    data_fields: ClassVar[dict[str, str]] = {"datum": "datum"}
    alpha: ClassVar[float] = 0.0
    beta: ClassVar[float] = 1.0
    involves_value: ClassVar[bool] = True
    is_dissipative: ClassVar[bool] = True
    families: ClassVar[tuple[str, ...]] = ("steady", "time", "eigen", "biharmonic", "coupled")

    @property
    def of_laplacian(self) -> Value:
        """The law Lap u = 0."""
        return Value(0.0)


@dataclass(frozen=True, eq=False)
class Support(Value):
    """The laws u = datum and Lap u = laplacian of a biharmonic problem."""

    laplacian: Data = 0.0
    data_fields: ClassVar[dict[str, str]] = {"datum": "value", "laplacian": "Laplacian"}
    families: ClassVar[tuple[str, ...]] = ("biharmonic",)
    needs: ClassVar[str] = "gives a Lap u that only a biharmonic problem takes"

    @property
    def of_laplacian(self) -> Value:
        """The law Lap u = laplacian."""
        return Value(self.laplacian)


@dataclass(frozen=True, eq=False)
class Flux(_Law):
    """The law du/db = datum."""

    datum: Data
    data_fields: ClassVar[dict[str, str]] = {"datum": "datum"}
    alpha: ClassVar[float] = 1.0
    beta: ClassVar[float] = 0.0
    is_dissipative: ClassVar[bool] = True
    families: ClassVar[tuple[str, ...]] = ("steady", "time", "eigen", "biharmonic", "coupled")

    @property
    def is_zero_flux(self) -> bool:
        """True if the flux is zero everywhere."""
        return is_zero(self.datum)


@dataclass(frozen=True, eq=False)
class Mixed(_Law):
    """The law alpha du/db + beta u = datum, alpha a number other than zero, beta a number or a function of points."""

    alpha: float
    beta: float | Callable[..., Any]
    datum: Data
    data_fields: ClassVar[dict[str, str]] = {"datum": "datum"}
    factor_fields: ClassVar[tuple[str, ...]] = ("alpha", "beta")
    involves_value: ClassVar[bool] = True

    @property
    def is_dissipative(self) -> bool:
        """True if beta is a number with the sign of alpha, or zero."""
        return not callable(self.beta) and self.alpha * self.beta >= 0


@dataclass(frozen=True, eq=False)
class Spectral(_Law):
    """The law du/db = lambda u with the unknown eigenvalue lambda."""

    alpha: ClassVar[float] = 1.0
    beta: ClassVar[float] = 0.0
    datum: ClassVar[float] = 0.0
    families: ClassVar[tuple[str, ...]] = ("eigen",)
    needs: ClassVar[str] = "has a lambda that only an eigenvalue problem seeks"


@dataclass(frozen=True, eq=False)
class Nonlinear(_Law):
    """The law du/db = flux(u), or flux(u, points), of values (n,) and points (n, d), that returns (n,).

    ``slope`` is its derivative by u, of the same arguments. Newton's method starts at u = ``guess`` on the boundary.
    """

    flux: Callable[..., Any]
    slope: Callable[..., Any] | None = None
    guess: float = 1.0
    alpha: ClassVar[float] = 1.0
    beta: ClassVar[float] = 0.0
    datum: ClassVar[float] = 0.0
    families: ClassVar[tuple[str, ...]] = ("steady",)
    needs: ClassVar[str] = "needs a steady equation"

    @property
    def factors(self) -> tuple[Any, ...]:
        """A new object, so that this law is equal to no other, since functions cannot be compared."""
        return (object(),)

    def flux_at(self, values: Floats, points: Floats) -> Floats:
        """Return du/db = flux (n,) for ``values`` (n,) of u at ``points`` (n, d), in the scene's coordinates.

        Raises InputError if the function does not return finite numbers (n,).
        """
        return call_pointwise(self.flux, (values, points), values.shape, "a nonlinear flux")

    def slope_at(self, values: Floats, points: Floats) -> Floats:
        """Return the derivative (n,) of :meth:`flux_at` by u, by central differences if the field ``slope`` is None."""
        if self.slope is not None:
            return call_pointwise(self.slope, (values, points), values.shape, "the slope of a nonlinear flux")
        return central_difference(lambda varied: self.flux_at(varied, points), values)

    def tangent(self, values: Floats, points: Floats, depends_on_u: bool) -> Mixed | Flux:
        """Return the law ``du/db = j(v) + j'(v) (u - v)``, v = ``values`` (n,), a flux unless it ``depends_on_u``.

        Its beta and datum hold at ``points`` (n, d) alone: as functions they return the same (n,) for any points.
        """
        slope = self.slope_at(values, points)
        datum = partial(_known_values, self.flux_at(values, points) - slope * values)
        return Mixed(1.0, partial(_known_values, -slope), datum) if depends_on_u else Flux(datum)


def _known_values(values: Floats, _points: Floats) -> Floats:
    """Return ``values`` (n,), whatever the points; unlike a nested function, it can be pickled."""
    return values


@dataclass(frozen=True, eq=False)
class Interface(_Law):
    """The coupling ``u_left - u_right = jump + resistance * flow``, ``k_left du/db_left + k_right du/db_right = flux``.

    ``left`` and ``right`` are the conductivities k, None for the diffusivity of the equation; ``flow``, from left to
    right, is the mean of ``-k_left du/db_left`` and ``k_right du/db_right``.
    """

    jump: Data
    flux: Data
    resistance: float = 0.0
    left: Data | None = None
    right: Data | None = None
    couples: ClassVar[bool] = True
    is_dissipative: ClassVar[bool] = True
    data_fields: ClassVar[dict[str, str]] = {"jump": "jump", "flux": "flux"}
    factor_fields: ClassVar[tuple[str, ...]] = ("resistance", "left", "right")


#: A law on one side.
OneSided = Value | Flux | Mixed | Spectral | Nonlinear
#: The law of a condition.
Law = OneSided | Interface


def beta_at(law: OneSided, points: Floats, label: str) -> Floats:
    """Return the factor beta (n,) of u in the law alpha du/db + beta u = datum at ``points`` (n, d) of a boundary.

    Points are in the scene's coordinates; ``label`` is the condition's name in messages. Raises InputError if values
    are not finite or not (n,).
    """
    return evaluate_data(law.beta, points, 1, f"beta of {label}")[:, 0]


def checked_beta(law: OneSided, kind: str, points: Floats, label: str) -> Floats:
    """Return :func:`beta_at` for the ``law`` of a condition of this ``kind``, ``points`` and ``label``.

    Raises InputError if the law is mixed and beta is zero at all points.
    """
    beta = beta_at(law, points, label)
    if isinstance(law, Mixed) and len(points) and not beta.any():
        raise InputError(f"beta of {kind.capitalize()} of {label} is zero at all {len(points)} points; use Neumann.")
    return beta
