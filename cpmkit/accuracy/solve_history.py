"""The record of the solves by which a target was met: an error, a time or a memory."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from cpmkit.forms.accuracy_target import AccuracyTarget
from cpmkit.runtime.deprecation import DeprecatedMember

#: ``reached``: the estimate is below the tolerance. ``floor``: the error due to the source of the manifold is above the
#: tolerance, and the estimate is below that error. ``within``: without a tolerance, time and memory were kept. ``not
#: reached``: none of these.
Status = Literal["reached", "floor", "within", "not reached"]
Purpose = Literal["pilot", "companion", "answer", "correction"]


@dataclass(frozen=True)
class SolveStep:
    """One solve on the way to a target.

    Attributes
    ----------
    purpose : str
        ``pilot``: a coarse solve that shows how the error falls and what solves cost; ``companion``: a coarser solution
        with which the answer is compared; ``answer``; ``correction``: a finer answer, as the estimate of the first was
        above the tolerance.
    spacing : float
        Spacing of the lattice.
    step : float
        Step in time; 0 for equations without time.
    unknowns : int
        Number of unknowns.
    seconds : float
        Duration of the solve.
    error : float
        The estimated error, as a share of the range; NaN without a coarser solution to compare with.
    """

    purpose: Purpose
    spacing: float
    step: float
    unknowns: int
    seconds: float
    error: float


@dataclass(frozen=True)
class SolveHistory:
    """The solves by which a target (error, time or memory) was met.

    Attributes
    ----------
    target : AccuracyTarget
        The target.
    status : str
        ``reached``, ``floor``, ``within`` or ``not reached``.
    error : float
        The estimate of the solution's error in the norm of the target.
    predicted_bytes : float
        Predicted peak of memory of the last solve.
    seconds : float
        Duration of all solves together.
    steps : tuple of SolveStep
        All solves, in order.
    summary : str
        The result, in a sentence.
    chosen : str
        Options that were chosen in addition to the spacing, with the reason; empty without any.
    """

    target: AccuracyTarget
    status: Status
    error: float
    predicted_bytes: float
    seconds: float
    steps: tuple[SolveStep, ...]
    summary: str
    chosen: str = ""

    told = DeprecatedMember("summary")
    asked = DeprecatedMember("target")

    @property
    def cost_over_last_solve(self) -> float:
        """Ratio of the seconds of all solves and estimates to the seconds of the last solve."""
        return self.seconds / self.steps[-1].seconds

    def as_dict(self) -> dict[str, Any]:
        """Return the record as a dictionary of plain values."""
        return {**asdict(self), "cost_over_last_solve": self.cost_over_last_solve}

    def __str__(self) -> str:
        """Return a line for each solve, then the options chosen and the result."""
        lines = [
            f"{step.purpose:<10} spacing {step.spacing:<8.3g} {step.unknowns:>9,} unknowns  {step.seconds:7.2f} s  "
            f"{'error not yet known' if step.error != step.error else f'error about {step.error:.2g}'}"
            for step in self.steps
        ]
        return "\n".join([*lines, *([self.chosen] if self.chosen else []), self.summary])
