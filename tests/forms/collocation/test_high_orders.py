"""Order 3 makes second order regular; order 4 is of fourth order, inside and at edges, and refused where it is not."""

import numpy as np
import pytest
from arc_problems import EDGES, arc_problem
from model_problems import circle_jump, max_error, on_circle, order_of, origins, rotation, sphere_points
from scipy.spatial import ConvexHull

import cpmkit as ck
from cpmkit.forms.collocation.ghosts.continuation import arc_length, points_inwards, polynomial_weights
from cpmkit.manifold.local_source import localize

SPACINGS = (0.1, 0.05, 0.025, 0.0125)
COARSE = (0.14, 0.1, 0.07)


def closed_circle():
    """-u'' + u = f with u = exp(sin theta)."""
    scene = ck.Scene(
        ck.source("analytic.circle"),
        ck.ScreenedPoisson(lambda x: np.exp(x[:, 1]) * (1 + x[:, 1] - x[:, 0] ** 2), c=1.0),
    )
    t = np.linspace(0, 2 * np.pi, 2000)
    return scene, on_circle(t), np.exp(np.sin(t))


@pytest.mark.parametrize(("degree", "bound"), [(5, 6e-8), (4, 1e-7)])
def test_a_closed_circle(degree, bound):
    errors = [max_error(*closed_circle(), h, degree=degree, order=4) for h in SPACINGS]
    assert errors[-1] <= bound
    assert order_of(SPACINGS, errors) >= 3.8


FOURTH = {"Dirichlet": (4e-7, 3.8), "Neumann": (1e-7, 3.6), "Robin": (1e-7, 3.6), "mixed": (1e-7, 3.6)}


@pytest.mark.parametrize("name", FOURTH)
def test_the_ends_of_an_arc(name):
    bound, least = FOURTH[name]
    errors = [max_error(*arc_problem(EDGES[name][0]), h, degree=5, order=4) for h in SPACINGS]
    assert errors[-1] <= bound
    assert order_of(SPACINGS, errors) >= least


def test_third_order_ghosts_halve_the_error_of_an_arc_with_given_ends():
    problem = arc_problem(EDGES["Dirichlet"][0])
    third = [max_error(*problem, h, order=3) for h in SPACINGS]
    second = [max_error(*problem, h, form="collocation") for h in SPACINGS]
    assert order_of(SPACINGS, third) >= 1.9
    assert np.all(np.array(third) <= 0.5 * np.array(second))


def test_third_order_ghosts_are_regular_on_single_grids():
    """Halving the spacing divides the error by four, wherever the nodes lie; at order 2 by 3 to 6."""
    spacings = (0.04, 0.02, 0.01)
    for origin in origins(2)[:2]:
        errors = [max_error(*circle_jump(), h, order=3, origin=origin * h) for h in spacings]
        orders = -np.diff(np.log2(errors))
        assert np.all((orders > 1.85) & (orders < 2.15)), orders


def test_a_jump_at_fourth_order():
    """The sides do not mix, right-hand sides that jump included."""
    errors = [max_error(*circle_jump(), h, degree=5, order=4) for h in SPACINGS]
    assert errors[-1] <= 1.5e-7
    assert order_of(SPACINGS, errors) >= 3.7


def u(x):
    return np.exp(x[:, 2]) + x[:, 0] * x[:, 1]


def f(x):
    z = x[:, 2]
    return u(x) - np.exp(z) * (1 - z * z - 2 * z) + 6 * x[:, 0] * x[:, 1]


def on_sphere(boundaries=()):
    points = sphere_points()
    return ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(f, c=1.0), boundaries), points, u(points)


def tilted(height=0.2):
    axis = rotation()[:, 2]
    return ck.source("analytic.circle", center=height * axis, radius=np.sqrt(1 - height**2), normal=axis), axis


def towards(axis):
    def left(x):
        v = axis - np.sum(axis * x, axis=1)[:, None] * x
        return v / np.linalg.norm(v, axis=1)[:, None]

    return left


def slope(x, direction):
    gradient = np.stack([x[:, 1], x[:, 0], np.exp(x[:, 2])], axis=1)
    return np.sum(gradient * direction, axis=1)


@pytest.mark.slow  # always: the same sphere with fluxes through a circle
def test_a_closed_sphere():
    errors = [max_error(*on_sphere(), h, degree=4, order=4) for h in COARSE]
    assert errors[-1] <= 5e-5
    assert order_of(COARSE, errors) >= 3.7


@pytest.mark.slow  # always: the ends of an arc, a jump, and fluxes on a sphere
def test_a_circle_on_the_sphere():
    circle, _ = tilted(-0.27)
    problem = on_sphere([ck.Boundary("circle", circle, both=ck.Dirichlet(u))])
    errors = [max_error(*problem, h, degree=4, order=4) for h in COARSE]
    assert errors[-1] <= 9e-5
    assert order_of(COARSE, errors) >= 3.6


