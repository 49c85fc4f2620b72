"""What was done to reach an error, or to stay within a time or a memory."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from cpmkit.forms.accuracy_target import AccuracyTarget

#: ``reached``: the estimate is below the tolerance. ``floor``: the source leaves more than the tolerance, and the
#: estimate is below that. ``within``: nothing but a time or a memory was asked for. ``not reached``: neither.
Status = Literal["reached", "floor", "within", "not reached"]
Purpose = Literal["pilot", "companion", "answer", "correction"]


@dataclass(frozen=True)
class Step:
    """One solve on the way.

    Attributes
    ----------
    purpose : str
        ``pilot``: to see how the error falls and what solves cost; ``companion``: what the answer is held against;
        ``answer``; ``correction``: a finer answer, for the first one's estimate was above the tolerance.
    spacing : float
        Of the lattice.
    step : float
        In time; 0 where there is none.
    unknowns : int
        Size of the system.
    seconds : float
        That it took.
    error : float
        The estimate, as a share of the range; NaN where nothing coarser was there.
    """

    purpose: Purpose
    spacing: float
    step: float
    unknowns: int
    seconds: float
    error: float


@dataclass(frozen=True)
class Trade:
    """The way to a solution for which an error, a time or a memory was asked.

    Attributes
    ----------
    target : AccuracyTarget
        What was asked for.
    status : str
        ``reached``, ``floor``, ``within`` or ``not reached``.
    error : float
        The estimate of the answer's error in the norm that was asked for.
    predicted_bytes : float
        Memory at the peak, as foretold for the answer.
    seconds : float
        In all.
    steps : tuple of Step
        Every solve, in order.
    told : str
        What came of it, in a sentence.
    chosen : str
        What was chosen beside the spacing, and why; empty where nothing was.
    """

    target: AccuracyTarget
    status: Status
    error: float
    predicted_bytes: float
    seconds: float
    steps: tuple[Step, ...]
    told: str
    chosen: str = ""

    @property
    def cost_over_last_solve(self) -> float:
        """Seconds in all, estimates included, over those of the last solve."""
        return self.seconds / self.steps[-1].seconds

    def as_dict(self) -> dict[str, Any]:
        """Return all of it as plain values."""
        return {**asdict(self), "cost_over_last_solve": self.cost_over_last_solve}

    def __str__(self) -> str:
        lines = [
            f"{step.purpose:<10} spacing {step.spacing:<8.3g} {step.unknowns:>9,} unknowns  {step.seconds:7.2f} s  "
            f"{'error not yet known' if step.error != step.error else f'error about {step.error:.2g}'}"
            for step in self.steps
        ]
        return "\n".join([*lines, *([self.chosen] if self.chosen else []), self.told])
