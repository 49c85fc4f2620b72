"""Formulas of position and time, computed by NumPy and never evaluated as Python."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from cpmkit.errors import SceneError, shown
from cpmkit.formulas.steps import Program, Steps, program
from cpmkit.formulas.trees import COORDINATES, formula_tree
from cpmkit.protocols import Floats


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
        return program(steps, [steps.add_tree(formula_tree(self.text, self._names))])

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
