"""Finite elements in solids: linear functions to rounding, second order, and refusals; in space they need TetGen."""

import sys
from importlib.util import find_spec

import numpy as np
import pytest
from cpmkit_fem.location import nearest_cells
from exact_eigenvalues import cube_eigenvalues
from model_problems import order_of
from solid_problems import f, gradient, u

import cpmkit as ck
from cpmkit.plugin import MissingDependencyError

in_space = pytest.mark.skipif(find_spec("tetgen") is None, reason="needs pip install 'cpmkit-fem[solids]'")
SLOPE = np.array([1.0, -2.0, 0.7])
TURN = np.array([[0.8, 0.6], [-0.6, 0.8]])
ELL = np.array([[0, 0], [1, 0], [1, 0.5], [0.5, 0.5], [0.5, 1], [0, 1]]) @ TURN
CIRCLE, SPHERE = ck.source("analytic.circle"), ck.source("analytic.sphere")
DISK, BALL = (ck.source("solid", of=each) for each in (CIRCLE, SPHERE))
CUBE = ck.source("analytic.box", lower=[-0.5] * 3, upper=[0.5] * 3)
SQUARE = ck.source("analytic.box", lower=[-0.5] * 2, upper=[0.5] * 2)
CORNERS, FACES = CUBE.mesh(1.0)
SHAPES = {
    "L": (ck.source("solid", of=ck.source("mesh.polyline", points=ELL, closed=True)), 0.1),
    "square": (SQUARE, 0.15),
    "cube": (CUBE, 0.25),
    "mesh of a cube": (
        ck.source("solid", of=ck.source("mesh.triangles", vertices=CORNERS, faces=FACES, closest="faceted")),
        0.25,
    ),
}
ALL = [pytest.param(name, marks=in_space if "cube" in name else ()) for name in SHAPES]
ROUND = [
    pytest.param(DISK, (0.2, 0.1, 0.05), 1, id="disk"),
    pytest.param(DISK, (0.4, 0.2, 0.1), 2, id="disk of degree 2"),
    pytest.param(BALL, (0.4, 0.28, 0.2), 1, id="ball", marks=in_space),
    pytest.param(BALL, (0.5, 0.35, 0.25), 2, id="ball of degree 2", marks=in_space),
]


def linear(x):
    return x @ SLOPE[: x.shape[1]] + 0.3


def normal_of_ell(x):
    side = np.roll(ELL, -1, axis=0) - ELL
    away = x[:, None] - ELL
    share = np.clip((away * side).sum(axis=2) / (side**2).sum(axis=1), 0, 1)
    nearest = np.linalg.norm(away - share[..., None] * side, axis=2).argmin(axis=1)
    return (side[:, ::-1] * [1, -1] / np.linalg.norm(side, axis=1)[:, None])[nearest]


def normal_of_box(x):
    return np.sign(x) * (np.abs(x) == np.abs(x).max(axis=1, keepdims=True))


def inside(source, count=600):
    points = np.random.default_rng(1).uniform(*np.asarray(source.bounds), (count, source.dim))
    return points[source.closest_point(points).edge < 0]


def solve(source, spacing, problem=None, **options):
    scene = ck.Scene(source, problem or ck.ScreenedPoisson(1.0), edge=options.pop("edge", ck.Neumann(0.0)))
    return ck.solve(scene, spacing, backend="fem", **options)


def conditions(value, flux):
    return [ck.Dirichlet(value), ck.Neumann(flux), ck.Robin(1.0, 2.0, lambda x: flux(x) + 2 * value(x))]


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("name", ALL)
def test_linear_functions_are_exact(name, degree):
    source, spacing = SHAPES[name]
    normal = normal_of_ell if name == "L" else normal_of_box
    points = inside(source)
    kinds = conditions(linear, lambda x: normal(x) @ SLOPE[: x.shape[1]])
    mixed = [(kinds[0], "x < 0.01"), (kinds[1], "y < 0.2"), kinds[2]]
    for edge in (*kinds, mixed):
        solution = solve(source, spacing, ck.ScreenedPoisson(linear), edge=edge, degree=degree)
        assert np.abs(solution.evaluate(points) - linear(points)).max() < 1e-9
        assert 0.6 < solution.spacing / spacing < 1.6


