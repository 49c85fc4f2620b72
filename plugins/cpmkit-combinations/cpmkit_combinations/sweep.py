"""Rings about drawn curves, and the cells between them: how a tube is drawn."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cpmkit.plugin import Floats, Ints, Polyline, unit

#: A ring about a curve in space has at least this many corners.
LEAST_RING_CORNERS = 8


class Swept(NamedTuple):
    """Vertices (v, d) and cells (m, d)."""

    points: Floats
    cells: Ints


def swept(curves: list[Polyline], radius: float, spacing: float, corners: int | None = None) -> Swept:
    """Return cells of about ``spacing`` at the distance ``radius`` from curves, caps at open ends.

    Rings have ``corners``; by default as many as the spacing asks for.
    """
    count = corners or max(LEAST_RING_CORNERS, int(np.ceil(2 * np.pi * radius / spacing)))
    parts = [_one(curve, radius, count) for curve in curves]
    starts = np.cumsum([0, *(len(part.points) for part in parts)])
    cells = [part.cells + start for part, start in zip(parts, starts[:-1], strict=True)]
    return Swept(np.concatenate([part.points for part in parts]), np.concatenate(cells))


def _one(curve: Polyline, radius: float, count: int) -> Swept:
    points, along = curve.points, _tangents(curve)
    if points.shape[1] == 2:
        return _offset(curve, np.stack([along[:, 1], -along[:, 0]], axis=1), radius, count)
    first, second = _frames(along, curve.closed)
    angle = 2 * np.pi * np.arange(count) / count
    around = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
    rings = points[:, None] + radius * around
    if curve.closed:
        return Swept(rings.reshape(-1, 3), _between(len(rings), count, closed=True))
    tilt = np.linspace(0.0, 0.5 * np.pi, max(count // 4, 2) + 1)[1:-1]
    out, level = np.sin(tilt)[:, None, None], np.cos(tilt)[:, None, None]
    start = points[0] + radius * (level * around[0] - out * along[0])
    end = points[-1] + radius * (level * around[-1] + out * along[-1])
    rings = np.concatenate([start[::-1], rings, end])
    poles = np.stack([points[0] - radius * along[0], points[-1] + radius * along[-1]])
    ring, n = np.arange(count), len(rings) * count
    turned = np.roll(ring, -1)
    low = np.stack([np.full(count, n), turned, ring], axis=1)
    high = np.stack([np.full(count, n + 1), n - count + ring, n - count + turned], axis=1)
    return Swept(
        np.concatenate([rings.reshape(-1, 3), poles]), np.concatenate([_between(len(rings), count, False), low, high])
    )


def _offset(curve: Polyline, right: Floats, radius: float, count: int) -> Swept:
    """Return the two sides of a curve in the plane; of an open one, joined by half circles about its ends."""
    sides = curve.points + radius * right, (curve.points - radius * right)[::-1]
    if curve.closed:
        n = len(curve.points)
        start = np.arange(n)
        cells = np.stack([start, (start + 1) % n], axis=1)
        return Swept(np.concatenate(sides), np.concatenate([cells, cells + n]))
    angle = np.linspace(0.0, np.pi, max(count // 2, 2) + 1)[1:-1, None]
    turned = np.stack([-right[:, 1], right[:, 0]], axis=1)  # the tangents
    ends = [
        curve.points[k] + radius * (np.cos(angle) * sign * right[k] + np.sin(angle) * sign * turned[k])
        for k, sign in ((-1, 1.0), (0, -1.0))
    ]
    points = np.concatenate([sides[0], ends[0], sides[1], ends[1]])
    start = np.arange(len(points))
    return Swept(points, np.stack([start, (start + 1) % len(points)], axis=1))


def _tangents(curve: Polyline) -> Floats:
    """Return (n, d) unit tangents: the mean direction of the two segments at each point."""
    p = curve.points
    steps = unit(np.diff(p, axis=0, append=p[:1]))
    if not curve.closed:
        steps[-1] = steps[-2]
    before = np.roll(steps, 1, axis=0)
    if not curve.closed:
        before[0] = steps[0]
    return unit(steps + before)


def _frames(along: Floats, closed: bool) -> tuple[Floats, Floats]:
    """Return two unit vectors (n, 3) each across a curve, carried along it; a closed one ends as it began."""
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


def _between(rings: int, count: int, closed: bool) -> Ints:
    """Return the triangles (m, 3) between rings of ``count`` corners each, seen from outside counterclockwise."""
    k, j = np.meshgrid(np.arange(rings if closed else rings - 1), np.arange(count), indexing="ij")
    here, there = k * count, (k + 1) % rings * count
    following = (j + 1) % count
    a, b, c, d = (one.ravel() for one in (here + j, here + following, there + following, there + j))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
