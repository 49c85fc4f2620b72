"""The edge made by trimming, a curve on a surface or one or two points on a curve, and meshes clipped at it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from cpmkit.plugin import (
    Bools,
    ClosestPoints,
    ClosestPointSource,
    Floats,
    InputError,
    Ints,
    dots,
    number_edges,
    rotate_triangles,
)
from cpmkit_combinations.curve import TracedCurve
from cpmkit_combinations.level_cut import LevelCut
from cpmkit_combinations.points import PointSet


class TrimmedEdge(Protocol):
    """The points at which a manifold is cut off."""

    @property
    def source(self) -> ClosestPointSource:
        """The points as a source."""

    @property
    def deviation(self) -> float:
        """Largest distance of the edge from the zeros of trim."""

    def outward(self, feet: ClosestPoints, /) -> Floats:
        """Return unit conormals (n, d) at feet on the edge, towards the part that is cut away."""

    def numbers(self, feet: ClosestPoints, /) -> Ints:
        """Return the numbers (n,) of the edges on which ``feet``, closest points of the new edge, lie."""

    def numbers_of_whole(self, edge: Ints, /) -> Ints:
        """Return the edge numbers (n,) on the part of feet with the numbers ``edge`` (n,) on the whole; -1 stays."""

    def translate(self, offset: Floats, /) -> TrimmedEdge:
        """Return the edge moved by ``offset`` (d,)."""


@dataclass(frozen=True, eq=False)
class CurveEdge:
    """The edge of a trimmed surface, on whose left the surface is cut away."""

    source: TracedCurve

    @property
    def deviation(self) -> float:
        """The largest distance of the curve from the zeros of trim."""
        return self.source.deviation

    def outward(self, feet: ClosestPoints, /) -> Floats:
        """Return unit conormals (n, d) at ``feet`` to the left of the curve, where the surface is cut away."""
        return self.source.leftward(feet)

    def numbers(self, feet: ClosestPoints, /) -> Ints:
        """Return the number (n,) of the curve's piece on which each foot lies, 0 the longest."""
        return self.source.piece(feet)

    def numbers_of_whole(self, edge: Ints, /) -> Ints:
        """Return ``edge`` (n,) plus the number of the curve's pieces; -1 stays."""
        return np.where(edge >= 0, edge + len(self.source.pieces), edge)

    def translate(self, offset: Floats, /) -> CurveEdge:
        """Return the edge moved by ``offset`` (d,)."""
        return CurveEdge(self.source.translate(offset))


@dataclass(frozen=True, eq=False)
class PointEdge:
    """The new ends of a trimmed curve.

    Attributes
    ----------
    source : PointSet
        The k = 1 or 2 points.
    directions : (k, d) float64
        Unit vectors along the curve, towards the part that is cut away.
    ends : (k,) int64
        0 for a point at the start of the part, 1 for one at its end.
    """

    source: PointSet
    directions: Floats
    ends: Ints

    deviation = 0.0

    def outward(self, feet: ClosestPoints, /) -> Floats:
        """Return unit vectors (n, d) at ``feet`` along the curve, towards the part that is cut away."""
        return np.asarray(self.directions[feet.element])

    def numbers(self, feet: ClosestPoints, /) -> Ints:
        """Return (n,) 0 for ``feet`` at the start of the part, 1 at its end."""
        return np.asarray(self.ends[feet.element], dtype=np.int64)

    def numbers_of_whole(self, edge: Ints, /) -> Ints:
        """Return the number of the end of the part that is not new where ``edge`` (n,) >= 0; -1 stays."""
        return np.where(edge >= 0, 1 - self.ends[0], edge)

    def translate(self, offset: Floats, /) -> PointEdge:
        """Return the edge moved by ``offset`` (d,)."""
        return replace(self, source=self.source.translate(offset))


def point_edge(cut: LevelCut, points: PointSet, ends_left: Ints) -> PointEdge:
    """Return the ends of the trimmed curve of ``cut``, whose function is trim.

    ``points`` are the zeros of trim on the curve, ``ends_left`` (k,) the ends of the whole, 0 or 1, that belong to the
    part. If the whole is closed and has no tangents, the start is the first of the points. Raise InputError if the part
    is not one piece with two ends.
    """
    feet = cut.surface.closest_point(points.positions)
    outward = cut.directions(feet)[1]
    count = len(points.positions)
    if count + len(ends_left) != 2:
        raise InputError(
            f"trim must leave one piece of the curve, with two ends, got {count} cuts and {len(ends_left)} ends of its "
            "own; use the kind union for several pieces."
        )
    if len(ends_left):
        ends = 1 - ends_left
    elif cut.surface.has_tangents:
        ends = (dots(outward, cut.surface.tangents(feet)) > 0).astype(np.int64)
    else:
        ends = np.arange(2)
    return PointEdge(points, outward, ends)


def clip_mesh(vertices: Floats, cells: Ints, values: Floats, onto: Callable[[Floats], Floats]) -> tuple[Floats, Ints]:
    """Return the vertices (k, d) and cells (l, 2 or 3) of the part of a mesh where ``values`` are negative.

    ``vertices`` are (v, d), ``cells`` (m, 2 or 3) segments or triangles, which keep their direction or winding;
    ``values`` (v,) are those of a function at the vertices. ``onto`` moves its zeros (n, d), interpolated on the edges
    of cells, to the edge of the part.
    """
    inside = values < 0
    edges, cell_edges = number_edges(cells, len(vertices))
    a, b = edges.T
    crossed = np.flatnonzero(inside[a] != inside[b])
    a, b = a[crossed], b[crossed]
    with np.errstate(all="ignore"):
        share = np.clip(np.nan_to_num(values[a] / (values[a] - values[b]), nan=0.5), 0.0, 1.0)[:, None]
    number = np.full(len(edges), -1)
    number[crossed] = len(vertices) + np.arange(len(crossed))
    points = np.concatenate([vertices, onto((1 - share) * vertices[a] + share * vertices[b])])
    clip = _clip_segments if cells.shape[1] == 2 else _clip_triangles
    cells = clip(cells, number[cell_edges], inside[cells])
    used, cells = np.unique(cells, return_inverse=True)
    return points[used], cells.reshape(-1, cells.shape[-1]).astype(np.int64)


def _clip_segments(cells: Ints, crossings: Ints, inside: Bools) -> Ints:
    """Return (k, 2) the segments with both ends ``inside`` (m, 2), and of those with one the part up to ``crossings``.

    ``crossings`` (m, 1) are the new vertices on the segments.
    """
    crossed = inside.sum(axis=1) == 1
    clipped = np.where(inside[crossed], cells[crossed], crossings[crossed])
    return np.concatenate([cells[inside.all(axis=1)], clipped])


def _clip_triangles(cells: Ints, crossings: Ints, inside: Bools) -> Ints:
    """Return (k, 3) the triangles inside, and the inner parts of others: corners, and the two halves of quadrangles.

    ``crossings`` (m, 3) are the new vertices on the triangles' edges, ``inside`` (m, 3) marks their corners.
    """
    count = inside.sum(axis=1)
    single, pair = count == 1, count == 2
    (a, _, _), (ab, _, ca) = rotate_triangles(cells[single], crossings[single], inside[single].argmax(axis=1))
    corner = np.stack([a, ab, ca], axis=1)
    # the vertex outside comes first
    (_, b, c), (ab, _, ca) = rotate_triangles(cells[pair], crossings[pair], inside[pair].argmin(axis=1))
    halves = [np.stack([ab, b, c], axis=1), np.stack([ab, c, ca], axis=1)]
    return np.concatenate([cells[count == 3], corner, *halves])
