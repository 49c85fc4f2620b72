"""The state of a run at one time, and the last few of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cpmkit.types import Floats

#: Moments that schemes look back on.
REMEMBERED_MOMENTS = 3


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
        Of the step that led here; zero at the start.
    acceleration : (n, channels) float64 or None
        Of leapfrog: at the start of that step.
    time : float
        When it is; that of a step's end, however that was rounded.
    """

    u: Floats
    rate: Floats | None
    length: float
    acceleration: Floats | None = None
    time: float = 0.0


History = Sequence[Moment]