@pytest.mark.slow
def test_fluxes_on_both_sides_of_a_circle_on_the_sphere():
    circle, axis = tilted()
    left = towards(axis)
    fluxes = {
        "left": ck.Neumann(lambda x: -slope(x, left(x))),
        "right": ck.Robin(1.0, 2.0, lambda x: slope(x, left(x)) + 2 * u(x)),
    }
    problem = on_sphere([ck.Boundary("circle", circle, left_of=axis, **fluxes)])
    errors = [max_error(*problem, h, degree=4, order=4) for h in COARSE]
    assert errors[-1] <= 1.5e-4
    assert order_of(COARSE, errors) >= 3.5


def test_the_rim_of_a_hemisphere():
    """u = x z + y, its flux through the rim given: -x."""
    scene = ck.Scene(
        ck.source("analytic.cap", height=0.0),
        ck.ScreenedPoisson(lambda x: 7 * x[:, 0] * x[:, 2] + 3 * x[:, 1], c=1.0),
        edge=ck.Neumann(lambda x: -x[:, 0]),
    )
    points = sphere_points(3000)
    points = points[points[:, 2] >= 0]
    exact = points[:, 0] * points[:, 2] + points[:, 1]
    errors = [max_error(scene, points, exact, h, degree=4, order=4, solver="reference") for h in COARSE]
    assert errors[-1] <= 1e-4
    assert order_of(COARSE, errors) >= 3.6


@pytest.mark.parametrize(("alpha", "beta"), [(0.0, 1.0), (1.0, 0.0), (2.0, 3.0)])
def test_the_polynomial_is_exact_for_its_degree(alpha, beta):
    rng = np.random.default_rng(4)
    c = rng.normal(size=4)
    positions = np.sort(rng.uniform(0.5, 4, (6, 3)), axis=1)
    at = rng.uniform(0, 3, 6)
    weights, factor = polynomial_weights(alpha, np.full(6, beta), positions, at, 0.7)
    read = np.sum(weights * np.polynomial.polynomial.polyval(-positions, c), axis=1)
    exact = np.polynomial.polynomial.polyval(at, c)
    np.testing.assert_allclose(read + factor * (alpha * c[1] + beta * c[0]), exact, rtol=1e-9)


def test_arc_lengths_are_those_of_the_circle():
    circle = localize(ck.source("analytic.circle", radius=2.0), np.zeros(2))
    inside = points_inwards(circle, np.array([[2.0, 0.0]]), np.array([[0.0, 1.0]]), 3, 0.3)
    angles = np.arctan2(inside.points[0, :, 1], inside.points[0, :, 0])
    np.testing.assert_allclose(inside.positions[0], 2 * angles, rtol=1e-12)
    np.testing.assert_allclose(inside.curvature[0], [-0.5, 0.0], atol=1e-12)
    assert arc_length(np.array([0.3]), np.array([0.0]))[0] == 0.3


def test_points_that_meet_an_edge_are_not_sound():
    arc = localize(ck.source("analytic.arc", start=0.0, end=0.3), np.zeros(2))
    inside = points_inwards(arc, np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]]), 3, 0.15)
    assert not inside.sound[0]


def test_two_cuts_too_near_for_cubics_fall_back():
    """Between them ghosts of lower order are used; elsewhere the order is kept."""
    h, gap = 0.025, 5.0

    def errors(spacing):
        scene, points, exact = circle_jump()
        theta = 1.022 * np.pi + gap * h
        second = ck.Boundary(
            "second",
            ck.source("analytic.point", at=on_circle(np.array([theta]))[0]),
            both=ck.Dirichlet(2 * np.cos(gap * h) + 10 / np.pi * gap * h),
        )
        cut = ck.Scene(scene.surface, scene.problem, [*scene.boundaries, second])
        return np.abs(ck.solve(cut, spacing, degree=5, order=4).evaluate(points) - exact)

    assert errors(h).max() <= 3e-3
    assert errors(h / 4).max() <= 1e-6


def test_fourth_order_needs_room():
    """The Dziuk surface bends with a radius of 0.096; the tube of fourth order is wider than that."""
    scene = ck.Scene(ck.source("levelset.dziuk"), ck.ScreenedPoisson(1.0))
    with pytest.raises(ck.ResolutionError, match=r"narrower than the manifold's radius of curvature: at spacing=0\.1"):
        ck.solve(scene, 0.1, degree=4, order=4)


def test_fourth_order_needs_an_exact_source():
    vertices = sphere_points(200)
    mesh = ck.source("mesh.triangles", vertices=vertices, faces=ConvexHull(vertices).simplices)
    with pytest.raises(ck.ResolutionError, match="order=4 needs a source whose closest points are exact"):
        ck.solve(ck.Scene(mesh, ck.ScreenedPoisson(1.0)), 0.2, degree=4, order=4)
