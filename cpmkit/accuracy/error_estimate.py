"""The estimated error of a solution: its size, where it is largest, and the coarser solutions that it comes from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.form_records import ExpectedError
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.solution.display_mesh import DisplayMesh, evaluate_on_sides
from cpmkit.solution.modes import EigenRecord, compare_modes
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats, Ints

#: Largest range of a constant solution, as a share of its size: rounding.
ROUNDING_SHARE = 1e-12
#: The error due to the source is not printed below this share of the estimated error.
NEGLIGIBLE_FLOOR = 0.01


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """An estimate of the error of a solution, or of its eigenvalues."""

    #: (channels,): root mean square of the error over the manifold, as a share of the solution's range; for an
    #: eigenvalue problem the relative error of each eigenvalue, infinite where a coarser lattice has no matching mode.
    rms: Floats
    largest: Floats  #: (channels,): the largest error, as a share of the range; of eigenvalues the same as ``rms``.
    unit: Floats  #: (channels,): the range of the solution, its size where it is constant, or each eigenvalue.
    in_time: float  #: The part of ``rms`` that is due to the steps in time; ``largest`` has a part of its own.
    #: (channels,): the error, a share, due to the source of the manifold at any spacing; 0, unknown, for eigenvalues.
    floor: Floats
    at: Floats  #: (d,): the point where the solutions differ most, in the scene's coordinates.
    slow: str  #: Why the error may fall slowly with the spacing; empty without a reason.
    solution: SolutionRecord  #: The solution.
    coarse_solutions: tuple[SolutionRecord, ...]  #: The solutions at larger spacings for comparison, coarsest last.
    order: float  #: The order at which errors are assumed to fall from the coarsest solution on.
    #: (channels,): factor of errors at points: the largest error over its estimate from the coarse solutions alone.
    factor: Floats

    companions = DeprecatedMember("coarse_solutions")

    @property
    def error(self) -> Floats:
        """The largest error (channels,), in the solution's unit."""
        return np.asarray(self.largest * self.unit)

    @property
    def bound(self) -> Floats:
        """Twice ``error`` plus ``floor * unit``, thrice this if estimated (channels,), in u's unit; rarely exceeded."""
        return np.asarray(2.0 * self.error + (1.0 if self.floor_is_bound else 3.0) * self.floor * self.unit)

    @property
    def floor_is_bound(self) -> bool:
        """Whether ``floor`` is a bound: that of a mesh read as smooth, unless the source's own estimate is larger."""
        form = self.solution.discretized
        return bool(form.source_error(0.0) < min(self.floor.max(), form.source_error()))

    @property
    def floor_in_words(self) -> str:
        """The error due to the source in percent, with "about" or "at most"; "" if it is negligible."""
        if self.floor.max() <= NEGLIGIBLE_FLOOR * self.rms.max():
            return ""
        about = "at most" if self.floor_is_bound else "about"
        return f", beside {about} {100 * self.floor.max():.2g} percent that the source leaves"

    @property
    def coarse(self) -> SolutionRecord:
        """The coarsest solution used for the estimate."""
        return self.coarse_solutions[-1]

    def of(self, norm: str) -> float:
        """Return the error in the norm ``"rms"`` or ``"max"``, as a share of ``unit``; the largest of the channels."""
        return float(np.max(self.rms if norm == "rms" else self.largest))

    def at_points(self, points: Any) -> Floats:
        """Return the estimated error (n,) or (n, channels) at points (n, d), in the unit of u, without ``in_time``."""
        values = (each.evaluate(points).reshape(len(points), each.channels) for each in (self.solution, self.coarse))
        errors = self._pointwise_error(*values)
        return np.asarray(errors[:, 0] if errors.shape[1] == 1 else errors)

    def on_mesh(self, mesh: DisplayMesh) -> Floats:
        """Return :meth:`at_points` (v, channels) at a mesh's vertices, on their cells' side if it has ``sides``."""
        sides = np.zeros((len(mesh.points), 0), dtype=np.int64) if mesh.sides is None else mesh.sides
        pair = (self.solution, self.coarse)
        return self._pointwise_error(*(evaluate_on_sides(solution, mesh.points, sides) for solution in pair))

    def _pointwise_error(self, fine: Floats, coarse: Floats) -> Floats:
        """Return the error (n, channels) from the values (n, channels) of the solution and of the coarsest one."""
        if self.solution.has_modes:
            coarse = coarse @ np.linalg.lstsq(coarse, fine, rcond=None)[0]
        ratio = self.coarse.spacing / self.solution.spacing
        return np.asarray(self.factor * np.abs(fine - coarse) / (ratio**self.order - 1))

    def as_dict(self) -> dict[str, Any]:
        """Return the estimate as numbers, lists and strings by name, with the coarser spacings, the coarsest last."""
        arrays = {name: getattr(self, name).tolist() for name in ("rms", "largest", "unit", "floor", "at")}
        spacings = [solution.spacing for solution in self.coarse_solutions]
        return {**arrays, "in_time": self.in_time, "slow": self.slow, "held_against_spacings": spacings}

    def __str__(self) -> str:
        """Return the error, its bound, place and causes in a sentence; for eigenvalues the error of each."""
        rms = ", ".join(f"{100 * share:.2g}" for share in self.rms)
        spacing, slow = self.solution.spacing, f"{'; ' if self.slow else ''}{self.slow}"
        if self.solution.has_modes:
            return f"error about {rms} percent of each eigenvalue at spacing {spacing:g}, rarely above twice that{slow}"
        errors = ", ".join(f"{error:.2g}" for error in self.error)
        in_time = f" ({100 * self.in_time:.2g} from the steps in time)" if self.in_time else ""
        return (
            f"largest error about {errors} at spacing {spacing:g}, rarely above {float(self.bound.max()):.2g}, "
            f"near {place(self.at)}; root mean square {rms} percent of the range{in_time}"
            f"{self.floor_in_words}{slow}"
        )


