"""The Galerkin form through the whole line: orders, laws, sides, files, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from model_problems import order_of

import cpmkit as ck
from cpmkit.forms.galerkin.dof_map import connected_pieces

SPHERE = ck.source("analytic.sphere")
EQUATOR = ck.source("analytic.circle", normal=[0, 0, 1])
CIRCLE = ck.source("analytic.circle")


def points(count=1500, seed=0):
    """Return points of the unit sphere."""
    found = np.random.default_rng(seed).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1)[:, None]


def xy(x):
    return x[:, 0] * x[:, 1]


SCREENED = ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: 7 * xy(x)))


def solve(scene, spacing, **options):
    return ck.solve(scene, spacing, form="galerkin", **{"solver": "direct", **options})


def error(solution, exact, at):
    return np.sqrt(np.mean((solution.evaluate(at) - exact(at)) ** 2))


def test_order_on_a_sphere():
    at, spacings, errors = points(), [0.4, 0.25, 0.15], []
    for spacing in spacings:
        shifts = np.random.default_rng(1).uniform(0, spacing, (2, 3))
        errors.append(np.mean([error(solve(SCREENED, spacing, origin=shift), xy, at) for shift in shifts]))
    assert order_of(spacings, errors) > 2.7
    assert errors[-1] < 8e-5  # by the closest point method 1e-3


def test_order_on_a_circle_cut_at_a_point():
    cut = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), left=ck.Dirichlet(1), right=ck.Neumann(0.0))
    scene = ck.Scene(CIRCLE, ck.ScreenedPoisson(0.0), [cut])
    angle = np.linspace(0.01, 2 * np.pi - 0.01, 300)
    at, spacings, errors = np.stack([np.cos(angle), np.sin(angle)], axis=1), [0.2, 0.1, 0.05], []
    for spacing in spacings:
        found = solve(scene, spacing).evaluate(at)
        errors.append(np.abs(found - np.cosh(angle) / np.cosh(2 * np.pi)).max())
    assert order_of(spacings, errors) > 2.5


def test_values_on_both_sides_of_an_equator():
    both = [ck.Boundary("eq", EQUATOR, left=ck.Dirichlet(lambda x: x[:, 0]), right=ck.Dirichlet(2.0))]
    at, spacings, errors = points(), [0.4, 0.25, 0.15], []
    for spacing in spacings:
        solution = solve(ck.Scene(SPHERE, ck.Laplace(), both), spacing)
        left = solution.signed_distance("eq", at) > 0
        exact = np.where(left, at[:, 0] / (1 + np.abs(at[:, 2])), 2.0)
        clear = np.abs(at[:, 2]) > 1e-3 * spacing
        errors.append(np.sqrt(np.mean((solution.evaluate(at) - exact)[clear] ** 2)))
    assert order_of(spacings, errors) > 2.6
    assert errors[-1] < 3e-5
    assert connected_pieces(solution.discretized.space.dof_map)[0] == 2
    on = np.array([[0.6, 0.8, 0.0], [-1.0, 0.0, 0.0]])
    np.testing.assert_allclose(solution.evaluate(on), on[:, 0], atol=2e-3)
    np.testing.assert_allclose(solution.evaluate(on, side="right"), 2.0, atol=1e-9)
    assert solution.flux("eq", "left") == pytest.approx(0.0, abs=1e-2)


def test_order_beside_rims_and_curves():
    """Order 3, where samples that straddle knot planes would be what is left."""
    rim = ck.Scene(ck.source("analytic.cap", height=0.0), SCREENED.problem, edge=ck.Dirichlet(xy))
    ring = ck.source("analytic.circle", center=[0, 0, 0.3], radius=np.sqrt(1 - 0.09), normal=[0, 0, 1])
    above = lambda x: np.where(x[:, 2] > 0.3, xy(x), 0.0)  # noqa: E731
    unlike = [ck.Boundary("ring", ring, left=ck.Dirichlet(xy), right=ck.Dirichlet(0.0))]
    curve = ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: 7 * above(x)), unlike)
    at, spacings = points(), [0.2, 0.12, 0.07]
    for scene, exact, seen in ((rim, xy, at[at[:, 2] > 0]), (curve, above, at)):
        errors = [error(solve(scene, spacing, solver="auto"), exact, seen) for spacing in spacings]
        assert order_of(spacings, errors) > 2.7
        assert errors[-1] < 1.1e-5


def test_a_constant_is_kept_and_the_mean_is_free():
    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(3.0, c=1.5))
    np.testing.assert_allclose(solve(scene, 0.3).evaluate(points(50)), 2.0, rtol=1e-10)
    solution = solve(ck.Scene(SPHERE, ck.Poisson(lambda x: 6 * xy(x))), 0.2)
    form = solution.discretized
    assert abs(form.inner(np.ones((form.size, 1)), solution.values)[0, 0]) < 1e-12
    assert error(solution, xy, points()) < 3e-4
    assert solve(ck.Scene(SPHERE, ck.Poisson(1.0)), 0.3).imbalances[0].relative > 0.9


def test_a_coefficient_that_varies():
    """-div(a grad u) = f with a = 1 + z / 2 and u = z: f = 2 a z - (1 - z^2) / 2."""
    a = lambda x: 1 + 0.5 * x[:, 2]  # noqa: E731
    f = lambda x: 2 * a(x) * x[:, 2] - 0.5 * (1 - x[:, 2] ** 2) + x[:, 2]  # noqa: E731
    at, spacings, errors = points(), [0.4, 0.25, 0.15], []
    for spacing in spacings:
        solution = solve(ck.Scene(SPHERE, ck.Elliptic(f, diffusivity=a, c=1.0)), spacing)
        errors.append(error(solution, lambda x: x[:, 2], at))
    assert order_of(spacings, errors) > 2


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_a_scene_that_is_moved_and_scaled_has_the_same_solution(scale):
    centre = scale * np.array([3.0, -2.0, 5.0])
    moved = ck.source("analytic.sphere", center=centre, radius=scale)
    local = lambda x: (x - centre) / scale  # noqa: E731
    scene = ck.Scene(moved, ck.ScreenedPoisson(lambda x: 7 * xy(local(x)) / scale**2, c=1 / scale**2))
    at = points(200)
    found = solve(scene, 0.3 * scale).evaluate(centre + scale * at)
    np.testing.assert_allclose(found, solve(SCREENED, 0.3).evaluate(at), atol=2e-6)


def test_gradients_and_integrals():
    at, spacings, errors = points(300), [0.4, 0.25, 0.15], []
    exact = np.stack([at[:, 1], at[:, 0], 0 * at[:, 0]], axis=1) - 2 * xy(at)[:, None] * at
    for spacing in spacings:
        solution = solve(SCREENED, spacing)
        errors.append(np.sqrt(np.mean((solution.gradient(at) - exact) ** 2)))
    assert order_of(spacings, errors) > 2.7
    assert errors[-1] < 3e-4
    assert solution.integrate(lambda x, u: u**2) == pytest.approx(4 * np.pi / 15, rel=1e-3)


def test_it_is_saved_loaded_and_described(tmp_path):
    solution = solve(SCREENED, 0.3)
    solution.save(tmp_path / "a.npz")
    solution.save(tmp_path / "a.vtp")
    loaded = ck.load(tmp_path / "a.npz", SCREENED)
    at = points(20)
    np.testing.assert_array_equal(loaded.evaluate(at), solution.evaluate(at))
    assert loaded.work == solution.work
    told = solution.summary()["discretization"]
    assert (told["form"], told["form_reason"], told["stabilisation"]) == ("galerkin", "as given", "default")
    other = ck.Scene(ck.source("analytic.sphere", radius=1.3), SCREENED.problem)
    with pytest.raises(ck.InputError, match="another scene"):
        ck.load(tmp_path / "a.npz", other)


def test_one_preparation_serves_many_equations():
    prepared = ck.prepare(SCREENED, 0.3, form="galerkin", solver="direct")
    again = prepared.solve(problem=ck.ScreenedPoisson(lambda x: 7 * xy(x), c=1.0))
    np.testing.assert_array_equal(again.values, solve(SCREENED, 0.3).values)
    assert prepared.solve(problem=ck.ScreenedPoisson(2.0)).evaluate([[1, 0, 0]])[0] == pytest.approx(2.0, rel=1e-10)


def test_a_forecast_is_right_to_a_fifth():
    told = ck.explain(SCREENED, 0.04, form="galerkin", dry_run=True)
    work = solve(SCREENED, 0.04, solver="auto").work
    assert not told.exact
    assert told.unknowns == pytest.approx(work.unknowns, rel=0.2)
    assert told.closest_point_queries == pytest.approx(work.closest_point_queries, rel=0.2)
    assert "form 'galerkin': as given" in str(told)


def test_an_estimate_is_near_the_error():
    estimate = ck.estimate_error(SCREENED, 0.15, form="galerkin", solver="direct")
    at = points(4000)
    assert 0.3 < estimate.error[0] / np.abs(estimate.solution.evaluate(at) - xy(at)).max() < 5


def test_forms_are_chosen_with_a_reason():
    reason = lambda **given: ck.discretize(SCREENED, 0.3, **given).describe()["form_reason"]  # noqa: E731
    assert reason(form="galerkin") == "as given"
    assert reason(stabilisation="accurate") == "the only one with the option 'stabilisation'"
    assert reason(order=2) == "the only one with the option 'order'"
    heat = ck.Scene(SPHERE, ck.Heat(xy, until=0.1, step=0.05))
    assert ck.discretize(heat, 0.3).describe()["form_reason"] == "the default"
    transported = replace(heat, problem=ck.Heat(xy, until=0.1, step=0.05, velocity=np.zeros_like))
    assert ck.discretize(transported, 0.3).describe()["form_reason"] == "the default"
    leaping = replace(heat, problem=ck.Wave(xy, until=0.1, step=0.05, scheme="leapfrog"))
    assert "explicit steps" in ck.discretize(leaping, 0.3).describe()["form_reason"]
    assert reason(degree=5) == "the only one with degree=5"
    assert reason(degree=1) == "the only one with degree=1"
    assert reason(degree=3) == "the default"
    with pytest.raises(ck.InputError, match="order is an option of the form 'collocation', got form='galerkin'"):
        solve(SCREENED, 0.3, order=2)
    with pytest.raises(ck.InputError, match="degree must be 1, 2 or 3 in the form 'galerkin', got 4; form="):
        solve(SCREENED, 0.3, degree=4)
    rod = ck.source("analytic.segment", start=[1, 0, 0], end=[2, 0, 0])
    union = ck.source("union", members=[ck.source("analytic.sphere"), rod])
    with pytest.raises(ck.SceneError, match="give the radius r of the curve's cross section"):
        solve(ck.Scene(union, ck.ScreenedPoisson(1.0)), 0.3)
    with pytest.raises(ck.InputError, match=r"no option 'method' \(did you mean form='galerkin'\?\)"):
        ck.solve(SCREENED, 0.3, method="galerkin")
    with pytest.raises(ck.PluginError, match="kind 'collocation'; it is a form: use form='collocation'"):
        ck.solve(SCREENED, 0.3, backend="collocation")
    with pytest.raises(ck.InputError, match="points must lie within 3 spacings"):
        solve(SCREENED, 0.3).evaluate([[3.0, 0, 0]])


def test_what_memory_cannot_hold_is_refused_before_it_is_built(monkeypatch):
    with pytest.raises(ck.ResolutionError, match=r"spacing=1e-06 needs about .* GiB, and .*; spacing=.* would fit"):
        solve(SCREENED, 1e-6)
    monkeypatch.setattr("cpmkit.forms.galerkin.solve_memory.FACTORS_BYTES", 1e12)
    with pytest.raises(ck.ResolutionError, match=r"with the solver 'direct', .*, or solver='multigrid'\."):
        solve(SCREENED, 0.4)


def test_a_flux_that_depends_on_the_solution():
    """-Lap u = 2 z on the upper half of a sphere, du/db = -u^3 on its rim: u = 1 + z."""
    cap = ck.source("analytic.cap", height=0.0)
    scene = ck.Scene(cap, ck.Poisson(lambda x: 2 * x[:, 2]), edge=ck.NonlinearFlux(lambda u: -(u**3)))
    solution = solve(scene, 0.2)
    at = points(300) * [1, 1, 0] + np.abs(points(300)) * [0, 0, 1]
    assert "Newton's method converged" in solution.report.reason
    assert error(solution, lambda x: 1 + x[:, 2], at) < 5e-4
