"""Formulas of position and time in scene files, computed by NumPy and never evaluated as Python."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from cpmkit.errors import SceneError, shown
from cpmkit.formulas.steps import Program, Steps, program
from cpmkit.formulas.trees import COORDINATES, formula_tree
from cpmkit.protocols import Floats


@dataclass(frozen=True)
class Expression:
    """A function of position, written as a formula in x, y, z, and of time where it has a t in it.

    Parameters
    ----------
    text : str
        For example ``"0.5 + 0.5 * sin(x / 20)"``. ``^`` is not a power; write ``**``. A comparison is 1 or 0. What has
        no value, such as ``1/0``, is infinite or NaN.
    dim : int
        2 or 3: which coordinates there are.

    Raises
    ------
    SceneError
        If the text does not parse, is too long, or uses what is not offered.

    Examples
    --------
    >>> import numpy as np
    >>> Expression("x * y + (x > 1)", 2)(np.array([[2.0, 3.0]]))
    array([7.])
    """

    text: str
    dim: int

    def __post_init__(self) -> None:
        _ = self._program  # a formula that is refused is refused here

    def __call__(self, points: Floats, t: float | None = None) -> Floats:
        """Return the values (n,) at points (n, d) and, where the formula has a t in it, the time ``t``.

        Raises
        ------
        SceneError
            If the formula has a t in it and no time is given.
        """
        if t is None and self.takes_time:
            raise SceneError(f"the formula {shown(self.text)} depends on t, and there is no time here; leave t out.")
        variables = {name: points[:, k] for k, name in enumerate(COORDINATES[: self.dim])}
        values: Floats = self._program({**variables, "t": t}, len(points))[0]
        return values

    @property
    def takes_time(self) -> bool:
        """True where the formula has a t in it."""
        return "t" in self._program.variables

    @cached_property
    def _program(self) -> Program:
        steps = Steps()
        return program(steps, [steps.add_tree(formula_tree(self.text, (*COORDINATES[: self.dim], "t")))])
