"""The kind ``mesh.polyline``, and the source of all curves of straight segments, in one chain or several."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.plugin import (
    Advice,
    ClosestPoints,
    Floats,
    InputError,
    Ints,
    as_points,
    as_positions,
    as_vector,
    in_three_dimensions,
    one_row_each,
    source_repr,
    unit,
)
from cpmkit.plugin import Polyline as Piece
from cpmkit_mesh.box_tree import BoxTree, build_tree, find_nearest
from cpmkit_mesh.mesh_files import as_numbers
from cpmkit_mesh.polyline_files import read_polyline

#: The error of a solution, relative to its range, over the angle in radians by which a polygon turns at its corners. On
#: circles of 16 to 64 corners it is 0.13 to 0.5.
ERROR_PER_CORNER_RADIAN = 0.3
#: A closest point nearer to a vertex than this share of its segment is at the vertex.
AT_VERTEX_SHARE = 1e-9
#: A last point nearer to the first than this share of the largest side of all points equals it up to rounding.
RETURNS_SHARE = 1e-9


@dataclass(frozen=True, eq=False)
class Polyline:
    """Segments between consecutive vertices of one or several chains, in the direction of the vertices' order.

    Attributes
    ----------
    vertices : (k, d) float64
        Those of one chain after those of another. Where chains meet, each has a vertex of its own.
    segments : (m, 2) int64
        The vertices at the start and the end of each segment, which differ in position. A vertex starts at most one
        segment and ends at most one.
    ends : (k,) int64
        The value of ``edge`` at each vertex: 0 where an open chain starts, 1 where it ends, -1 elsewhere.
    given_index : (k,) int64
        The number of each vertex among the points that the user gave.
    value_count : int
        How many points the user gave: the rows that :meth:`interpolate` expects.
    given_points : (value_count, d) float64
        These points.
    """

    vertices: Floats
    segments: Ints
    ends: Ints
    given_index: Ints
    value_count: int
    given_points: Floats

    manifold_dim = 1
    exact = True

    __repr__ = source_repr

    @property
    def dim(self) -> int:
        """Dimension of the space, 2 or 3."""
        return self.vertices.shape[1]

    @property
    def closed(self) -> bool:
        """Whether every chain is closed."""
        return bool((self.ends < 0).all())

    @property
    def pieces(self) -> list[Piece]:
        """The chains, each with ``points`` (k, d) and ``closed``: those of a cut or of edges with the longest first."""
        last = np.ones(len(self.vertices), dtype=bool)
        last[self.segments[self.segments[:, 1] == self.segments[:, 0] + 1, 0]] = False
        bounds = np.flatnonzero(last)[:-1] + 1
        chains = zip(np.split(self.vertices, bounds), np.split(self.ends, bounds), strict=True)
        return [Piece(points, bool(ends[0] < 0)) for points, ends in chains]

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of the box that holds all vertices."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of the queries ``x`` (n, d) on the segments.

        ``element`` is the segment of the closest point, ``local`` (n, 1) the share of the segment's length before it,
        and ``edge`` 0 at the start of an open chain, 1 at its end, -1 elsewhere. Raise InputError if ``x`` does not
        have shape (n, d) or is not finite.
        """
        nearest = find_nearest(self._tree, in_three_dimensions(as_points(x, self.dim)))
        segment, t = self._tree.order[nearest.slot], nearest.local[:, :1]
        start, end = self.segments[segment].T
        edge = np.where(t[:, 0] <= 0.0, self.ends[start], np.where(t[:, 0] >= 1.0, self.ends[end], -1))
        return ClosestPoints(np.ascontiguousarray(nearest.point[:, : self.dim]), nearest.distance, edge, segment, t)

    def tangents(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, d) unit tangents at ``feet``, in the curve's direction; at vertices the mean of both segments'.

        Where the curve turns back by half a turn, that of the segment before. Raise InputError if ``feet`` lack
        ``element`` or ``local``.
        """
        segment, t = self._locate(feet)
        direction = self._directions[segment]
        at_start, at_end = t <= AT_VERTEX_SHARE, t >= 1.0 - AT_VERTEX_SHARE
        direction[at_start] = self._bisectors[self.segments[segment[at_start], 0]]
        direction[at_end] = self._bisectors[self.segments[segment[at_end], 1]]
        return direction

    def interpolate(self, values: Floats, feet: ClosestPoints, /) -> Floats:
        """Return (n, ...) ``values`` (value_count, ...) of the user's points, interpolated linearly at ``feet``.

        Raise InputError if ``values`` has another number of rows, or ``feet`` lack ``element`` or ``local``.
        """
        segment, t = self._locate(feet)
        values = one_row_each(values, self.value_count, "points")
        ends = self.given_index[self.segments[segment]]
        t = t.reshape(-1, *(1,) * (values.ndim - 1))
        return (1.0 - t) * values[ends[:, 0]] + t * values[ends[:, 1]]

    def advice(self, _spacing: float, /) -> Advice:
        """Return advice with the error, at most 1, relative to the solution's range, that the corners cause.

        In the form ``galerkin`` there is none: the segments are the exact curve.
        """
        start, end = self.segments.T
        along = np.concatenate([self._directions, self._directions])
        cosine = np.einsum("nd,nd->n", along, self._bisectors[np.concatenate([start, end])])
        turn = 2.0 * np.arccos(np.clip(cosine, -1.0, 1.0))
        floor = min(1.0, ERROR_PER_CORNER_RADIAN * float(np.sqrt(np.mean(turn**2))))
        return Advice(floor, integral_floor=0.0)

    def mesh(self, _spacing: float, /) -> tuple[Floats, Ints]:
        """Return the polyline's own vertices (k, d) and segments (m, 2), whatever the spacing."""
        return self.vertices, self.segments

    @property
    def given_mesh(self) -> tuple[Floats, Ints]:
        """The points (value_count, d) that the user gave, and the segments (m, 2) between them."""
        return self.given_points, self.given_index[self.segments]

    def translate(self, offset: Floats, /) -> Polyline:
        """Return a new polyline with vertices and given points translated by ``offset`` (d,).

        Raise InputError if ``offset`` is not d finite numbers.
        """
        shift = as_vector(offset, self.dim, "offset")
        return replace(self, vertices=self.vertices + shift, given_points=self.given_points + shift)

    def _locate(self, feet: ClosestPoints) -> tuple[Ints, Floats]:
        """Return the segment (n,) of each closest point in ``feet`` and the share (n,) of its length before it.

        Raise InputError if ``feet`` lack ``element`` or ``local``: another source returned them.
        """
        if feet.element is None or feet.local is None:
            raise InputError("feet must be records that this polyline answered: they lack element or local.")
        return feet.element, feet.local[:, 0]

    @cached_property
    def _directions(self) -> Floats:
        return unit(self.vertices[self.segments[:, 1]] - self.vertices[self.segments[:, 0]])

    @cached_property
    def _bisectors(self) -> Floats:
        """(k, d) the unit tangent at each vertex; where the polyline turns back, that of the segment before."""
        start, end = self.segments.T
        arriving, leaving = np.zeros_like(self.vertices), np.zeros_like(self.vertices)
        arriving[start], leaving[end] = self._directions, self._directions  # at an end, where there is one segment
        arriving[end], leaving[start] = self._directions, self._directions
        both = arriving + leaving
        turned_back = np.linalg.norm(both, axis=1) <= AT_VERTEX_SHARE
        return unit(np.where(turned_back[:, None], arriving, both))

    @cached_property
    def _tree(self) -> BoxTree:
        points = in_three_dimensions(self.vertices)
        return build_tree(points[self.segments[:, [0, 1, 1]]])


