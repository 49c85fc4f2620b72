"""Splines of degree 1, 2 and 3: orders of convergence, and what holds of all of them."""

import numpy as np
import pytest
from cut_meshes import data_mesh
from galerkin_scenes import SHIFT, plane_circle, sphere
from scipy.sparse.linalg import splu

import cpmkit as ck
from cpmkit.forms.galerkin.dof_map import build_dof_map
from cpmkit.forms.galerkin.space.spline_space import derivative_rows, value_rows

SPHERE = ck.source("analytic.sphere")
POINTS = np.random.default_rng(4).normal(size=(500, 3))
POINTS /= np.linalg.norm(POINTS, axis=1)[:, None]
MAJOR, MINOR = 1.0, 0.4


def solve(scene, h, degree, **options):
    return ck.solve(scene, h, form="galerkin", degree=degree, **options)


def order(spacings, errors):
    return np.polyfit(np.log(spacings), np.log(errors), 1)[0]


def rms(error):
    return np.sqrt(np.mean(np.square(error)))


def xyz(x):
    return np.prod(x, axis=1)


def on_torus(x):
    """u = sin 2p cos t around the axis and the core, and -Lap u + u."""
    p, t = np.arctan2(x[:, 1], x[:, 0]), np.arctan2(x[:, 2], np.hypot(x[:, 0], x[:, 1]) - MAJOR)
    width, s = MAJOR + MINOR * np.cos(t), np.sin(2 * p)
    across = s * (-np.cos(t) / MINOR**2 + np.sin(t) ** 2 / (MINOR * width))
    return s * np.cos(t), (4 / width**2 + 1) * s * np.cos(t) - across


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("drawn", [plane_circle(0.2), sphere(0.12).moved(SHIFT)])
def test_splines_sum_to_one_and_slopes_are_theirs(degree, drawn):
    dof_map = build_dof_map(drawn.samples.points, drawn.contacts, 0.2, degree=degree)
    at = 0.2 * (dof_map.cells + np.random.default_rng(0).uniform(-0.4, 0.4, dof_map.cells.shape))
    patch, step = np.arange(len(at)), 1e-6
    ones = np.ones(dof_map.size)
    np.testing.assert_allclose(value_rows(dof_map, patch, at) @ ones, 1.0, atol=1e-13)
    u, along = np.random.default_rng(1).normal(size=dof_map.size), np.ones_like(at)
    apart = [value_rows(dof_map, patch, at + sign * step * along) @ u for sign in (1, -1)]
    slopes = derivative_rows(dof_map, patch, at, along) @ u
    np.testing.assert_allclose(slopes, (apart[0] - apart[1]) / (2 * step), atol=1e-6 * np.abs(slopes).max())


@pytest.mark.parametrize("stabilisation", ["default", "accurate"])
@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize(("surface", "h"), [(ck.source("analytic.circle"), 0.2), (SPHERE, 0.3)])
def test_the_matrix_is_symmetric_and_positive_but_for_constants(surface, h, degree, stabilisation):
    scene = ck.Scene(surface, ck.Laplace())
    form = ck.discretize(
        scene, h, form="galerkin", degree=degree, stabilisation=stabilisation, origin=SHIFT[: surface.dim]
    )
    K = form.stiffness(scene.problem.terms()).to_csr()
    assert abs(K - K.T).max() == 0
    assert abs(K @ np.ones(K.shape[0])).max() < 1e-12 * K.diagonal().max()
    lowest = np.linalg.eigvalsh(K.toarray())
    assert lowest[0] > -1e-13 * K.diagonal().max()
    assert lowest[1] > 1e-8 * K.diagonal().max()


def test_solutions_on_the_sphere_are_of_an_order_more_than_the_degree():
    scene, spacings = ck.Scene(SPHERE, ck.Poisson(lambda x: 12 * xyz(x))), (0.25, 0.18, 0.125)
    exact, finest = xyz(POINTS), {}
    for degree, least in ((1, 1.5), (2, 2.9), (3, 3.9)):
        solved = [solve(scene, h, degree, solver="multigrid") for h in spacings]
        errors = [rms(one.evaluate(POINTS).ravel() - exact) for one in solved]
        assert order(spacings, errors) > least
        assert solved[-1].report.iterations < 45
        finest[degree] = errors[-1]
    assert finest[3] < 8e-6
    assert finest[3] < finest[2] / 5 < finest[1] / 50


def test_solutions_on_a_torus():
    torus = ck.source("analytic.torus", major=MAJOR, minor=MINOR)
    scene = ck.Scene(torus, ck.ScreenedPoisson(lambda x: on_torus(x)[1], c=1.0))
    p, t = np.random.default_rng(2).uniform(0, 2 * np.pi, (2, 300))
    width = MAJOR + MINOR * np.cos(t)
    at, spacings = np.stack([width * np.cos(p), width * np.sin(p), MINOR * np.sin(t)], axis=1), (0.25, 0.18, 0.13)
    for degree, least in ((1, 1.7), (3, 4.0)):
        errors = [rms(solve(scene, h, degree).evaluate(at).ravel() - on_torus(at)[0]) for h in spacings]
        assert order(spacings, errors) > least


