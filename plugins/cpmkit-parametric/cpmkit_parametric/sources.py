"""Parametric manifolds as closest point sources; a class for each set of abilities."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from cpmkit.plugin import ClosestPoints, Floats, Ints, as_points, as_vector, positive, source_repr
from cpmkit_parametric.cells import CellTree
from cpmkit_parametric.descent import minimize_distance
from cpmkit_parametric.domain import Domain, Sides
from cpmkit_parametric.maps import UnitMap
from cpmkit_parametric.meshes import curve_mesh, surface_mesh

#: Queries that are searched at a time.
PARAMETRIC_PARCEL_QUERIES = 1 << 11
#: Step, as a share of the range, off a point at which the derivatives do not tell a direction.
ASIDE_RANGE_SHARE = 1e-5
#: Derivatives shorter than this share of the typical one tell no direction.
VANISHING_DERIVATIVE_SHARE = 1e-10
#: Where two branches cross, feet closer than this share of the size leave it open on which one they are.
COINCIDENT_FEET_SHARE = 1e-4
#: Unit parameters, and projections on tangent planes, that differ by more than this are two.
TWO_FEET_SHARE = 1e-6

Own = TypeVar("Own", bound="Parametric")


@dataclass(frozen=True, eq=False)
class Parametric:
    """The image of a map.

    Attributes
    ----------
    map : UnitMap
        From unit parameters to space.
    domain : Domain
        How the ends of the parameters are glued.
    sides : Sides
        Which ends are edges.
    tree : CellTree
        Where descents start.
    size : float
        Diagonal of the image's box.
    shift : (d,) float64
        Added to the map.
    """

    map: UnitMap
    domain: Domain
    sides: Sides
    tree: CellTree
    size: float
    shift: Floats

    __repr__ = source_repr

    @property
    def dim(self) -> int:
        """Dimension of the space."""
        return self.map.dim

    @property
    def manifold_dim(self) -> int:
        """1 a curve, 2 a surface."""
        return self.map.count

    @property
    def exact(self) -> bool:
        """True: the feet are nearest points."""
        return True

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of a box around the image; it is wider than the image by a share of the finest cells' bend."""
        return self.tree.box + self.shift

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d); ``local`` holds the user's parameters (n, m).

        ``edge`` is 0 or 1 at the start or end of a curve, the loop's number, as in :class:`Sides`, on the edge of a
        surface, -1 elsewhere. Feet are ``doubtful`` without convergence or where the image crosses itself. Raise
        InputError if ``x`` holds NaN or infinity, or its shape is not (n, d).
        """
        queries = as_points(x, self.dim) - self.shift
        if len(queries) <= PARAMETRIC_PARCEL_QUERIES:
            return self._find_feet(queries)
        starts = range(0, len(queries), PARAMETRIC_PARCEL_QUERIES)
        return ClosestPoints.join(
            [self._find_feet(queries[start : start + PARAMETRIC_PARCEL_QUERIES]) for start in starts]
        )

    def translate(self: Own, offset: Floats, /) -> Own:
        """Return the same image moved by ``offset``, (d,) finite numbers; the shift alone is rounded, once."""
        return replace(self, shift=self.shift + as_vector(offset, self.dim, "offset"))

    def _find_feet(self, x: Floats) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d), given relative to the shift: the nearest ends of the descents."""
        from cpmkit_parametric.descent_kernels import nearest_rows, point_distances

        starts = self.tree.descent_starts(x)
        longest = 2.0 / np.array(self.tree.finest.shape)
        target = x[starts.query]
        ends = minimize_distance(self.map, self.domain, target, starts.parameters, longest, self.size)
        s = self.domain.snap_to_bounds(ends.parameters)
        points = self.map.value(s)
        distance = point_distances(points, target)
        best = nearest_rows(starts.query, distance, len(x))
        doubtful = ~ends.converged[best]
        doubtful[self._crossing_queries(starts.query, s, points, best)] = True
        return ClosestPoints(
            points[best] + self.shift,
            distance[best],
            self.sides.edge(s[best]),
            local=self.map.user_parameters(s[best]),
            doubtful=doubtful,
        )

    def _crossing_queries(self, query: Ints, s: Floats, points: Floats, best: Ints) -> Ints:
        """Return the queries (k,), with repetitions, whose foot is where two sheets of the image cross.

        The end of the descent for ``query`` (r,) has unit parameters ``s`` (r, m) and ``points`` (r, d); ``best`` (n,)
        are the rows of the feet.
        """
        other = best[query]
        apart = np.abs(s - s[other])
        apart = np.where(self.domain.periodic, np.minimum(apart, 1 - apart), apart)
        coincide = np.linalg.norm(points - points[other], axis=1) <= COINCIDENT_FEET_SHARE * self.size
        rows = np.flatnonzero(coincide & (apart.max(axis=1) > TWO_FEET_SHARE))
        pole = self.sides.on_pole(s[rows]) | self.sides.on_pole(s[other[rows]])
        rows = rows[~pole]
        if not len(rows):
            return rows
        planes = [_projectors(self.map.jet(s[index])[1]) for index in (rows, other[rows])]
        crossing = np.abs(planes[0] - planes[1]).max(axis=(1, 2), initial=0.0) > TWO_FEET_SHARE
        return np.asarray(query[rows[crossing]])

    def _unit_parameters(self, feet: ClosestPoints) -> Floats:
        """Return the unit parameters (n, m) of ``feet``."""
        assert feet.local is not None
        return self.map.unit_parameters(feet.local)