def polyline(*, points: Any = None, file: str | Path | None = None, closed: bool | None = None) -> Polyline:
    """Return the polyline through ``points``, or through those in ``file``.

    Parameters
    ----------
    points : (n, 2) or (n, 3) array
        At least two that differ, in the direction of the curve; repeated consecutive points count once.
    file : str or Path
        A ``.npy`` file that holds such an array, a ``.csv``, ``.txt`` or ``.xyz`` file with one point in each row, or
        an OBJ file with one line.
    closed : bool, optional
        True adds the segment from the last point to the first, False leaves both as ends though they are equal. By
        default a polyline is closed if its last point equals its first, up to rounding: 1e-9 of its largest side.

    Raises
    ------
    InputError
        If both or neither of ``points`` and ``file`` are given, the file is missing or no polyline, or the points are
        of another shape, not finite, too large, or all the same.
    """
    if (points is None) == (file is None):
        raise InputError(
            "mesh.polyline takes either points or a file, got " + ("neither." if file is None else "both.")
        )
    array = as_numbers(points, "points") if file is None else read_polyline(file)
    if array.ndim != 2 or array.shape[1] not in (2, 3):
        raise InputError(f"points must have shape (n, 2) or (n, 3), got {array.shape}.")
    places = as_positions(array, array.shape[1])
    if len(places) < 2:
        raise InputError(f"A polyline needs at least 2 points, got {len(places)}.")
    distinct = np.flatnonzero(np.r_[True, (places[1:] != places[:-1]).any(axis=1)])
    apart = np.abs(places[distinct[-1]] - places[distinct[0]]).max()
    returns = bool(apart <= RETURNS_SHARE * np.ptp(places, axis=0).max())
    if len(distinct) == 1:
        raise InputError(
            f"A polyline needs 2 points that differ, got {len(places)} times the same; use analytic.point."
        )
    distinct = distinct[:-1] if returns and closed is not False else distinct
    return _single_chain(places, distinct, returns if closed is None else bool(closed))


def _single_chain(points: Floats, rows: Ints, closed: bool) -> Polyline:
    """Return the polyline of one chain through those of the user's ``points`` (n, d) in ``rows`` (k,)."""
    k = len(rows)
    start = np.arange(k if closed else k - 1)
    ends = np.full(k, -1)
    if not closed:
        ends[[0, -1]] = 0, 1
    return Polyline(points[rows], np.stack([start, (start + 1) % k], axis=1), ends, rows, len(points), points)
