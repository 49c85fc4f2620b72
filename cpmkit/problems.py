"""Equations: what is solved on the manifold, and its right-hand side.

All are written with -Lap, so that every operator is positive: ``laplace`` -Lap u = 0, ``poisson``
-Lap u = f, ``screened`` -Lap u + c u = f with c > 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from cpmkit.arrays import positive
from cpmkit.conditions import Data


@dataclass(frozen=True, eq=False)
class Poisson:
    """-Lap u = f.

    Parameters
    ----------
    f : number, sequence, or callable
        Right-hand side on the manifold: a number, one entry a channel, or a function of points (n, d).
    """

    f: Data
    kind: ClassVar[str] = "poisson"

    @property
    def c(self) -> float:
        """Factor of u."""
        return 0.0


@dataclass(frozen=True, eq=False)
class Laplace:
    """-Lap u = 0."""

    kind: ClassVar[str] = "laplace"

    @property
    def f(self) -> Data:
        """Right-hand side."""
        return 0.0

    @property
    def c(self) -> float:
        """Factor of u."""
        return 0.0


@dataclass(frozen=True, eq=False)
class ScreenedPoisson:
    """-Lap u + c u = f with c > 0.

    Parameters
    ----------
    f : number, sequence, or callable
        Right-hand side, as for :class:`Poisson`.
    c : float
        Above zero, in one over the square of the unit of length.

    Raises
    ------
    InputError
        If ``c`` is not above zero.
    """

    f: Data
    c: float = 1.0
    kind: ClassVar[str] = "screened"

    def __post_init__(self) -> None:
        positive(self.c, "c of a screened Poisson problem")


Problem = Poisson | Laplace | ScreenedPoisson
