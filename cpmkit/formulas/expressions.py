"""Formulas of position and time, computed by NumPy and never evaluated as Python."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.formulas.steps import Program, Steps, make_program
from cpmkit.formulas.trees import COORDINATES, formula_tree
from cpmkit.types import Floats


@dataclass(frozen=True)
class Formula:
    """A formula in x, y, z and what else a class of them offers.

    Parameters
    ----------
    text : str
        For example ``"0.5 + 0.5 * sin(x / 20)"``. ``^`` is not a power; write ``**``. A comparison is 1 or 0. What has
        no value, such as ``1/0``, is infinite or NaN.
    dim : int
        2 or 3: which coordinates it may use. Points that have fewer of them are refused where it does use more.

    Raises
    ------
    SceneError
        If the text does not parse, is too long, or uses what is not offered.
    """

    text: str
    dim: int = len(COORDINATES)

    def __post_init__(self) -> None:
        _ = self._program  # a formula that is refused is refused here

    @property
    def _names(self) -> tuple[str, ...]:
        """What the formula may use, in the order in which a refusal lists them."""
        return COORDINATES[: self.dim]

    @cached_property
    def _program(self) -> Program:
        steps = Steps()
        return make_program(steps, [steps.add_tree(formula_tree(self.text, self._names))])

    def _values(self, points: Floats, **others: Any) -> Floats:
        """Return the values (n,) at points (n, d)."""
        variables = position_variables(points, self._program.variables, self.text)
        values: Floats = self._program({**variables, **others}, len(points))[0]
        return values


def position_variables(points: Floats, used: Collection[str], text: object) -> dict[str, Floats]:
    """Return the columns of points (n, d) by the names of their coordinates.

    Raises
    ------
    SceneError
        If a coordinate is ``used`` that they do not have.
    """
    given = COORDINATES[: points.shape[1]]
    beyond = [name for name in COORDINATES if name in used and name not in given]
    if beyond:
        raise SceneError(
            f"the formula {shown(text)} uses {beyond[0]}, and points here have {' and '.join(given)} alone."
        )
    return {name: points[:, k] for k, name in enumerate(given)}


class Expression(Formula):
    """A function of position, and of time where the formula has a t in it.

    Examples
    --------
    >>> import numpy as np
    >>> Expression("x * y + (x > 1)", 2)(np.array([[2.0, 3.0]]))
    array([7.])
    """

    @property
    def _names(self) -> tuple[str, ...]:
        return (*super()._names, "t")

    def __call__(self, points: Floats, t: float | None = None) -> Floats:
        """Return the values (n,) at points (n, d) and, where the formula has a t in it, the time ``t``.

        Raises
        ------
        SceneError
            If the formula has a t in it and no time is given.
        """
        if t is None and self.takes_time:
            raise SceneError(f"the formula {shown(self.text)} depends on t, and there is no time here; leave t out.")
        return self._values(points, t=t)

    @property
    def takes_time(self) -> bool:
        """True where the formula has a t in it."""
        return "t" in self._program.variables


class StateExpression(Formula):
    """A function of a solution u, of the size s of its slope and of position: a diffusivity that depends on u.

    Examples
    --------
    >>> import numpy as np
    >>> StateExpression("1 + u * s + x", 2)(np.array([2.0]), np.array([3.0]), np.array([[0.5, 0.0]]))
    array([7.5])
    """

    @property
    def _names(self) -> tuple[str, ...]:
        return ("u", "s", *super()._names)

    def __call__(self, u: Floats, s: Floats, points: Floats) -> Floats:
        """Return the values (n,) for u (n,), s (n,) and points (n, d)."""
        return self._values(points, u=u, s=s)


#: Channels of a reaction that is written as formulas.
MOST_REACTING_CHANNELS = 100


@dataclass(frozen=True)
class ReactionExpression:
    """A reaction: one formula a channel, in the channels u1, u2, ..., in position, and in the time t.

    Where there is one channel, u is its name too.

    Parameters
    ----------
    texts : tuple of str
        The rates of the channels, for example ``("u1*u2**2 - u1", "-u1*u2**2")``.
    dim : int
        2 or 3: which coordinates they may use.

    Raises
    ------
    SceneError
        If there is no formula, if one does not parse, is too long, or uses what is not offered.

    Examples
    --------
    >>> ReactionExpression(("u2 - u1", "x * u1"), 2)(np.array([[1.0, 3.0]]), np.array([[0.5, 0.0]]))
    array([[2. , 0.5]])
    """

    texts: tuple[str, ...]
    dim: int = len(COORDINATES)

    def __post_init__(self) -> None:
        if not 1 <= len(self.texts) <= MOST_REACTING_CHANNELS:
            raise SceneError(
                f"a reaction must be 1 to {MOST_REACTING_CHANNELS} formulas, one a channel, got {len(self.texts)}."
            )
        for text in self.texts:
            if not isinstance(text, str):
                raise SceneError(f"a reaction must be one formula a channel, such as '-u1*u2**2', got {shown(text)}.")
        _ = self._program  # formulas that are refused are refused here

    @property
    def channels(self) -> int:
        """How many channels react."""
        return len(self.texts)

    @property
    def takes_time(self) -> bool:
        """True where a formula has a t in it."""
        return "t" in self._program.variables

    def __call__(self, u: Floats, points: Floats, t: float | None = None) -> Floats:
        """Return the rates (n, channels) for u (n, channels), points (n, d) and the time."""
        own = {f"u{k}": u[:, k - 1] for k in range(1, self.channels + 1)}
        position = position_variables(points, self._program.variables, self.texts)
        rates = self._program({"u": u[:, 0], "t": t, **own, **position}, len(points))
        return np.stack(list(rates), axis=1)

    @cached_property
    def _program(self) -> Program:
        own = tuple(f"u{k}" for k in range(1, self.channels + 1))
        names = (*(("u", *own) if len(own) == 1 else own), *COORDINATES[: self.dim], "t")
        steps = Steps()
        return make_program(steps, [steps.add_tree(formula_tree(text, names)) for text in self.texts])