@pytest.mark.parametrize("number", [0, 1, 2])
@pytest.mark.parametrize(("source", "spacings", "degree"), ROUND)
def test_orders_on_disks_and_balls(source, spacings, degree, number):
    edge, points = conditions(u, lambda x: np.sum(gradient(x) * x, axis=1))[number], inside(source)
    found = [
        np.abs(solve(source, h, ck.ScreenedPoisson(f), edge=edge, degree=degree).evaluate(points) - u(points))
        for h in spacings
    ]
    # Largest errors of unstructured meshes scatter: the mean square has the order.
    assert order_of(spacings, [np.sqrt(np.mean(each**2)) for each in found]) > degree + 0.6
    assert found[-1].max() < {1: 0.03, 2: 0.003}[degree]


@in_space
def test_faces_of_a_box_by_number():
    kinds = conditions(linear, lambda x: normal_of_box(x) @ SLOPE)
    solution = solve(CUBE, 0.3, ck.ScreenedPoisson(linear), edge={k: kinds[k % 3] for k in range(6)})
    points = inside(CUBE)
    assert np.abs(solution.evaluate(points) - linear(points)).max() < 1e-9


@in_space
def test_eigenvalues_of_the_cube():
    exact = cube_eigenvalues(8)
    found = [np.abs(solve(CUBE, h, ck.Eigen(8)).eigenvalues[1:] / exact[1:] - 1).max() for h in (0.3, 0.2, 0.14)]
    assert order_of((0.3, 0.2, 0.14), found) > 1.7
    assert found[-1] < 0.08
    assert np.abs(solve(CUBE, 0.3, ck.Eigen(8), degree=2).eigenvalues[1:] / exact[1:] - 1).max() < 0.01


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("source", [pytest.param(SQUARE, id="square"), pytest.param(BALL, id="ball", marks=in_space)])
def test_heat_keeps_its_total(source, degree):
    heat = ck.Heat(lambda x: np.exp(-4 * np.sum((x - 0.3) ** 2, axis=1)), until=0.1, step=0.01, frames=5)
    totals = [frame.integrate() for frame in solve(source, 0.3, heat, degree=degree).frames]
    np.testing.assert_allclose(totals, totals[0], rtol=1e-10)


SHELL = ck.source("solid", of=ck.source("union", members=[SPHERE, ck.source("analytic.sphere", radius=0.5)]))
RING = ck.source("solid", of=ck.source("union", members=[CIRCLE, ck.source("analytic.circle", radius=0.5)]))


@pytest.mark.parametrize(
    ("source", "value"),
    [
        pytest.param(RING, lambda r: np.log(r) / np.log(0.5), id="ring"),
        pytest.param(SHELL, lambda r: 1 / r - 1, id="shell", marks=in_space),
    ],
)
def test_holes_have_conditions_of_their_own(source, value):
    solution = solve(source, 0.12, ck.Laplace(), edge={0: ck.Dirichlet(0.0), 1000: ck.Dirichlet(1.0)})
    points = inside(source)
    assert np.abs(solution.evaluate(points) - value(np.linalg.norm(points, axis=1))).max() < 0.03
    size = {2: np.pi * 0.75, 3: 4 / 3 * np.pi * 0.875}[source.dim]
    assert solution.integrate(1.0) == pytest.approx(size, rel=0.01)


@pytest.mark.parametrize("source", [pytest.param(SQUARE, id="square"), pytest.param(CUBE, id="cube", marks=in_space)])
def test_sides_of_a_gap_have_conditions_of_their_own(source):
    other = ck.source("moved", of=source, translation=[1.02, *[0] * (source.dim - 1)])
    edge = {1000 * m + k: ck.Dirichlet(float(m)) for m in range(2) for k in range(2 * source.dim)}
    solution = solve(ck.source("union", members=[source, other]), 0.5, ck.Laplace(), edge=edge)
    points = inside(source)
    np.testing.assert_allclose(solution.evaluate(points), 0.0, atol=1e-9)
    np.testing.assert_allclose(solution.evaluate(points + [1.02, *[0] * (source.dim - 1)]), 1.0, atol=1e-9)


