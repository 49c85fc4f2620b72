"""Problems with known solutions on surfaces that nothing flows out of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from model_problems import on_circle, origins, sphere_points

import cpmkit as ck

SPHERE = ck.source("analytic.sphere")
CIRCLE = ck.source("analytic.circle")
TORUS = ck.source("analytic.torus", major=1.0, minor=0.4)
SPACINGS = (0.2, 0.14, 0.1)


@dataclass(frozen=True)
class Known:
    """A scene whose solution is known at points."""

    scene: ck.Scene
    points: Any
    values: Any
    spacings: tuple[float, ...] = SPACINGS

    def errors(self, count=1, **options):
        """Rms errors at the spacings, also over ``count`` positions of the lattice; means apart where they are free."""
        found = []
        for h in self.spacings:
            off = []
            for shift in origins(self.points.shape[1])[:count]:
                off.append(ck.solve(self.scene, h, origin=h * shift, **options).evaluate(self.points))
            off = np.array(off).reshape(count, len(self.points), -1) - self.values.reshape(len(self.points), -1)
            if self.scene.problem.kind == "poisson":
                off -= off.mean(axis=1, keepdims=True)
            found.append(np.sqrt(np.mean(off**2)))
        return np.array(found)


def u_sphere(x):
    return np.exp(2 * x[:, 2]) + np.sin(3 * x[:, 0])


def f_sphere(x):
    """-Lap u + u; Lap g(z) = (1 - z^2) g'' - 2 z g' on the unit sphere."""
    p, q = x[:, 2], x[:, 0]
    lap = (4 * (1 - p**2) - 4 * p) * np.exp(2 * p) - 9 * (1 - q**2) * np.sin(3 * q) - 6 * q * np.cos(3 * q)
    return u_sphere(x) - lap


def on_sphere():
    points = sphere_points()
    return Known(ck.Scene(SPHERE, ck.ScreenedPoisson(f_sphere)), points, u_sphere(points))


def on_torus():
    """u = sin a cos 2b at the angles a around the axis and b around the tube."""

    def angles(x):
        return np.arctan2(x[:, 1], x[:, 0]), np.arctan2(x[:, 2], np.hypot(x[:, 0], x[:, 1]) - 1)

    def u(x):
        a, b = angles(x)
        return np.sin(a) * np.cos(2 * b)

    def f(x):
        a, b = angles(x)
        ring = 1 + 0.4 * np.cos(b)
        along = -np.sin(a) * np.cos(2 * b) / ring**2
        around = np.sin(a) * (-4 * np.cos(2 * b) / 0.4**2 + 2 * np.sin(b) * np.sin(2 * b) / (0.4 * ring))
        return u(x) - along - around

    a, b = np.random.default_rng(0).uniform(0, 2 * np.pi, (2, 3000))
    ring = 1 + 0.4 * np.cos(b)
    points = np.stack([ring * np.cos(a), ring * np.sin(a), 0.4 * np.sin(b)], axis=1)
    return Known(ck.Scene(TORUS, ck.ScreenedPoisson(f)), points, u(points), (0.1, 0.07, 0.05))


def on_half_sphere():
    """Between walls: no flux of u = cos(pi z) + x crosses z = 0."""

    def u(x):
        return np.cos(np.pi * x[:, 2]) + x[:, 0]

    def f(x):
        z = x[:, 2]
        curved = (1 - z**2) * np.pi**2 * np.cos(np.pi * z) - 2 * np.pi * z * np.sin(np.pi * z)
        return curved + np.cos(np.pi * z) + 3 * x[:, 0]

    points = sphere_points()
    points = points[points[:, 2] > 0]
    half = ck.source("analytic.cap", height=0.0)
    return Known(ck.Scene(half, ck.ScreenedPoisson(f)), points, u(points))


def on_two_spheres():
    """Twice as much on the second."""
    shift = np.array([3.0, 0, 0])

    def both(function):
        return lambda x: np.where(x[:, 0] < 1.5, function(x), 2 * function(x - shift))

    union = ck.source("union", members=[SPHERE, ck.source("analytic.sphere", center=shift)])
    points = np.concatenate([sphere_points(), sphere_points() + shift])
    return Known(ck.Scene(union, ck.ScreenedPoisson(both(f_sphere))), points, both(u_sphere)(points), (0.2, 0.14, 0.1))


def angle(x):
    return np.arctan2(x[:, 1], x[:, 0])


def u_circle(x):
    return np.sin(4 * angle(x)) + np.exp(x[:, 0])


def on_circle_with_coefficients():
    """a = 2 + x, c = 1 + y^2, two channels of which one is half the other."""

    def f(x):
        t, grown = angle(x), np.exp(x[:, 0])
        first = 4 * np.cos(4 * t) - x[:, 1] * grown
        second = -16 * np.sin(4 * t) + (x[:, 1] ** 2 - x[:, 0]) * grown
        value = -(2 + x[:, 0]) * second + x[:, 1] * first + (1 + x[:, 1] ** 2) * u_circle(x)
        return np.stack([value, value / 2], axis=1)

    problem = ck.Elliptic(f, diffusivity=lambda x: 2 + x[:, 0], c=lambda x: 1 + x[:, 1] ** 2)
    points = on_circle(np.linspace(0, 2 * np.pi, 500, endpoint=False))
    values = np.stack([u_circle(points), u_circle(points) / 2], axis=1)
    return Known(ck.Scene(CIRCLE, problem), points, values, (0.1, 0.05, 0.025))


def on_circle_up_to_a_constant():
    def f(x):
        return 16 * np.sin(4 * angle(x)) + np.exp(x[:, 0]) * (x[:, 0] - x[:, 1] ** 2)

    points = on_circle(np.linspace(0, 2 * np.pi, 500, endpoint=False))
    values = u_circle(points)
    return Known(ck.Scene(CIRCLE, ck.Poisson(f)), points, values - values.mean(), (0.1, 0.05, 0.025))
