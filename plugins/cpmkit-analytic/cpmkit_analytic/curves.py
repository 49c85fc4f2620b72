"""A point, a segment, a circle and an arc in canonical position, in the plane or in space."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.plugin import Floats, Ints
from cpmkit_analytic.directions import normalize_or_default
from cpmkit_analytic.revolution import count_intervals
from cpmkit_analytic.shapes import Feet, no_edge_entries

FULL_TURN = 2 * np.pi


@dataclass(frozen=True)
class Point:
    """The origin."""

    dim: int
    manifold_dim: int = 0

    def feet(self, q: Floats) -> Feet:
        """Return the origin as the closest point of each of ``q`` (n, d)."""
        return Feet(np.zeros_like(q), no_edge_entries(q))

    def support(self, u: Floats) -> Floats:
        """Return (n,) zeros: a point has no extent."""
        return np.zeros(len(u))

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:  # noqa: ARG002 - a point has one size
        """Return the point itself as the only vertex and the only cell."""
        return np.zeros((1, self.dim)), np.zeros((1, 1), dtype=np.int64)

    def scale_by(self, factor: float) -> Point:  # noqa: ARG002 - a point has one size
        """Return the point."""
        return self


@dataclass(frozen=True)
class Segment:
    """From the origin to ``length`` on the first axis; ``local`` is the share of the way."""

    dim: int
    length: float
    manifold_dim: int = 1

    def feet(self, q: Floats) -> Feet:
        """Return closest points of ``q`` (n, d), with ``edge`` 0 or 1 at ends and the share of the way as ``local``."""
        along = np.clip(q[:, 0], 0.0, self.length)
        edge = np.where(along <= 0, 0, np.where(along >= self.length, 1, -1))
        return Feet(_embed_axis_points(along, self.dim), edge, along[:, None] / self.length)

    def support(self, u: Floats) -> Floats:
        """Return (n,) the largest u . p over the segment for each of ``u`` (n, d)."""
        return np.maximum(0.0, self.length * u[:, 0])

    def tangents(self, p: Floats) -> Floats:
        """Return the first axis (n, d), once for each of ``p`` (n, d)."""
        return _embed_axis_points(np.ones(len(p)), self.dim)

    def normals(self, p: Floats) -> Floats:
        """Return the normals (n, 2), in the plane, on the right hand of travel, as on a counterclockwise circle."""
        return _right_normals(self.tangents(p))

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices (v, d) and segments (m, 2) of equal length, at most ``spacing``, in order of travel."""
        count = count_intervals(self.length, spacing)
        return _embed_axis_points(np.linspace(0.0, self.length, count + 1), self.dim), _chain_segments(count)

    def scale_by(self, factor: float) -> Segment:
        """Return the segment ``factor`` times as long."""
        return replace(self, length=factor * self.length)


@dataclass(frozen=True)
class Circle:
    """Around the origin in the plane of the first two axes; ``local`` is the angle from the first."""

    dim: int
    radius: float
    manifold_dim: int = 1

    def feet(self, q: Floats) -> Feet:
        """Return closest points of ``q`` (n, d), with angles in [-pi, pi] as ``local``; from the axis, angle 0."""
        direction = normalize_or_default(q[:, :2], (1.0, 0.0))
        angle = np.arctan2(direction[:, 1], direction[:, 0])
        return Feet(_embed_plane_points(self.radius * direction, self.dim), no_edge_entries(q), angle[:, None])

    def support(self, u: Floats) -> Floats:
        """Return (n,) the largest u . p over the curve for each of ``u`` (n, d): on a circle, at the foot of u."""
        reach: Floats = np.einsum("nd,nd->n", u, self.feet(u).points)
        return reach

    def tangents(self, p: Floats) -> Floats:
        """Return the counterclockwise unit tangents (n, d) at points ``p`` (n, d)."""
        outward = normalize_or_default(p[:, :2], (1.0, 0.0))
        return _embed_plane_points(np.stack([-outward[:, 1], outward[:, 0]], axis=1), self.dim)

    def normals(self, p: Floats) -> Floats:
        """Return the outward unit normals (n, 2) at points ``p`` (n, 2) of a circle in the plane."""
        return _right_normals(self.tangents(p))

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices (v, d) and segments (m, 2) of a regular polygon, up to ``spacing`` long, counterclockwise."""
        count = count_intervals(FULL_TURN * self.radius, spacing, least=3)
        return self._angle_points(FULL_TURN * np.arange(count) / count), _chain_segments(count) % count

    def scale_by(self, factor: float) -> Circle:
        """Return the circle ``factor`` times as large."""
        return replace(self, radius=factor * self.radius)

    def _angle_points(self, angle: Floats) -> Floats:
        return _embed_plane_points(self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), self.dim)


@dataclass(frozen=True)
class Arc(Circle):
    """The part of a circle from the angle ``start`` counterclockwise over ``sweep``, in radians."""

    start: float = 0.0
    sweep: float = np.pi

    def feet(self, q: Floats) -> Feet:
        """Return closest points of ``q`` (n, d), with ``edge`` 0 or 1 at ends and the angle as ``local`` (n, 1).

        Angles lie in [start, start + sweep]. A query equally near to both ends has the foot at end 1. From the axis
        every point of the arc is equally near: the middle is taken.
        """
        middle = self.start + 0.5 * self.sweep
        direction = normalize_or_default(q[:, :2], (float(np.cos(middle)), float(np.sin(middle))))
        past_start = np.mod(np.arctan2(direction[:, 1], direction[:, 0]) - self.start, FULL_TURN)
        nearer_end = np.where(past_start - self.sweep <= FULL_TURN - past_start, self.sweep, 0.0)
        covered = past_start <= self.sweep
        past_start = np.where(covered, past_start, nearer_end)
        angle = self.start + past_start
        points = np.where(
            covered[:, None], _embed_plane_points(self.radius * direction, self.dim), self._angle_points(angle)
        )
        edge = np.where(past_start <= 0, 0, np.where(past_start >= self.sweep, 1, -1))
        return Feet(points, edge, angle[:, None])

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices (v, d) on the arc and segments (m, 2), at most ``spacing`` long, in order of travel."""
        count = count_intervals(self.radius * self.sweep, spacing)
        return self._angle_points(self.start + np.linspace(0.0, self.sweep, count + 1)), _chain_segments(count)


def _embed_plane_points(points: Floats, dim: int) -> Floats:
    """Return ``points`` (n, 2) as (n, dim), zero in a third coordinate."""
    embedded = np.zeros((len(points), dim))
    embedded[:, :2] = points
    return embedded


def _embed_axis_points(along: Floats, dim: int) -> Floats:
    embedded = np.zeros((len(along), dim))
    embedded[:, 0] = along
    return embedded


def _right_normals(tangents: Floats) -> Floats:
    return np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)


def _chain_segments(count: int) -> Ints:
    start = np.arange(count, dtype=np.int64)
    return np.stack([start, start + 1], axis=1)
