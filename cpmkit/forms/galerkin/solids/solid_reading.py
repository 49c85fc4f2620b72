"""Evaluation on a solid: the patch of a point inside, and data extended to Gauss points outside."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.forms.field import Field
from cpmkit.forms.galerkin.coefficients import SampleCoefficients
from cpmkit.forms.galerkin.conditions.boundary_sides import DIFFERENCE_SPACINGS
from cpmkit.forms.galerkin.patch_locator import (
    HEIGHT_FACTOR,
    NEIGHBOURS,
    ON_BOUNDARY_SPACINGS,
    READ_FROM_SIDE_SPACINGS,
)
from cpmkit.forms.galerkin.solids.solid_sampling import SampledSolid
from cpmkit.grid.lattice import find_codes
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.vector_algebra import unit
from cpmkit.mesh.solid_moments import MOMENTS
from cpmkit.runtime.compilation import compiled
from cpmkit.scene.data import evaluate_data, is_sequence
from cpmkit.types import Floats, Ints, Side

#: Points on the skin are moved inside by this distance, in spacings, to find their patch.
PROBE_SPACINGS = 1e-6
#: Points nearer to a boundary inside than this, in spacings, are moved to this distance from it to find their patch.
ASIDE_SPACINGS = 0.05
#: Data that may jump at a boundary inside are evaluated at this distance from it, in spacings.
INSIDE_SPACINGS = 0.01
#: Polynomials are fitted on so many patches at a time, to bound the memory of the fits.
FITTED_PATCHES = 1000


@dataclass(frozen=True, eq=False)
class SolidLocator:
    """The search for the patch in which u is evaluated at a point of a solid."""

    sampled: SampledSolid

    def patches(self, feet: ClosestPoints, side_of: Mapping[int, Side]) -> tuple[Ints, Ints]:
        """Return the patches (k,) that evaluate u at ``feet`` (k,), and a sample (k,) of each.

        Points on boundary b are evaluated on ``side_of[b]``, by default left.
        """
        points, spacing, patches = feet.points, self.sampled.lattice.spacing, self.sampled.patches
        aside, near = points.copy(), []
        for number, rows, signed, leftward in self.near_boundaries(points):
            # Flat facets of curved boundaries differ from these by less than the distance by which points are moved.
            side = side_of.get(number)
            within = ON_BOUNDARY_SPACINGS if side is None else READ_FROM_SIDE_SPACINGS
            signs = np.where(np.abs(signed) < within * spacing, -1.0 if side == "right" else 1.0, np.sign(signed))
            aside[rows] += (ASIDE_SPACINGS * spacing * signs - signed)[:, None] * leftward
            near.append((number, rows, signs))
        patch = patches.patches_at(np.floor(aside / spacing + 0.5).astype(np.int64), aside / spacing)
        for number, rows, signs in near:  # moved points may lie past a thin strip beside the boundary
            is_other = (patch[rows] < 0) | (self.sides_of_patches[number][patch[rows]] * signs < 0)
            for sign in (1.0, -1.0):
                moved = rows[is_other & (signs == sign)]
                if len(moved):
                    samples, tree = self._samples_on_side(number, sign > 0)
                    patch[moved] = self.sampled.boundary.cell[samples[tree.query(points[moved])[1]]]
        missing = np.flatnonzero(patch < 0)  # on the skin, in a cell that it only touches
        if len(missing):
            boundary = self.sampled.boundary
            distance, rows = self._skin_tree.query(points[missing], min(NEIGHBOURS[0], len(boundary)))
            off = points[missing, None] - boundary.points[rows]
            height = np.einsum("kqd,kqd->kq", off, boundary.conormals[rows])  # another part may be as near
            nearest = np.argmin(distance**2 + (HEIGHT_FACTOR * height) ** 2, axis=1)
            patch[missing] = boundary.cell[rows[np.arange(len(missing)), nearest]]
        quantised: Any = self.sampled.samples
        return patch, quantised.first_of_cells(patch)

    @cached_property
    def sides_of_patches(self) -> list[Ints]:
        """For each boundary (p,): 1 for patches on its left alone, -1 for those on its right alone, else 0."""
        sampled = self.sampled
        on = (sampled.boundary.owner >= 0) & ~sampled.boundary.beyond_tip
        found = []
        for number in range(len(sampled.oriented)):
            own = on & (sampled.boundary.owner == number)
            sides = np.zeros((2, len(sampled.patches.cells)), dtype=np.int64)
            for row, side in enumerate((sampled.left, ~sampled.left)):
                sides[row, sampled.boundary.cell[own & side]] = 1
            found.append(sides[0] - sides[1])
        return found

    def _samples_on_side(self, number: int, is_left: bool) -> tuple[Ints, Any]:
        """Return the samples (k,) on a side of a boundary and their k-d tree; cached."""
        from scipy.spatial import cKDTree

        if (number, is_left) not in self._sides:
            boundary = self.sampled.boundary
            rows = np.flatnonzero((boundary.owner == number) & ~boundary.beyond_tip & (self.sampled.left == is_left))
            self._sides[number, is_left] = rows, cKDTree(boundary.points[rows])
        return self._sides[number, is_left]

    @cached_property
    def _sides(self) -> dict[tuple[int, bool], tuple[Ints, Any]]:
        """The cache of :meth:`_samples_on_side`."""
        return {}

    def near_boundaries(self, points: Floats) -> Iterator[tuple[int, Ints, Floats, Floats]]:
        """Yield each boundary inside that has a left, and which of ``points`` (k, d) are very near it.

        Yielded are its number, the rows (n,) of points, their distances (n,) from it, positive on its left, and unit
        vectors (n, d) to the left.
        """
        lattice = self.sampled.lattice
        for number, oriented in enumerate(self.sampled.oriented):
            if oriented.has_left:
                at = lattice.to_scene(points) - oriented.left.origin
                near = np.flatnonzero(oriented.source.closest_point(at).distance < ASIDE_SPACINGS * lattice.spacing)
                feet, on = oriented.feet(at[near])
                leftward = oriented.leftward(feet, on, DIFFERENCE_SPACINGS * lattice.spacing)
                yield number, near, np.sum((at[near] - on.points) * leftward, axis=1), leftward

    @cached_property
    def _skin_tree(self) -> Any:
        """The k-d tree of the samples on the skin."""
        from scipy.spatial import cKDTree

        return cKDTree(self.sampled.boundary.points)


@dataclass(frozen=True, eq=False)
class SolidCoefficients(SampleCoefficients):
    """Coefficients at the samples of a solid, some of which are Gauss points of cut cells outside.

    At a point x outside, f is extrapolated as 2 f(y) - f(2 y - x), where y is the closest point of x (its foot), so
    that functions are only evaluated on the solid; positive coefficients are f(y)^2 / f(2 y - x). In a thin patch the
    mirror image 2 y - x may lie outside too, and weights have both signs: there f is replaced by a polynomial, whose
    integral over the solid is exact however thin the solid is.
    """

    sampled: SampledSolid

    @cached_property
    def locator(self) -> Any:
        """The search for the patch in which a point is evaluated."""
        return SolidLocator(self.sampled)

    @cached_property
    def inside(self) -> Ints:
        """The samples (k,) inside the solid with positive weights, by which solutions are compared."""
        inside = self.sampled.samples.weights[: self.sampled.interior] > 0
        inside[self.outside[0]] = False  # those on boundaries inside too
        return np.flatnonzero(inside)

    @cached_property
    def outside(self) -> tuple[Ints, Floats, Floats, Ints]:
        """The samples (k,) outside, their feet and mirror images (k, d) in the scene's coordinates, and thin patches.

        A sample is outside if it lies neither in its patch nor in one that touches it: f may differ on both sides of a
        thin gap. If the closest point is outside too, the foot is the nearest sample on the skin of the patch. A mirror
        image outside is moved to the solid; the patches (t,) of such samples are thin.
        """
        sampled = self.sampled
        own = sampled.samples.cell[: sampled.interior]
        rows = np.flatnonzero(own < sampled.patches.cut)
        points, own = sampled.samples.points_at(rows), own[rows]
        feet = sampled.surface.closest_point(points)
        foot = feet.points.copy()
        foreign = self._foreign(own, foot, foot - points) if sampled.has_near_parts else np.zeros(0, dtype=np.int64)
        foreign = np.union1d(foreign, self._across_boundaries(own, points))
        foot[foreign] = self._nearest_on_skin(own[foreign], points[foreign])
        out = np.union1d(np.flatnonzero(feet.edge >= 0), foreign)
        mirrored = sampled.surface.closest_point(2 * foot[out] - points[out])
        mirror, is_thin = mirrored.points.copy(), mirrored.distance > PROBE_SPACINGS * sampled.lattice.spacing
        if len(foreign):
            far = self._foreign(own[out], mirror, foot[out] - mirror)
            mirror[far], is_thin[far] = foot[out[far]], True
        thin = np.unique(own[out[is_thin]])
        return rows[out], sampled.lattice.to_scene(foot[out]), sampled.lattice.to_scene(mirror), thin

    def _foreign(self, own: Ints, points: Floats, inward: Floats) -> Ints:
        """Return which points (n, d) of the solid lie neither in their ``own`` (n,) patch nor in one that touches it.

        Points on the skin are first moved slightly along ``inward`` (n, d).
        """
        spacing, patches = self.sampled.lattice.spacing, self.sampled.patches
        at = points / spacing + PROBE_SPACINGS * unit(inward)
        patch = patches.patches_at(np.floor(at + 0.5).astype(np.int64), at)
        low, high = np.minimum(own, patch), np.maximum(own, patch)
        return np.flatnonzero((low != high) & (find_codes(self._touching, low * len(patches.cells) + high) < 0))

    def _across_boundaries(self, own: Ints, points: Floats) -> Ints:
        """Return which points (n, d) lie on a boundary inside, or on another side of it than their ``own`` (n,) patch.

        The test is needed since the flat facets between patches differ slightly from curved boundaries.
        """
        across = [np.zeros(0, dtype=np.int64)]
        for number, near, signed, _ in self.locator.near_boundaries(points):
            side = self.locator.sides_of_patches[number][own[near]]
            is_across = side * signed < READ_FROM_SIDE_SPACINGS * self.sampled.lattice.spacing
            across.append(near[is_across & (side != 0)])
        return np.concatenate(across)

    @cached_property
    def _touching(self) -> Ints:
        """(t,) codes of pairs of patches that touch, ascending."""
        low, high = np.sort(self.sampled.dof_map.touching, axis=1).astype(np.int64).T
        return np.sort(low * len(self.sampled.patches.cells) + high)

    def _nearest_on_skin(self, patch: Ints, points: Floats) -> Floats:
        """Return points (n, d) just inside the sample on the skin of each ``patch`` (n,) that is nearest to ``points``.

        Samples in sharp corners, from which such a point lies outside of the patch, are left out.
        """
        boundary, spacing, patches = self.sampled.boundary, self.sampled.lattice.spacing, self.sampled.patches
        rows = np.flatnonzero(np.isin(boundary.cell, patch))
        cell, inside = boundary.cell[rows], (boundary.points - INSIDE_SPACINGS * spacing * boundary.conormals)[rows]
        found = patches.patches_at(np.floor(inside / spacing + 0.5).astype(np.int64), inside / spacing)
        low, high = np.minimum(cell, found), np.maximum(cell, found)
        own = np.flatnonzero((low == high) | (find_codes(self._touching, low * len(patches.cells) + high) >= 0))
        starts = np.searchsorted(cell[own], np.arange(patches.cut + 1))
        return nearest_of_group(points, patch, starts, inside[own])

    @property
    def data_points(self) -> Floats:
        """(p, d) the samples, or the mirror images of those outside, in the scene's coordinates."""
        points = self.points.copy()
        points[self.outside[0]] = self.outside[2]
        return points

    def at_points(self, data: Any, label: str, time: float | None = None, channels: int | None = 1) -> Floats:
        """Return ``data`` (p, channels) at ``time`` at samples, extrapolated outside; ``label`` is for errors."""
        parts = data if is_sequence(data) else [data]
        if not any(map(callable, parts)) or any(isinstance(part, Field) for part in parts):
            return super().at_points(data, label, time, channels)

        def evaluate(points: Floats) -> Floats:
            return evaluate_data(data, points, channels, label, time)

        return self._extended(evaluate, lambda foot, mirror: 2 * foot - mirror)

    def function_at_points(self, data: Any, evaluate: Callable[[Floats], Floats]) -> Floats:
        """Return the coefficient ``data`` (p, ...) at the samples, by ``evaluate``, a function of points (p, d).

        Functions are extrapolated to the samples :attr:`outside` from the values f at the foot (closest point) and m at
        the mirror image: numbers as f^2 / m, tensors as 2 f - m or f. Polynomials on thin patches must be positive.
        """
        if not callable(data) or isinstance(data, Field):
            return super().function_at_points(data, evaluate)

        def extend(foot: Floats, mirror: Floats) -> Floats:
            if foot.ndim > 1:
                linear = 2 * foot - mirror
                return np.where(np.linalg.eigvalsh(linear)[:, :1, None] > 0, linear, foot)
            ratio = foot / np.where(mirror > 0, mirror, 1.0)
            return foot * np.where(mirror > 0, ratio, 1.0)  # without a ratio the value at the foot

        return self._extended(evaluate, extend, positive=True)

    def _extended(
        self,
        evaluate: Callable[[Floats], Floats],
        extend: Callable[[Floats, Floats], Floats],
        positive: bool = False,
    ) -> Floats:
        """Return values at the samples: ``evaluate`` of the samples inside, and extrapolated values outside.

        Outside they are ``extend`` of the values at feet and mirror images, or polynomials on thin patches. With
        ``positive``, polynomials with a value (or an eigenvalue) below zero at a sample are not used.
        """
        rows, *places, thin = self.outside
        at, values = [], []
        for place in places:  # all points both times: data may be values at the samples, whatever the points
            at.append(self.points.copy())
            at[-1][rows] = place
            values.append(evaluate(at[-1].copy()))
        extended = values[1].copy()
        extended[rows] = extend(values[0][rows], values[1][rows])
        for first in range(0, len(thin), FITTED_PATCHES):
            samples = self._samples_of_cut(thin[first : first + FITTED_PATCHES])
            known, given = (np.concatenate([each[samples] for each in both], axis=1) for both in (at, values))
            centre, spacing = known.mean(axis=1, keepdims=True), self.sampled.lattice.spacing
            fit = fit_polynomials((known - centre) / spacing, given, (self.points[samples] - centre) / spacing)
            if positive:
                least = fit if fit.ndim == 2 else np.linalg.eigvalsh(fit)[..., 0]
                samples, fit = (each[least.min(axis=1) > 0] for each in (samples, fit))
            extended[samples] = fit
        return extended

    def _samples_of_cut(self, patches: Ints) -> Ints:
        """Return the samples (k, n) of ``patches`` (k,) in cut cells; the samples of cut cells come first, by patch."""
        count = MOMENTS ** self.points.shape[1]
        return np.asarray(patches[:, None] * count + np.arange(count))


