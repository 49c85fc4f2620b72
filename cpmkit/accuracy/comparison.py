"""Two solutions of one scene at different spacings held against each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.protocols import Floats
from cpmkit.solution.modes import EigenRecord, compare_modes
from cpmkit.solution.record import SolutionRecord

#: Points of the finer solution that are compared, for each of its unknowns, at least, and at most.
COMPARED_PER_UNKNOWN, LEAST_COMPARED, MOST_COMPARED = 0.15, 200, 3_000
#: Eigenvalues below this share of the largest are zero: their errors are shares of the first that is not.
ZERO_SHARE = 1e-6
#: A range below this share of a solution's size is rounding.
ROUNDING_SHARE = 1e-12


@dataclass(frozen=True, eq=False)
class Difference:
    """By how much two solutions differ.

    Attributes
    ----------
    rms, largest : (channels,) float64
        Of the difference, as shares of ``unit``; of eigenvalue problems both are the relative difference of each
        eigenvalue, infinite where the coarser solution has no mode like it.
    unit : (channels,) float64
        The range of the finer solution, its size where it is constant; of eigenvalue problems each eigenvalue.
    at : (d,) float64
        Where they differ most, in the scene's coordinates.
    ratio : float
        The coarser spacing over the finer one.
    """

    rms: Floats
    largest: Floats
    unit: Floats
    at: Floats
    ratio: float


def compared_points(solution: SolutionRecord) -> tuple[Floats, Floats, Floats]:
    """Return points (k, d) at which a solution is compared, their weights (k,) and its values (k, channels) there."""
    form = solution.discretized
    count = min(max(int(COMPARED_PER_UNKNOWN * form.size), LEAST_COMPARED), MOST_COMPARED)
    chosen, points = form.some_points(count)
    if form.point_weights is None:
        weights, values = np.ones(len(chosen)), solution.evaluate(points)
    else:
        weights, values = form.point_weights[chosen], form.at_points(solution.values, chosen)
    return points, weights / weights.sum(), values.reshape(len(points), -1)


def difference(fine: SolutionRecord, coarse: SolutionRecord) -> Difference:
    """Return by how much a solution differs from one at a larger spacing, at the points of the finer one."""
    points, weights, ours = compared_points(fine)
    ratio = coarse.spacing / fine.spacing
    if isinstance(fine, EigenRecord) and isinstance(coarse, EigenRecord):
        differences, apart = compare_modes(fine, coarse, points)
        size = np.abs(fine.eigenvalues)
        unit = np.maximum(size, size[size > ZERO_SHARE * size.max()].min(initial=size.max()) or 1.0)
        at = points[int(apart.max(axis=1).argmax())]
        return Difference(differences / unit, differences / unit, unit, at, ratio)
    apart = np.abs(ours - coarse.evaluate(points).reshape(len(points), -1))
    unit = _scales(ours)
    at = points[int((apart / unit).max(axis=1).argmax())]
    return Difference(np.sqrt(weights @ apart**2) / unit, apart.max(axis=0) / unit, unit, at, ratio)


def scales_of(solution: SolutionRecord) -> Floats:
    """Return what a solution's errors are shares of, (channels,): its range where it is compared."""
    return _scales(compared_points(solution)[2])


def _scales(values: Floats) -> Floats:
    """Return the range of each channel of (k, channels), its size where that is rounding, and 1 where it is zero."""
    extent, size = np.ptp(values, axis=0), np.abs(values).max(axis=0)
    return np.where(extent > ROUNDING_SHARE * size, extent, np.where(size > 0, size, 1.0))