@dataclass(frozen=True, eq=False)
class Difference:
    """The difference of two solutions."""

    #: (2, channels): root mean square and largest difference, as shares of ``unit``; for eigenvalue problems both are
    #: the relative difference of each eigenvalue, infinite where the coarser solution has no matching mode.
    sizes: Floats
    unit: Floats  #: (channels,): as :attr:`ErrorEstimate.unit`, of the finer solution.
    at: Floats  #: (d,): the point where the solutions differ most, in the scene's coordinates.
    ratio: float  #: The coarser spacing over the finer one; 1 if they are equal.


class ComparedPoints(NamedTuple):
    """Points at which solutions are compared."""

    points: Floats  #: (k, d): the points, in the scene's coordinates.
    weights: Floats  #: (k,): their weights, of sum 1.
    values: Floats  #: (k, channels): the values of the finer solution.
    dims: Ints | None  #: (k,): the dimensions of the members on which the points are, in a union of several dimensions.


def compared_points(solution: SolutionRecord) -> ComparedPoints:
    """Return points where a solution is compared, with its values there."""
    form = solution.discretized
    rows, points = form.some_points(min(max(int(0.15 * form.size), 200), 3_000))
    if form.point_weights is None:
        weights, values = np.ones(len(rows)), solution.evaluate(points)
    else:
        weights, values = form.point_weights[rows], form.at_points(solution.values, rows)
    dims = None
    if parts := form.traits.parts:
        ends = [part.points.stop for part in parts]
        dims = np.array([part.dim for part in parts])[np.searchsorted(ends, rows, side="right")]
    return ComparedPoints(points, weights / weights.sum(), values.reshape(len(points), -1), dims)


def difference(fine: SolutionRecord, coarse: SolutionRecord) -> Difference:
    """Return the difference of two solutions at points of ``fine``, relative to its range, or to each eigenvalue.

    ``coarse`` has a larger spacing, or the same spacing and longer steps or the flat triangles of the surface.
    """
    points, weights, values, dims = compared_points(fine)
    ratio = coarse.spacing / fine.spacing
    if fine.has_modes:
        modes = cast("EigenRecord", fine)
        differences, pointwise = compare_modes(modes, cast("EigenRecord", coarse), points, dims)
        size = np.abs(modes.eigenvalues)
        # errors of eigenvalues that count as zero are relative to the first larger eigenvalue
        unit = np.maximum(size, size[size > 1e-6 * size.max()].min(initial=size.max()) or 1.0)
        at = points[int(pointwise.max(axis=1).argmax())]
        return Difference(np.stack([differences, differences]) / unit, unit, at, ratio)
    pointwise = np.abs(values - coarse.evaluate_by_dimension(points, dims))
    unit = _value_ranges(values)
    at = points[int((pointwise / unit).max(axis=1).argmax())]
    sizes = np.stack([np.sqrt(weights @ pointwise**2), pointwise.max(axis=0)])
    return Difference(sizes / unit, unit, at, ratio)


def error_unit(solution: SolutionRecord) -> Floats:
    """Return the unit (channels,) of relative errors: a solution's range, its size if it is constant, 1 if zero."""
    return _value_ranges(compared_points(solution).values)


def _value_ranges(values: Floats) -> Floats:
    """Return the range (channels,) of values (k, channels); their size if that is rounding, 1 if all are zero."""
    extent, size = np.ptp(values, axis=0), np.abs(values).max(axis=0)
    return np.where(extent > ROUNDING_SHARE * size, extent, np.where(size > 0, size, 1.0))


