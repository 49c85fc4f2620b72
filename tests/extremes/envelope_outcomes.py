"""What came of a scene whose solution is known: its error, and whether the user was warned of it."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from extremes.envelope_scenes import Known

import cpmkit as ck
from cpmkit.errors import CpmkitError

FORMS = ("galerkin", "collocation")
#: An estimate covers errors up to so many times itself, and those below a share of the range; what counts as resolved.
FACTOR, SMALL, RESOLVED = 2.5, 1e-3, 0.01
#: Marks of the table.
MARKS = {"right": "", "warned": " w", "refused": "refused", "silent": " !"}


@dataclass(frozen=True)
class Outcome:
    """The root mean square error, as a share of the range, and what was said of it.

    ``state`` is ``"right"``: the estimate covers the error and nothing was said; ``"warned"``; ``"refused"``;
    ``"silent"``: the error is larger than the estimate covers, and nothing was said.
    """

    state: str
    error: float = np.nan

    def __str__(self) -> str:
        return MARKS[self.state] if self.state == "refused" else f"{100 * self.error:.2g}{MARKS[self.state]}"


def outcome(known: Known, form: str) -> Outcome:
    """Solve and compare."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            solution = ck.solve(known.scene, known.spacing, form=form)
        except CpmkitError:
            return Outcome("refused")
        off = solution.evaluate(known.points) - known.u
        error = float(np.sqrt(np.mean(off**2)) / np.ptp(known.u))
        try:
            estimate = solution.error
        except CpmkitError:  # who asks for the estimate hears that there is none
            return Outcome("warned", error)
    covered = error <= max(FACTOR * (estimate.of("rms") + float(estimate.floor.max())), SMALL)
    said = bool(heard or solution.warnings or estimate.slow)
    return Outcome("warned" if said else "right" if covered else "silent", error)
