"""The steps of a run in time, and the moments at their ends.

Steps are equal, with a shorter one before each frame and the end where they do not fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cpmkit.types import Floats

#: A last step shorter than this share of the others is rounding.
ROUNDED_STEP_SHARE = 1e-9
#: Digits of the ratio of a shortened step to the others: equal steps are then equal as numbers, and share a system.
STEP_RATIO_DIGITS = 9
#: Number of moments that schemes read.
REMEMBERED_MOMENTS = 3


@dataclass(frozen=True)
class Step:
    """One step.

    Attributes
    ----------
    start, end : float
        Times.
    length : float
        ``end - start`` but for rounding; equal steps have equal lengths.
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
        Their values.
    rate : (n, channels) float64 or None
        Of a wave: their rates, for leapfrog those half a step before.
    length : float
        Of the step that ends here; zero at the start.
    acceleration : (n, channels) float64 or None
        Of leapfrog: at the start of that step.
    time : float
        The end of the step, as the schedule has it.
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
    ratio = (stop - start) / step
    whole = int(ratio + ROUNDED_STEP_SHARE)
    rest = round(ratio - whole, STEP_RATIO_DIGITS)
    lengths = [step] * whole + ([rest * step] if rest > ROUNDED_STEP_SHARE else []) or [stop - start]
    times = [start, *(start + number * step for number in range(1, len(lengths))), stop]
    for number, length in enumerate(lengths):
        yield Step(times[number], times[number + 1], length, is_frame and number == len(lengths) - 1)