def fit_polynomials(points: Floats, values: Floats, at: Floats) -> Floats:
    """Return the values (k, m, ...) at points ``at`` (k, m, d) of k polynomials of degree 2.

    Each polynomial is fitted by least squares to ``values`` (k, n, ...) at its ``points`` (k, n, d); of several it is
    that with the smallest coefficients.
    """

    def monomials(x: Floats) -> Floats:
        i, j = np.triu_indices(x.shape[2])
        return np.concatenate([np.ones_like(x[..., :1]), x, x[..., i] * x[..., j]], axis=2)

    fits = monomials(at) @ (np.linalg.pinv(monomials(points)) @ values.reshape(*values.shape[:2], -1))
    return np.asarray(fits.reshape(*at.shape[:2], *values.shape[2:]))


@compiled
def nearest_of_group(points: Floats, group: Ints, starts: Ints, candidates: Floats) -> Floats:
    """Return the candidate (n, d) that is nearest to each of ``points`` (n, d), from the point's ``group`` (n,).

    Group g has the ``candidates[starts[g] : starts[g + 1]]``, (k, d) in all. If it has none, the point is returned.
    """
    found = points.copy()
    for q in range(len(points)):
        best = np.inf
        for k in range(starts[group[q]], starts[group[q] + 1]):
            square = 0.0
            for i in range(points.shape[1]):
                square += (candidates[k, i] - points[q, i]) ** 2
            if square < best:
                best = square
                for i in range(points.shape[1]):
                    found[q, i] = candidates[k, i]
    return found
