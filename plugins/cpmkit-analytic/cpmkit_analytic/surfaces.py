"""A sphere, a cap, a torus and a cylinder in canonical position: surfaces of revolution about z.

None answers ``local`` coordinates: two inverse tangents a query would cost more than the foot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.plugin import Floats, Ints
from cpmkit_analytic.directions import normalize_or_default
from cpmkit_analytic.revolution import intervals, revolve
from cpmkit_analytic.shapes import Feet, no_edge_entries

NORTH = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Sphere:
    """Around the origin."""

    radius: float
    dim: int = 3
    manifold_dim: int = 2

    def feet(self, q: Floats) -> Feet:
        """Return the direction from the centre, scaled to the radius; from the centre, the north pole."""
        return Feet(self.radius * normalize_or_default(q, NORTH), no_edge_entries(q))

    def support(self, u: Floats) -> Floats:
        """Return u . p at the foot of u: about the origin the nearest reaches farthest."""
        reach: Floats = np.einsum("nd,nd->n", u, self.feet(u).points)
        return reach

    def normals(self, p: Floats) -> Floats:
        """Return the direction from the centre."""
        return normalize_or_default(p, NORTH)

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return rings of latitude between the poles."""
        polar = np.linspace(0.0, np.pi, 1 + intervals(np.pi * self.radius, spacing, least=2))
        around = self.radius * np.sin(polar)
        around[[0, -1]] = 0.0
        return revolve(around, self.radius * np.cos(polar), spacing)

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
        """Return the foot on the sphere or, below the rim, the point of the rim on the same meridian."""
        on_sphere = self.radius * normalize_or_default(q, NORTH)
        rim = np.full_like(q, self.height)
        rim[:, :2] = self.rim_radius * normalize_or_default(q[:, :2], (1.0, 0.0))
        above = on_sphere[:, 2] > self.height
        return Feet(np.where(above[:, None], on_sphere, rim), np.where(above, -1, 0))

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return rings of latitude from the pole to the rim."""
        angle = np.arctan2(self.rim_radius, self.height)
        polar = np.linspace(0.0, angle, 1 + intervals(self.radius * angle, spacing, least=2))
        around, up = self.radius * np.sin(polar), self.radius * np.cos(polar)
        around[-1], up[-1] = self.rim_radius, self.height
        return revolve(around, up, spacing)

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
        """Return the nearest point of the core circle, and ``minor`` from it towards the query.

        From the axis the meridian of the first axis is taken, from the core circle the top.
        """
        core = self._core(q)
        return Feet(core + self.minor * normalize_or_default(q - core, NORTH), no_edge_entries(q))

    def support(self, u: Floats) -> Floats:
        """Return (n,) the largest u . p over the torus for each of ``u`` (n, 3)."""
        return self.major * np.hypot(u[:, 0], u[:, 1]) + self.minor

    def normals(self, p: Floats) -> Floats:
        """Return the direction from the core circle."""
        return normalize_or_default(p - self._core(p), NORTH)

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return rings around the axis, down the outside and up the inside."""
        count = intervals(2 * np.pi * self.minor, spacing, least=3)
        angle = 2 * np.pi * np.arange(count) / count
        return revolve(self.major + self.minor * np.cos(angle), -self.minor * np.sin(angle), spacing, closed=True)

    def scale_by(self, factor: float) -> Torus:
        """Return the torus ``factor`` times as large."""
        return replace(self, major=factor * self.major, minor=factor * self.minor)

    def _core(self, q: Floats) -> Floats:
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
        """Return the direction from the axis scaled to the radius, at the query's height cut to the length."""
        half = 0.5 * self.length
        up = np.clip(q[:, 2], -half, half)
        points = self.radius * self.normals(q)
        points[:, 2] = up
        return Feet(points, np.where(up <= -half, 0, np.where(up >= half, 1, -1)))

    def support(self, u: Floats) -> Floats:
        """Return (n,) the largest u . p over the cylinder for each of ``u`` (n, 3)."""
        return self.radius * np.hypot(u[:, 0], u[:, 1]) + 0.5 * self.length * np.abs(u[:, 2])

    def normals(self, p: Floats) -> Floats:
        """Return the direction from the axis."""
        directions = np.zeros_like(p)
        directions[:, :2] = normalize_or_default(p[:, :2], (1.0, 0.0))
        return directions

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return rings from the upper rim to the lower."""
        up = np.linspace(0.5 * self.length, -0.5 * self.length, 1 + intervals(self.length, spacing))
        return revolve(np.full_like(up, self.radius), up, spacing)

    def scale_by(self, factor: float) -> Cylinder:
        """Return the cylinder ``factor`` times as large."""
        return replace(self, radius=factor * self.radius, length=factor * self.length)
