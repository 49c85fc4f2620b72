"""Heat, waves and eigenvalues by finite elements: the same families as by any form, on another form's matrices."""

import sys

import numpy as np
import pytest
from model_problems import order_of, sphere_points

import cpmkit as ck
from cpmkit.plugin import Discretized

POINTS = sphere_points(1000)
SPHERE = ck.source("analytic.sphere")
SPACINGS = [0.2, 0.1, 0.05]
EQUATOR = ck.source("analytic.circle", normal=[0, 0, 1])


def errors_of(problem, exact, boundaries=(), surface=SPHERE, points=POINTS, spacings=SPACINGS, **edge):
    errors = []
    for h in spacings:
        scene = ck.Scene(surface, problem(h) if callable(problem) else problem, list(boundaries), **edge)
        errors.append(np.abs(ck.solve(scene, h, backend="fem").evaluate(points) - exact).max())
    return errors


@pytest.mark.parametrize("scheme", ["bdf2", "crank-nicolson"])
def test_heat_is_of_second_order_and_keeps_its_total(scheme):
    def heat(h):
        return ck.Heat(lambda x: 1 + x[:, 2], until=0.5, step=h / 4, scheme=scheme)

    errors = errors_of(heat, 1 + np.exp(-1) * POINTS[:, 2])
    assert 1.8 < order_of(SPACINGS, errors) < 2.2
    solution = ck.solve(ck.Scene(SPHERE, heat(0.2)), 0.2, backend="fem")
    mass, start = solution.discretized.mass_matrix, 1 + solution.discretized.vertices[:, 2]
    np.testing.assert_allclose((mass @ solution.values[:, 0]).sum(), (mass @ start).sum(), rtol=1e-12)


def test_heat_between_data_that_move():
    """u = z exp(-t) + t on a cap: the rim's vertices and a circle's have values that change, f is u_t - Lap u."""
    height, until = 0.2, 0.5
    cap = ck.source("analytic.cap", height=height)
    points = POINTS[POINTS[:, 2] > height]
    tropic = ck.source("analytic.circle", normal=[0, 0, 1], center=[0, 0, 0.6], radius=0.8)

    def u(x, t):
        return x[:, 2] * np.exp(-t) + t

    def heat(h):
        return ck.Heat(lambda x: u(x, 0), until, h / 4, f=lambda x, t: 1 + x[:, 2] * np.exp(-t))

    slope = -np.sqrt(1 - height**2)
    for edge in (ck.Dirichlet(u), ck.Neumann(lambda x, t: slope * np.exp(-t) + 0 * x[:, 0])):
        for boundaries in ([], [ck.Boundary("tropic", tropic, both=ck.Dirichlet(u))]):
            target = {"surface": cap, "points": points, "spacings": [0.1], "edge": edge}
            (error,) = errors_of(heat, u(points, until), boundaries, **target)
            assert error < (4e-2 if boundaries else 4e-3)  # beside a circle that misses vertices, of first order


def test_columns_of_the_mass_matter_where_data_move():
    """With the rim and the pole at t and f = 1 the solution is t, to rounding, by what pinned vertices add to M u'."""
    cap, problem = ck.source("analytic.cap", height=0.2), ck.Heat(0.0, until=1.0, step=0.1, f=1.0)
    moving = ck.Dirichlet(lambda x, t: t + 0 * x[:, 0])
    for boundaries in ([], [ck.Boundary("pole", ck.source("analytic.point", at=[0, 0, 1]), both=moving)]):
        solution = ck.solve(ck.Scene(cap, problem, boundaries, edge=moving), 0.3, backend="fem")
        np.testing.assert_allclose(solution.values, 1.0, rtol=1e-12)


