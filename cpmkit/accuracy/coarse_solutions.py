"""The error of a solution estimated from its differences to coarser solutions, and from the solution alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.accuracy.error_estimate import ErrorEstimate
from cpmkit.forms.form_records import Diagnosis, ExpectedError
from cpmkit.solution.modes import EigenRecord, compare_modes
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats

#: Number of points at which solutions are compared: per unknown of the finer solution, at least, and at most.
COMPARED_PER_UNKNOWN, LEAST_COMPARED, MOST_COMPARED = 0.15, 200, 3_000
#: Eigenvalues below this share of the largest count as zero: the unit of their errors is the first larger eigenvalue.
ZERO_SHARE = 1e-6
#: Largest range of a constant solution, as a share of its size: rounding.
ROUNDING_SHARE = 1e-12
#: Weight of the estimate from coarse solutions, in the geometric mean with that from the solution alone, where it is
#: the larger one (a coarse lattice that does not resolve the solution makes differences large), and where it is not.
WEIGHT_ABOVE, WEIGHT_BELOW = 0.35, 0.5
#: The result is at least this share of the estimate from coarse solutions: the solution alone does not show the errors
#: of quadrature.
LEAST_OF_APART = 0.45
#: Factor by which estimates are too small where a solution is hardly resolved (measured).
UNRESOLVED_FACTOR = 1.7


@dataclass(frozen=True, eq=False)
class Difference:
    """The difference of two solutions.

    Attributes
    ----------
    rms, largest : (channels,) float64
        Root mean square and largest difference, as shares of ``unit``; for eigenvalue problems both are the relative
        difference of each eigenvalue, infinite where the coarser solution has no matching mode.
    unit : (channels,) float64
        The range of the finer solution, or its size where it is constant; for eigenvalue problems each eigenvalue.
    at : (d,) float64
        The point where the solutions differ most, in the scene's coordinates.
    ratio : float
        The coarser spacing over the finer one.
    """

    rms: Floats
    largest: Floats
    unit: Floats
    at: Floats
    ratio: float


def compared_points(solution: SolutionRecord) -> tuple[Floats, Floats, Floats]:
    """Return points (k, d) where a solution is compared, weights (k,) of sum 1, and its values (k, channels) there."""
    form = solution.discretized
    count = min(max(int(COMPARED_PER_UNKNOWN * form.size), LEAST_COMPARED), MOST_COMPARED)
    rows, points = form.some_points(count)
    if form.point_weights is None:
        weights, values = np.ones(len(rows)), solution.evaluate(points)
    else:
        weights, values = form.point_weights[rows], form.at_points(solution.values, rows)
    return points, weights / weights.sum(), values.reshape(len(points), -1)


def difference(fine: SolutionRecord, coarse: SolutionRecord) -> Difference:
    """Return the difference of the solution ``fine`` from one at a larger spacing, at points of the finer one."""
    points, weights, values = compared_points(fine)
    ratio = coarse.spacing / fine.spacing
    if isinstance(fine, EigenRecord) and isinstance(coarse, EigenRecord):
        differences, pointwise = compare_modes(fine, coarse, points)
        size = np.abs(fine.eigenvalues)
        unit = np.maximum(size, size[size > ZERO_SHARE * size.max()].min(initial=size.max()) or 1.0)
        at = points[int(pointwise.max(axis=1).argmax())]
        return Difference(differences / unit, differences / unit, unit, at, ratio)
    pointwise = np.abs(values - coarse.evaluate(points).reshape(len(points), -1))
    unit = _ranges(values)
    at = points[int((pointwise / unit).max(axis=1).argmax())]
    return Difference(np.sqrt(weights @ pointwise**2) / unit, pointwise.max(axis=0) / unit, unit, at, ratio)


def error_unit(solution: SolutionRecord) -> Floats:
    """Return the unit (channels,) of relative errors of a solution: its range at the points of comparison."""
    return _ranges(compared_points(solution)[2])


def _ranges(values: Floats) -> Floats:
    """Return the range (channels,) of values (k, channels); the size if the range is rounding, 1 if that is zero."""
    extent, size = np.ptp(values, axis=0), np.abs(values).max(axis=0)
    return np.where(extent > ROUNDING_SHARE * size, extent, np.where(size > 0, size, 1.0))


def estimate_alone(solution: SolutionRecord) -> ExpectedError | None:
    """Return the error of a solution estimated from that solution alone; None if the form has no such estimate."""
    return None if isinstance(solution, EigenRecord) else solution.discretized.estimate(solution.values)


def estimate_from(
    solution: SolutionRecord,
    coarse_solutions: Sequence[SolutionRecord],
    in_time: float = 0.0,
    order: float | None = None,
    alone: ExpectedError | None = None,
) -> ErrorEstimate:
    """Return the error of a solution estimated from coarser solutions.

    Each coarser solution, at r times the spacing, gives ``|u_h - u_rh| / (r^p - 1)``; the estimate is the geometric
    mean of these. The order p is that of the form for differences at that ratio (docs/explanation/galerkin.md,
    section 10). With ``alone`` the result is a weighted geometric mean of this estimate and the estimate from the
    solution alone: the two are independent, and together are less often too small than either (measured:
    docs/explanation/galerkin.md).

    Parameters
    ----------
    solution : SolutionRecord
        The solution whose error is estimated.
    coarse_solutions : sequence of Solution
        Solutions at larger spacings, the coarsest last.
    in_time : float
        The error of the steps in time, as a share of the range, which is added.
    order : float, optional
        The order p, if it is not that of the form.
    alone : ExpectedError, optional
        See :func:`estimate_alone`.
    """
    differences = [difference(solution, coarse) for coarse in coarse_solutions]
    diagnoses = [_diagnosis(solution, *pair) for pair in zip(coarse_solutions, differences, strict=True)]
    orders = [order or diagnosis.order for diagnosis in diagnoses]
    divisors = [apart.ratio**p - 1 for apart, p in zip(differences, orders, strict=True)]
    coarsest = differences[-1]
    by_norm = {
        norm: _geometric_mean([getattr(apart, norm) / by for apart, by in zip(differences, divisors, strict=True)])
        for norm in ("rms", "largest")
    }
    rms, largest = (_combine(error, norm, alone, coarsest.unit) for norm, error in by_norm.items())
    resonant_rms, resonant_largest = _resonance_error(solution, coarse_solutions[-1], coarsest)
    rms, largest = np.maximum(rms, resonant_rms), np.maximum(largest, resonant_largest)
    source_error = 0.0 if isinstance(solution, EigenRecord) else solution.discretized.source_error()
    slow = diagnoses[-1].slow
    if not slow and alone is not None and alone.unresolved:
        slow = "waves or peaks that the spacing hardly resolves; the error may fall slowly"
    if not slow and resonant_largest >= 1:
        slow = "an eigenvalue is as near as its error: size and sign of the solution are not determined"
    return ErrorEstimate(
        rms + in_time,
        largest + in_time,
        coarsest.unit,
        in_time,
        np.full(len(coarsest.unit), source_error),
        coarsest.at,
        slow,
        solution,
        tuple(coarse_solutions),
        orders[-1],
        np.ones_like(largest) if alone is None else largest / by_norm["largest"],
    )


def _resonance_error(solution: SolutionRecord, coarse: SolutionRecord, apart: Difference) -> tuple[float, float]:
    """Return the rms and the largest error of a solution due to an eigenvalue near zero; 0 if there is none.

    The error of the eigenvalue is estimated from the eigenvalue on the lattice of the ``coarse`` solution, if known.
    """
    fine, other = solution.resonance, coarse.resonance
    if fine is None:
        return 0.0, 0.0
    order = solution.discretized.diagnosis(coarse.discretized, apart.ratio, eigenvalues=True).order
    error = fine.error if other is None else abs(fine.gap - other.gap) / (apart.ratio**order - 1)
    return fine.amplified_error(error)


def _combine(error: Floats, norm: str, alone: ExpectedError | None, unit: Floats) -> Floats:
    """Return the weighted mean (channels,) of an ``error`` from coarse solutions and that from the solution alone.

    The first is a share of ``unit``, the second in the solution's unit; without ``alone`` it is the first.
    """
    if alone is None:
        return error
    expected = getattr(alone, norm) / unit
    weight = np.where(error > expected, WEIGHT_ABOVE, WEIGHT_BELOW)
    tiny = np.finfo(float).tiny
    mean = np.maximum(error, tiny) ** weight * np.maximum(expected, tiny) ** (1 - weight)
    return np.asarray(np.maximum(mean, LEAST_OF_APART * error) * (UNRESOLVED_FACTOR if alone.unresolved else 1.0))


def _diagnosis(solution: SolutionRecord, coarse: SolutionRecord, apart: Difference) -> Diagnosis:
    """Return the form's diagnosis of the differences ``apart`` between a solution and a coarser one."""
    eigenvalues = isinstance(solution, EigenRecord)
    return solution.discretized.diagnosis(coarse.discretized, apart.ratio, float(apart.rms.max()), eigenvalues)


def _geometric_mean(errors: Sequence[Floats]) -> Floats:
    """Return the geometric mean (channels,) of several errors (channels,)."""
    return np.asarray(np.exp(np.mean(np.log(np.maximum(errors, np.finfo(float).tiny)), axis=0)))
