"""A point cloud as a sample of a smooth surface (in space) or curve (in the plane)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import (
    Advice,
    ClosestPoints,
    Floats,
    InputError,
    Ints,
    as_points,
    as_vector,
    one_row_each,
    place,
    positive,
    source_repr,
)
from cpmkit_pointcloud.blend import Blend, find_feet, surface_normals
from cpmkit_pointcloud.floor import SLOPE_SAMPLES, fitted_floor, integral_floor, slope_error
from cpmkit_pointcloud.patches import curvatures
from cpmkit_pointcloud.rim import count_open_samples
from cpmkit_pointcloud.samples import as_cells, build_kd_tree, query_nearest_samples, thin_out
from cpmkit_pointcloud.values import interpolation_weights

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

#: Neighbours that stray from their plane by more than this share of their spread are no piece of a smooth surface.
THICK_SPREAD_SHARE = 0.25
#: Lowered or thick samples are worth a warning from this share of all on, duplicates from the second one.
SPOILING_SAMPLES_SHARE, REPEATED_SAMPLES_SHARE = 1e-3, 1e-2
#: Distances are exact up to this share of the smallest radius of curvature.
TRUSTED_RADIUS_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class PointCloud:
    """The smooth surface through (or, where there is noise, between) the samples.

    Attributes
    ----------
    surface : Blend
        The samples, each place once, and the patches that define the surface.
    given : (k,) int64
        The row of each sample among the user's points.
    value_count : int
        How many points the user gave: the rows that :meth:`interpolate` expects.
    closed : bool
        False where the surface has an edge.
    given_points : (value_count, d) float64
        The user's points.
    """

    surface: Blend
    given: Ints
    value_count: int
    closed: bool
    given_points: Floats

    exact = False

    __repr__ = source_repr

    @property
    def points(self) -> Floats:
        """(k, d) the samples, each place once."""
        return self.surface.points

    @property
    def dim(self) -> int:
        """Dimension of the space, 2 or 3."""
        return self.points.shape[1]

    @property
    def manifold_dim(self) -> int:
        """Dimension of the manifold: a curve in the plane, a surface in space."""
        return self.dim - 1

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of the box that holds all samples and all feet."""
        return np.stack([self.points.min(axis=0) - self.gap, self.points.max(axis=0) + self.gap])

    @property
    def duplicates(self) -> int:
        """Number of points that were omitted because an earlier one has the same position."""
        return self.value_count - len(self.points)

    @property
    def lowered_degree_count(self) -> int:
        """Number of samples whose neighbours determine only a patch of lower degree than the chosen one."""
        patches = self.surface.patches
        return int((patches.degrees < patches.degree).sum())

    @property
    def thick(self) -> int:
        """Number of samples whose neighbours lie on no smooth surface: on several sheets, at creases, or noisy."""
        return int((self.surface.patches.thickness > THICK_SPREAD_SHARE).sum())

    @cached_property
    def _original(self) -> PointCloud:
        """The cloud before translation, or itself: it caches quantities that do not depend on the position."""
        return self

    @cached_property
    def gap(self) -> float:
        """No foot is farther than this from its nearest sample: the largest radius within which a patch counts."""
        return float(self.surface.patches.radii.max())

    @cached_property
    def trusted_distance(self) -> float:
        """Distance from the surface up to which ``distance`` is the distance of the foot, if this is not on the rim.

        Farther out the nearest foot may be another than the one that was found, and ``distance`` is a lower
        bound: the distance to the samples less :attr:`gap`, but not less than this.
        """
        if self._original is not self:
            return self._original.trusted_distance
        bend = float(curvatures(self.surface.patches).max())
        extent = float(np.linalg.norm(np.ptp(self.points, axis=0)))
        return min(extent, TRUSTED_RADIUS_SHARE / bend) if bend > 0.0 else extent

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d) on the surface.

        ``element`` is the sample nearest to the foot, by the user's numbers. ``edge`` is -1, but 0 on the rim if
        :attr:`closed` is false: feet beyond the rim are moved onto it. ``distance`` is a lower bound for feet on the
        rim and beyond :attr:`trusted_distance`. Feet are ``doubtful`` where the search did not converge, where all
        samples lie on one side of them (in holes of a closed cloud), and where the samples around lie on no smooth
        surface. Raise InputError if ``x`` does not have shape (n, d) or is not finite, or the patches around a query
        contradict each other.
        """
        x = as_points(x, self.dim)
        to_samples, nearest = query_nearest_samples(self._tree, x)
        feet, sample, edge, doubtful = find_feet(self.surface, x, nearest, self._tiny, self.closed)
        lost = ~np.isfinite(feet).all(axis=1)
        if lost.any():
            raise InputError(
                f"The cloud makes no surface near {place(self.points[nearest[np.argmax(lost)]])}: the neighbours of "
                f"{self.thick} of {len(self.points)} samples lie on several sheets, or on none; give normals, fewer "
                "neighbours, or samples nearer to each other than the sheets are."
            )
        doubtful |= self.surface.patches.thickness[sample] > THICK_SPREAD_SHARE
        to_feet = np.linalg.norm(x - feet, axis=1)
        bound = np.maximum(to_samples - self.gap, 0.0)
        distance = np.where(edge < 0, np.maximum(bound, np.minimum(to_feet, self.trusted_distance)), bound)
        return ClosestPoints(feet, distance, edge, self.given[sample], None, doubtful)

    def interpolate(self, values: Floats, feet: ClosestPoints, /) -> Floats:
        """Return (n, ...) ``values`` (value_count, ...) of the user's points by a linear fit at each of ``feet``.

        Of points at the same place the first one's row counts. Raise InputError if ``values`` has another number of
        rows, or ``feet``, records of :meth:`closest_point`, lack ``element``.
        """
        values = one_row_each(values, self.value_count, "points")
        tangents = self.surface.patches.frames[self._sample_rows(feet), :-1]
        index, weights = interpolation_weights(feet.points, self.points, self._tree, tangents)
        return np.einsum("nk,nk...->n...", weights, values[self.given[index]])

    def advice(self, spacing: float, /) -> Advice:
        """Return errors, relative to a solution's range, by gaps and noise of samples at ``spacing``, and warnings.

        Raise InputError if ``spacing`` is not a number above zero.
        """
        slope, width = self._slope
        floor = fitted_floor(slope, width, positive(spacing, "spacing"), self.dim)
        return Advice(
            floor, tuple(self._warnings()), integral_floor(slope, self._noise, len(self.points)), mesh_for_samples=False
        )

    def _warnings(self) -> list[str]:
        """Return a sentence for each defect: repeated points, patches of lower degree, thick samples, open ends."""
        count, degree, sentences = len(self.points), self.surface.patches.degree, []
        if self.duplicates > REPEATED_SAMPLES_SHARE * self.value_count:
            sentences.append(
                f"{self.duplicates} of {self.value_count} points of the cloud lie where an earlier one lies and were "
                "left out, with their data."
            )
        if self.lowered_degree_count > SPOILING_SAMPLES_SHARE * count:
            sentences.append(
                f"Around {self.lowered_degree_count} of {count} samples of the cloud the neighbours determine no "
                f"patch of degree {degree}, and the surface is less accurate there; more neighbours or a lower "
                "degree may help."
            )
        if self.thick > SPOILING_SAMPLES_SHARE * count:
            sentences.append(
                f"The neighbours of {self.thick} of {count} samples of the cloud lie on no smooth surface, and the "
                "solution may be off there; where sheets are close give normals, at creases more samples, where there "
                f"is noise neighbours={3 * self.surface.patches.neighbours}, and fewer if that raises this count: then "
                "the patches are too wide."
            )
        ends, target = self.open_samples
        if self.closed and ends:
            sentences.append(
                f"At {ends} of {target} samples of the cloud that were looked at the surface ends: if it is open, set "
                "closed=False; if not, samples lack there."
            )
        return sentences

    @cached_property
    def open_samples(self) -> tuple[int, int]:
        """Number of samples at which the surface ends, 0 if that may be chance, and number of samples examined."""
        if self._original is not self:
            return self._original.open_samples
        return count_open_samples(self.surface, self._tree, self._tiny)

    def mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return the closest points (v, d) of samples, thinned to about half of ``spacing``, and their cells (v, 1)."""
        return as_cells(self.closest_point(thin_out(self.points, spacing)).points)

    @property
    def given_mesh(self) -> tuple[Floats, Ints]:
        """The user's points (value_count, d), and their numbers as cells."""
        return as_cells(self.given_points)

    def translate(self, offset: Floats, /) -> PointCloud:
        """Return the cloud translated by ``offset`` (d,); it shares its accuracy and warnings with this cloud."""
        shift = as_vector(offset, self.dim, "offset")
        moved = replace(self.surface, points=self.points + shift)
        made = replace(self, surface=moved, given_points=self.given_points + shift)
        made.__dict__["_original"] = self._original
        return made

    def _sample_rows(self, feet: ClosestPoints) -> Ints:
        """Return (n,) the rows of :attr:`points` that ``feet`` name as element; raise InputError if they have none."""
        if feet.element is None:
            raise InputError("feet must be records that this cloud answered: they lack element.")
        return np.searchsorted(self.given, feet.element)

    @cached_property
    def _slope(self) -> tuple[float, float]:
        """The surface's slope error, and the width of its bumps in the unit of length: see :func:`slope_error`."""
        if self._original is not self:
            return self._original._slope
        return slope_error(self.points, self.surface.patches, self._tree, self._sides)

    @cached_property
    def _noise(self) -> float:
        """Root mean square distance of at most 500 samples from the surface, over the longest side of their box."""
        if self._original is not self:
            return self._original._noise
        count = len(self.points)
        rows = np.sort(np.random.default_rng(0).choice(count, min(SLOPE_SAMPLES, count), replace=False))
        off = self.points[rows] - self.closest_point(self.points[rows]).points
        return float(np.sqrt(np.mean(np.sum(off**2, axis=1))) / np.ptp(self.points, axis=0).max())

    @property
    def _sides(self) -> Floats | None:
        """(k, d) normals of the samples that distinguish neighbours on another sheet; None if the user gave none."""
        return None

    @cached_property
    def _tiny(self) -> float:
        """Length of a step at which a search ends: the rounding of coordinates."""
        return 1e-13 * float(np.ptp(self.points, axis=0).max()) + 1e-15 * float(np.abs(self.points).max())

    @cached_property
    def _tree(self) -> cKDTree:
        return build_kd_tree(self.points)


@dataclass(frozen=True, eq=False)
class OrientedPointCloud(PointCloud):
    """A point cloud with normals of one sign everywhere.

    Attributes
    ----------
    sample_normals : (k, d) float64
        Unit normals; only their side counts, directions are the fitted surface's.
    """

    sample_normals: Floats

    __repr__ = source_repr

    @property
    def _sides(self) -> Floats:
        return self.sample_normals

    def normals(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, d) unit normals of the surface at ``feet``, on the side of the normals given at their samples.

        Raise InputError if ``feet`` lack ``element``.
        """
        sample = self._sample_rows(feet)
        normal = surface_normals(self.surface, feet.points, sample)
        against = np.einsum("nd,nd->n", normal, self.sample_normals[sample]) < 0.0
        return np.where(against[:, None], -normal, normal)
