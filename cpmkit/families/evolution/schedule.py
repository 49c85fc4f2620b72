"""The steps of a run in time, and the moments at their ends.

Steps are equal, except for a shorter step before a frame and before the end where the step does not fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cpmkit.types import Floats

#: Shares of a step up to this are rounding, and no step of their own.
ROUNDED_STEP_SHARE = 1e-9
#: Digits to which the ratio of a shortened step to the others is rounded, so that equal steps share a system.
STEP_RATIO_DIGITS = 9
#: Number of moments that schemes read.
REMEMBERED_MOMENTS = 3


@dataclass(frozen=True)
class Step:
    """One step in time.

    Attributes
    ----------
    start, end : float
        Times at the ends of the step.
    length : float
        ``end - start`` up to rounding; equal steps have equal lengths.
    is_frame : bool
        Whether the solution at the end is stored.
    """

    start: float
    end: float
    length: float
    is_frame: bool


@dataclass(frozen=True, eq=False)
class Moment:
    """The unknowns at one time.

    Attributes
    ----------
    u : (n, channels) float64
        Values of the unknowns.
    rate : (n, channels) float64 or None
        For a wave the time derivatives of the unknowns; for leapfrog those half a step before.
    length : float
        Length of the step that ends at this time; zero at the start.
    acceleration : (n, channels) float64 or None
        For leapfrog the second derivatives at the start of that step.
    time : float
        The time, as the schedule has it.
    """

    u: Floats
    rate: Floats | None
    length: float
    acceleration: Floats | None = None
    time: float = 0.0


History = Sequence[Moment]


def schedule(until: float, step: float, frames: Sequence[float], start: float = 0.0) -> list[Step]:
    """Return the steps from time ``start`` to ``until``, with a step that ends at each time in ``frames``.

    Examples
    --------
    >>> [(each.end, each.length) for each in schedule(1.0, 0.4, ())]
    [(0.4, 0.4), (0.8, 0.4), (1.0, 0.2)]
    """
    steps: list[Step] = []
    begin = start
    for stop in sorted({*(time for time in frames if time > start), until}):
        steps += _between(begin, stop, step, stop in frames)
        begin = stop
    return steps


def _between(start: float, stop: float, step: float, is_frame: bool) -> Iterator[Step]:
    """Yield equal steps from ``start`` to ``stop``, the last one shorter if they do not fit.

    ``is_frame`` is the property of the last step.
    """
    ratio = (stop - start) / step
    whole = int(ratio + ROUNDED_STEP_SHARE)
    rest = round(ratio - whole, STEP_RATIO_DIGITS)
    lengths = [step] * whole + ([rest * step] if rest > ROUNDED_STEP_SHARE else []) or [stop - start]
    times = [start, *(start + number * step for number in range(1, len(lengths))), stop]
    for number, length in enumerate(lengths):
        yield Step(times[number], times[number + 1], length, is_frame and number == len(lengths) - 1)
