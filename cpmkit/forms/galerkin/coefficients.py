"""Coefficients of equations at the samples: diffusivities, factors and velocities, which may depend on u."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.errors import InputError, place
from cpmkit.forms.field import Field
from cpmkit.forms.form_records import StateDependentCoefficient
from cpmkit.forms.galerkin.advection import Advection, tangential_velocity, upwinding_times
from cpmkit.forms.galerkin.conditions.boundary_sides import DIFFERENCE_SPACINGS
from cpmkit.forms.galerkin.point_reading import PointReader
from cpmkit.forms.galerkin.scene_sampling import SampledScene
from cpmkit.forms.galerkin.space.energy import gradients_at_samples
from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.mesh.adjacency import CellSides
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.diffusivities import evaluate_diffusivity, principal_diffusivities
from cpmkit.scene.equations import Terms
from cpmkit.types import Bools, Floats, Ints

#: A tensor whose smallest eigenvalue on tangents is below this share of its largest one counts as singular: rounding.
SINGULAR_SHARE = 1e-12
#: Samples nearer than so many spacings to the chord of an edge on a boundary may lie past it: edges bend by less.
NEAR_CHORD_SPACINGS = 0.05


@dataclass(frozen=True, eq=False)
class SampleCoefficients(PointReader):
    """Coefficients at the p samples of the manifold, or at all q samples, those on boundaries included."""

    def at_points(self, data: Any, label: str, time: float | None = None, channels: int | None = 1) -> Floats:
        """Return ``data`` (p, channels) at ``time`` at samples, on the sides of their cells; errors name ``label``."""
        return evaluate_data(data, self._reading_points(data), channels, label, time)

    @property
    def data_points(self) -> Floats:
        """(p, d) the points at which data are evaluated for the samples, in the scene's coordinates."""
        return self.points

    def _reading_points(self, data: Any) -> Floats:
        """Return the points (p, d) at which ``data`` are evaluated for the samples, in the scene's coordinates.

        These are the samples themselves. For functions of the user, samples that lie past the boundary beside their
        cell are moved to the side of the cell; for numbers all points are zero.
        """
        parts = data if isinstance(data, Sequence) else [data]
        if not any(map(callable, parts)):  # numbers are the same everywhere
            return np.broadcast_to(np.zeros(1), (self.sampled.interior, self.sampled.lattice.dim))
        if any(isinstance(part, Field) for part in parts):
            return self.points
        points = self.points.copy()  # functions of the user may write to it
        if self.sampled.oriented:
            rows, places = self._samples_past_boundary
            points[rows] = places
        return points

    @cached_property
    def _samples_past_boundary(self) -> tuple[Ints, Floats]:
        """The result of :func:`_samples_past_boundary`, cached."""
        return _samples_past_boundary(self.sampled, self.locator.sides)

    def at_all_samples(self, data: Any, label: str) -> Floats:
        """Return a coefficient (q,) at all samples, or (1,) if ``data`` are a number; errors call it ``label``."""
        if not callable(data) and np.ndim(data) == 0:
            return evaluate_data(data, np.zeros((1, self.sampled.lattice.dim)), 1, label)[:, 0]
        return self.append_boundary_samples(self.at_points(data, label)[:, 0])

    def append_boundary_samples(self, values: Floats) -> Floats:
        """Return ``values`` (p, ...) as (q, ...): a boundary sample has the value at the first sample of its cell."""
        samples = self.sampled.samples
        first = np.searchsorted(samples.cell[: self.sampled.interior], self.sampled.boundary.cell)
        return np.concatenate([values, values[first]])

    def append_zeros(self, values: Floats) -> Floats:
        """Return ``values`` (p, ...) at the samples of the manifold extended by zeros on boundaries, (q, ...)."""
        return np.concatenate([values, np.zeros((len(self.sampled.boundary), *values.shape[1:]))])

    def diffusivity(self, data: Any) -> Floats:
        """Return the diffusivity at all samples, (q,) or (q, d, d), or (1,) if ``data`` are a number.

        Raises InputError if the diffusivity is not positive (a tensor: definite on tangents), or a tensor is given
        together with singular functions.
        """
        if isinstance(data, StateDependentCoefficient):
            a = self.evaluate_at_state(data)
        elif not callable(data) and np.ndim(data) == 0:
            return check_diffusivity(self.at_all_samples(data, "the diffusivity"))
        else:
            a = self.function_at_points(data, lambda points: evaluate_diffusivity(data, points, "the diffusivity"))
        if a.ndim < 3:
            return self.append_boundary_samples(check_diffusivity(a))
        if self.space.size > self.space.spline_count:
            raise InputError("tips='singular' takes a diffusivity that is a number, got a tensor; use 'extended'.")
        normals = self.sampled.samples.normals_at(slice(self.sampled.interior))
        return self.append_boundary_samples(check_tensor(a, normals, self.points))

    def function_at_points(self, data: Any, evaluate: Callable[[Floats], Floats]) -> Floats:
        """Return the coefficient ``data`` (p, ...) at the samples, by ``evaluate``, a function of points (p, d)."""
        return evaluate(self._reading_points(data))

    def penalty_scale(self, data: Any) -> Floats | None:
        """Return the coefficient (q,) that penalties are proportional to; None if it is the diffusivity ``data``."""
        if not isinstance(data, StateDependentCoefficient) or data.penalty_coefficient is None:
            return None
        return self.diffusivity(StateDependentCoefficient(data.penalty_coefficient, data.u))

    def evaluate_at_state(self, state: StateDependentCoefficient) -> Floats:
        """Return the values (p, ...) of a coefficient that depends on u at the samples of the manifold."""
        values = self.space.values_at_samples(state.u)[:, 0]
        gradients = self.space.gradients_at_samples(state.u)[:, 0]
        return np.asarray(state.coefficient(values, gradients, self.points.copy()))

    def side_coefficient(self, state: StateDependentCoefficient) -> Callable[[Floats], Floats]:
        """Return a coefficient that depends on u as a function of ``points`` (b, d), one beside each boundary sample.

        u and its gradient are evaluated at the boundary samples.
        """
        u = state.u[: self.space.spline_count]
        values = np.asarray(self.boundary_rows[0] @ u)[:, 0]
        on_boundaries = slice(self.sampled.interior, None)
        gradients = gradients_at_samples(self.space.splines, self.space.to_coefficients(u), on_boundaries)[:, 0]
        return lambda points: state.coefficient(values, gradients, points)

    @cached_property
    def boundary_rows(self) -> tuple[Any, Any]:
        """The matrices (b, n) of values and of derivatives along conormals of splines at boundary samples."""
        boundary, patch = self.sampled.boundary, self.space.dof_map.patch[self.sampled.interior :]
        along = self.space.spline_derivative_rows(patch, boundary.points, boundary.conormals)
        return self.space.spline_rows(patch, boundary.points), along

    def advection_at_samples(self, terms: Terms) -> Advection:
        """Return the advection by the velocity of ``terms`` at all samples; the velocity is zero on boundaries."""
        assert terms.velocity is not None
        a, c = self.diffusivity(terms.diffusivity), self.at_all_samples(terms.c, "the factor c")
        rows, samples = slice(self.sampled.interior), self.sampled.samples
        points, normals = samples.points_at(rows), samples.normals_at(rows)
        v = tangential_velocity(terms.velocity, points, normals, self.sampled.lattice)
        upwinding = upwinding_times(np.linalg.norm(v, axis=1), a[: len(v)], self.space.spacing)
        gradient_of_a = v[:0]
        if terms.conservative and upwinding.any():
            c = c + self.append_zeros(np.trace(self._projected_gradients(v), axis1=1, axis2=2))
        if len(a) > 1 and upwinding.any():
            gradient_of_a = self.append_zeros(self._projected_gradients(a[: len(v), None])[:, 0])
        v, upwinding = self.append_zeros(v), self.append_zeros(upwinding)
        return Advection(self.space.splines, v, upwinding, a, c, gradient_of_a, terms.conservative)

    def _projected_gradients(self, values: Floats) -> Floats:
        """Return tangential gradients (p, k, d) at the samples of the L2 projections of ``values`` (p, k)."""
        return self.space.spline_gradients_at_samples(self.space.project(values))


