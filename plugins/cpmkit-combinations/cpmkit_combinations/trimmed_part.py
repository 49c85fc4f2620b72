"""The part of a manifold where a function of position is at most zero, as a closest point source."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partialmethod
from typing import Any

import numpy as np

from cpmkit.plugin import (
    MOST_EDGES,
    Bools,
    ClosestPoints,
    Floats,
    Ints,
    as_points,
    as_vector,
    dots,
    edge_limit_of,
    norms,
    positive,
    source_repr,
)
from cpmkit_combinations.clipping import clipped
from cpmkit_combinations.descent import descend
from cpmkit_combinations.position_function import PositionFunction
from cpmkit_combinations.rim import MeshRim
from cpmkit_combinations.wrapper import Wrapper

#: Descents from samples, for a query whose closest point on the whole is cut away.
TRIMMED_DESCENTS = 3
#: A query seen from the edge under a smaller sine than this, inwards, has its foot there.
INWARD_SINE = 1e-6
#: A mesh has at least this many cells along the largest side.
TRIMMED_LEAST_CELLS = 16


@dataclass(frozen=True, eq=False)
class Trimmed(Wrapper):
    """The points of a manifold with trim <= 0.

    Attributes
    ----------
    of : ClosestPointSource
        The whole.
    trim : PositionFunction
    rim : Rim
        The edge that the trimming makes.
    samples : (k, d) float64
        Points of the part that is kept.
    covering : float
        Every point of it has a sample within this distance.
    margin : float
        Where trim is above minus this, a point counts as lying on the edge.
    tolerance : float
        A length below which what is seen from the edge does not count.
    """

    trim: PositionFunction
    rim: MeshRim
    samples: Floats
    covering: float
    margin: float
    tolerance: float

    __repr__ = source_repr

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of a box that holds the part, a little larger than the smallest."""
        rim, whole = self.rim.source.bounds, np.asarray(self.of.bounds, dtype=np.float64)
        lower = np.minimum(self.samples.min(axis=0) - self.covering, rim[0])
        upper = np.maximum(self.samples.max(axis=0) + self.covering, rim[1])
        return np.stack([np.clip(lower, *whole), np.clip(upper, *whole)])

    @property
    def deviation(self) -> float:
        """The largest distance, in the unit of length, of the edge from where trim vanishes on the manifold."""
        return self.rim.deviation

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d).

        Of a surface ``edge`` is 0, 1, ... on the edges that trimming makes, the longest first, and after those come
        the edges that the whole has, in their order; of a curve it is 0 at the start and 1 at the end. A foot is
        ``doubtful`` where the closest point of the whole is cut away and not every part that may be nearest instead
        could be looked at.

        Raises
        ------
        InputError
            If ``x`` does not have shape (n, d) or is not finite.
        """
        x = as_points(x, self.dim)
        feet = self.of.closest_point(x)
        edge = self.rim.numbers_of_whole(feet.edge)
        away = np.flatnonzero(~self._inside(feet.points))
        points, distance = feet.points.copy(), feet.distance.copy()
        doubtful = np.zeros(len(x), dtype=bool) if feet.doubtful is None else feet.doubtful.copy()
        points[away], distance[away], edge[away], doubtful[away] = self._beyond(x[away])
        found = ClosestPoints(points, distance, edge, feet.element, feet.local, doubtful)
        return found if feet.element is None and feet.local is None else self._placed(found, away)

    def _inside(self, points: Floats) -> Bools:
        """Return which points of the whole belong to the part and do not lie on its edge."""
        return np.asarray(self.trim(points) < -self.margin)

    def _placed(self, found: ClosestPoints, rows: Ints) -> ClosestPoints:
        """Return the records with element and local of the feet at ``rows``, as the whole gives them."""
        whole = self.of.closest_point(np.ascontiguousarray(found.points[rows]))
        return found.replaced(rows, replace(found.take(rows), element=whole.element, local=whole.local))

    def _beyond(self, x: Floats) -> tuple[Floats, Floats, Ints, Bools]:
        """Return feet of queries whose closest point on the whole is cut away: on the edge, or on another part."""
        rim = self.rim.source.closest_point(x)
        points, distance, doubtful = rim.points.copy(), rim.distance.copy(), np.zeros(len(x), dtype=bool)
        edge = self.rim.numbers(rim)
        starts, left = self._starts(x, rim)
        for tried in range(TRIMMED_DESCENTS + 1):
            rows = np.flatnonzero(left.any(axis=1))
            if not len(rows):
                break
            if tried == TRIMMED_DESCENTS:
                doubtful[rows] = True
                break
            pick = left[rows].argmax(axis=1)
            foot, ended = descend(self.of, x[rows], starts[rows, pick], 3 * self.covering)
            reached = norms(x[rows] - foot)
            better = (reached < distance[rows]) & self._inside(foot)
            won = rows[better]
            points[won], distance[won], doubtful[won] = foot[better], reached[better], ~ended[better]
            edge[won] = self.rim.numbers_of_whole(self.of.closest_point(foot[better]).edge)
            near = norms(starts[rows] - starts[rows, pick][:, None]) <= 3 * self.covering
            near |= norms(starts[rows] - foot[:, None]) <= 3 * self.covering
            promising = norms(x[rows, None] - starts[rows]) ** 2 - (2 * self.covering) ** 2 < distance[rows, None] ** 2
            left[rows] &= promising & ~near
            left[rows, pick] = False
        return points, distance, edge, doubtful

    def _starts(self, x: Floats, rim: ClosestPoints) -> tuple[Floats, Bools]:
        """Return points (n, k, d) of the part and which of them (n, k) may lead to a foot nearer than on the edge.

        The first is the foot on the edge itself, where the query is seen from it inwards. The others are samples,
        but for those beside that foot: what they stand for is farther than the edge, or found from it.
        """
        inwards = dots(x - rim.points, self.rim.outward(rim)) < -INWARD_SINE * rim.distance - self.tolerance
        count = min(2 * TRIMMED_DESCENTS, len(self.samples))
        gap, near = self._tree.query(x, np.arange(1, count + 1))
        samples = self.samples[near]
        beside = norms(samples - rim.points[:, None]) <= 3 * self.covering
        promising = (gap**2 - (2 * self.covering) ** 2 < rim.distance[:, None] ** 2) & ~beside
        starts = np.concatenate([rim.points[:, None], samples], axis=1)
        return starts, np.concatenate([inwards[:, None], promising], axis=1)

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.samples)

    def _directions(self, name: str, feet: ClosestPoints, /) -> Floats:
        """Return the unit vectors (n, d) of the whole that it calls ``name``."""
        return np.asarray(getattr(self.of, name)(feet))

    _normals = partialmethod(_directions, "normals")
    _facet_normals = partialmethod(_directions, "facet_normals")
    _tangents = partialmethod(_directions, "tangents")
    _leftward = partialmethod(_directions, "leftward")

    @property
    def _left_of(self) -> Floats | None:
        """(d,) the point on the left that the whole names; None where what it is left of is cut away."""
        point = self.of.left_of
        if point is None:
            return None
        foot = self.of.closest_point(as_vector(point, self.dim, "left_of")[None]).points
        return as_vector(point, self.dim, "left_of") if self._inside(foot)[0] else None

    def _interpolate(self, values: Floats, feet: ClosestPoints, /) -> Floats:
        """Return ``values`` (value_count, ...), one row for each of the whole's, interpolated at the feet."""
        return np.asarray(self.of.interpolate(values, feet))

    def _mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return the mesh of the whole, cut along the edge: vertices (v, d), and cells (m, k) of about ``spacing``."""
        coarsest = float(np.ptp(self.bounds, axis=0).max()) / TRIMMED_LEAST_CELLS
        vertices, cells = self.of.mesh(min(positive(spacing, "spacing"), coarsest))
        beyond = self.trim(vertices) + self.margin
        return clipped(vertices, cells, beyond, lambda points: self.rim.source.closest_point(points).points)

    def _translated(self, offset: Floats, /) -> Trimmed:
        """Return the part moved by ``offset`` (d,)."""
        shift = as_vector(offset, self.dim, "offset")
        return replace(
            self,
            of=self.of.translated(shift),
            trim=replace(self.trim, origin=self.trim.origin - shift),
            rim=self.rim.translated(shift),
            samples=self.samples + shift,
        )

    @property
    def _edge_limit(self) -> int:
        """What all numbers of edges are below: those of the whole come after the rim's."""
        return edge_limit_of(self.of) + MOST_EDGES
