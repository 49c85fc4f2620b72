"""Formulas of a solution u, the size s of its slope, and position: diffusivities that depend on u, in scene files."""

from __future__ import annotations

from cpmkit.formulas.expressions import Formula
from cpmkit.protocols import Floats


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