class Curve(Parametric):
    """A curve with tangents."""

    def tangents(self, feet: ClosestPoints, /) -> Floats:
        """Return unit tangents (n, d) at ``feet`` in the direction of growing t, where x' is zero along a chord."""
        s = self._unit_parameters(feet)
        along = self.map.jet(s)[1][:, 0]
        resting = np.linalg.norm(along, axis=1) < VANISHING_DERIVATIVE_SHARE * self.size
        if resting.any():
            ahead, behind = (
                self.map.value(self.domain.wrap_parameters(s[resting] + step))
                for step in (ASIDE_RANGE_SHARE, -ASIDE_RANGE_SHARE)
            )
            along[resting] = ahead - behind
        return _unit_vectors(along)

    def mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices (v, d) and segments (m, 2) in order of growing t, of about equal arcs up to ``spacing``."""
        vertices, cells = curve_mesh(self.map, self.domain, positive(spacing, "spacing"))
        return vertices + self.shift, cells


class PlaneCurve(Curve):
    """A curve in the plane, with normals and tangents."""

    def normals(self, feet: ClosestPoints, /) -> Floats:
        """Return unit normals (n, 2) at ``feet``, at the right hand of growing t: outside if counterclockwise."""
        tangents = self.tangents(feet)
        return np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)


class Surface(Parametric):
    """A surface that may be one-sided and has no normals."""

    def mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices (v, 3) and triangles (m, 3) as :func:`surface_mesh`, for ``spacing`` > 0."""
        vertices, cells = surface_mesh(self.map, self.domain, self.sides, positive(spacing, "spacing"))
        return vertices + self.shift, cells


class OrientedSurface(Surface):
    """A surface with two sides."""

    def normals(self, feet: ClosestPoints, /) -> Floats:
        """Return the unit normals (n, 3) at ``feet`` along x_u x x_v.

        At a pole, where that is zero, it is the mean around it; elsewhere, the value just inside of the range.
        """
        s = self._unit_parameters(feet)
        normals = self._cross_products(s)
        poles = np.linalg.norm(normals, axis=1) < VANISHING_DERIVATIVE_SHARE * self.size**2
        if poles.any():
            normals[poles] = self._pole_normals(s[poles])
        return _unit_vectors(normals)

    def _cross_products(self, s: Floats) -> Floats:
        J = self.map.jet(s)[1]
        return np.asarray(np.cross(J[:, 0], J[:, 1]))

    def _pole_normals(self, s: Floats) -> Floats:
        """Return the sum (k, 3) of x_u x x_v around each of ``s`` (k, 2) at a pole, else that just inside of it."""
        total = np.zeros((len(s), 3))
        for axis in (0, 1):
            if not self.sides.collapsed[axis].any():
                continue
            beside = np.clip(s, ASIDE_RANGE_SHARE, 1 - ASIDE_RANGE_SHARE)
            for turn in np.arange(8) / 8:
                beside[:, 1 - axis] = turn
                at = self.sides.collapsed[axis][(s[:, axis] > 0.5).astype(int)]
                total += np.where(at[:, None], self._cross_products(beside), 0.0)
        return np.where(
            np.any(total != 0, axis=1)[:, None],
            total,
            self._cross_products(np.clip(s, ASIDE_RANGE_SHARE, 1 - ASIDE_RANGE_SHARE)),
        )


def _unit_vectors(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1.0), np.eye(vectors.shape[1])[0])


def _projectors(J: Floats) -> Floats:
    """Return the projections (n, d, d) on the spans of derivatives (n, m, d)."""
    return np.asarray(np.linalg.pinv(J) @ J)
