"""A sphere, a cap, a torus and a cylinder in canonical position: surfaces of revolution about z.

None answers ``local`` coordinates: two inverse tangents a query would cost more than the foot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.plugin import Floats, Ints
from cpmkit_analytic.directions import normalize_or_default
from cpmkit_analytic.revolution import count_intervals, revolve_profile
from cpmkit_analytic.shapes import Feet, no_edge_entries

NORTH = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Sphere:
    """Around the origin."""

    radius: float
    dim: int = 3
    manifold_dim: int = 2

    def feet(self, q: Floats) -> Feet:
        """Return the closest points of ``q`` (n, 3); that of the centre is the north pole."""
        return Feet(self.radius * normalize_or_default(q, NORTH), no_edge_entries(q))

    def support(self, u: Floats) -> Floats:
        """Return (n,) the largest u . p over the surface for each of ``u`` (n, 3): on a sphere, at the foot of u."""
        reach: Floats = np.einsum("nd,nd->n", u, self.feet(u).points)
        return reach

    def normals(self, p: Floats) -> Floats:
        """Return the outward unit normals (n, 3) at points ``p`` (n, 3)."""
        return normalize_or_default(p, NORTH)

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices (v, 3), about ``spacing`` apart, and triangles (m, 3), counterclockwise seen from outside."""
        polar = np.linspace(0.0, np.pi, 1 + count_intervals(np.pi * self.radius, spacing, least=2))
        around = self.radius * np.sin(polar)
        around[[0, -1]] = 0.0
        return revolve_profile(around, self.radius * np.cos(polar), spacing)

    def scale_by(self, factor: float) -> Sphere:
        """Return the sphere ``factor`` times as large."""
        return replace(self, radius=factor * self.radius)


@dataclass(frozen=True)
class Cap(Sphere):
    """The part of a sphere with z >= height; its rim is edge loop 0."""

    height: float = 0.0

    @property
    def rim_radius(self) -> float:
        """Radius of the rim."""
        return float(np.sqrt((self.radius - self.height) * (self.radius + self.height)))

    def feet(self, q: Floats) -> Feet:
        """Return closest points of ``q`` (n, 3); below the rim, its point on their meridian, with ``edge`` 0.

        Points on the axis have the meridian of the x axis.
        """
        on_sphere = self.radius * normalize_or_default(q, NORTH)
        rim = np.full_like(q, self.height)
        rim[:, :2] = self.rim_radius * normalize_or_default(q[:, :2], (1.0, 0.0))
        above = on_sphere[:, 2] > self.height
        return Feet(np.where(above[:, None], on_sphere, rim), np.where(above, -1, 0))

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices (v, 3), about ``spacing`` apart, and triangles (m, 3), counterclockwise seen from outside."""
        angle = np.arctan2(self.rim_radius, self.height)
        polar = np.linspace(0.0, angle, 1 + count_intervals(self.radius * angle, spacing, least=2))
        around, up = self.radius * np.sin(polar), self.radius * np.cos(polar)
        around[-1], up[-1] = self.rim_radius, self.height
        return revolve_profile(around, up, spacing)

    def scale_by(self, factor: float) -> Cap:
        """Return the cap ``factor`` times as large."""
        return replace(self, radius=factor * self.radius, height=factor * self.height)


@dataclass(frozen=True)
class Torus:
    """All points at the distance ``minor`` from a core circle of radius ``major`` around z."""

    major: float
    minor: float
    dim: int = 3
    manifold_dim: int = 2

    def feet(self, q: Floats) -> Feet:
        """Return the closest points of ``q`` (n, 3): ``minor`` from the nearest point of the core circle, towards q.

        From the axis the meridian of the x axis is taken, from the core circle the top.
        """
        core = self._core_points(q)
        return Feet(core + self.minor * normalize_or_default(q - core, NORTH), no_edge_entries(q))

    def support(self, u: Floats) -> Floats:
        """Return (n,) the largest u . p over the torus for each of ``u`` (n, 3)."""
        return self.major * np.hypot(u[:, 0], u[:, 1]) + self.minor

    def normals(self, p: Floats) -> Floats:
        """Return the outward unit normals (n, 3) at points ``p`` (n, 3): the directions from the core circle."""
        return normalize_or_default(p - self._core_points(p), NORTH)

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices (v, 3), about ``spacing`` apart, and triangles (m, 3), counterclockwise seen from outside."""
        count = count_intervals(2 * np.pi * self.minor, spacing, least=3)
        angle = 2 * np.pi * np.arange(count) / count
        return revolve_profile(
            self.major + self.minor * np.cos(angle), -self.minor * np.sin(angle), spacing, closed=True
        )

    def scale_by(self, factor: float) -> Torus:
        """Return the torus ``factor`` times as large."""
        return replace(self, major=factor * self.major, minor=factor * self.minor)

    def _core_points(self, q: Floats) -> Floats:
        core = np.zeros_like(q)
        core[:, :2] = self.major * normalize_or_default(q[:, :2], (1.0, 0.0))
        return core


@dataclass(frozen=True)
class Cylinder:
    """The open lateral surface with |z| <= length / 2; edge loop 0 is the lower rim, 1 the upper."""

    radius: float
    length: float
    dim: int = 3
    manifold_dim: int = 2

    def feet(self, q: Floats) -> Feet:
        """Return the closest points of ``q`` (n, 3), with ``edge`` 0 or 1 on the lower or upper rim, and -1 between."""
        half = 0.5 * self.length
        up = np.clip(q[:, 2], -half, half)
        points = self.radius * self.normals(q)
        points[:, 2] = up
        return Feet(points, np.where(up <= -half, 0, np.where(up >= half, 1, -1)))

    def support(self, u: Floats) -> Floats:
        """Return (n,) the largest u . p over the cylinder for each of ``u`` (n, 3)."""
        return self.radius * np.hypot(u[:, 0], u[:, 1]) + 0.5 * self.length * np.abs(u[:, 2])

    def normals(self, p: Floats) -> Floats:
        """Return unit vectors (n, 3) from the axis towards points ``p`` (n, 3); on the axis, the x axis."""
        directions = np.zeros_like(p)
        directions[:, :2] = normalize_or_default(p[:, :2], (1.0, 0.0))
        return directions

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices (v, 3), about ``spacing`` apart, and triangles (m, 3), counterclockwise seen from outside."""
        up = np.linspace(0.5 * self.length, -0.5 * self.length, 1 + count_intervals(self.length, spacing))
        return revolve_profile(np.full_like(up, self.radius), up, spacing)

    def scale_by(self, factor: float) -> Cylinder:
        """Return the cylinder ``factor`` times as large."""
        return replace(self, radius=factor * self.radius, length=factor * self.length)
