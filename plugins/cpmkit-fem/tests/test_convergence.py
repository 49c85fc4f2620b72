"""Finite elements are of second order, beside curves that cross triangles too, and meet the other method."""

import numpy as np
import pytest
from model_problems import order_of, rotation, sphere_points, sphere_poisson

import cpmkit as ck

POINTS = sphere_points(1000)
HEIGHT = 0.3


def worst(scene, exact, points, spacings):
    return [np.abs(ck.solve(scene, h, backend="fem").evaluate(points) - exact).max() for h in spacings]


def test_second_order_on_meshes_of_the_sphere(octahedron):
    errors, spacings = [], []
    for times in (3, 4, 5):
        vertices, faces = octahedron(times)
        surface = ck.source("mesh.triangles", vertices=vertices, faces=faces)
        solution = ck.solve(ck.Scene(surface, ck.ScreenedPoisson(lambda x: 3 * x[:, 2])), backend="fem")
        np.testing.assert_array_equal(solution.discretized.vertices, vertices)
        errors.append(np.sqrt(np.mean((solution.evaluate(POINTS) - POINTS[:, 2]) ** 2)))
        spacings.append(solution.spacing)
    assert 1.85 < order_of(spacings, errors) < 2.2
    assert errors[-1] < 1e-3


def test_second_order_where_the_curve_runs_through_vertices(octahedron):
    errors = []
    scene, points, exact = sphere_poisson([[0, 0, 1]])
    for times in (3, 4, 5):
        vertices, faces = octahedron(times)
        surface = ck.source("mesh.triangles", vertices=vertices, faces=faces)
        solution = ck.solve(ck.Scene(surface, scene.problem, scene.boundaries), backend="fem")
        on = np.abs(solution.discretized.vertices[:, 2]) < 1e-14
        pinned = len(solution.discretized.vertices) - solution.work.unknowns
        assert pinned == on.sum() >= 2 * 4 * 2**times  # on either side a vertex of its own
        assert solution.warnings == ()
        errors.append(np.abs(solution.evaluate(points) - exact).max())
    assert 1.7 < order_of([4, 2, 1], errors) < 2.2


def test_second_order_where_the_curve_crosses_triangles():
    scene, points, exact = sphere_poisson([rotation()[0]])
    spacings = [0.2, 0.1, 0.05]
    assert 1.6 < order_of(spacings, worst(scene, exact, points, spacings)) < 2.4
    solution = ck.solve(scene, 0.1, backend="fem")
    pinned = len(solution.discretized.vertices) - solution.work.unknowns
    assert 2 < pinned / (2 * np.pi / solution.spacing) < 8  # two chains of vertices, one a side, not a strip


def test_a_curve_leaves_no_gap():
    circle = ck.source("analytic.circle", normal=rotation()[0], center=0.2 * rotation()[0], radius=np.sqrt(0.96))
    wall = ck.Boundary("wall", circle, both=ck.Dirichlet(0.0))
    source = ck.Boundary("source", ck.source("analytic.point", at=rotation()[0]), both=ck.Dirichlet(1.0))
    solution = ck.solve(ck.Scene(ck.source("analytic.sphere"), ck.Laplace(), [wall, source]), 0.1, backend="fem")
    height = solution.discretized.vertices @ rotation()[0]
    assert np.abs(solution.values[height < 0.1]).max() < 1e-12
    assert solution.values[height > 0.9].min() > 0.1


def test_the_two_methods_approach_each_other():
    scene = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(lambda x: np.exp(x[:, 0] - x[:, 2])))
    spacings = [0.2, 0.1, 0.05]
    apart = [
        np.abs(ck.solve(scene, h).evaluate(POINTS) - ck.solve(scene, h, backend="fem").evaluate(POINTS)).max()
        for h in spacings
    ]
    assert 1.8 < order_of(spacings, apart) < 2.3
    assert apart[-1] < 3e-3


@pytest.mark.parametrize("edge", [ck.Neumann(-np.sqrt(1 - HEIGHT**2)), ck.Dirichlet(lambda x: x[:, 2])])
def test_second_order_at_an_edge(edge):
    cap = ck.source("analytic.cap", height=HEIGHT)
    points = POINTS[POINTS[:, 2] > HEIGHT]
    scene = ck.Scene(cap, ck.ScreenedPoisson(lambda x: 3 * x[:, 2]), edge=edge)
    spacings = [0.2, 0.1, 0.05]
    errors = worst(scene, points[:, 2], points, spacings)
    assert 1.7 < order_of(spacings, errors) < 2.4


def test_a_condition_for_each_loop():
    cylinder = ck.source("analytic.cylinder", radius=0.5, length=2.0)
    edge = {0: ck.Dirichlet([-1.0, 4.0]), 1: ck.Neumann([1.0, 0.0])}
    solution = ck.solve(ck.Scene(cylinder, ck.Laplace(), edge=edge), 0.2, backend="fem")
    np.testing.assert_allclose(solution.values[:, 0], solution.discretized.vertices[:, 2], atol=1e-12)
    np.testing.assert_allclose(solution.values[:, 1], 4.0, rtol=1e-12)


def test_channels_are_solved_together():
    data = [lambda x: x[:, 0], 2.0, lambda x: x[:, 1] * x[:, 2]]
    circle = ck.source("analytic.circle", normal=[0, 0, 1])
    sphere = ck.source("analytic.sphere")

    def solved(one):
        return ck.solve(ck.Scene(sphere, ck.Poisson(1.0), [ck.Boundary("c", circle, both=one)]), 0.2, backend="fem")

    together = solved(ck.Dirichlet(data))
    assert together.channels == 3
    assert together.evaluate(POINTS).shape == (1000, 3)
    for k, one in enumerate(data):
        np.testing.assert_allclose(
            together.evaluate(POINTS)[:, k], solved(ck.Dirichlet(one)).evaluate(POINTS), atol=1e-12
        )


@pytest.mark.parametrize(("scale", "offset"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e6)])
def test_size_and_place_change_nothing(octahedron, scale, offset):
    vertices, faces = octahedron(3)

    def solved(scale, offset):
        surface = ck.source("mesh.triangles", vertices=scale * vertices + offset, faces=faces)
        problem = ck.ScreenedPoisson(lambda x: (x[:, 2] - offset) / scale**3, c=1 / scale**2)
        pin = ck.Boundary("pin", ck.source("analytic.point", at=scale * vertices[9] + offset), both=ck.Dirichlet(0.5))
        return ck.solve(ck.Scene(surface, problem, [pin]), backend="fem").values

    np.testing.assert_allclose(solved(scale, offset), solved(1.0, 0.0), atol=1e-8)
