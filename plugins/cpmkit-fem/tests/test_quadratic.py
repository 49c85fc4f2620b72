"""Elements of degree 2 on cells that follow the surface: third order of values, fourth of eigenvalues."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from model_problems import order_of, sphere_points
from sphere_zones import SPHERE, coupled, errors

import cpmkit as ck
from cpmkit.cli import main

SPACINGS = (0.4, 0.2, 0.1)
POINTS = sphere_points(800)


def solve(scene, spacing, degree=2):
    return ck.solve(scene, spacing, backend="fem", degree=degree)


def errors_of(scene, points, exact, spacings=SPACINGS):
    return [np.abs(solve(scene, h).evaluate(points) - exact).max() for h in spacings]


def test_the_sphere_is_of_third_order_and_far_better_than_linear_at_equal_unknowns():
    scene, exact = ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: 13 * np.prod(x, axis=1))), np.prod(POINTS, axis=1)
    found = errors_of(scene, POINTS, exact)
    assert order_of(SPACINGS, found) > 2.7
    linear = solve(scene, 0.1, degree=1)
    assert len(solve(scene, 0.2).values) < 1.1 * len(linear.values)
    assert found[1] < 0.15 * np.abs(linear.evaluate(POINTS) - exact).max()


def test_the_torus_is_of_third_order():
    """u = sin(phi) cos(theta) with Beltrami's operator on a torus of radii 2 and 1."""
    torus = ck.source("analytic.torus", major=2.0, minor=1.0)

    def angles(x):
        rho = np.hypot(x[:, 0], x[:, 1])
        return np.arctan2(x[:, 1], x[:, 0]), np.arctan2(x[:, 2], rho - 2)

    def value(x):
        phi, theta = angles(x)
        return np.sin(phi) * np.cos(theta)

    def f(x):
        phi, theta = angles(x)
        rho = 2 + np.cos(theta)
        return value(x) * (1 + 1 / rho**2) + np.sin(phi) * (np.cos(theta) * rho - np.sin(theta) ** 2) / rho

    rng = np.random.default_rng(2)
    phi, theta = rng.uniform(0, 2 * np.pi, (2, 500))
    rho = 2 + np.cos(theta)
    points = np.stack([rho * np.cos(phi), rho * np.sin(phi), np.sin(theta)], axis=1)
    found = errors_of(ck.Scene(torus, ck.ScreenedPoisson(f)), points, value(points), (0.5, 0.35, 0.25))
    assert order_of((0.5, 0.35, 0.25), found) > 2.7
    assert found[-1] < 1e-3


def test_eigenvalues_of_the_sphere_are_of_fourth_order():
    spacings, wanted = (0.6, 0.4, 0.2), [0, 2, 2, 2, 6, 6, 6, 6, 6]
    found = [np.abs(solve(ck.Scene(SPHERE, ck.Eigen(count=9)), h).eigenvalues - wanted).max() for h in spacings]
    assert order_of(spacings, found) > 3.7
    assert found[-1] < 4e-4


@pytest.mark.parametrize("kind", ["dirichlet", "neumann", "robin"])
def test_a_rim_is_followed(kind):
    """u = z on a spherical cap, where du/db = -sin of the polar angle."""
    cap, out = ck.source("analytic.cap", height=0.3), -np.sqrt(1 - 0.09)
    edge = {
        "dirichlet": ck.Dirichlet(lambda x: x[:, 2]),
        "neumann": ck.Neumann(out),
        "robin": ck.Robin(1.0, 2.0, out + 0.6),
    }[kind]
    points = POINTS[POINTS[:, 2] > 0.3]
    scene = ck.Scene(cap, ck.ScreenedPoisson(lambda x: 3 * x[:, 2]), edge=edge)
    found = errors_of(scene, points, points[:, 2])
    assert order_of(SPACINGS, found) > 2.9
    assert found[-1] < 1e-5


def test_a_curve_that_ends_on_the_rim():
    """u = xz and -3xz on the two sides of the great circle x = 0, on a cap."""
    half = np.arccos(0.3)
    arc = ck.source("analytic.arc", normal=[1, 0, 0], x_axis=[0, 0, 1], start=-half, end=half)

    def value(x):
        return np.where(x[:, 0] > 0, 1.0, -3.0) * x[:, 0] * x[:, 2]

    scene = ck.Scene(
        ck.source("analytic.cap", height=0.3),
        ck.ScreenedPoisson(lambda x: 7 * value(x)),
        [ck.Boundary("arc", arc, both=ck.Dirichlet(0.0))],
        edge=ck.Dirichlet(value),
    )
    points = POINTS[POINTS[:, 2] > 0.3]
    spacings = (0.3, 0.2, 0.1)
    found = errors_of(scene, points, value(points), spacings)
    assert order_of(spacings, found) > 2.6
    assert found[-1] < 2e-4


