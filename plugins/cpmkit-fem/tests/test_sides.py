"""Conditions on the sides of curves that cross triangles: exact solutions, orders, and what points on a curve read.

On a sphere atanh(z) is harmonic away from the poles, so between three parallels u is a + b atanh(z), with an a and a b
of its own on each side of the middle one.
"""

import numpy as np
import pytest
from model_problems import order_of, sphere_points

import cpmkit as ck

LOW, MIDDLE, HIGH = -0.5, 0.2, 0.7
POINTS = sphere_points(1500)
POINTS = POINTS[(POINTS[:, 2] > LOW) & (POINTS[:, 2] < HIGH)]
#: d/db of atanh(z) on the middle parallel, b to the north.
SLOPE = 1 / np.sqrt(1 - MIDDLE**2)


def harmonic(x):
    return np.arctanh(np.clip(x[:, 2], -0.999, 0.999))


def north(x):
    return 1 + 2 * harmonic(x)


def south(x):
    return -1 + 0.5 * harmonic(x)


def exact(points):
    return np.where(points[:, 2] > MIDDLE, north(points), south(points))


def parallel(name, height, **conditions):
    circle = ck.source("analytic.circle", center=[0, 0, height], normal=[0, 0, 1], radius=np.sqrt(1 - height**2))
    return ck.Boundary(name, circle, **conditions)


def condition(kind, u, out):
    """Return the condition of a kind that u keeps, where du/db = ``out``."""
    return {
        "dirichlet": lambda: ck.Dirichlet(u),
        "neumann": lambda: ck.Neumann(out),
        "robin": lambda: ck.Robin(1.0, 3.0, lambda x: out + 3 * u(x)),
        "nonlinear": lambda: ck.NonlinearFlux(lambda v, x: out - v**3 + u(x) ** 3, lambda v, _: -3 * v**2),
    }[kind]()


def scene(surface, left, right):
    middle = parallel(
        "middle", MIDDLE, left=condition(left, north, -2 * SLOPE), right=condition(right, south, 0.5 * SLOPE)
    )
    ends = [parallel("low", LOW, both=ck.Dirichlet(south)), parallel("high", HIGH, both=ck.Dirichlet(north))]
    return ck.Scene(surface, ck.Laplace(), [middle, *ends])


@pytest.mark.parametrize(
    ("left", "right"),
    [("dirichlet", "dirichlet"), ("neumann", "dirichlet"), ("robin", "neumann"), ("dirichlet", "robin")],
)
def test_second_order_with_another_condition_on_each_side(left, right):
    spacings, errors = [0.2, 0.14, 0.1], []
    for spacing in spacings:
        solution = ck.solve(scene(ck.source("analytic.sphere"), left, right), spacing, backend="fem")
        errors.append(np.abs(solution.evaluate(POINTS) - exact(POINTS)).max())
        assert solution.warnings == ()
    assert 1.6 < order_of(spacings, errors) < 2.3
    assert errors[-1] < 6e-3


def test_third_order_with_elements_of_degree_2():
    spacings, errors = [0.2, 0.14, 0.1], []
    for spacing in spacings:
        solution = ck.solve(scene(ck.source("analytic.sphere"), "robin", "neumann"), spacing, backend="fem", degree=2)
        errors.append(np.abs(solution.evaluate(POINTS) - exact(POINTS)).max())
    assert order_of(spacings, errors) > 2.5
    assert errors[-1] < 1.2e-4


def test_a_point_on_a_curve_reads_the_left_unless_the_right_is_requested(octahedron):
    vertices, faces = octahedron(4)
    surface = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    solution = ck.solve(scene(surface, "dirichlet", "neumann"), backend="fem")
    angle, radius = np.linspace(0, 6, 7), np.sqrt(1 - MIDDLE**2)
    on = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(7, MIDDLE)], axis=1)
    np.testing.assert_allclose(solution.evaluate(on), north(on), atol=1e-3)
    np.testing.assert_allclose(solution.evaluate(on, side={"middle": "left"}), north(on), atol=1e-3)
    np.testing.assert_allclose(solution.evaluate(on, side="right"), south(on), atol=0.02)


def test_points_beside_a_curve_read_their_own_side_where_it_bends_away_from_its_chords():
    solution = ck.solve(scene(ck.source("analytic.sphere"), "dirichlet", "dirichlet"), 0.2, backend="fem")
    angle = np.linspace(0, 2 * np.pi, 200)
    for height in (MIDDLE - 1e-3, MIDDLE + 1e-3):
        radius = np.sqrt(1 - height**2)
        beside = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(200, height)], axis=1)
        assert np.abs(solution.evaluate(beside) - exact(beside)).max() < 0.05  # of a jump of 2.3


def test_u_is_continuous_past_the_end_of_a_curve():
    angle = np.linspace(0.3, 1.4, 100)
    slit = ck.source("mesh.polyline", points=np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1))
    sphere = ck.source("analytic.sphere")
    imposed = ck.Boundary("slit", slit, left=ck.Neumann(0.0), right=ck.Neumann(0.0))
    solution = ck.solve(ck.Scene(sphere, ck.ScreenedPoisson(lambda x: 3 * x[:, 2]), [imposed]), 0.1, backend="fem")

    def jump(at):
        one = np.array([[np.cos(at), np.sin(at), 0.01], [np.cos(at), np.sin(at), -0.01]])
        return float(np.ptp(solution.evaluate(one)))

    assert jump(0.85) > 0.3
    assert jump(2.2) < 0.05
    assert jump(-0.5) < 0.05


def test_a_flux_that_depends_on_u():
    solution = ck.solve(scene(ck.source("analytic.sphere"), "nonlinear", "dirichlet"), 0.1, backend="fem")
    assert np.abs(solution.evaluate(POINTS) - exact(POINTS)).max() < 0.01


def test_data_of_the_rim_may_jump_where_a_curve_ends_on_it():
    """u = x on the left of a seam across a plate, x + 2 on its right: what the edge holds jumps at its ends."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    plate = ck.source("mesh.triangles", vertices=corners, faces=[[0, 1, 2], [0, 2, 3]])

    def u(x):
        return x[:, 0] + np.where(x[:, 0] > 0.3, 2.0, 0.0)

    line = ck.source("mesh.polyline", points=[[0.3, 0, 0], [0.3, 1, 0]])
    seam = ck.Boundary("seam", line, left=ck.Neumann(1.0), right=ck.Neumann(-1.0))
    solution = ck.solve(ck.Scene(plate, ck.Laplace(), [seam], edge=ck.Dirichlet(u)), backend="fem")
    points = np.hstack([np.random.default_rng(0).uniform(0, 1, (100, 2)), np.zeros((100, 1))])
    np.testing.assert_allclose(solution.evaluate(points), u(points), atol=1e-5)


def test_a_point_is_a_vertex(octahedron):
    vertices, faces = octahedron(2)
    surface = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    at = 0.6 * vertices[faces[0, 0]] + 0.25 * vertices[faces[0, 1]] + 0.15 * vertices[faces[0, 2]]
    pin = ck.Boundary("pin", ck.source("analytic.point", at=at), both=ck.Dirichlet(2.0))
    solution = ck.solve(ck.Scene(surface, ck.ScreenedPoisson(1.0), [pin]), backend="fem")
    assert solution.evaluate(at[None])[0] == pytest.approx(2.0)
    assert len(solution.discretized.vertices) == len(vertices) + 1
