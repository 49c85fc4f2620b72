"""What may hold on a side of a boundary: ``alpha du/db + beta u = gamma``.

b is the conormal out of the side that the condition is given on (CONVENTIONS: left -v, right +v,
outward at an edge). Data may be a number, one number a channel, or a function of position.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.scene.condition import Condition
from cpmkit.scene.data import Data, as_number, takes_time
from cpmkit.scene.laws import Flux, Mixed, Value


@dataclass(frozen=True, eq=False)
class Dirichlet(Condition):
    """u = value.

    Parameters
    ----------
    value : number, text, sequence, or callable
        A number; a formula such as ``"sin(x)"``; one of them (or a callable) a channel; or a function of points
        (n, d) that returns (n,) or (n, channels).
    order : 1 to 4, optional
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
    order : 1 to 4, optional
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
    order : 1 to 4, optional
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