def test_a_run_goes_on_from_its_checkpoint(tmp_path):
    def run(until, **target):
        scene = ck.Scene(SPHERE, ck.Heat(lambda x: x[:, 2], until, step=0.05, frames=[0.1]))
        return ck.solve(scene, 0.3, backend="fem", **target)

    file = tmp_path / "half.npz"
    run(0.25, checkpoint=file)
    whole, resumed = run(0.5), run(0.5, resume=file)
    np.testing.assert_array_equal(resumed.values, whole.values)
    np.testing.assert_array_equal(resumed.frames[0].values, whole.frames[0].values)
    with pytest.raises(ck.InputError, match="is of another run"):
        ck.solve(whole.scene, 0.2, backend="fem", resume=file)
    whole.save(tmp_path / "whole.npz")
    assert ck.load(tmp_path / "whole.npz").values.shape == whole.values.shape
    with pytest.raises(ck.InputError, match="of another back end than 'cpm'"):
        ck.load(tmp_path / "whole.npz", whole.scene)
    assert len(whole.frame_meshes()) == 1


@pytest.mark.parametrize("scheme", ["auto", "implicit"])
def test_waves_are_of_second_order(scheme):
    errors = errors_of(
        lambda h: ck.Wave(lambda x: x[:, 2], until=1.0, step=h / 4, scheme=scheme), np.cos(2**0.5) * POINTS[:, 2]
    )
    assert 1.7 < order_of(SPACINGS, errors) < 2.3


def test_newmark_with_ends_that_move():
    """u = sin t + z on a cap whose rim moves so."""
    cap, points = ck.source("analytic.cap", height=0.2), POINTS[POINTS[:, 2] > 0.2]
    wave = ck.Wave(
        lambda x: x[:, 2], 2.0, 0.02, initial_rate=1.0, f=lambda x, t: 2 * x[:, 2] - np.sin(t), scheme="newmark"
    )
    scene = ck.Scene(cap, wave, edge=ck.Dirichlet(lambda x, t: np.sin(t) + x[:, 2]))
    solution = ck.solve(scene, 0.1, backend="fem")
    assert np.abs(solution.evaluate(points) - np.sin(2.0) - points[:, 2]).max() < 2e-2


def test_driven_waves_are_of_second_order():
    errors = errors_of(ck.Helmholtz(lambda x: (2 - 6.25) * x[:, 2], 2.5), POINTS[:, 2])
    assert 1.7 < order_of(SPACINGS, errors) < 2.3


def test_eigenvalues_of_the_sphere():
    exact = np.repeat([0.0, 2.0, 6.0], [1, 3, 5])
    errors = []
    for h in SPACINGS:
        solution = ck.solve(ck.Scene(SPHERE, ck.Eigen(count=9)), h, backend="fem")
        assert not solution.imaginary.any()
        assert (solution.eigenvalues > exact - 1e-10).all()  # from above: the elements conform
        errors.append(np.abs(solution.eigenvalues - exact).max())
        form = solution.discretized
        np.testing.assert_allclose(form.inner(solution.values, solution.values), np.eye(9), atol=1e-8)
    assert 1.8 < order_of(SPACINGS, errors) < 2.2


def test_eigenfunctions_vanish_where_a_value_is_imposed():
    """Odd in z: l (l + 1) with m + l odd, twice, one on each hemisphere."""
    imposed = [ck.Boundary("equator", EQUATOR, both=ck.Dirichlet(0.0))]
    solution = ck.solve(ck.Scene(SPHERE, ck.Eigen(count=2), imposed), 0.1, backend="fem")
    np.testing.assert_allclose(solution.eigenvalues, 2.0, rtol=0.02)
    assert np.abs(solution.values[solution.discretized.pins.vertices]).max() < 1e-12


def test_eigenvalues_at_the_rim():
    """A hemisphere is a disc to Laplace's equation: on its rim du/db = l u has l = 0, 1, 1, 2, 2."""
    cap = ck.source("analytic.cap", height=0.0)
    exact, errors = np.array([0.0, 1, 1, 2, 2]), []
    for h in SPACINGS:
        solution = ck.solve(ck.Scene(cap, ck.Eigen(count=5), edge=ck.Steklov()), h, backend="fem")
        errors.append(np.abs(solution.eigenvalues - exact).max())
    assert 1.7 < order_of(SPACINGS, errors) < 2.3


def test_a_diffusivity_that_varies_and_robin():
    """u = z, a = 2 + z, c = 1 + x^2: f = -a Lap u - grad a . grad u + c u."""
    height = 0.3
    cap = ck.source("analytic.cap", height=height)
    points = POINTS[POINTS[:, 2] > height]

    def f(x):
        z = x[:, 2]
        return (2 + z) * 2 * z - (1 - z**2) + (1 + x[:, 0] ** 2) * z

    problem = ck.Elliptic(f, diffusivity=lambda x: 2 + x[:, 2], c=lambda x: 1 + x[:, 0] ** 2)
    slope = -np.sqrt(1 - height**2)
    beta = ck.Robin(2.0, lambda x: 3 + x[:, 0], lambda x: 2 * slope + (3 + x[:, 0]) * height)
    for edge in (ck.Neumann(slope), beta):
        errors = errors_of(problem, points[:, 2], surface=cap, points=points, edge=edge)
        assert 1.7 < order_of(SPACINGS, errors) < 2.4


def test_a_flux_that_depends_on_the_solution():
    """u = z on a cap, with the flux j(u) = slope u^4 / height^4 through its rim."""
    height = 0.3
    cap = ck.source("analytic.cap", height=height)
    points = POINTS[POINTS[:, 2] > height]
    slope = -np.sqrt(1 - height**2)
    edge = ck.NonlinearFlux(lambda u: slope * (u / height) ** 4, guess=0.4)
    errors = errors_of(ck.Poisson(lambda x: 2 * x[:, 2]), points[:, 2], surface=cap, points=points, edge=edge)
    assert 1.7 < order_of(SPACINGS, errors) < 2.4


def test_a_prepared_scene_takes_other_data_and_equations(octahedron):
    """Matrices and factors that are kept belong to the data that they are used with, moving ones included."""
    vertices, faces = octahedron(3)
    upper = faces[(vertices[faces, 2] > -1e-9).all(axis=1)]
    half = ck.source("mesh.triangles", vertices=vertices, faces=upper)
    tropic = ck.source("analytic.circle", normal=[0, 0, 1], center=[0, 0, 0.5**0.5], radius=0.5**0.5)
    heat = ck.Heat(0.0, until=0.5, step=0.1, f=1.0)

    def scene(value, flux, problem=heat):
        return ck.Scene(half, problem, [ck.Boundary("tropic", tropic, both=value)], edge=flux)

    still, moving = ck.Dirichlet(0.0), ck.Dirichlet(lambda x, t: t + 0 * x[:, 0])
    prepared = ck.prepare(scene(still, ck.Neumann(0.0)), backend="fem")
    for value, flux in ((still, 0.0), (moving, 0.0), (still, 2.0), (ck.Dirichlet(3.0), 1.0)):
        flux = ck.Neumann(flux)
        again = prepared.solve(data={"tropic": value, "edge": flux})
        np.testing.assert_array_equal(again.values, ck.solve(scene(value, flux), backend="fem").values)
    two = ck.ScreenedPoisson([1.0, 2.0])
    wanted = ck.solve(scene(still, ck.Neumann(0.0), two), backend="fem").values
    np.testing.assert_array_equal(prepared.solve(problem=two).values, wanted)


def test_families_know_no_form():
    """Both forms solve heat through one function of one module, which has imported neither."""
    problem = ck.Heat(lambda x: x[:, 2], until=0.2, step=0.1)
    told = [ck.solve(ck.Scene(SPHERE, problem), 0.3, backend=name) for name in ("cpm", "fem")]
    assert {type(one) for one in told} == {type(told[0])}
    assert len({type(one.discretized) for one in told}) == 2
    assert all(isinstance(one.discretized, Discretized) for one in told)
    families = [module for name, module in sys.modules.items() if name.startswith("cpmkit.families")]
    assert sys.modules["cpmkit.families.evolution.stepping"] in families
    for module in families:
        known = {getattr(value, "__module__", None) or "" for value in vars(module).values()}
        assert not [name for name in known if name.startswith(("cpmkit.forms.collocation", "cpmkit_fem"))]
