"""Eigenvalues and eigenfunctions of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.protocols import Floats
from cpmkit.solution.solution import Solution

#: So many eigenvalues are told in a line.
MOST_TOLD_EIGENVALUES = 4
#: An eigenvalue below this share of the largest is zero but for rounding.
ZERO_EIGENVALUE_SHARE = 1e-10


@dataclass(frozen=True, eq=False)
class EigenSolution(Solution):
    """The solution of an eigenvalue problem: eigenfunction k is channel k, read like any solution.

    Each has unit mean square over the manifold, in the collocation form over the nodes of the band, and so about over
    it. Its sign is such that of the values of nearly the greatest size the first is above zero. Those of one
    eigenvalue are orthogonal.

    Attributes
    ----------
    eigenvalues : (count,) float64
        Ascending; real parts, where the discrete operator, which in the collocation form is not symmetric, has a
        complex pair.
    imaginary : (count,) float64
        Imaginary parts; zero but for such a pair, whose eigenfunctions are real and imaginary part.
    residuals : (count,) float64
        By how much of its size, its root mean square, each eigenfunction changes in one more step of inverse iteration;
        about, where a cycle of the multigrid stands for the step. How far eigenvalues are from those of the manifold is
        told by :func:`cpmkit.estimate_error`.
    """

    eigenvalues: Floats
    imaginary: Floats
    residuals: Floats

    @property
    def titles(self) -> list[str]:
        """A title for each mode, its eigenvalue to four digits; one that is zero but for rounding is 0."""
        zero = ZERO_EIGENVALUE_SHARE * float(np.abs(self.eigenvalues).max(initial=0.0))
        return [f"\N{GREEK SMALL LETTER LAMDA} = {value if abs(value) > zero else 0:.4g}" for value in self.eigenvalues]

    def arrays(self) -> dict[str, Any]:
        """Return the lattice, the nodes, the values and the eigenvalues as plain arrays."""
        return {**super().arrays(), "eigenvalues": self.eigenvalues}

    def summary(self) -> dict[str, Any]:
        """Return what was solved, what it cost and what it reached, as plain values."""
        return {**super().summary(), "eigenvalues": self.eigenvalues.tolist(), "residuals": self.residuals.tolist()}

    def __repr__(self) -> str:
        return f"{super().__repr__()}, {self._told}"

    def _figures(self) -> list[tuple[str, str]]:
        return [*super()._figures(), ("eigenvalues", ", ".join(f"{value:.6g}" for value in self.eigenvalues))]

    @property
    def _told(self) -> str:
        first = ", ".join(f"{value:.6g}" for value in self.eigenvalues[:MOST_TOLD_EIGENVALUES])
        return f"eigenvalues {first}{', ...' if len(self.eigenvalues) > MOST_TOLD_EIGENVALUES else ''}"
