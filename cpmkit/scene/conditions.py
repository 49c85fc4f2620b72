"""What may hold on a side of a boundary: ``alpha du/db + beta u = gamma``.

b is the conormal out of the side that the condition is given on (CONVENTIONS: left -v, right +v,
outward at an edge). Data may be a number, one number a channel, or a function of position.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.runtime.arrays import whole
from cpmkit.scene.data import Data, as_number, read_formulas, takes_time
from cpmkit.scene.laws import Flux, Interface, Law, Mixed, OneSided, Value, data_of

if TYPE_CHECKING:
    from cpmkit.scene.equations import Equation


def check_order(order: Any, label: str) -> int:
    """Return the order of accuracy of a condition, which ``label`` names in errors.

    Raises
    ------
    InputError
        If it is neither 1 nor 2; the Galerkin form has conditions of third order.
    """
    if order in (3, 4):
        raise InputError(f'{label} must be 1 or 2, got {order}; use form="galerkin", with conditions of third order.')
    return whole(order, label, 1, 2)


class Condition(ABC):
    """What holds on a side of a boundary, on an edge, or across a boundary.

    A kind is a frozen dataclass of what it is given; its parameters are told in summaries, and two conditions are the
    same where they are.

    Attributes
    ----------
    kind : str
        Its name in reports, and in scene files.
    order : 1 or 2, or None
        Overrides the discretisation's order for this condition.
    """

    kind: ClassVar[str]
    order: int | None = None

    def __post_init__(self) -> None:
        read_formulas(self, self.kind)
        if self.order is not None:
            check_order(self.order, f"order of {type(self).__name__}")

    def __init_subclass__(cls, **keywords: Any) -> None:
        """Keep the law that a kind answers: by that one object the data that it gives are known again."""
        super().__init_subclass__(**keywords)
        own = cls.__dict__.get("law")
        if isinstance(own, property) and own.fget is not None:
            kept: cached_property[Law] = cached_property(own.fget)
            kept.__set_name__(cls, "law")
            cls.law = kept  # type: ignore[assignment]

    @property
    @abstractmethod
    def law(self) -> Law:
        """Which of the standard laws it is; asked once."""

    @property
    def couples(self) -> bool:
        """True where it holds across a boundary, and not on one side."""
        return isinstance(self.law, Interface)

    @property
    def one_sided(self) -> OneSided:
        """The law of a condition that does not couple sides."""
        law = self.law
        assert not isinstance(law, Interface)
        return law

    def data(self) -> list[tuple[str, Data]]:
        """Return the data that have channels, and what each is."""
        return data_of(self.law)

    def refusal(self, problem: Equation) -> str:
        """Return why an equation does not take it, the predicate of a sentence; empty where it does."""
        return "" if problem.family in self.law.families else self.law.needs


@dataclass(frozen=True, eq=False)
class Dirichlet(Condition):
    """u = value.

    Parameters
    ----------
    value : number, text, sequence, or callable
        A number; a formula such as ``"sin(x)"``; one of them (or a callable) a channel; or a function of points
        (n, d) that returns (n,) or (n, channels).
    order : 1 or 2, optional
        Overrides the discretisation's order for this condition.

    Examples
    --------
    On a circle that nothing else touches, the value at one point is the value everywhere.

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

    @property
    def law(self) -> Value:
        """The value."""
        return Value(self.value)


def as_condition(given: Any) -> Any:
    """Return data, numbers, formulas and functions, as the Dirichlet condition of them; anything else as it is."""
    if isinstance(given, (Condition, bool, type)) or given is None:
        return given
    if isinstance(given, (list, tuple)) and any(isinstance(one, Condition) for one in given):
        return given  # no data of channels
    accepted = isinstance(given, (int, float, str, list, tuple, np.ndarray, np.number))
    if accepted or callable(given) or hasattr(given, "to_numpy"):
        return Dirichlet(given)
    return given


def as_conditions(given: Any) -> Any:
    """Return what is given for sides or loops, by their names, or for all of them, as :func:`as_condition` does."""
    return {key: as_condition(one) for key, one in given.items()} if isinstance(given, Mapping) else as_condition(given)


@dataclass(frozen=True, eq=False)
class Neumann(Condition):
    """du/db = flux, b pointing out of the side on which the condition is given.

    Parameters
    ----------
    flux : number, sequence, or callable
        As for :class:`Dirichlet`. Zero makes the boundary a wall that nothing crosses.
    order : 1 or 2, optional
        Overrides the discretisation's order for this condition.
    """

    flux: Data = 0.0
    order: int | None = None
    kind: ClassVar[str] = "neumann"

    @property
    def law(self) -> Flux:
        """The flux."""
        return Flux(self.flux)


@dataclass(frozen=True, eq=False)
class Robin(Condition):
    """alpha du/db + beta u = gamma, b pointing out of the side on which the condition is given.

    With alpha and beta of one sign the condition damps, and is well posed. With opposite signs it feeds; a spacing
    too coarse for such a beta is refused.

    Parameters
    ----------
    alpha : float
        Not zero.
    beta : number or callable
        Not zero; a callable of points (n, d) returns (n,).
    gamma : number, sequence, or callable
        As for :class:`Dirichlet`.
    order : 1 or 2, optional
        Overrides the discretisation's order for this condition.

    Raises
    ------
    InputError
        If alpha or beta is zero, for then the condition is of another kind, or not a finite number.

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

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, other in (("alpha", "Dirichlet"), ("beta", "Neumann")):
            given = getattr(self, name)
            if name == "beta" and callable(given) and not takes_time(given):
                continue
            try:
                number = as_number(given, f"{name} of Robin")
            except InputError:
                number = 0.0
            if number == 0:
                raise InputError(
                    f"{name} of Robin must be a finite number other than zero, got {shown(given)}; use {other}."
                )
            object.__setattr__(self, name, number)

    @property
    def law(self) -> Mixed:
        """The value and the flux in one relation."""
        beta: Any = self.beta  # a number or a function, formulas made so
        return Mixed(self.alpha, beta, self.gamma)


def same_condition(first: Any, second: Any) -> bool:
    """Tell whether two conditions are of one kind with equal numbers, equal formulas or the same callables."""
    if first is second:
        return True
    if type(first) is not type(second) or not is_dataclass(first):
        return False
    return all(_equal(getattr(first, field.name), getattr(second, field.name)) for field in fields(first) if field.init)


def sides_differ(left: Condition, right: Condition) -> bool:
    """Tell whether it matters which side of a boundary is called left.

    Where both hold one condition it does not, nor across a contact that is the same from both sides.
    """
    law = left.law
    if isinstance(law, Interface):
        return not (law.left == law.right and _equal(law.jump, 0.0))
    return not same_condition(left, right)


def _equal(first: Any, second: Any) -> bool:
    if first is second:
        return True
    if callable(first) or callable(second):
        return callable(first) and callable(second) and _same_function(first, second)
    if isinstance(first, (list, tuple)) and isinstance(second, (list, tuple)):
        return len(first) == len(second) and all(map(_equal, first, second))
    if first is None or second is None:
        return False
    return np.array_equal(np.asarray(first), np.asarray(second))


def _same_function(first: Any, second: Any) -> bool:
    """Tell whether two callables are equal: formulas are by their text, a bound method by its object."""
    try:
        return bool(first == second)
    except ValueError:  # some class compares arrays entry by entry
        return False