def test_two_materials_and_a_jump():
    found = [errors(solve(coupled(30.0, 0.0), h), POINTS)[1] for h in (0.2, 0.14, 0.1)]
    assert order_of((0.2, 0.14, 0.1), found) > 2.7
    assert found[-1] < 2e-5


def test_a_plate_keeps_straight_edges_and_quadratic_solutions_are_exact():
    """Laplace with data of a harmonic polynomial, by parts of the edge, and a cut whose sides differ by a constant."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    plate = ck.source("mesh.triangles", vertices=np.hstack([corners, np.zeros((4, 1))]), faces=[[0, 1, 2], [0, 2, 3]])

    def value(x):
        return x[:, 0] ** 2 - x[:, 1] ** 2 + np.where(x[:, 0] > 0.3, 2.0, 0.0)

    seam = ck.source("mesh.polyline", points=[[0.3, 0, 0], [0.3, 1, 0]])
    scene = ck.Scene(
        plate,
        ck.Laplace(),
        [ck.Boundary("seam", seam, left=ck.Dirichlet(lambda x: 0.09 - x[:, 1] ** 2), right=ck.Neumann(-0.6))],
        edge=[
            (ck.Neumann(0.0), "x < 0.001"),
            (ck.Dirichlet(value), "x > 0.999"),
            (ck.Neumann(-2.0), "y > 0.999"),
            (ck.Neumann(0.0), "y < 0.001"),
        ],
    )
    solution = ck.solve(scene, backend="fem", degree=2)
    points = np.random.default_rng(0).uniform(0, 1, (200, 2))
    points = np.hstack([points, np.zeros((200, 1))])
    np.testing.assert_allclose(solution.evaluate(points), value(points), atol=1e-9)


def test_heat_decays_as_its_mode():
    heat = ck.Heat(lambda x: x[:, 0] * x[:, 1], until=0.1, step=0.001)
    solution = solve(ck.Scene(SPHERE, heat), 0.3)
    exact = np.exp(-0.6) * POINTS[:, 0] * POINTS[:, 1]
    assert np.abs(solution.evaluate(POINTS) - exact).max() < 1e-3


def test_coefficients_and_fluxes_vary_over_cells():
    """u = z, a = 1 + z^2 / 2: -div(a grad u) = 2 z a - (1 - z^2) z."""
    f = lambda x: 2 * x[:, 2] * (1 + x[:, 2] ** 2 / 2) - (1 - x[:, 2] ** 2) * x[:, 2] + x[:, 2]  # noqa: E731
    scene = ck.Scene(SPHERE, ck.Elliptic(f, lambda x: 1 + x[:, 2] ** 2 / 2, c=1.0))
    found = errors_of(scene, POINTS, POINTS[:, 2])
    assert order_of(SPACINGS, found) > 2.9


def test_what_it_shows_and_saves(tmp_path):
    solution = solve(ck.Scene(SPHERE, ck.ScreenedPoisson("3*z")), 0.4)
    form, mesh = solution.discretized, solution.display_mesh()
    assert mesh.triangles.shape == (4 * solution.work.faces, 3)
    assert len(mesh.points) == solution.work.vertices == len(solution.values)
    assert solution.summary()["discretization"]["degree"] == 2
    np.testing.assert_allclose(solution.evaluate(form.vertices), solution.values[:, 0], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(form.vertices, axis=1), 1.0, rtol=1e-12)
    assert solution.integrate() == pytest.approx(0.0, abs=1e-6)
    solution.save(tmp_path / "solution.npz")
    np.testing.assert_array_equal(ck.load(tmp_path / "solution.npz").values, solution.values)


def test_the_command_and_the_file_name_the_degree(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (
        '[surface]\nkind = "analytic.sphere"\n[problem]\nkind = "screened"\nf = 1.0\n[discretization]\nspacing = 0.4\n'
    )
    (tmp_path / "plain.toml").write_text(text)
    (tmp_path / "quadratic.toml").write_text(text + "degree = 2\n")

    def degree(*arguments):
        done = CliRunner().invoke(main, ["solve", *arguments, "--backend", "fem", "--json"])
        return json.loads(done.stdout)["discretization"]["degree"]

    assert degree("plain.toml") == 1
    assert degree("quadratic.toml") == degree("plain.toml", "--degree", "2") == 2
    assert degree("quadratic.toml", "--degree", "1") == 1


def test_what_it_does_not_take():
    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(1.0))
    for degree in (0, 3):
        with pytest.raises(ck.InputError, match="has elements of degree 1 and 2, got"):
            solve(scene, 0.4, degree)
    with pytest.raises(ck.InputError, match="a lumped mass is one of degree 1"):
        solve(ck.Scene(SPHERE, ck.ScreenedPoisson(1.0, lumped=True)), 0.4)
    with pytest.raises(ck.SceneError, match="'fem-pinned' has the unknown key 'degree'"):
        ck.solve(scene, 0.4, backend="fem-pinned", degree=2)
