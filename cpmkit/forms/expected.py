"""What a form lets expect of a solution's error by the solution alone."""

from __future__ import annotations

from dataclasses import dataclass

from cpmkit.protocols import Floats


@dataclass(frozen=True, eq=False)
class ExpectedError:
    """About how large the error of a solution is, told without another one.

    Attributes
    ----------
    rms, largest : (channels,) float64
        Of the error, in the solution's unit; most are within a factor of two.
    unresolved : bool
        Whether the solution has waves or peaks that the lattice hardly resolves, so that errors may be larger.
    """

    rms: Floats
    largest: Floats
    unresolved: bool
