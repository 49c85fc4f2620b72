"""Formulas of a solution u, the size s of its slope, and position: diffusivities that depend on u, in scene files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from cpmkit.formulas.steps import Program, Steps, program
from cpmkit.formulas.trees import COORDINATES, formula_tree
from cpmkit.protocols import Floats


@dataclass(frozen=True)
class StateExpression:
    """A function of u, s and position, written as a formula in u, s, x, y and z.

    Parameters
    ----------
    text : str
        For example ``"1 + u**2"``.
    dim : int
        2 or 3: which coordinates there are.

    Raises
    ------
    SceneError
        If the text does not parse, is too long, or uses what is not offered.

    Examples
    --------
    >>> import numpy as np
    >>> StateExpression("1 + u * s + x", 2)(np.array([2.0]), np.array([3.0]), np.array([[0.5, 0.0]]))
    array([7.5])
    """

    text: str
    dim: int

    def __post_init__(self) -> None:
        _ = self._program  # a formula that is refused is refused here

    def __call__(self, u: Floats, s: Floats, points: Floats) -> Floats:
        """Return the values (n,) for u (n,), s (n,) and points (n, d)."""
        variables = {name: points[:, k] for k, name in enumerate(COORDINATES[: self.dim])}
        values: Floats = self._program({**variables, "u": u, "s": s}, len(points))[0]
        return values

    @cached_property
    def _program(self) -> Program:
        steps = Steps()
        return program(steps, [steps.add_tree(formula_tree(self.text, ("u", "s", *COORDINATES[: self.dim])))])