def estimate_alone(solution: SolutionRecord) -> ExpectedError | None:
    """Return the error of a solution estimated from it alone; None for eigenvalues and forms without an estimate."""
    return None if solution.has_modes else solution.discretized.estimate(solution.values)


def estimate_from(
    solution: SolutionRecord,
    coarse_solutions: Sequence[SolutionRecord],
    in_time: Floats | None = None,
    order: float | None = None,
    alone: ExpectedError | None = None,
) -> ErrorEstimate:
    """Return the error of a solution estimated from coarser solutions, the coarsest last.

    Each coarser solution, at r times the spacing, gives ``|u_h - u_rh| / (r^p - 1)``; the estimate is the geometric
    mean of these. The order p is ``order``, or if that is None the form's for differences at that ratio
    (docs/explanation/accuracy.md). With ``alone``, an estimate from the solution alone, the result is a weighted
    geometric mean of both: they are independent, and their mean is less often too small than either (measured). The
    result is at least the error that an eigenvalue near zero causes. The error of the steps in time, ``in_time`` (2,),
    root mean square and largest as shares of the range, is added.
    """
    in_time = np.zeros(2) if in_time is None else in_time
    differences = [difference(solution, coarse) for coarse in coarse_solutions]
    form, modes, tiny = solution.discretized, solution.has_modes, np.finfo(float).tiny
    diagnoses = [
        form.diagnosis(coarse.discretized, apart.ratio, float(apart.sizes[0].max()), modes)
        for coarse, apart in zip(coarse_solutions, differences, strict=True)
    ]
    orders = [order or diagnosis.order for diagnosis in diagnoses]
    errors = [apart.sizes / (apart.ratio**p - 1) for apart, p in zip(differences, orders, strict=True)]
    by_norm = np.exp(np.mean(np.log(np.maximum(errors, tiny)), axis=0))
    coarsest = differences[-1]
    rms, largest = by_norm if alone is None else _combine_estimates(by_norm, alone, coarsest.unit)
    resonant_rms, resonant_largest = _resonance_error(solution, coarse_solutions[-1], coarsest)
    rms, largest = np.maximum(rms, resonant_rms), np.maximum(largest, resonant_largest)
    source_error = 0.0 if modes else form.source_error()
    slow = diagnoses[-1].slow
    if not slow and alone is not None and alone.unresolved:
        first = "the steps in time make most of the error: halve the step first; " if in_time[1] > largest.max() else ""
        slow = f"{first}waves or peaks that the spacing hardly resolves; the error may fall slowly"
    if not slow and resonant_largest >= 1:
        slow = "an eigenvalue is as near as its error: size and sign of the solution are not determined"
    return ErrorEstimate(
        rms + in_time[0],
        largest + in_time[1],
        coarsest.unit,
        float(in_time[0]),
        np.full(len(coarsest.unit), source_error),
        coarsest.at,
        slow,
        solution,
        tuple(coarse_solutions),
        orders[-1],
        np.ones_like(largest) if alone is None else largest / by_norm[1],
    )


def _resonance_error(solution: SolutionRecord, coarse: SolutionRecord, apart: Difference) -> tuple[float, float]:
    """Return the rms and the largest error of a solution due to an eigenvalue near zero; 0 if there is none.

    The errors are shares of the range. The eigenvalue's error is estimated from the eigenvalue of ``coarse``, if known,
    else by the form; ``apart`` is the difference of the two solutions.
    """
    fine, other = solution.resonance, coarse.resonance
    if fine is None:
        return 0.0, 0.0
    order = solution.discretized.diagnosis(coarse.discretized, apart.ratio, eigenvalues=True).order
    error = fine.error if other is None else abs(fine.gap - other.gap) / (apart.ratio**order - 1)
    return fine.amplified_error(error)


def _combine_estimates(errors: Floats, alone: ExpectedError, unit: Floats) -> Floats:
    """Return the weighted geometric mean (2, channels) of errors from coarse solutions and from the solution alone.

    The mean is at least 0.45 times ``errors``, and is multiplied by 1.7 if the solution is hardly resolved. ``errors``
    (2, channels), root mean square and largest, are shares of ``unit`` (channels,); ``alone`` is in the solution's
    unit.
    """
    expected = np.stack([alone.rms, alone.largest]) / unit
    # less weight if larger: a coarse lattice that does not resolve the solution makes differences large
    weight = np.where(errors > expected, 0.35, 0.0 if alone.differences_cancel else 0.5)
    mean = errors**weight * np.maximum(expected, np.finfo(float).tiny) ** (1 - weight)
    # at least .45 of the errors from coarse solutions: the solution alone does not show the errors of quadrature;
    # where a solution is hardly resolved, estimates are too small by a factor of 1.7 (measured)
    return np.asarray(np.maximum(mean, 0.45 * errors) * (1.7 if alone.unresolved else 1.0))
