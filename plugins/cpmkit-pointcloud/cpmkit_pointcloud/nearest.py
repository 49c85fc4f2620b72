"""The source whose feet are the samples of a cloud."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

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
    positive,
    source_repr,
)
from cpmkit_pointcloud.floor import plain_floor
from cpmkit_pointcloud.samples import as_cells, build_kd_tree, query_nearest_samples, thin_out

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


@dataclass(frozen=True, eq=False)
class NearestSamples:
    """A cloud whose closest points are its samples.

    Attributes
    ----------
    points : (n, d) float64
        As given.
    """

    points: Floats

    exact = True

    __repr__ = source_repr

    @property
    def dim(self) -> int:
        """Dimension of the space, 2 or 3."""
        return self.points.shape[1]

    @property
    def manifold_dim(self) -> int:
        """Dimension of the manifold that is sampled: that of the space less 1."""
        return self.dim - 1

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of the box that holds all samples."""
        return np.stack([self.points.min(axis=0), self.points.max(axis=0)])

    @property
    def value_count(self) -> int:
        """Number of points."""
        return len(self.points)

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the samples nearest to ``x`` (n, d), their rows as ``element``, and ``edge`` -1.

        Raise InputError if ``x`` does not have shape (n, d) or is not finite.
        """
        x = as_points(x, self.dim)
        distance, nearest = query_nearest_samples(self._tree, x)
        return ClosestPoints(self.points[nearest], distance, np.full(len(x), -1), nearest)

    def interpolate(self, values: Any, feet: ClosestPoints, /) -> Floats:
        """Return (n, ...) the rows of ``values`` (value_count, ...) of the samples in ``feet``, unchanged.

        Raise InputError if ``values`` has another number of rows, or ``feet`` lack ``element``.
        """
        if feet.element is None:
            raise InputError("feet must be records that this cloud answered: they lack element.")
        return one_row_each(values, self.value_count, "points")[feet.element]

    def advice(self, spacing: float, /) -> Advice:
        """Return the error, relative to a solution's range, that gaps between samples cause at grid ``spacing``.

        Raise InputError if ``spacing`` is not a number above zero.
        """
        floor = plain_floor(self.points, self._tree, positive(spacing, "spacing"))
        return Advice(floor, mesh_for_samples=False, foot_count=len(self.points))

    def mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return the samples (v, d), thinned to about half of ``spacing``, and a cell (v, 1) for each."""
        return as_cells(thin_out(self.points, spacing))

    def translate(self, offset: Floats, /) -> NearestSamples:
        """Return the cloud moved by ``offset`` (d,)."""
        return NearestSamples(self.points + as_vector(offset, self.dim, "offset"))

    @property
    def given_mesh(self) -> tuple[Floats, Ints]:
        """The user's points (n, d), and their numbers as cells."""
        return as_cells(self.points)

    @cached_property
    def _tree(self) -> cKDTree:
        return build_kd_tree(self.points)
