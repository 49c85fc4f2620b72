"""Eigenvalues and eigenfunctions: their solution, its error, and the eigenvalue of a steady problem nearest to zero."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class EigenRecord(SolutionRecord):
    """The solution of an eigenvalue problem: eigenfunction k is channel k, read like any solution."""

    has_modes: ClassVar[bool] = True

    #: (count,): eigenvalues in ascending order; real parts where the discrete operator, which is not symmetric in the
    #: collocation form, has a pair of complex eigenvalues.
    eigenvalues: Floats
    #: (count,): imaginary parts; zero except for such a pair, whose eigenfunctions are the real and the imaginary part.
    imaginary: Floats
    #: (count,): relative change (root mean square) of each eigenfunction in one more step of inverse iteration;
    #: approximate if a multigrid cycle replaces the step. :func:`cpmkit.estimate_error` estimates the errors of the
    #: eigenvalues.
    residuals: Floats

    @property
    def titles(self) -> list[str]:
        """A title for each mode: its eigenvalue to four digits, 0 where it is zero up to rounding."""
        zero = 1e-10 * float(np.abs(self.eigenvalues).max(initial=0.0))
        return [f"\N{GREEK SMALL LETTER LAMDA} = {value if abs(value) > zero else 0:.4g}" for value in self.eigenvalues]

    def arrays(self) -> dict[str, Any]:
        """Return the arrays of :meth:`SolutionRecord.arrays`, and ``eigenvalues`` (count,)."""
        return {**super().arrays(), "eigenvalues": self.eigenvalues}

    def summary(self) -> dict[str, Any]:
        """Return the plain values of :meth:`SolutionRecord.summary`, with lists ``eigenvalues`` and ``residuals``."""
        return {**super().summary(), "eigenvalues": self.eigenvalues.tolist(), "residuals": self.residuals.tolist()}

    def __repr__(self) -> str:
        first = ", ".join(f"{value:.6g}" for value in self.eigenvalues[:4])
        return f"{super().__repr__()}, eigenvalues {first}{', ...' if len(self.eigenvalues) > 4 else ''}"

    def _notebook_rows(self) -> list[tuple[str, str]]:
        """Return the rows of :meth:`SolutionRecord._notebook_rows`, and one with the eigenvalues."""
        return [*super()._notebook_rows(), ("eigenvalues", ", ".join(f"{value:.6g}" for value in self.eigenvalues))]


def compare_modes(
    fine: EigenRecord, coarse: EigenRecord, points: Floats, dims: Ints | None = None
) -> tuple[Floats, Floats]:
    """Return the differences of the eigenvalues (count,) and of the eigenfunctions (n, count) of two solutions.

    Each eigenfunction of ``fine`` is approximated by least squares in those of ``coarse`` at ``points`` (n, d) of the
    scene, which also works for multiple eigenvalues, whose basis is arbitrary. Its eigenvalue is compared with the mean
    of the coarse eigenvalues, weighted by the squares of the coefficients. The difference of an eigenvalue is infinite
    if the coarse solution does not recover its mode: more than half of the mean square of the eigenfunction is left as
    a remainder. The differences of eigenfunctions are the absolute values of these remainders at the points. ``dims``
    (n,) are the dimensions of the members on which the points are, in a union of several dimensions.
    """
    of_fine, of_coarse = (modes.evaluate_by_dimension(points, dims) for modes in (fine, coarse))
    weights = np.linalg.lstsq(of_coarse, of_fine, rcond=None)[0]
    remainder = np.abs(of_fine - of_coarse @ weights)
    recovered = 1 - np.mean(remainder**2, axis=0) / np.mean(of_fine**2, axis=0)
    shares = weights**2 / np.sum(weights**2, axis=0)
    differences = np.abs(fine.eigenvalues - coarse.eigenvalues @ shares)
    return np.where(recovered >= 0.5, differences, np.inf), remainder


#: A problem is undetermined if its eigenvalue is within so many of its errors of zero; beyond the second number of
#: errors from zero, the eigenvalue's error does not matter.
NEAR_RESONANCE_ERRORS, AMPLIFYING_ERRORS = 2.0, 20.0


@dataclass(frozen=True)
class Resonance:
    """The eigenvalue of a steady operator nearest to zero, and the part of the solution in its modes."""

    #: The discrete eigenvalue of (-div(a grad u) + c u) / a nearest to zero; for standing waves this is an eigenvalue
    #: of -Lap minus k^2.
    gap: float
    error: float  #: Estimated error of the form's eigenvalues there.
    rms: float  #: Root mean square of the solution's part in these modes, as a share of the solution's range.
    largest: float  #: The largest value of this part, as a share of the range.

    @property
    def is_undetermined(self) -> bool:
        """True if the eigenvalue is within two of its errors of zero, so that it may be zero or of the other sign."""
        return abs(self.gap) <= NEAR_RESONANCE_ERRORS * self.error

    def amplified_error(self, measured: float) -> tuple[float, float]:
        """Return the rms and the largest error of u that the eigenvalue's error causes, as shares of the range of u.

        The part of u in the eigenvalue's modes is f / gap, with the relative error ``error / (|gap| - error)``. The
        result is the whole range if the eigenvalue may be zero, and zero if the eigenvalue is more than 20 errors from
        zero. The eigenvalue's error is ``measured``, but at least half of the form's estimate.
        """
        error = max(measured, 0.5 * self.error)
        if abs(self.gap) <= NEAR_RESONANCE_ERRORS * error:
            return 1.0, 1.0
        if abs(self.gap) > AMPLIFYING_ERRORS * error:
            return 0.0, 0.0
        factor = error / (abs(self.gap) - error)
        return factor * self.rms, factor * self.largest