def check_diffusivity(a: Floats) -> Floats:
    """Return the diffusivity ``a`` (k,), finite, at samples; raise InputError with its least value if not positive."""
    if np.any(a <= 0):
        raise InputError(f"the diffusivity must be above zero, got {a.min():g}.")
    return a


def check_tensor(a: Floats, normals: Floats, points: Floats) -> Floats:
    """Return the diffusivity ``a`` (k, d, d), or raise InputError unless it is positive definite on tangents.

    The samples are the ``points`` (k, d) in the scene's coordinates, with orthonormal ``normals`` (k, c, d).
    """
    least, largest = principal_diffusivities(a, normals)
    worst = int(np.argmin(least - SINGULAR_SHARE * largest))
    if least[worst] <= SINGULAR_SHARE * largest[worst]:
        raise InputError(
            f"the diffusivity must be positive definite on tangents of the manifold, got a tensor near "
            f"{place(points[worst])} whose smallest eigenvalue there is {least[worst]:.3g}, and the largest "
            f"{largest[worst]:.3g}."
        )
    return a


def _samples_past_boundary(sampled: SampledScene, sides: CellSides) -> tuple[Ints, Floats]:
    """Return the samples (k,) past the boundary beside their cell, and points (k, d) to replace them.

    The points are the mirror images of the samples at the boundary, on the side of the cell, in the scene's
    coordinates. A sample may lie past the boundary by a thousandth of a spacing, since quadratic edges approximate
    boundaries. If the material there is a thousand times stiffer, its coefficient would make the matrix indefinite.

    Where a boundary lies off the manifold, data may change anywhere between the boundary and its closest points:
    samples within twice their distance, at most :data:`NEAR_CHORD_SPACINGS`, count as past the boundary, too.
    Boundaries without a left, and those of curves, have no such samples.
    """
    rows, places = [np.zeros(0, dtype=np.int64)], [np.zeros((0, sampled.lattice.dim))]
    spacing = sampled.lattice.spacing
    for number, oriented in enumerate(sampled.oriented):
        if sampled.mesh.manifold_dim == 1 or not oriented.has_left:
            continue
        near, side = _samples_near_chords(sampled, np.flatnonzero(sides.owner == number), sides.left)
        if not len(near):
            continue
        origin = oriented.left.origin
        x = sampled.lattice.to_scene(sampled.samples.points_at(near)) - origin
        feet, on_boundary = oriented.feet(x)
        leftward = oriented.leftward(feet, on_boundary, DIFFERENCE_SPACINGS * spacing)
        inside = side * dots(x - on_boundary.points, leftward)
        doubt = np.minimum(2.0 * norms(on_boundary.points - feet.points), NEAR_CHORD_SPACINGS * spacing)
        past = (inside < doubt) & (feet.edge < 0)
        step = side * np.maximum(doubt, -inside)
        rows.append(near[past])
        places.append((on_boundary.points + step[:, None] * leftward)[past] + origin)
    distinct, first = np.unique(np.concatenate(rows), return_index=True)
    return distinct, np.concatenate(places)[first]