@in_space
def test_separate_solids_fluxes_of_u_and_pictures():
    pair = ck.source("union", members=[BALL, ck.source("moved", of=BALL, translation=[3, 0, 0])])
    solution = solve(pair, 0.4, edge=ck.NonlinearFlux(lambda u: 1 - u**3, guess=0.5))
    np.testing.assert_allclose(solution.values, 1.0, atol=1e-9)
    assert solution.mean() == pytest.approx(1.0)
    mesh = solution.display_mesh()
    assert mesh.triangles.shape[0] > 100
    middles = mesh.points[mesh.triangles].mean(axis=1)
    middles[middles[:, 0] > 1.5, 0] -= 3
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    assert (np.sum(np.cross(b - a, c - a) * middles, axis=1) > 0).all()
    steklov = solve(BALL, 0.25, ck.Eigen(4), edge=ck.Steklov()).eigenvalues
    np.testing.assert_allclose(steklov, [0, 1, 1, 1], atol=0.02)


def test_the_nearest_point_of_tetrahedra_is_exact():
    vertices = np.concatenate([np.zeros((1, 3)), np.eye(3), [[1.0, 1, 1]]])
    cells = np.array([[0, 1, 2, 3], [4, 1, 2, 3]])
    queries = np.random.default_rng(3).uniform(-1, 2, (200, 3))
    cell, local = nearest_cells(vertices, cells, queries)
    found = np.einsum("nk,nkd->nd", local, vertices[cells[cell]])
    weights = np.random.default_rng(4).dirichlet([0.5] * 4, 40_000)
    samples = np.concatenate([weights @ vertices[each] for each in cells])
    nearest = np.array([np.linalg.norm(samples - x, axis=1).min() for x in queries])
    own = np.linalg.norm(found - queries, axis=1)
    assert local.min() >= 0
    assert (own <= nearest + 1e-12).all()
    assert (own >= nearest - 0.05).all()


def refused(source, message, spacing=0.25, error=ck.SceneError, **options):
    with pytest.raises(error, match=message):
        solve(source, spacing, **options)


def test_what_is_refused_in_the_plane():
    two = ck.source("union", members=[SQUARE, ck.source("moved", of=SQUARE, translation=[1, 0])])
    refused(two, "members 0 and 1 of the union meet near")
    crossed = ck.source("mesh.polyline", points=[[0, 0], [1, 1], [1, 0], [0, 1]], closed=True)
    refused(ck.source("solid", of=crossed), r"meets itself near \(0.5, 0.5\)")
    refused(DISK, "curved more sharply; use spacing=1.5", spacing=3.0, error=ck.ResolutionError)
    line = ck.Boundary("line", ck.source("analytic.circle", radius=0.5), both=ck.Dirichlet(0.0))
    with pytest.raises(ck.SceneError, match="no boundaries inside a solid"):
        ck.solve(ck.Scene(DISK, ck.Laplace(), [line]), 0.2, backend="fem")


@in_space
def test_what_is_refused_in_space():
    wall = ck.Boundary("wall", ck.source("analytic.sphere", radius=0.5), both=ck.Dirichlet(0.0))
    for backend in ("fem", "fem-pinned"):
        with pytest.raises(ck.SceneError, match="no boundaries inside a solid"):
            ck.solve(ck.Scene(BALL, ck.Laplace(), [wall]), 0.3, backend=backend)
    near = ck.source("union", members=[BALL, ck.source("moved", of=BALL, translation=[1.99, 0, 0])])
    refused(near, "members 0 and 1 of the union meet near")
    crossing = ck.source("union", members=[SPHERE, ck.source("analytic.sphere", center=[1, 0, 0])])
    refused(ck.source("solid", of=crossing), "TetGen refuses the boundary", error=ck.InputError)
    refused(BALL, "too coarse for the boundary", spacing=3.0, error=ck.ResolutionError)
    refused(BALL, "spacing is needed", spacing=None, error=ck.InputError)
    with pytest.raises(ck.InputError, match="computes no fluxes"):
        solve(BALL, 0.4).flux("edge")


def test_without_tetgen_a_command_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "tetgen", None)
    refused(BALL, r"pip install 'cpmkit-fem\[solids\]'", error=MissingDependencyError)
