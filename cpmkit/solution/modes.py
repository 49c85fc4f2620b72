"""Eigenvalues and eigenfunctions of a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.scene import Scene
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats

#: So many eigenvalues are told in a line.
MOST_TOLD_EIGENVALUES = 4
#: An eigenvalue below this share of the largest is zero but for rounding.
ZERO_EIGENVALUE_SHARE = 1e-10


@dataclass(frozen=True, eq=False)
class EigenRecord(SolutionRecord):
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


#: At twice the spacing so many more eigenvalues are sought: there modes may come in another order.
FURTHER_MODES = 6
#: A mode is seen at twice the spacing where at least this share of its mean square lies in modes found there.
SEEN_SHARE = 0.5


def with_further_modes(scene: Scene) -> Scene:
    """Return the scene of the coarse solution: with some more modes than are asked for."""
    assert isinstance(scene.problem, Eigen)
    return replace(scene, problem=replace(scene.problem, count=scene.problem.count + FURTHER_MODES))


def compare_modes(fine: EigenRecord, coarse: EigenRecord, points: Floats) -> tuple[Floats, Floats]:
    """Return the differences (count,) of eigenvalues, and of functions (n, count), infinite where one is not seen.

    Each function of the finer solution is a sum of those of the coarser one, as near as may be, which also tells those
    of a multiplet, that are any basis of it; the eigenvalues of those, weighed as in the sum, are what is compared.

    Parameters
    ----------
    fine, coarse : EigenSolution
        At a spacing and at twice it.
    points : (n, d) float64
        Where functions are compared, in the scene's coordinates.
    """
    ours, theirs = (one.evaluate(points).reshape(len(points), -1) for one in (fine, coarse))
    weights = np.linalg.lstsq(theirs, ours, rcond=None)[0]
    apart = np.abs(ours - theirs @ weights)
    seen = 1 - np.mean(apart**2, axis=0) / np.mean(ours**2, axis=0)
    shares = weights**2 / np.sum(weights**2, axis=0)
    differences = np.abs(fine.eigenvalues - coarse.eigenvalues @ shares)
    return np.where(seen >= SEEN_SHARE, differences, np.inf), apart


#: An eigenvalue nearer to zero than so many times its error may lie on the other side; one farther than the second
#: multiplies errors hardly more than others do.
NEAR_RESONANCE_ERRORS, AMPLIFYING_ERRORS = 2.0, 20.0


@dataclass(frozen=True)
class Resonance:
    """The nearest eigenvalue, and how much of a solution lies in its modes.

    Attributes
    ----------
    gap : float
        The eigenvalue of (-div(a grad u) + c u) / a on the lattice that is nearest to zero: of standing waves the
        difference of an eigenvalue of -Lap and k^2, with its sign.
    error : float
        By about how much the form's eigenvalues are off there.
    rms, largest : float
        Size of the solution's part in the modes of this eigenvalue, as shares of the solution's range.
    """

    gap: float
    error: float
    rms: float
    largest: float

    @property
    def undetermined(self) -> bool:
        """Whether the eigenvalue may lie on the other side of zero."""
        return abs(self.gap) <= NEAR_RESONANCE_ERRORS * self.error

    def amplified(self, measured: float) -> tuple[float, float]:
        """Return what an error of the eigenvalue leaves in the solution, rms and largest, as shares of its range.

        The part in its modes is f / gap: it is off by ``error / (|gap| - error)`` of itself, and by all of the range
        where the eigenvalue may be zero. The error is the one that is ``measured``, and no less than half of what the
        form lets expect.
        """
        error = max(measured, 0.5 * self.error)
        if abs(self.gap) <= NEAR_RESONANCE_ERRORS * error:
            return 1.0, 1.0
        if abs(self.gap) > AMPLIFYING_ERRORS * error:
            return 0.0, 0.0
        factor = error / (abs(self.gap) - error)
        return factor * self.rms, factor * self.largest
