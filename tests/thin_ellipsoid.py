"""An ellipsoid with the half axes 1, 1 and c, and a solution on it, both in closed form."""

from dataclasses import dataclass

import numpy as np

import cpmkit as ck
from cpmkit import ClosestPoints


@dataclass(frozen=True)
class Ellipsoid:
    """Closest points by bisection (Eberly 2013, "Distance from a point to an ellipsoid")."""

    c: float
    dim = 3
    manifold_dim = 2
    exact = True

    @property
    def squares(self):
        return np.array([1.0, 1.0, self.c**2])

    @property
    def bounds(self):
        return np.array([[-1, -1, -self.c], [1, 1, self.c]])

    def closest_point(self, x):
        r, z, thin = np.hypot(x[:, 0], x[:, 1]), np.abs(x[:, 2]), self.c**2
        low = np.maximum(self.c * z - thin, r - 1)
        high = np.maximum(np.hypot(r, self.c * z) - thin, low)
        low = np.maximum(low, -thin)
        for _ in range(60):
            middle = 0.5 * (low + high)
            beyond = (r / (middle + 1)) ** 2 + (self.c * z / np.maximum(middle + thin, 1e-300)) ** 2 > 1
            low, high = np.where(beyond, middle, low), np.where(beyond, high, middle)
        points = x * self.squares / np.maximum(high[:, None] + self.squares, 1e-300)
        level = high + thin < 1e-9 * thin  # in the middle plane, above the evolute: one of two feet
        height = self.c * np.sqrt(np.maximum(1 - np.sum(points[:, :2] ** 2, axis=1), 0.0))
        points[level, 2] = np.where(x[level, 2] < 0, -1, 1) * height[level]
        return ClosestPoints(points, np.linalg.norm(x - points, axis=1), np.full(len(x), -1))

    def normals(self, feet):
        n = feet.points / self.squares
        return n / np.linalg.norm(n, axis=1, keepdims=True)


def odd_solution(c, power=7):
    """-Lap u + u = f for u = (z/c)^power (1 + x/2), of opposite signs above and below.

    As z/c grows with the root of the distance from the rim, small powers are not smooth at the scale of a spacing.
    """
    hessian_diagonal = 2 / np.array([1.0, 1.0, c**2])

    def u(x):
        return (x[:, 2] / c) ** power * (1 + x[:, 0] / 2)

    def f(x):
        gradient = x * hessian_diagonal
        size = np.linalg.norm(gradient, axis=1)
        n = gradient / size[:, None]
        bend = (hessian_diagonal.sum() - (n * n) @ hessian_diagonal) / size  # div n
        z, wide = x[:, 2] / c, 1 + x[:, 0] / 2
        u_x, u_z, u_xz = z**power / 2, power * z ** (power - 1) * wide / c, power * z ** (power - 1) / (2 * c)
        u_zz = power * (power - 1) * z ** (power - 2) * wide / c**2
        twice = 2 * n[:, 0] * n[:, 2] * u_xz + n[:, 2] ** 2 * u_zz
        return u(x) - (u_zz - bend * (n[:, 0] * u_x + n[:, 2] * u_z) - twice)

    return ck.Scene(Ellipsoid(c), ck.ScreenedPoisson(f, c=1.0)), u
