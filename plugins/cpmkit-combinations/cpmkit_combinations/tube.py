"""The kind ``tube``: the points at one distance from a curve: a tube in space, an offset to both sides in the plane."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from cpmkit.plugin import (
    Advice,
    ClosestPoints,
    ClosestPointSource,
    Floats,
    HasMesh,
    HasTranslation,
    InputError,
    Ints,
    Polyline,
    advice_of,
    as_points,
    as_vector,
    chain_segments,
    check_source,
    norms,
    place,
    positive,
    shown,
    source_repr,
    unit,
)

#: Distance from the curve, over the radius, below which the direction away from it is undefined.
ON_CURVE_SHARE = 1e-10
#: Distance, over the radius, below which rounding affects the direction, so that it is computed again at the foot.
NEAR_CURVE_SHARE = 1e-4
#: Largest amount, over the radius, by which a point of the tube may be nearer to the curve, in the check at samples.
RADIUS_MISMATCH_SHARE = 1e-3
#: Samples of that check: their distance along the curve over the radius, and their number around it.
REACH_STEP_SHARE, REACH_DIRECTIONS = 0.05, 16
#: Largest number of those samples along the curve.
MOST_REACH_SAMPLES = 4096
#: Least number of corners of a ring around a curve in space.
LEAST_RING_CORNERS = 8


@dataclass(frozen=True, eq=False)
class Tube:
    """The points at the distance ``radius`` from a curve; around an open end they form a cap.

    Attributes
    ----------
    around : ClosestPointSource
        The curve.
    radius : float
        Less than the curve's reach, so that each point at this distance has one foot on the curve.
    """

    around: ClosestPointSource
    radius: float

    __repr__ = source_repr

    @property
    def dim(self) -> int:
        """Dimension of the space."""
        return self.around.dim

    @property
    def manifold_dim(self) -> int:
        """Dimension of the space less 1."""
        return self.dim - 1

    @property
    def exact(self) -> bool:
        """Whether the curve's feet are true nearest points: then the tube's are."""
        return self.around.exact

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of the curve's box, widened by the radius."""
        return np.asarray(self.around.bounds, dtype=np.float64) + self.radius * np.array([[-1.0], [1.0]])

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d): at the radius from the foot on the curve, towards ``x``.

        ``edge`` is -1. On the curve itself all directions across it are equal, and the feet are ``doubtful``, as they
        are where the curve's foot is. Raise InputError if ``x`` holds NaN or infinity, or its shape is not (n, d).
        """
        x = as_points(x, self.dim)
        middle = self.around.closest_point(x)
        away = x - middle.points
        length = norms(away)
        on_curve = length <= ON_CURVE_SHARE * self.radius
        if on_curve.any():
            away[on_curve], length[on_curve] = self._directions_across(middle.points[on_curve]), 1.0
        feet = middle.points + (self.radius / length)[:, None] * away
        inexact = on_curve | (length < NEAR_CURVE_SHARE * self.radius)
        if inexact.any():
            feet[inexact] = self._project(feet[inexact])
        # Projected feet are off the line through the foot on the curve.
        distance = np.where(inexact, norms(x - feet), np.abs(length - self.radius))
        doubtful = on_curve if middle.doubtful is None else on_curve | middle.doubtful
        return ClosestPoints(feet, distance, np.full(len(x), -1), doubtful=doubtful)

    def normals(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, d) unit normals at ``feet``: away from the curve."""
        return unit(feet.points - self.around.closest_point(feet.points).points)

    def mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices (v, d) on the tube and cells (m, d), triangles or segments, of about ``spacing``.

        A ring around the curve has at least 8 corners. Triangles are wound counterclockwise as seen from outside;
        segments have the outside on their right. Raise InputError if the curve itself cannot be drawn, or the spacing
        is not above zero.
        """
        sweep = sweep_curves(_polylines(self.around, positive(spacing, "spacing")), self.radius, spacing)
        return self.closest_point(sweep.points).points, sweep.cells

    def advice(self, spacing: float, /) -> Advice:
        """Return the error estimates and warnings of the curve at grid ``spacing``."""
        return advice_of(self.around, spacing)

    def translate(self, offset: Floats, /) -> Tube:
        """Return the tube translated by ``offset`` (d,)."""
        if isinstance(self.around, HasTranslation):
            return replace(self, around=self.around.translate(as_vector(offset, self.dim, "offset")))
        from cpmkit_combinations.moved import moved_source

        return replace(self, around=moved_source(of=self.around, translation=offset))

    def _project(self, points: Floats) -> Floats:
        """Return the tube's closest points (n, d) to ``points`` (n, d) near it, where directions are exact."""
        middle = self.around.closest_point(points).points
        return np.asarray(middle + self.radius * unit(points - middle))

    def _directions_across(self, points: Floats) -> Floats:
        """Return unit vectors (n, d) across the curve at ``points`` (n, d) on it, from feet of points beside them."""
        step, best = 0.1 * self.radius, np.zeros(points.shape)
        for axis in np.eye(self.dim):
            beside = points + step * axis
            away = beside - self.around.closest_point(beside).points
            best = np.where((norms(away) > norms(best))[:, None], away, best)
        return unit(best)


