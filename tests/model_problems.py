"""Problems with known solutions that several tests solve, and how errors are read from them."""

from __future__ import annotations

import numpy as np

import cpmkit as ck

THETA_C = 1.022 * np.pi


def order_of(spacings, errors):
    """Least-squares slope of log(error) over log(spacing)."""
    return np.polyfit(np.log(spacings), np.log(errors), 1)[0]


def origins(dim):
    """The 16 positions of the lattice, in spacings, over which errors are averaged."""
    return np.random.default_rng(1).uniform(0, 1, (16, dim))


def on_circle(theta, radius=1.0, center=(0.0, 0.0)):
    return np.asarray(center) + radius * np.stack([np.cos(theta), np.sin(theta)], axis=1)


def angle_after(theta_c, center):
    """A function of points: the angle s in [0, 2 pi) travelled since the boundary point at ``theta_c``."""

    def s(x):
        v = x - np.asarray(center)
        return np.mod(np.arctan2(v[:, 1], v[:, 0]) - theta_c, 2 * np.pi)

    return s


def circle_jump(radius=1.0, center=(0.0, 0.0), **sides):
    """-u'' = 2 cos s on a circle cut at one point, u = 2 just after it and 22 just before (its left)."""
    s = angle_after(THETA_C, center)
    sides = sides or {"left": ck.Dirichlet(22.0), "right": ck.Dirichlet(2.0)}
    cut = ck.source("analytic.point", at=on_circle(np.array([THETA_C]), radius, center)[0])
    scene = ck.Scene(
        ck.source("analytic.circle", center=center, radius=radius),
        ck.Poisson(lambda x: 2 * np.cos(s(x)) / radius**2),
        [ck.Boundary("cut", cut, **sides)],
    )
    t = np.linspace(1e-6, 2 * np.pi - 1e-6, 2000)
    return scene, on_circle(THETA_C + t, radius, center), 2 * np.cos(t) + 10 / np.pi * t


def sphere_points(n=3000):
    """Fibonacci points of the unit sphere."""
    i = np.arange(n) + 0.5
    z, a = 1 - 2 * i / n, np.pi * (1 + np.sqrt(5)) * i
    return np.stack([np.sqrt(1 - z * z) * np.cos(a), np.sqrt(1 - z * z) * np.sin(a), z], axis=1)


def rotation():
    """The rotation by which curves on the sphere are turned out of the lattice's planes."""
    return np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


def sphere_poisson(normals):
    """-Lap u = f on the unit sphere, u = x y + z, given on great circles with these normals."""

    def u(x):
        return x[:, 0] * x[:, 1] + x[:, 2]

    circles = [ck.source("analytic.circle", center=[0, 0, 0], radius=1.0, normal=n) for n in normals]
    scene = ck.Scene(
        ck.source("analytic.sphere"),
        ck.Poisson(lambda x: 6 * x[:, 0] * x[:, 1] + 2 * x[:, 2]),
        [ck.Boundary(f"circle {k}", circle, both=ck.Dirichlet(u)) for k, circle in enumerate(circles)],
    )
    return scene, sphere_points(), u(sphere_points())


def max_error(scene, points, exact, spacing, **options):
    return float(np.abs(ck.solve(scene, spacing, **options).evaluate(points) - exact).max())


def octahedron(rounds):
    """The unit sphere as an octahedron whose triangles were cut in four so many times."""
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
    for _ in range(rounds):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, number = np.unique(edges, axis=0, return_inverse=True)
        middle = len(vertices) + number.reshape(-1, 3)
        vertices = np.concatenate([vertices, vertices[unique].mean(axis=1)])
        (a, b, c), (ab, bc, ca) = faces.T, middle.T
        corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.stack(part, axis=1) for part in corners])
    return vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces
