"""Splines of several levels: what they reproduce, what they save at tips and spikes, and where they are left out."""

import numpy as np
import pytest
from numpy.polynomial.legendre import legval
from scipy.sparse.linalg import splu

import cpmkit as ck
from cpmkit.errors import InputError, SceneError
from cpmkit.forms.choice import options_of
from cpmkit.forms.galerkin.discretize_scene import discretize_in_regions
from cpmkit.forms.galerkin.refinement.regions import Regions
from cpmkit.forms.galerkin.scene_sampling import insert_scene
from cpmkit.linear.solver_options import make_solver

SPHERE = ck.source("analytic.sphere")
SMOOTH = ck.ScreenedPoisson(lambda x: 3 * x[:, 0] + 13 * x.prod(axis=1), c=1.0)
H = 0.25
TURN = np.array([[0.96, -0.28, 0], [0.28, 0.96, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])


def smooth(x):
    return x[:, 0] + x.prod(axis=1)


def on_sphere(count=400):
    points = np.random.default_rng(0).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1)[:, None]


def regions_where(picked, levels, scene, h):
    """Return regions whose cells of each level are those near the unit sphere that ``picked`` tells."""
    found = Regions(h, 3)
    for level in range(levels):
        size = h / 2**level
        n = int(1.3 / size) + 2
        cells = np.stack(np.meshgrid(*[np.arange(-n, n + 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
        middles = (cells + 0.5) * size - 0.5 * h
        chosen = cells[picked(middles, level) & (np.abs(np.linalg.norm(middles, axis=1) - 1) < size)]
        found = found.with_subdivided(np.full(len(chosen), level), chosen, level + 1)
    return found


def refined_in(picked, levels=1, problem=SMOOTH, h=H, boundaries=()):
    scene = ck.Scene(SPHERE, problem, list(boundaries))
    options, _ = options_of(scene, h, {"form": "galerkin"})
    return discretize_in_regions(scene, options, insert_scene(scene, options), regions_where(picked, levels, scene, h))


def everywhere(points, level):
    return np.ones(len(points), dtype=bool)


def in_a_cap(points, level):
    return np.linalg.norm(points - [1, 0, 0], axis=1) < 0.8 / 2**level


def solved(form):
    stiffness = form.stiffness(form.scene.problem.terms())
    b = form.load(form.scene.problem.terms().f) + form.condition_load(stiffness)
    return splu(stiffness.to_csr().tocsc()).solve(b)


@pytest.fixture(scope="module")
def cap():
    return refined_in(in_a_cap, levels=2)


def test_neighbouring_cells_differ_by_one_level_at_most():
    found = Regions(1.0, 2).with_subdivided(np.array([3]), np.array([[17, 5]]), 4)
    places = np.indices((200, 200)).reshape(2, -1).T / 200 * 4 - 0.47
    level = found.levels_at(places).reshape(200, 200)
    assert level.max() == 4
    assert np.abs(np.diff(level, axis=0)).max() == 1
    assert np.abs(np.diff(level, axis=1)).max() == 1


def test_truncated_splines_sum_to_one_and_constants_are_kept(cap):
    ones = np.ones(cap.size)
    np.testing.assert_allclose(cap.space.representation @ ones, 1, atol=1e-13)
    stiffness = cap.stiffness(ck.Laplace().terms())
    assert abs(stiffness.to_csr() @ ones).max() < 1e-12 * abs(stiffness.to_csr()).max()


def test_linear_functions_are_kept(cap):
    """On each level the coefficients of a linear function are its values at the nodes."""
    dof_map = cap.space.dof_map
    active = np.concatenate([level.active for level in cap.space.levels])
    places = np.concatenate(
        [
            level.dof_map.nodes * level.dof_map.spacing - 0.5 * H * (1 - 0.5**number)
            for number, level in enumerate(cap.space.levels)
        ]
    )[active]
    for axis in range(3):
        np.testing.assert_allclose(cap.space.representation @ places[:, axis], dof_map.places[:, axis], atol=1e-13)


def test_matrices_are_symmetric_and_positive(cap):
    matrix = cap.stiffness(SMOOTH.terms()).to_csr()
    assert abs(matrix - matrix.T).max() == 0
    np.linalg.cholesky(matrix.toarray() - 1e-6 * np.eye(matrix.shape[0]))  # fails unless all eigenvalues are larger


def test_a_level_everywhere_is_the_uniform_space():
    """The lattice of level 1 has its node a quarter of h before that of level 0."""
    form = refined_in(everywhere)
    assert form.space.level_sizes[0] == 0
    scene = ck.Scene(SPHERE, SMOOTH)
    uniform = ck.solve(scene, H / 2, form="galerkin", origin=form.sampled.lattice.origin - H / 4, solver="direct")
    assert form.size == uniform.work.unknowns
    x = on_sphere()
    found, wanted = form.evaluate(solved(form), x)[:, 0], uniform.evaluate(x)
    assert np.abs(found - smooth(x)).max() < 1.05 * np.abs(wanted - smooth(x)).max()
    np.testing.assert_allclose(found, wanted, atol=2e-5)


def test_errors_are_of_third_order_with_the_same_regions():
    errors = []
    for h in (0.25, 0.18, 0.125):
        form = refined_in(lambda x, level: x[:, 0] > 0.3, h=h)
        x, u = on_sphere(), multigrid(form)[0]
        errors.append(np.sqrt(np.mean((form.evaluate(u, x)[:, 0] - smooth(x)) ** 2)))
    orders = 2 * np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders.min() > 2.7


def multigrid(form):
    stiffness = form.stiffness(form.scene.problem.terms())
    b = form.load(form.scene.problem.terms().f) + form.condition_load(stiffness)
    return make_solver("multigrid", {}).prepare(stiffness, form.levels(stiffness)).solve(b, 1e-10)


def test_gradients_and_integrals_are_read(cap):
    u, x = solved(cap), on_sphere()
    exact = np.stack([1 + x[:, 1] * x[:, 2], x[:, 0] * x[:, 2], x[:, 0] * x[:, 1]], axis=1)
    exact -= np.sum(exact * x, axis=1)[:, None] * x
    assert np.abs(cap.gradient(u, x)[:, 0] - exact).max() < 0.01
    assert cap.point_weights.sum() == pytest.approx(4 * np.pi, rel=1e-4)


def test_two_sided_data_across_levels():
    """A circle with one on its left and zero on its right, crossed by a change of level."""
    circle = ck.Boundary(
        "ring", ck.source("analytic.circle", normal=[0, 0, 1]), left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0)
    )
    form = refined_in(in_a_cap, levels=2, problem=ck.Laplace(), boundaries=[circle])
    u, report = multigrid(form)
    x = on_sphere()
    np.testing.assert_allclose(form.evaluate(u, x)[:, 0], x[:, 2] > 0, atol=1e-7)
    assert report.iterations < 45


def spike(width=0.05, turn=None):
    """Return a scene on the unit sphere whose solution is a spike of this width, and the solution."""
    centre, k = np.array([0.6, 0.48, 0.64]) if turn is None else turn @ [0.6, 0.48, 0.64], width**-2

    def u(x):
        return np.exp(-k * (1 - x @ centre / np.linalg.norm(x, axis=1)))

    def f(x):
        s = x @ centre / np.linalg.norm(x, axis=1)
        return u(x) * (1 - (1 - s * s) * k * k + 2 * s * k)

    return ck.Scene(SPHERE, ck.ScreenedPoisson(f, c=1.0)), u


def error_of(solution, u):
    x = on_sphere(4000)
    x[:2000] = 0.04 * x[:2000] + [0.6, 0.48, 0.64]
    x /= np.linalg.norm(x, axis=1)[:, None]
    return np.sqrt(np.mean((solution.evaluate(x) - u(x)) ** 2))


def test_a_spike_takes_an_eighth_of_the_unknowns():
    scene, u = spike()
    refined, uniform = ck.solve(scene, 0.2, refine="auto", refine_levels=2), ck.solve(scene, 0.05, estimate=False)
    assert error_of(refined, u) < 1.2 * error_of(uniform, u)
    assert uniform.work.unknowns > 8 * refined.work.unknowns
    assert refined.report.iterations < 45
    assert refined.discretization()["refinement"].startswith("on: ")


def slit():
    """Return a turned plate with a slit that nothing flows through, and u = r^(1/2) sin(t/2) about its tip."""

    def u(x):
        y = x @ TURN
        return np.sqrt(np.hypot(y[:, 0], y[:, 1])) * np.sin(np.arctan2(y[:, 1], y[:, 0]) / 2)

    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]) @ TURN.T
    plate = ck.source("mesh.triangles", vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]), closest="faceted")
    line = ck.source("mesh.polyline", points=np.array([[-1, 0, 0], [-0.5, 0, 0], [0, 0, 0.0]]) @ TURN.T)
    cut = ck.Boundary("slit", line, both=ck.Neumann(0.0))
    return ck.Scene(plate, ck.Laplace(), [cut], edge=ck.Dirichlet(u)), u


def slit_error(solution, u):
    y = np.random.default_rng(3).uniform(-0.95, 0.95, size=(3000, 2))
    y[:1500] *= 0.1
    x = np.column_stack([y, np.zeros(len(y))])[np.abs(y[:, 1]) > 1e-3] @ TURN.T
    return np.sqrt(np.mean((solution.evaluate(x) - u(x)) ** 2))


def test_refinement_gathers_at_a_point_source():
    source = ck.PointSource([[0.0, 0.0, 1.0]])
    scene = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(source, c=1.0))
    angle, degree = np.array([0.05, 0.1, 0.2]), np.arange(20_000)
    exact = legval(np.cos(angle), (2 * degree + 1) / (degree**2 + degree + 1)) / (4 * np.pi)
    points = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    refined, uniform = ck.solve(scene, spacing=0.3, refine="auto"), ck.solve(scene, spacing=0.1)
    assert refined.work.unknowns < uniform.work.unknowns / 5
    error, plain = (np.abs(solution.evaluate(points) - exact).max() for solution in (refined, uniform))
    assert error < plain / 3


def test_the_tip_of_a_slit_takes_an_eighth_of_the_unknowns():
    scene, u = slit()
    refined, uniform = ck.solve(scene, 0.2, refine="auto"), ck.solve(scene, 0.025, estimate=False)
    assert slit_error(refined, u) < 1.1 * slit_error(uniform, u)
    assert uniform.work.unknowns > 8 * refined.work.unknowns


@pytest.mark.slow
def test_errors_at_the_tip_fall_with_the_levels():
    scene, u = slit()
    errors = [slit_error(ck.solve(scene, 0.1, refine="auto", refine_levels=levels), u) for levels in (1, 2, 3)]
    assert np.all(np.divide(errors[:-1], errors[1:]) > 1.7)


def test_a_moved_scene_gives_the_same_answer_to_the_error():
    errors = []
    for shift in (0.0, 0.31):
        scene, u = spike(width=0.08)
        found = ck.solve(scene, 0.25, refine="auto", refine_levels=2, origin=np.full(3, shift * 0.25), estimate=False)
        errors.append(error_of(found, u))
    assert max(errors) < 3 * min(errors)


def test_refining_is_left_out_where_it_does_not_pay():
    solution = ck.solve(ck.Scene(SPHERE, SMOOTH), H, refine="auto")
    told = solution.discretization()
    assert told["refinement"].startswith("off: ")
    assert told["refined_levels"] == [solution.work.unknowns]
    uniform = ck.solve(ck.Scene(SPHERE, SMOOTH), H)
    np.testing.assert_allclose(solution.evaluate(on_sphere()), uniform.evaluate(on_sphere()), atol=1e-8)


def test_an_organic_mesh_is_left_alone(real_mesh):
    vertices, faces = ck.read_mesh(real_mesh("spot.obj"))
    mesh = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    form = ck.discretize(
        ck.Scene(mesh, ck.ScreenedPoisson(lambda x: np.sin(4 * x[:, 0]) + x[:, 1])), 0.1, refine="auto"
    )
    assert form.space.level_sizes == (form.size,)


def test_a_refined_solution_estimates_its_error_and_is_saved(tmp_path):
    scene, u = spike(width=0.15)
    solution = ck.solve(scene, 0.3, refine="auto", refine_levels=2)
    assert len(solution.discretized.space.level_sizes) > 1
    x = on_sphere(2000)
    true = np.abs(solution.evaluate(x) - u(x)).max()
    assert 0.3 * true < solution.error.error[0] < 30 * true
    solution.save(tmp_path / "spike.npz")
    again = ck.load(tmp_path / "spike.npz", scene)
    np.testing.assert_array_equal(again.evaluate(x), solution.evaluate(x))


def test_explaining_solves_nothing():
    message = str(ck.explain(spike()[0], spacing=0.2, refine="auto", dry_run=True))
    assert "refine" in message


@pytest.mark.parametrize(
    ("surface", "problem", "said"),
    [
        (SPHERE, ck.Heat(lambda x: x[:, 0], until=0.1, step=0.05), "steady"),
        (ck.source("analytic.circle"), SMOOTH, "surfaces"),
    ],
)
def test_problems_that_are_not_supported_are_refused(surface, problem, said):
    with pytest.raises(SceneError, match=said):
        ck.solve(ck.Scene(surface, problem), 0.2, refine="auto")


@pytest.mark.parametrize("given", [{"refine": "on"}, {"refine_levels": 9}, {"refine_levels": 0.5}])
def test_options_that_are_refused(given):
    with pytest.raises(InputError):
        ck.solve(ck.Scene(SPHERE, SMOOTH), 0.2, **given)
