"""Formulas of several channels, position and time: reactions in scene files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.formulas.expressions import position_variables
from cpmkit.formulas.steps import Program, Steps, program
from cpmkit.formulas.trees import COORDINATES, formula_tree
from cpmkit.protocols import Floats

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
        return program(steps, [steps.add_tree(formula_tree(text, names)) for text in self.texts])
