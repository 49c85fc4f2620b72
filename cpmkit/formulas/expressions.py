"""Formulas as functions: of position and time, of a solution and its slope, and of several channels."""

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
    """Base class of formulas in x, y, z and further variables.

    Parameters
    ----------
    text : str
        For example ``"0.5 + 0.5 * sin(x / 20)"``. A power is ``**``, not ``^``. A comparison is 1 or 0. Undefined
        values, such as ``1/0``, are infinite or NaN.
    dim : int
        2 or 3, the number of coordinates that it may use.

    Raises
    ------
    SceneError
        If the text does not parse, is too long, or uses a name or operation that is not available.
    """

    text: str
    dim: int = len(COORDINATES)

    def __post_init__(self) -> None:
        _ = self._program  # parsed here, so that errors are raised here

    @property
    def _names(self) -> tuple[str, ...]:
        """The names that the formula may use, in the order in which messages list them."""
        return COORDINATES[: self.dim]

    @cached_property
    def _program(self) -> Program:
        """The program that computes the formula."""
        steps = Steps()
        return make_program(steps, [steps.add_tree(formula_tree(self.text, self._names))])

    def _values(self, points: Floats, **others: Any) -> Floats:
        """Return the values (n,) at points (n, d), given the ``others`` of the formula's variables."""
        variables = position_variables(points, self._program.variables, self.text)
        values: Floats = self._program({**variables, **others}, len(points))[0]
        return values


def position_variables(points: Floats, used: Collection[str], text: object) -> dict[str, Floats]:
    """Return the coordinates (n,) of points (n, d) by name; ``used`` are the names in the formula ``text``.

    Raises
    ------
    SceneError
        If a coordinate is ``used`` that the points do not have.
    """
    names = COORDINATES[: points.shape[1]]
    missing = [name for name in COORDINATES if name in used and name not in names]
    if missing:
        raise SceneError(
            f"the formula {shown(text)} uses {missing[0]}, and points here have {' and '.join(names)} alone."
        )
    return {name: points[:, k] for k, name in enumerate(names)}


class Expression(Formula):
    """A function of position, and of time if the formula contains t.

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
        """Return the values (n,) at points (n, d) and, if the formula contains t, the time ``t``.

        Raises
        ------
        SceneError
            If the formula contains t and ``t`` is None.
        """
        if t is None and self.takes_time:
            raise SceneError(f"the formula {shown(self.text)} depends on t, and there is no time here; leave t out.")
        return self._values(points, t=t)

    @property
    def takes_time(self) -> bool:
        """Whether the formula contains t."""
        return "t" in self._program.variables


class StateExpression(Formula):
    """A function of a solution u, the norm s of its gradient, and position, such as a diffusivity that depends on u.

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


#: Most channels of a reaction of formulas: more are a mistake.
MAX_REACTING_CHANNELS = 100


@dataclass(frozen=True)
class ReactionExpression:
    """A reaction: one formula for each channel, in the channels u1, u2, ..., the position and the time t.

    A single channel is also called u.

    Parameters
    ----------
    texts : tuple of str
        The rates of the channels, for example ``("u1*u2**2 - u1", "-u1*u2**2")``.
    dim : int
        2 or 3, the number of coordinates that they may use.

    Raises
    ------
    SceneError
        If there is no formula, or one does not parse, is too long, or uses a name or operation that is not available.

    Examples
    --------
    >>> ReactionExpression(("u2 - u1", "x * u1"), 2)(np.array([[1.0, 3.0]]), np.array([[0.5, 0.0]]))
    array([[2. , 0.5]])
    """

    texts: tuple[str, ...]
    dim: int = len(COORDINATES)

    def __post_init__(self) -> None:
        """Check the number and the types of the formulas, and parse them."""
        if not 1 <= len(self.texts) <= MAX_REACTING_CHANNELS:
            raise SceneError(
                f"a reaction must be 1 to {MAX_REACTING_CHANNELS} formulas, one a channel, got {len(self.texts)}."
            )
        for text in self.texts:
            if not isinstance(text, str):
                raise SceneError(f"a reaction must be one formula a channel, such as '-u1*u2**2', got {shown(text)}.")
        _ = self._program  # parsed here, so that errors are raised here

    @property
    def channels(self) -> int:
        """The number of channels."""
        return len(self.texts)

    @property
    def takes_time(self) -> bool:
        """Whether a formula contains t."""
        return "t" in self._program.variables

    def __call__(self, u: Floats, points: Floats, t: float | None = None) -> Floats:
        """Return the rates (n, channels) for u (n, channels), points (n, d) and the time ``t``."""
        channels = {f"u{k}": u[:, k - 1] for k in range(1, self.channels + 1)}
        position = position_variables(points, self._program.variables, self.texts)
        rates = self._program({"u": u[:, 0], "t": t, **channels, **position}, len(points))
        return np.stack(list(rates), axis=1)

    @cached_property
    def _program(self) -> Program:
        """The program that computes the rates of all channels."""
        channels = tuple(f"u{k}" for k in range(1, self.channels + 1))
        names = (*(("u", *channels) if len(channels) == 1 else channels), *COORDINATES[: self.dim], "t")
        steps = Steps()
        return make_program(steps, [steps.add_tree(formula_tree(text, names)) for text in self.texts])
