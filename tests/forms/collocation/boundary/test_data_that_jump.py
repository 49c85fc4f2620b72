"""An f or a diffusivity that jumps across a snapped curve is read on the right side, at no cost in order."""

import numpy as np
import pytest
from model_problems import order_of, sphere_points

import cpmkit as ck

NORMAL = np.array([0.3, 0.5, 0.8]) / np.linalg.norm([0.3, 0.5, 0.8])
HEIGHT = 0.35
RADIUS = np.sqrt(1 - HEIGHT**2)


def sphere_of_triangles(halvings=3):
    """An octahedron's faces, halved so often, on the unit sphere."""
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
    for _ in range(halvings):
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        corners = [(a, a + b, a + c), (b, b + c, a + b), (c, a + c, b + c), (a + b, b + c, a + c)]
        soup = np.concatenate([np.stack(three, axis=1).reshape(-1, 3) for three in corners])
        soup /= np.linalg.norm(soup, axis=1, keepdims=True)
        _, first, number = np.unique(soup.round(9), axis=0, return_index=True, return_inverse=True)
        vertices, faces = soup[first], number.reshape(-1, 3)
    return ck.source("mesh.triangles", vertices=vertices, faces=faces)


def error(surface, spacing, step):
    """Of u = n . y +- step on both sides of a circle with given fluxes; f jumps by ``2 step``."""
    circle = ck.source("analytic.circle", center=HEIGHT * NORMAL, radius=RADIUS, normal=NORMAL)

    def jump(y):
        return np.where(y @ NORMAL > HEIGHT, step, -step)

    cut = ck.Boundary("cut", circle, left=ck.Neumann(-RADIUS), right=ck.Neumann(RADIUS), left_of=NORMAL)
    problem = ck.ScreenedPoisson(lambda y: 3 * (y @ NORMAL) + jump(y), 1.0)
    points = sphere_points()
    points = points[np.abs(points @ NORMAL - HEIGHT) > 0.05]
    found = ck.solve(ck.Scene(surface, problem, [cut]), spacing, form="collocation", solver="reference").evaluate(
        points
    )
    return np.abs(found - points @ NORMAL - jump(points)).max()


def test_on_a_mesh_a_jump_costs_no_more_than_none():
    surface = sphere_of_triangles()
    assert error(surface, 0.2, 3.0) < 1.05 * error(surface, 0.2, 0.0) + 1e-4


def test_smooth_data_keep_second_order():
    spacings = (0.2, 0.1414, 0.1)
    errors = [error(ck.source("analytic.sphere"), h, 0.0) for h in spacings]
    assert order_of(spacings, errors) > 1.7, errors


@pytest.mark.parametrize("shift", [0.0, 0.37])
def test_a_diffusivity_that_jumps_off_the_curve_a_little(shift):
    """A circle of two materials whose formula jumps a hundredth of a spacing beside the cuts."""
    h = 0.05
    cuts = [
        ck.Boundary(name, ck.source("analytic.point", at=[0, y]), left=ck.Neumann(0.0), right=ck.Neumann(0.0))
        for name, y in (("top", 1.0), ("bottom", -1.0))
    ]

    def a(x):
        return np.where(x[:, 0] > 0.01 * h, 4.0, 1.0) * (1 + 0.1 * x[:, 1])

    def f(x):
        return x[:, 1] * (1 + a(x)) - 0.1 * (a(x) / (1 + 0.1 * x[:, 1])) * (1 - x[:, 1] ** 2)

    problem = ck.Elliptic(f, c=1.0, diffusivity=a)
    scene = ck.Scene(ck.source("analytic.circle"), problem, cuts)
    angle = np.linspace(0, 2 * np.pi, 200) + 0.01
    points = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = ck.solve(scene, h, origin=[shift * h, 0.0], form="collocation").evaluate(points)
    assert np.abs(found - points[:, 1]).max() < 3e-3
