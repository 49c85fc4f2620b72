"""The eigenvalue of a steady problem's operator that is nearest to zero: what it multiplies errors by."""

from __future__ import annotations

from dataclasses import dataclass

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
