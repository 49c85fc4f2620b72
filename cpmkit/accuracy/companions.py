"""Estimates from solutions that are there: of coarser lattices, and of what the solution alone lets expect."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpmkit.accuracy.comparison import Difference, difference
from cpmkit.accuracy.error_estimate import ErrorEstimate
from cpmkit.forms.form_records import Diagnosis, ExpectedError
from cpmkit.protocols import Floats
from cpmkit.solution.modes import EigenRecord
from cpmkit.solution.record import SolutionRecord

#: What an estimate by companions weighs in the geometric mean with what the solution alone lets expect, where it is the
#: larger one of both, for a coarser lattice that does not resolve yet what the finer one does makes differences large,
#: and where it is not.
WEIGHT_ABOVE, WEIGHT_BELOW = 0.35, 0.5
#: Of an estimate by companions at least this share counts: the solution alone tells nothing of what samples leave.
LEAST_OF_APART = 0.45
#: By how much estimates are too small where a solution is hardly resolved.
UNRESOLVED_FACTOR = 1.7
UNRESOLVED_SENTENCE = "waves or peaks that the spacing hardly resolves; the error may fall slowly"

RESONANT_SENTENCE = "an eigenvalue is as near as its error: size and sign of the solution are not determined"


def from_companions(
    solution: SolutionRecord,
    companions: Sequence[SolutionRecord],
    in_time: float = 0.0,
    order: float | None = None,
    alone: ExpectedError | None = None,
) -> ErrorEstimate:
    """Estimate from solutions at larger spacings that are there; ``in_time`` is what the steps add, as a share.

    The estimate is the geometric mean of those from each companion: |u_h - u_rh| / (r^p - 1) at r times the spacing,
    with the order p that the form has for differences at that ratio (GALERKIN 10), or that is given; and a geometric
    mean of that and of what the solution ``alone`` lets expect, if that is given. The two know nothing of each other,
    and both together are seldomer too small than either (measured: docs/explanation/galerkin.md).
    """
    form = solution.discretized
    found = [difference(solution, one) for one in companions]
    diagnoses = [_diagnosis(solution, *both) for both in zip(companions, found, strict=True)]
    orders = [order or one.order for one in diagnoses]
    divisors = [one.ratio**p - 1 for one, p in zip(found, orders, strict=True)]
    last = found[-1]
    apart = {
        norm: _mean([getattr(one, norm) / divisor for one, divisor in zip(found, divisors, strict=True)])
        for norm in ("rms", "largest")
    }
    rms, largest = (_agreed(one, norm, alone, last.unit) for norm, one in apart.items())
    resonant_rms, resonant_largest = _resonant(solution, companions[-1], last)
    rms, largest = np.maximum(rms, resonant_rms), np.maximum(largest, resonant_largest)
    left = 0.0 if isinstance(solution, EigenRecord) else form.source_error()
    floor = np.full(len(last.unit), left)
    slow = diagnoses[-1].slow or (UNRESOLVED_SENTENCE if alone and alone.unresolved else "")
    slow = slow or (RESONANT_SENTENCE if resonant_largest >= 1 else "")
    return ErrorEstimate(
        rms + in_time,
        largest + in_time,
        last.unit,
        in_time,
        floor,
        last.at,
        slow,
        solution,
        tuple(companions),
        orders[-1],
        np.ones_like(largest) if alone is None else largest / apart["largest"],
    )


def _resonant(solution: SolutionRecord, companion: SolutionRecord, found: Difference) -> tuple[float, float]:
    """Return the errors, rms and largest, that come from an eigenvalue near zero: 0 where there is none.

    The error of the eigenvalue is measured on the companion's lattice, which has one of its own.
    """
    mine, theirs = solution.resonance, companion.resonance
    if mine is None:
        return 0.0, 0.0
    order = solution.discretized.diagnosis(companion.discretized, found.ratio, eigenvalues=True).order
    error = mine.error if theirs is None else abs(mine.gap - theirs.gap) / (found.ratio**order - 1)
    return mine.amplified(error)


def expected_of(solution: SolutionRecord) -> ExpectedError | None:
    """Return what a solution alone lets expect of its error; None where that is not known."""
    return None if isinstance(solution, EigenRecord) else solution.discretized.estimate(solution.values)


def _agreed(apart: Floats, norm: str, alone: ExpectedError | None, unit: Floats) -> Floats:
    """Return the mean of an estimate by companions and of what the solution alone lets expect, if that is known."""
    if alone is None:
        return apart
    told = getattr(alone, norm) / unit
    weight = np.where(apart > told, WEIGHT_ABOVE, WEIGHT_BELOW)
    tiny = np.finfo(float).tiny
    mean = np.maximum(apart, tiny) ** weight * np.maximum(told, tiny) ** (1 - weight)
    return np.asarray(np.maximum(mean, LEAST_OF_APART * apart) * (UNRESOLVED_FACTOR if alone.unresolved else 1.0))


def _diagnosis(solution: SolutionRecord, companion: SolutionRecord, found: Difference) -> Diagnosis:
    return solution.discretized.diagnosis(
        companion.discretized, found.ratio, float(found.rms.max()), isinstance(solution, EigenRecord)
    )


def _mean(found: Sequence[Floats]) -> Floats:
    return np.asarray(np.exp(np.mean(np.log(np.maximum(found, np.finfo(float).tiny)), axis=0)))