@pytest.mark.parametrize(("degree", "least", "bound"), [(1, 1.7, 3e-3), (3, 4.0, 2e-6)])
def test_solutions_on_a_circle(degree, least, bound):
    waves = lambda x: x[:, 0] ** 3 - 3 * x[:, 0] * x[:, 1] ** 2  # noqa: E731
    scene = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(lambda x: 10 * waves(x), c=1.0))
    t = np.linspace(0, 2 * np.pi, 300)
    at, spacings = np.stack([np.cos(t), np.sin(t)], axis=1), (0.2, 0.1, 0.05)
    errors = [rms(solve(scene, h, degree).evaluate(at).ravel() - waves(at)) for h in spacings]
    assert order(spacings, errors) > least
    assert errors[-1] < bound


@pytest.mark.parametrize(("degree", "least", "spacings"), [(1, 1.55, (0.2, 0.14, 0.1)), (3, 3.7, (0.3, 0.2, 0.14))])
def test_values_on_both_sides_of_a_circle(degree, least, spacings):
    """u = z + 1 above and xyz below a circle, which at 0.2 lies in a knot plane."""
    ring = ck.source("analytic.circle", center=[0, 0, 0.3], normal=[0, 0, 1], radius=np.sqrt(1 - 0.3**2))
    boundary = ck.Boundary("ring", ring, left=ck.Dirichlet(lambda x: x[:, 2] + 1), right=ck.Dirichlet(xyz))
    scene = ck.Scene(SPHERE, ck.Poisson(lambda x: np.where(x[:, 2] > 0.3, 2 * x[:, 2], 12 * xyz(x))), [boundary])
    exact = np.where(POINTS[:, 2] > 0.3, POINTS[:, 2] + 1, xyz(POINTS))
    errors = []
    for h in spacings:
        solution = solve(scene, h, degree, solver="multigrid")
        errors.append(rms(solution.evaluate(POINTS).ravel() - exact))
        assert solution.report.iterations < 45
    assert order(spacings, errors) > least


@pytest.mark.parametrize("degree", [1, 3])
@pytest.mark.parametrize("seed", range(3))
def test_no_position_of_the_grid_makes_pivots_negative(degree, seed):
    random = np.random.default_rng(seed)
    height, h = random.uniform(-0.5, 0.5), 0.25
    rings = [
        ck.source("analytic.circle", center=[0, 0, z], normal=[0, 0, 1], radius=np.sqrt(1 - z**2))
        for z in (height, height + 0.1 * h)
    ]
    boundaries = [ck.Boundary(f"ring {k}", ring, both=ck.Dirichlet(0.0)) for k, ring in enumerate(rings)]
    scene = ck.Scene(SPHERE, ck.Poisson(1.0), boundaries)
    form = ck.discretize(scene, h, form="galerkin", degree=degree, origin=random.uniform(0, h, 3))
    matrix = form.stiffness(scene.problem.terms()).to_csr().tocsc()
    options = {"SymmetricMode": True}
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    assert factors.U.diagonal().min() > 0


@pytest.mark.parametrize(("degree", "bound"), [(1, 3e-2), (3, 1.2e-3)])
def test_eigenvalues_heat_and_slopes(degree, bound):
    found = np.ravel(solve(ck.Scene(SPHERE, ck.Eigen(count=9)), 0.3, degree).eigenvalues)
    exact = np.array([2.0, 2, 2, 6, 6, 6, 6, 6])
    assert abs(found[0]) < 1e-10
    assert np.abs(found[1:] / exact - 1).max() < bound
    heat = solve(ck.Scene(SPHERE, ck.Heat(xyz, until=0.1, step=0.02)), 0.3, degree)
    assert rms(heat.evaluate(POINTS).ravel() - np.exp(-1.2) * xyz(POINTS)) < bound


def test_a_mesh():
    """On a mesh cubic splines are no better, as the mesh is the error, but they hold; linear ones are quick."""
    spot = data_mesh("spot.obj")
    vertices, faces = spot.vertices, spot.cells
    mesh = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    size = np.ptp(vertices, axis=0).max()
    scene = ck.Scene(mesh, ck.ScreenedPoisson(lambda x: np.cos(6 * x[:, 0] / size), c=1 / size**2))
    fine = solve(scene, 0.04 * size, 2).evaluate(vertices).ravel()
    for degree, bound in ((1, 5e-3), (3, 2e-3)):
        solution = solve(scene, 0.06 * size, degree, solver="multigrid")
        assert rms(solution.evaluate(vertices).ravel() - fine) < bound * np.ptp(fine)
        assert solution.report.iterations < 45


def test_the_degree_is_described_and_saved(tmp_path):
    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(xyz, c=1.0))
    solution = solve(scene, 0.3, 3)
    assert solution.discretized.describe()["degree"] == 3
    solution.save(tmp_path / "solution.npz")
    loaded = ck.load(tmp_path / "solution.npz", scene)
    np.testing.assert_array_equal(loaded.evaluate(POINTS[:20]), solution.evaluate(POINTS[:20]))
    forecast = ck.explain(scene, 0.3, form="galerkin", degree=3, dry_run=True)
    assert "of degree 3" in str(forecast)
    assert forecast.unknowns == solution.work.unknowns


@pytest.mark.parametrize("degree", [1, 3])
def test_the_error_that_gives_a_warning(degree):
    scene, h = ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: 13 * xyz(x), c=1.0)), 0.2
    estimate = ck.estimate_error(scene, h, form="galerkin", degree=degree)
    true = rms(solve(scene, h, degree).evaluate(POINTS).ravel() - xyz(POINTS))
    assert 0.4 * true < estimate.rms * estimate.unit < 4 * true