def tube(*, around: ClosestPointSource, radius: Any) -> Tube:
    """Return the points at one distance from a curve: a tube in space, in the plane the curve's offset to both sides.

    Raise InputError if ``around`` is no curve, the radius is not above zero, or the tube would meet itself; the last is
    tested at samples, and only around a curve that can be drawn.

    Parameters
    ----------
    around : source
        A curve. The tube has caps at its open ends.
    radius : number
        The distance, above zero, and less than the curve's radii of curvature and half its distance from itself.

    Examples
    --------
    >>> import cpmkit as ck
    >>> torus = ck.source("tube", around=ck.source("analytic.circle", normal=[0, 0, 1]), radius=0.3)
    >>> torus.closest_point([[2.0, 0.0, 0.0]]).points.tolist()
    [[1.3, 0.0, 0.0]]
    """
    check_source(around, "the curve of the tube")
    if around.manifold_dim != 1:
        raise InputError(
            f"A tube lies around a curve, got {shown(around)} of manifold_dim {around.manifold_dim}; of a surface take "
            "a level set of its distance."
        )
    result = Tube(around, positive(radius, "radius"))
    if isinstance(around, HasMesh):
        _check_reach(around, result.radius)
    return result


def _check_reach(around: Any, radius: float) -> None:
    """Raise InputError if the tube of ``radius`` around the curve ``around`` would meet itself, tested at samples."""
    size = float(np.ptp(around.bounds, axis=0).max())
    step = max(REACH_STEP_SHARE * radius, size / MOST_REACH_SAMPLES)
    points = sweep_curves(_polylines(around, step), radius, radius, REACH_DIRECTIONS).points
    shortfall = radius - around.closest_point(points).distance
    worst = int(np.argmax(shortfall))
    if shortfall[worst] > RADIUS_MISMATCH_SHARE * radius:
        raise InputError(
            f"A tube of the radius {radius:g} meets itself near {place(points[worst])}: the curve turns there, or "
            f"comes back to itself, within {radius - shortfall[worst]:.3g}; take a smaller radius."
        )


def _polylines(around: Any, spacing: float) -> list[Polyline]:
    """Return the chains of the segments, about ``spacing`` long, of a curve; raise InputError if it cannot be drawn."""
    if not isinstance(around, HasMesh):
        raise InputError(f"{type(around).__name__} cannot be drawn, so neither can a tube around it.")
    return chain_segments(*around.mesh(spacing))


class Sweep(NamedTuple):
    """A mesh around curves: vertices ``points`` (v, d), and ``cells`` (m, d) between them."""

    points: Floats
    cells: Ints


def sweep_curves(curves: list[Polyline], radius: float, spacing: float, corners: int | None = None) -> Sweep:
    """Return a mesh, of about ``spacing``, at the distance ``radius`` from ``curves``, with caps at open ends.

    A ring has the number ``corners`` of vertices, by default 2 pi radius / spacing, at least 8. In 2D there are no
    rings: offsets have the curves' segments, half circles at ends half as many as a ring. Triangles are
    counterclockwise seen from outside; segments have the outside on their right.
    """
    count = corners or max(LEAST_RING_CORNERS, int(np.ceil(2 * np.pi * radius / spacing)))
    parts = [_sweep_curve(curve, radius, count) for curve in curves]
    starts = np.cumsum([0, *(len(part.points) for part in parts)])
    cells = [part.cells + start for part, start in zip(parts, starts[:-1], strict=True)]
    return Sweep(np.concatenate([part.points for part in parts]), np.concatenate(cells))


