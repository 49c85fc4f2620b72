"""A point, a segment, a circle and an arc in canonical position, in the plane or in space."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.plugin import Floats, Ints
from cpmkit_analytic.directions import normalize_or_default
from cpmkit_analytic.revolution import intervals
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
        """Return zero: a point has no extent."""
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
        """Return the closest points of ``q`` (n, d): the first coordinate, cut to the segment; edge 0 or 1 at ends."""
        along = np.clip(q[:, 0], 0.0, self.length)
        edge = np.where(along <= 0, 0, np.where(along >= self.length, 1, -1))
        return Feet(_on_first_axis(along, self.dim), edge, along[:, None] / self.length)

    def support(self, u: Floats) -> Floats:
        """Return (n,) the largest u . p over the segment for each of ``u`` (n, d)."""
        return np.maximum(0.0, self.length * u[:, 0])

    def tangents(self, p: Floats) -> Floats:
        """Return the first axis."""
        return _on_first_axis(np.ones(len(p)), self.dim)

    def normals(self, p: Floats) -> Floats:
        """Return the normal on the right hand of travel, as on a counterclockwise circle."""
        return _right_hand(self.tangents(p))

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices and segments (m, 2) of equal parts, at most ``spacing`` long."""
        count = intervals(self.length, spacing)
        return _on_first_axis(np.linspace(0.0, self.length, count + 1), self.dim), _chain(count)

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
        """Return the direction from the centre, scaled to the radius; from the axis, the angle 0."""
        direction = normalize_or_default(q[:, :2], (1.0, 0.0))
        angle = np.arctan2(direction[:, 1], direction[:, 0])
        return Feet(_embed_plane_points(self.radius * direction, self.dim), no_edge_entries(q), angle[:, None])

    def support(self, u: Floats) -> Floats:
        """Return u . p at the foot of u: on a circle about the origin the nearest reaches farthest."""
        reach: Floats = np.einsum("nd,nd->n", u, self.feet(u).points)
        return reach

    def tangents(self, p: Floats) -> Floats:
        """Return the counterclockwise direction."""
        outward = normalize_or_default(p[:, :2], (1.0, 0.0))
        return _embed_plane_points(np.stack([-outward[:, 1], outward[:, 0]], axis=1), self.dim)

    def normals(self, p: Floats) -> Floats:
        """Return the outward normal in the plane."""
        return _right_hand(self.tangents(p))

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices and segments (m, 2) of a regular polygon with sides of at most ``spacing``."""
        count = intervals(FULL_TURN * self.radius, spacing, least=3)
        return self._at(FULL_TURN * np.arange(count) / count), _chain(count) % count

    def scale_by(self, factor: float) -> Circle:
        """Return the circle ``factor`` times as large."""
        return replace(self, radius=factor * self.radius)

    def _at(self, angle: Floats) -> Floats:
        return _embed_plane_points(self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), self.dim)


@dataclass(frozen=True)
class Arc(Circle):
    """The part of a circle from the angle ``start`` counterclockwise over ``sweep``, in radians."""

    start: float = 0.0
    sweep: float = np.pi

    def feet(self, q: Floats) -> Feet:
        """Return the foot on the circle or, beyond the ends, the end at the smaller angle.

        From the axis every point of the arc is equally near: the middle is taken.
        """
        middle = self.start + 0.5 * self.sweep
        direction = normalize_or_default(q[:, :2], (float(np.cos(middle)), float(np.sin(middle))))
        past_start = np.mod(np.arctan2(direction[:, 1], direction[:, 0]) - self.start, FULL_TURN)
        nearer_end = np.where(past_start - self.sweep <= FULL_TURN - past_start, self.sweep, 0.0)
        covered = past_start <= self.sweep
        past_start = np.where(covered, past_start, nearer_end)
        angle = self.start + past_start
        points = np.where(covered[:, None], _embed_plane_points(self.radius * direction, self.dim), self._at(angle))
        edge = np.where(past_start <= 0, 0, np.where(past_start >= self.sweep, 1, -1))
        return Feet(points, edge, angle[:, None])

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices and segments (m, 2) between equal parts of the arc, at most ``spacing`` long."""
        count = intervals(self.radius * self.sweep, spacing)
        return self._at(self.start + np.linspace(0.0, self.sweep, count + 1)), _chain(count)


def _embed_plane_points(points: Floats, dim: int) -> Floats:
    """Return (n, 2) as (n, dim), zero in the third coordinate."""
    embedded = np.zeros((len(points), dim))
    embedded[:, :2] = points
    return embedded


def _on_first_axis(along: Floats, dim: int) -> Floats:
    embedded = np.zeros((len(along), dim))
    embedded[:, 0] = along
    return embedded


def _right_hand(tangents: Floats) -> Floats:
    return np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)


def _chain(count: int) -> Ints:
    start = np.arange(count, dtype=np.int64)
    return np.stack([start, start + 1], axis=1)
