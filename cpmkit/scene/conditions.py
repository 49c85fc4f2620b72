"""Conditions on a side of a boundary or on an edge: ``alpha du/db + beta u = gamma``; comparison of conditions.

b is the conormal out of the side on which the condition is given (CONVENTIONS: left -v, right +v, outward at an edge).
Data are a number, one number for each channel, or a function of position.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.runtime.arrays import number, whole
from cpmkit.scene.data import Data, is_sequence, is_zero, replace_formulas, takes_time
from cpmkit.scene.laws import Flux, Law, Mixed, OneSided, Value

if TYPE_CHECKING:
    from cpmkit.scene.equations import Equation


def check_order(order: Any, label: str) -> int:
    """Return the order of accuracy of a condition, 1 or 2; ``label`` is the name of the argument in error messages.

    Raises InputError if the order is neither 1 nor 2. The Galerkin form, not the collocation form, has conditions of
    third order.
    """
    if order in (3, 4):
        raise InputError(f'{label} must be 1 or 2, got {order}; use form="galerkin", with conditions of third order.')
    return whole(order, label, 1, 2)


class Condition:
    """Base class of conditions on a side of a boundary, on an edge, or across a boundary.

    A kind of condition is a frozen dataclass of its parameters, which summaries show; two conditions are the same if
    their parameters are. A new kind is one class, wherever it is defined.
    """

    kind: ClassVar[str]  #: Its name in reports, and in scene files.
    law_kind: ClassVar[type]  #: The class of its law; a condition may have the property ``law`` in its place.
    order: int | None = None  #: 1 or 2; overrides the discretisation's order for this condition.

    def __post_init__(self) -> None:
        """Replace formulas by functions; raise SceneError if one does not parse, InputError for a wrong order."""
        replace_formulas(self, self.kind)
        if self.order is not None:
            check_order(self.order, f"order of {type(self).__name__}")

    def __init_subclass__(cls, **keywords: Any) -> None:
        """Make the property ``law`` of a subclass cached: discretisations recognise data by the identity of the law."""
        super().__init_subclass__(**keywords)
        law: Any = getattr(cls, "law", None)
        if isinstance(law, property) and law.fget is not None:
            cached: cached_property[Law] = cached_property(law.fget)
            cached.__set_name__(cls, "law")
            cls.law = cached  # type: ignore[assignment]

    @property
    def law(self) -> Law:
        """The law of the condition, by which forms discretise it: of ``law_kind``, with the parameters in order."""
        members: Any = self
        law: Law = self.law_kind(*(getattr(self, each.name) for each in fields(members) if each.name != "order"))
        return law

    @property
    def couples(self) -> bool:
        """True if the condition couples both sides of a boundary."""
        return self.law.couples

    @property
    def one_sided(self) -> OneSided:
        """The law of a condition that does not couple sides; AssertionError if it does."""
        assert not self.couples
        law: Any = self.law
        return cast("OneSided", law)

    def data(self) -> list[tuple[str, Data]]:
        """Return pairs (name in messages, data) of the data that may have a value for each channel."""
        return self.law.data

    def refusal(self, problem: Equation) -> str:
        """Return why the equation ``problem`` does not accept the condition, as a predicate; "" if it accepts it."""
        return "" if problem.family in self.law.families else self.law.needs


@dataclass(frozen=True, eq=False)
class Dirichlet(Condition):
    """u = value.

    Parameters
    ----------
    value : number, text, sequence, or callable
        A number; a formula such as ``"sin(x)"`` (SceneError if it does not parse); one of them (or a callable) a
        channel; or a function of points (n, d) that returns (n,) or (n, channels).
    order : 1 or 2, optional
        Overrides the discretisation's order for this condition. Raises InputError for another number.

    Examples
    --------
    On a circle without other conditions, the value at one point is the value everywhere.

    >>> import cpmkit as ck
    >>> square = ck.Dirichlet(lambda points: points[:, 0] ** 2)
    >>> pin = ck.Boundary("pin", ck.source("analytic.point", at=[0.6, 0.8]), both=square)
    >>> scene = ck.Scene(ck.source("analytic.circle"), ck.Laplace(), [pin])
    >>> ck.solve(scene, spacing=0.1).evaluate([[-1, 0]]).round(6)
    array([0.36])
    """

    value: Data
    order: int | None = None
    kind: ClassVar[str] = "dirichlet"
    law_kind: ClassVar[type] = Value


def as_condition(value: Any) -> Any:
    """Return data (a number, formula, sequence, array or function) as a Dirichlet condition, other values unchanged.

    A condition or a list with a condition in it is such another value. Raises SceneError if a formula does not parse.
    """
    if isinstance(value, (bool, type)) or (is_sequence(value) and any(isinstance(entry, Condition) for entry in value)):
        return value
    is_data = is_sequence(value) or callable(value) or hasattr(value, "to_numpy")
    return Dirichlet(value) if is_data or isinstance(value, (int, float, str, np.ndarray, np.number)) else value


@dataclass(frozen=True, eq=False)
class Neumann(Condition):
    """du/db = flux, with b out of the side on which the condition is given.

    Parameters
    ----------
    flux : number, sequence, or callable
        As for :class:`Dirichlet`. Zero makes the boundary an insulating wall.
    order : 1 or 2, optional
        Overrides the discretisation's order for this condition.
    """

    flux: Data = 0.0
    order: int | None = None
    kind: ClassVar[str] = "neumann"
    law_kind: ClassVar[type] = Flux


@dataclass(frozen=True, eq=False)
class Robin(Condition):
    """alpha du/db + beta u = gamma, with b out of the side on which the condition is given.

    With alpha and beta of one sign the condition damps, and is well posed. With opposite signs it amplifies; a spacing
    too coarse for such a beta is refused.

    Parameters
    ----------
    alpha : float
        Not zero.
    beta : number, text or callable
        Not zero; a callable of points (n, d) returns (n,).
    gamma : number, sequence, or callable
        As for :class:`Dirichlet`.
    order : 1 or 2, optional
        Overrides the discretisation's order for this condition.

    Raises
    ------
    InputError
        If alpha is not a finite number other than zero, or beta neither such a number nor a function of points.

    Examples
    --------
    >>> Robin(1.0, 3.0, 0.5).kind
    'robin'
    >>> Robin(0.0, 1.0)
    Traceback (most recent call last):
    cpmkit.errors.InputError: alpha of Robin must be a finite number other than zero, got 0.0; use Dirichlet.
    """

    alpha: float
    beta: Data
    gamma: Data = 0.0
    order: int | None = None
    kind: ClassVar[str] = "robin"
    law_kind: ClassVar[type] = Mixed

    def __post_init__(self) -> None:
        """Convert alpha and beta, if no function, to floats; raise InputError if one is zero or no finite number."""
        super().__post_init__()
        for name, other in (("alpha", "Dirichlet"), ("beta", "Neumann")):
            value = getattr(self, name)
            if name == "beta" and callable(value) and not takes_time(value):
                continue
            try:
                factor = number(value, f"{name} of Robin")
            except InputError:
                factor = 0.0
            if factor == 0:
                raise InputError(
                    f"{name} of Robin must be a finite number other than zero, got {shown(value)}; use {other}."
                )
            object.__setattr__(self, name, factor)


def same_condition(first: Any, second: Any) -> bool:
    """Return True if two conditions are one object, or of one type and equal by :func:`same_parameter`."""
    if first is second:
        return True
    if type(first) is not type(second) or not is_dataclass(first):
        return False
    return all(
        same_parameter(getattr(first, field.name), getattr(second, field.name)) for field in fields(first) if field.init
    )


def depends_on_sides(left: Condition, right: Condition) -> bool:
    """Return True if the solution may depend on which side of a boundary is called left.

    ``left`` and ``right`` are the conditions on the sides. The solution does not depend on the choice if they are the
    same condition, or one coupling with equal conductivities and no jump.
    """
    law: Any = left.law
    if law.couples:
        return law.left != law.right or not is_zero(law.jump)
    return not same_condition(left, right)


def same_parameter(first: Any, second: Any) -> bool:
    """Return True if two parameters of conditions or equations are equal: numbers, sequences, arrays or functions.

    Functions are equal if they are one object, formulas of equal text, or the same method bound to the same object.
    """
    if first is second:
        return True
    if is_sequence(first) and is_sequence(second):
        return len(first) == len(second) and all(map(same_parameter, first, second))
    if not callable(first) and not callable(second):
        return np.array_equal(first, second)
    try:
        return bool(first == second)
    except ValueError:  # a class that compares arrays entry by entry
        return False