def _sweep_curve(curve: Polyline, radius: float, count: int) -> Sweep:
    """Return the mesh of :func:`sweep_curves` around one curve, with ``count`` vertices in a ring."""
    points, along = curve.points, _vertex_tangents(curve)
    if points.shape[1] == 2:
        return _offset_curve(curve, np.stack([along[:, 1], -along[:, 0]], axis=1), radius, count)
    first, second = _transport_frame(along, curve.closed)
    angle = 2 * np.pi * np.arange(count) / count
    around = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
    rings = points[:, None] + radius * around
    if curve.closed:
        return Sweep(rings.reshape(-1, 3), _ring_triangles(len(rings), count, closed=True))
    tilt = np.linspace(0.0, 0.5 * np.pi, max(count // 4, 2) + 1)[1:-1]
    out, level = np.sin(tilt)[:, None, None], np.cos(tilt)[:, None, None]
    start = points[0] + radius * (level * around[0] - out * along[0])
    end = points[-1] + radius * (level * around[-1] + out * along[-1])
    rings = np.concatenate([start[::-1], rings, end])
    poles = np.stack([points[0] - radius * along[0], points[-1] + radius * along[-1]])
    ring, n = np.arange(count), len(rings) * count
    following = np.roll(ring, -1)
    low = np.stack([np.full(count, n), following, ring], axis=1)
    high = np.stack([np.full(count, n + 1), n - count + ring, n - count + following], axis=1)
    return Sweep(
        np.concatenate([rings.reshape(-1, 3), poles]),
        np.concatenate([_ring_triangles(len(rings), count, False), low, high]),
    )


def _offset_curve(curve: Polyline, right: Floats, radius: float, count: int) -> Sweep:
    """Return segments of both offsets of a plane curve by ``radius``, and of half circles around ends of an open one.

    ``right`` (n, 2) are unit vectors to its right; ``count`` is the number of segments of a full circle.
    """
    sides = curve.points + radius * right, (curve.points - radius * right)[::-1]
    if curve.closed:
        n = len(curve.points)
        start = np.arange(n)
        cells = np.stack([start, (start + 1) % n], axis=1)
        return Sweep(np.concatenate(sides), np.concatenate([cells, cells + n]))
    angle = np.linspace(0.0, np.pi, max(count // 2, 2) + 1)[1:-1, None]
    tangents = np.stack([-right[:, 1], right[:, 0]], axis=1)
    ends = [
        curve.points[k] + radius * (np.cos(angle) * sign * right[k] + np.sin(angle) * sign * tangents[k])
        for k, sign in ((-1, 1.0), (0, -1.0))
    ]
    points = np.concatenate([sides[0], ends[0], sides[1], ends[1]])
    start = np.arange(len(points))
    return Sweep(points, np.stack([start, (start + 1) % len(points)], axis=1))


def _vertex_tangents(curve: Polyline) -> Floats:
    """Return (n, d) unit tangents at the curve's points: mean directions of the adjacent segments, two or one."""
    p = curve.points
    steps = unit(np.diff(p, axis=0, append=p[:1]))
    if not curve.closed:
        steps[-1] = steps[-2]
    before = np.roll(steps, 1, axis=0)
    if not curve.closed:
        before[0] = steps[0]
    return unit(steps + before)


def _transport_frame(along: Floats, closed: bool) -> tuple[Floats, Floats]:
    """Return two unit vectors (n, 3) across a curve with unit tangents ``along`` (n, 3), orthogonal, without twist.

    The second is the cross product of the tangent and the first. On a closed curve the angle between the first and the
    last frame is distributed along it.
    """
    first = np.empty_like(along)
    across = np.eye(3)[np.argmin(np.abs(along[0]))]
    for k, t in enumerate(along):
        across = across - (across @ t) * t
        across = first[k] = across / np.linalg.norm(across)
    second = np.cross(along, first)
    if not closed:
        return first, second
    back = first[-1] - (first[-1] @ along[0]) * along[0]
    twist = np.arctan2(back @ second[0], back @ first[0])
    turn = -twist * np.arange(len(along))[:, None] / len(along)
    first, second = np.cos(turn) * first + np.sin(turn) * second, np.cos(turn) * second - np.sin(turn) * first
    return first, second


def _ring_triangles(rings: int, count: int, closed: bool) -> Ints:
    """Return the triangles (m, 3) of a tube of ``rings`` rings with ``count`` vertices each.

    Vertices are numbered ring by ring; triangles are counterclockwise seen from outside. If ``closed``, the last ring
    is connected to the first.
    """
    k, j = np.meshgrid(np.arange(rings if closed else rings - 1), np.arange(count), indexing="ij")
    here, there = k * count, (k + 1) % rings * count
    following = (j + 1) % count
    a, b, c, d = (corner.ravel() for corner in (here + j, here + following, there + following, there + j))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
