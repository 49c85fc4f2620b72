"""Values and coefficients: splines read at the samples, what is nearest to values there, integrals, gradients."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.contract import spread_rows
from cpmkit.forms.field import Field
from cpmkit.forms.galerkin.conditions.boundary_sides import samples_past_boundary
from cpmkit.forms.galerkin.normal_alignment import NormalSpread, normal_alignment, normal_spread
from cpmkit.forms.galerkin.patch_locator import DIFFERENCE_SPACINGS
from cpmkit.forms.galerkin.point_reading import Reader
from cpmkit.forms.galerkin.projection import Projection
from cpmkit.forms.galerkin.shared import cached_on_space
from cpmkit.forms.galerkin.space.energy import (
    STABILISATIONS_OF_DEGREE,
    Stabilisation,
    gradients_at_samples,
    load,
    mass,
    stiffness,
    values_at_samples,
)
from cpmkit.linear.operators import CsrOperator
from cpmkit.manifold.tangent_space import project_tangent
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Data are not resolved, but jump, where the nearest splines are farther from them than this share of their range.
UNRESOLVED_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class SplineValues(Reader):
    """The part of the form that goes from coefficients to values and back, and integrates."""

    @property
    def size(self) -> int:
        """Number of splines, copies counted, and of singular functions behind them."""
        return self.space.dof_map.size + len(self._tips)

    @property
    def constant(self) -> Floats:
        """(n, 1) ones, for splines sum to one; zero of singular functions."""
        return (np.arange(self.size) < self._tips.splines).astype(np.float64)[:, None]

    def data_at_points(self, data: Any, label: str, time: float | None = None, channels: int | None = 1) -> Floats:
        """Return a coefficient of the equation at the samples, (p, channels), each on the side of its cell."""
        return evaluate_data(data, self._reading_points(data), channels, label, time)

    def _reading_points(self, data: Any) -> Floats:
        """Return where data are read for the samples, (p, d): on the side of their cell, but fields as they are."""
        each = data if isinstance(data, Sequence) else [data]
        if not any(map(callable, each)):  # numbers are the same everywhere
            return np.broadcast_to(np.zeros(1), (self.sampled.interior, self.sampled.lattice.dim))
        if any(isinstance(one, Field) for one in each):
            return self.points
        points = self.points.copy()  # functions of the user may write to it
        if self.sampled.oriented:
            rows, places = self._astray
            points[rows] = places
        return points

    @cached_on_space
    def _astray(self) -> tuple[Ints, Floats]:
        """The samples past the boundary that their cell lies beside, and their places on its own side."""
        return samples_past_boundary(self.sampled, self._locator.sides)

    @property
    def mass(self) -> CsrOperator:
        """M, the integrals of products of splines; singular, for splines that no sample sees have none."""
        return self._mass

    @cached_on_space
    def _mass(self) -> CsrOperator:
        return CsrOperator(self._tips.bordered(mass(self.space, 1.0), None, np.ones(1)), symmetric=True)

    @property
    def mass_in_time(self) -> CsrOperator:
        """M + h^2 S: with M alone, systems of short steps are as badly conditioned as h^2 over the step is large.

        S vanishes on constants: totals are those of M. The errors of heat and waves are the same, measured.
        """
        return self._mass_in_time

    @cached_property
    def _mass_in_time(self) -> CsrOperator:
        return CsrOperator(self._projection.matrix, symmetric=True)

    @property
    def _strength(self) -> Stabilisation:
        return STABILISATIONS_OF_DEGREE[self.options.own.degree][self.options.own.strength]

    @cached_on_space
    def _areas(self) -> Floats:
        """(n,) the integral of each spline over the manifold."""
        return self._areas_and_turned[0]

    @cached_on_space
    def _areas_and_turned(self) -> tuple[Floats, NormalSpread]:
        """The same, and how much of the manifold turns under splines: samples are gone through once for both."""
        sums = normal_alignment(self.space, self.sampled.mesh, self.sampled.winding)
        return sums[:, 0].copy(), normal_spread(self.space, sums)

    def _loads(self, values: Floats) -> Floats:
        """Return the integrals (n, k) of ``values`` (q, k) at all samples, or (1, k), times each spline."""
        return load(self.space, values)

    @cached_on_space
    def _totals(self) -> Floats:
        """(n,) the integral of each spline and singular function."""
        return self._tips.with_loads(self._areas[:, None], np.ones((1, 1)))[:, 0]

    def _integrals(self, values: Floats) -> Floats:
        """Return the integrals (n, k) of ``values`` (p, k) at the points times each spline."""
        none = np.zeros((len(self.sampled.boundary), values.shape[1]))
        everywhere = np.concatenate([values, none]) if len(none) else values
        return self._tips.with_loads(self._loads(everywhere), values)

    @property
    def point_weights(self) -> Floats:
        """(p,) those of the samples."""
        return self.sampled.samples.weights[: self.sampled.interior]

    def at_points(self, u: Floats, rows: Ints | None = None) -> Floats:
        """Return the values (k, channels) of u at the samples, or at those of the numbers ``rows`` (k,)."""
        values = self._spline_values(u, slice(self.sampled.interior) if rows is None else rows)
        if not len(self._tips):
            return values
        inside = self._tips.inside if rows is None else self._tips.inside[rows]
        return np.asarray(values + inside @ u[self._tips.splines :])

    def some_points(self, count: int) -> tuple[Ints, Floats]:
        """Return the numbers (k,) and positions (k, d) of about ``count`` samples, evenly spread over all."""
        rows = spread_rows(self.sampled.interior, count)
        return rows, self.sampled.lattice.to_scene(self.sampled.samples.points_at(rows))

    def _spline_values(self, u: Floats, rows: slice | Ints) -> Floats:
        """Return the values (k, channels) at samples of the splines in u."""
        return values_at_samples(self.space, u[: self._tips.splines], rows)

    def slopes_at_points(self, u: Floats) -> Floats:
        """Return the tangential gradients (p, channels, d) of u at the samples, as they are."""
        found = self._spline_slopes(u)
        if len(self._tips):
            own = [slopes @ u[self._tips.splines :] for slopes in self._tips.slopes_inside]
            found = found + np.stack(own, axis=-1)
        return found

    def _spline_slopes(self, u: Floats) -> Floats:
        """Return the tangential gradients (p, channels, d) at the samples of the splines in u."""
        return gradients_at_samples(self.space, self.sampled.interior, u[: self._tips.splines])

    def project(self, values: Floats, start: Floats | None = None, time: float | None = None) -> Floats:
        """Return the splines (n, channels) nearest to ``values`` (p, channels) at the samples, in mean square.

        M alone is singular: ``(M + h^2 S) u = V' w values``, S what holds u where no sample sees it.
        """
        del time  # no unknown holds the data of a condition
        if start is not None:
            return start + self.project(values - self.at_points(start))
        return self._projected(self._integrals(values))

    def interpolate(
        self, data: Data, label: str, time: float = 0.0, in_range: bool = False, step: float = 0.0
    ) -> Floats:
        """Return the splines that stand for ``data``; in range, of spikes and jumps their mean under each spline.

        The nearest splines swing by a tenth of a jump beyond both its sides, and below zero beside a spike. Means keep
        the range and the total, and spread the data as heat spreads in a time of h^2 / 4.
        """
        values = self.data_at_points(data, label, time, self.channels)
        integrals = self._integrals(values)
        u = self._projected(integrals)
        if not in_range:
            return u
        off = np.abs(self.at_points(u) - values).max(axis=0, initial=0.0)
        rough = off > UNRESOLVED_SHARE * np.ptp(values, axis=0)
        seen = np.flatnonzero(self._areas > 0)
        u[self._tips.splines :, rough] = 0.0
        u[np.ix_(seen, rough)] = integrals[np.ix_(seen, rough)] / self._areas[seen, None]
        return u

    def integrals(self, u: Floats) -> Floats:
        """Return the integrals (channels,) of u over the samples."""
        return np.asarray(self._totals @ u)

    def _projected(self, integrals: Floats) -> Floats:
        return self._projection.solve(integrals)

    @cached_on_space
    def _projection(self) -> Projection:
        holding = stiffness(self.space, 1.0, self._strength) - stiffness(self.space, 1.0, Stabilisation(0.0, 0.0, 0.0))
        held = self._tips.bordered(holding, None, None)
        return Projection((self.mass.matrix + self.spacing**2 * held).tocsr())

    def gradient(self, u: Floats, points: Any = None, side: Any = None) -> Floats:
        """Return the tangential gradient (k, channels, d), projected on the splines: 2 to 6 times better than raw.

        At the samples, where no points are given, it is not projected.
        """
        if points is None:
            return self.slopes_at_points(u)
        rows, feet, cells = self.reading_rows(points, side)
        found = np.asarray(rows @ self._projected_slopes(u)).reshape(-1, u.shape[1], self.space.dof_map.dim)
        if len(self._tips):
            read = [slopes @ u[self._tips.splines :] for slopes in self._tips.gradients(feet.points, cells)]
            found = found + np.stack(read, axis=-1)
        step = DIFFERENCE_SPACINGS * self.spacing
        channels = [project_tangent(self.sampled.surface, feet, one, step) for one in found.transpose(1, 0, 2)]
        return np.stack(channels, axis=1) if channels else found

    def _projected_slopes(self, u: Floats) -> Floats:
        """Return the splines (n, channels d) nearest to the tangential gradient of u's own; kept for the last u."""
        if self._last_slopes.get("u") is not u:
            raw = self._spline_slopes(u)
            projected = self._projected(self._integrals(raw.reshape(len(raw), -1)))
            self._last_slopes.update(u=u, projected=projected)
        return self._last_slopes["projected"]

    @cached_property
    def _last_slopes(self) -> dict[str, Floats]:
        return {}

    def gradient_rows(self, points: Any, side: Any = None) -> tuple[csr_array, ...]:
        """Return the d matrices (k, n) that read the same; all splines take part, so that they are full."""
        from scipy.sparse import csr_array

        one, dim = self.sampled, self.space.dof_map.dim
        rows, feet, cells = self.reading_rows(points, side)
        tested = self._projected(rows.T.toarray())
        weighted = one.samples.weights[: one.interior, None] * self.at_points(tested)
        raw = np.stack([(slopes.T @ weighted).T for slopes in self._slopes()])
        axes = [np.tile(axis, (len(feet), 1)) for axis in np.eye(dim)]
        step = DIFFERENCE_SPACINGS * self.spacing
        tangential = np.stack([project_tangent(one.surface, feet, axis, step) for axis in axes])
        if len(self._tips):
            own = np.stack([slopes.toarray() for slopes in self._tips.gradients(feet.points, cells)])
            raw = np.concatenate([raw, own], axis=2)
        return tuple(csr_array(np.einsum("dk,dkn->kn", tangential[:, :, i], raw)) for i in range(dim))

    def _nearest_slopes(self, values: Floats) -> Floats:
        """Return the tangential gradients (p, k, d) of the splines nearest to ``values`` (p, k) at the samples."""
        nearest = self._projected(self._integrals(values))[: self._tips.splines]
        return np.stack([rows @ nearest for rows in self._slopes()], axis=-1)

    def _slopes(self) -> Iterator[csr_array]:
        """Yield the d matrices (p, n) that read the tangential gradient at the samples, as it is.

        One at a time, and none is kept: each has 27 entries a sample of degree 2, more than all else of a solution.
        """
        one, dof_map = self.sampled, self.space.dof_map
        rows = slice(one.interior)
        at, normals = one.samples.points_at(rows), one.samples.normals_at(rows)
        tangential = np.eye(dof_map.dim) - np.einsum("qcd,qce->qde", normals, normals)
        for axis in range(dof_map.dim):
            yield self._derivative_rows(dof_map.patch[: len(at)], at, tangential[:, axis])

    def inner(self, u: Floats, v: Floats) -> Floats:
        """Return the means (k, m) over the manifold of the products of u's columns with v's."""
        return np.asarray(u.T @ self.mass.apply(v) / self.sampled.samples.weights.sum())
