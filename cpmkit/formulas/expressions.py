"""Formulas as functions: of position and time, of a solution and its slope, and of several channels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.formulas.steps import Program, Steps, make_program
from cpmkit.formulas.trees import COORDINATES, formula_tree
from cpmkit.types import Floats


class Formulas:
    """Base class of functions that are given by formulas in x, y, z and further variables."""

    dim: int

    def __post_init__(self) -> None:
        _ = self._program  # parsed here, so that errors are raised here

    @property
    def _texts(self) -> tuple[str, ...]:
        """The formulas."""
        raise NotImplementedError

    @property
    def _variables(self) -> tuple[str, ...]:
        """The names that the formulas may use, in the order in which messages list them."""
        return COORDINATES[: self.dim]

    @cached_property
    def _program(self) -> Program:
        """The program that computes the formulas."""
        steps = Steps()
        return make_program(steps, [steps.add_tree(formula_tree(text, self._variables)) for text in self._texts])

    @property
    def takes_time(self) -> bool:
        """Whether a formula contains t."""
        return "t" in self._program.variables

    def _values(self, points: Floats, **others: Any) -> Floats:
        """Return the values (k, n) of the k formulas at points (n, d), given the ``others`` of their variables.

        Raises
        ------
        SceneError
            If a formula uses a coordinate that the points do not have.
        """
        names = COORDINATES[: points.shape[1]]
        missing = [name for name in COORDINATES if name in self._program.variables and name not in names]
        if missing:
            text = shown(self._texts if len(self._texts) > 1 else self._texts[0])
            raise SceneError(f"the formula {text} uses {missing[0]}, and points here have {' and '.join(names)} alone.")
        return self._program({**dict(zip(names, points.T, strict=True)), **others}, len(points))


@dataclass(frozen=True)
class Formula(Formulas):
    """Base class of functions that are given by one formula.

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

    @property
    def _texts(self) -> tuple[str, ...]:
        return (self.text,)


class Expression(Formula):
    """A function of position, and of time if the formula contains t.

    Examples
    --------
    >>> import numpy as np
    >>> Expression("x * y + (x > 1)", 2)(np.array([[2.0, 3.0]]))
    array([7.])
    """

    @property
    def _variables(self) -> tuple[str, ...]:
        return (*super()._variables, "t")

    def __call__(self, points: Floats, t: float | None = None) -> Floats:
        """Return the values (n,) at points (n, d) and, if the formula contains t, the time ``t``.

        Raises
        ------
        SceneError
            If the formula contains t and ``t`` is None.
        """
        if t is None and self.takes_time:
            raise SceneError(f"the formula {shown(self.text)} depends on t, and there is no time here; leave t out.")
        values: Floats = self._values(points, t=t)[0]
        return values


class StateExpression(Formula):
    """A function of a solution u, the norm s of its gradient, and position, such as a diffusivity that depends on u.

    Examples
    --------
    >>> import numpy as np
    >>> StateExpression("1 + u * s + x", 2)(np.array([2.0]), np.array([3.0]), np.array([[0.5, 0.0]]))
    array([7.5])
    """

    @property
    def _variables(self) -> tuple[str, ...]:
        return ("u", "s", *super()._variables)

    def __call__(self, u: Floats, s: Floats, points: Floats) -> Floats:
        """Return the values (n,) for u (n,), s (n,) and points (n, d)."""
        values: Floats = self._values(points, u=u, s=s)[0]
        return values


@dataclass(frozen=True)
class ReactionExpression(Formulas):
    """A reaction: one formula for each channel, in the channels u1, u2, ..., the position and the time t.

    A single channel is also called u.

    Parameters
    ----------
    texts : tuple of str
        The rates of the channels, for example ``("u1*u2**2 - u1", "-u1*u2**2")``; 100 at most.
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
        if not 1 <= len(self.texts) <= 100 or not all(isinstance(text, str) for text in self.texts):
            raise SceneError(
                "a reaction must be 1 to 100 formulas, one formula a channel, such as '-u1*u2**2', got "
                f"{len(self.texts)}: {shown(self.texts)}."
            )
        super().__post_init__()

    @property
    def channels(self) -> int:
        """The number of channels."""
        return len(self.texts)

    @property
    def _texts(self) -> tuple[str, ...]:
        return self.texts

    @property
    def _variables(self) -> tuple[str, ...]:
        channels = [f"u{k}" for k in range(1, self.channels + 1)]
        return (*(["u"] if self.channels == 1 else []), *channels, *super()._variables, "t")

    def __call__(self, u: Floats, points: Floats, t: float | None = None) -> Floats:
        """Return the rates (n, channels) for u (n, channels), points (n, d) and the time ``t``."""
        channels = {f"u{k}": u[:, k - 1] for k in range(1, self.channels + 1)}
        return np.ascontiguousarray(self._values(points, u=u[:, 0], t=t, **channels).T)