def _samples_near_chords(sampled: SampledScene, half_facets: Ints, left: Bools) -> tuple[Ints, Ints]:
    """Return the samples (k,) near the chord of a half facet of their cell, and their side (k,) of the boundary.

    ``half_facets`` (j,) are the numbers of the half facets; a side is 1 if ``left`` (n,) is true, else -1.
    """
    half, mesh = sampled.half, sampled.mesh
    samples: Any = sampled.samples  # quantised by now
    cells, facet = half.cell[half_facets], half.facet[half_facets]
    starts = samples.cell_starts[cells].astype(np.int64)
    count = samples.cell_starts[cells + 1] - starts
    rows = np.arange(count.sum()) + np.repeat(starts - np.cumsum(count) + count, count)
    start, end = (mesh.vertices[mesh.cells[cells, (facet + k) % 3]] for k in (1, 2))
    along = np.repeat((end - start) / norms(end - start)[:, None], count, axis=0)
    offset = samples.points_at(rows) - np.repeat(start, count, axis=0)
    near = norms(offset - dots(offset, along)[:, None] * along) < NEAR_CHORD_SPACINGS * sampled.lattice.spacing
    distinct, first = np.unique(rows[near], return_index=True)
    return distinct, np.repeat(np.where(left[half_facets], 1, -1), count)[near][first]
