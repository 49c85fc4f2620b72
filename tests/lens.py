"""The surface of a lens, two caps of unit spheres that meet at an angle, known by its closest points alone."""

from dataclasses import dataclass

import numpy as np

import cpmkit as ck


@dataclass(frozen=True)
class Lens:
    """Caps of two unit spheres about the points (0, 0, -c) and (0, 0, c); they meet in a circle."""

    c: float = 0.6
    dim = 3
    manifold_dim = 2
    exact = True

    @property
    def radius(self):
        """The radius of the circle."""
        return np.sqrt(1 - self.c**2)

    @property
    def bounds(self):
        r = self.radius
        return np.array([[-r, -r, self.c - 1], [r, r, 1 - self.c]])

    def closest_point(self, x):
        feet, distances = [], []
        for side in (1, -1):
            centre = np.array([0, 0, -side * self.c])
            out = x - centre
            foot = centre + out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-300)
            feet.append(foot)
            distances.append(np.where(side * foot[:, 2] >= 0, np.linalg.norm(x - foot, axis=1), np.inf))
        r = np.maximum(np.hypot(x[:, 0], x[:, 1]), 1e-300)
        circle = np.stack([self.radius * x[:, 0] / r, self.radius * x[:, 1] / r, np.zeros(len(x))], axis=1)
        feet, distances = np.stack([*feet, circle]), np.stack([*distances, np.linalg.norm(x - circle, axis=1)])
        best = distances.argmin(axis=0)
        return ck.ClosestPoints(feet[best, np.arange(len(x))], distances.min(axis=0), np.full(len(x), -1))

    def load(self, x):
        """Return f of -Lap u + u = f for u = z: odd, zero on the circle, with fluxes that balance there."""
        return 3 * x[:, 2] + 2 * self.c * np.sign(x[:, 2])
