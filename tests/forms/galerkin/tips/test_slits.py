"""Ends of boundaries with a singular unknown: full order on a plate and on a sphere, where u has roots."""

import numpy as np
import pytest
from conformal_arc import arc_scene, on_sphere
from model_problems import order_of
from plane_zones import FRAME, PLATE, POINTS, flat, off, segment, slit, solved

import cpmkit as ck

SPACINGS = [0.28, 0.2, 0.14]


def errors(scene, value, spacings, at=POINTS, **options):
    found = [off(solved(scene, h, tips="singular", **options), value, at) for h in spacings]
    return np.array(found).T


@pytest.mark.parametrize(("kind", "bound"), [("flux", 5e-5), ("value", 1.2e-4)])
def test_a_slit_to_the_rim(kind, bound):
    scene, value = slit(kind)
    spacings = [0.2, 0.14, 0.1]
    largest, mean = errors(scene, value, spacings)
    assert order_of(spacings, mean) > 2
    assert order_of(spacings, largest) > 1.5
    assert mean[-1] < bound


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["flux", "value"])
def test_a_slit_keeps_its_order(kind):
    scene, value = slit(kind)
    spacings = [0.1, 0.05, 0.025]
    assert order_of(spacings, errors(scene, value, spacings, solver="multigrid")[1]) > 2.3


@pytest.mark.parametrize("spacings", [SPACINGS[:1], pytest.param(SPACINGS, marks=pytest.mark.slow)])
def test_rows_read_the_gradient_of_roots(spacings):
    """That of sqrt(r) sin(t/2) is (-sin(t/2), cos(t/2)) / (2 sqrt(r)); rows read it as a gradient of values does."""
    scene, _ = slit("flux")
    r, t = np.meshgrid([0.1, 0.3, 0.5], np.linspace(-2.5, 2.5, 11))
    at = np.stack([r.ravel() * np.cos(t.ravel()), r.ravel() * np.sin(t.ravel())], axis=1) @ FRAME[:2]
    half, exact_size = t.ravel() / 2, 0.5 / np.sqrt(r.ravel())
    exact = exact_size[:, None] * np.stack([-np.sin(half), np.cos(half)], axis=1) @ FRAME[:2]
    errors = []
    for spacing in spacings:
        solution = solved(scene, spacing, tips="singular")
        form, u = solution.discretized, solution.values
        found = form.gradient(u, at)[:, 0]
        errors.append(np.sqrt(np.mean((found - exact) ** 2)))
    assert errors[-1] < (4e-3 if len(spacings) > 1 else 4e-2)
    assert len(spacings) == 1 or order_of(spacings, errors) > 1.5


@pytest.mark.parametrize("imposed", ["left", "right"])
def test_a_value_on_one_side_and_a_flux_on_the_other(imposed):
    """Fourth roots: u = r^(1/4) sin((pi - t)/4) + r^(3/4) sin(3 (pi - t)/4) / 2, or with -t for t."""
    sign = 1 if imposed == "left" else -1

    def value(x):
        u, v = flat(x).T
        r, t = np.hypot(u, v), np.pi - sign * np.arctan2(v, u)
        return r**0.25 * np.sin(t / 4) + 0.5 * r**0.75 * np.sin(0.75 * t)

    other = {"left": "right", "right": "left"}[imposed]
    sides = {imposed: ck.Dirichlet(0.0), other: ck.Neumann(0.0)}
    scene = ck.Scene(
        PLATE, ck.Laplace(), [ck.Boundary("slit", segment([-1, 0], [0, 0]), **sides)], edge=ck.Dirichlet(value)
    )
    extended, singular = (off(solved(scene, 0.1, tips=tips), value)[1] for tips in ("extended", "singular"))
    assert singular < 4e-4
    assert singular < 0.05 * extended


@pytest.mark.parametrize("kind", ["flux", "value"])
def test_an_arc_on_a_sphere(kind):
    """Neither it nor the sphere is straight, and constants are free beside its fluxes."""
    scene, value = arc_scene(kind)
    at = on_sphere(np.random.default_rng(1), 2000)

    def about_its_mean(x):
        return value(x) - np.mean(value(at))

    found = []
    for h in SPACINGS:
        u = solved(scene, h, tips="singular", solver="multigrid").evaluate(at)
        shift = np.mean(u) if kind == "flux" else np.mean(value(at))
        error = u - shift - about_its_mean(at)
        found.append(np.sqrt(np.mean(error**2)) / np.ptp(value(at)))
    assert order_of(SPACINGS, found) > 2.5
    assert found[-1] < 4e-4


def test_gradients_beside_an_end():
    scene, _ = slit("flux")
    at = np.random.default_rng(3).uniform(-0.8, 0.8, (500, 2))
    at = at[np.hypot(*at.T) > 0.05]
    r, t = np.hypot(*at.T), np.arctan2(at[:, 1], at[:, 0])
    exact = np.stack([-np.sin(t / 2), np.cos(t / 2)], axis=1) / (2 * np.sqrt(r))[:, None]
    found = []
    for h in SPACINGS:
        solution = solved(scene, h, tips="singular")
        error = solution.gradient(at @ FRAME[:2]).reshape(-1, 3) @ FRAME[:2].T - exact
        found.append(np.sqrt(np.mean(np.sum(error**2, axis=1))))
    assert order_of(SPACINGS, found) > 1.8
    assert found[-1] < 5e-3


def test_an_end_too_near_to_the_rim_gives_a_warning():
    scene = ck.Scene(PLATE, ck.Poisson(1.0), [ck.Boundary("slit", segment([-1, 0], [0.93, 0]), both=ck.Dirichlet(0.0))])
    with pytest.warns(ck.CpmkitWarning, match="no singular unknown"):
        solution = solved(scene, 0.1, tips="singular")
    assert not solution.discretized.sampled.singular
    apart = solution.evaluate(POINTS) - solved(scene, 0.1).evaluate(POINTS)
    assert np.sqrt(np.mean(apart**2)) < 2e-4


@pytest.mark.parametrize(
    "condition",
    [{"across": ck.Transmission(resistance=0.3)}, {"both": ck.Robin(1.0, 2.0, 1.0)}],
    ids=["across", "robin"],
)
def test_two_ends_inside(condition):
    scene = ck.Scene(
        PLATE, ck.Poisson(lambda x: flat(x)[:, 0]), [ck.Boundary("slit", segment([-0.4, 0.1], [0.3, 0.2]), **condition)]
    )
    fine = solved(scene, 0.07, tips="singular", solver="multigrid").evaluate(POINTS)
    off_fine = {
        tips: np.sqrt(np.mean((solved(scene, 0.14, tips=tips).evaluate(POINTS) - fine) ** 2))
        for tips in ("extended", "singular")
    }
    assert off_fine["singular"] < 0.4 * off_fine["extended"]


def test_a_slit_that_passes_everything_leaves_no_trace():
    """Where u and its flux go on across, there is nothing singular at the ends."""
    line = ck.Boundary("line", segment([-0.4, 0.1], [0.3, 0.2]), across=ck.Transmission())
    scene = ck.Scene(PLATE, ck.ScreenedPoisson(1.0), [line])
    solution = solved(scene, 0.14, tips="singular")
    assert not solution.discretized.sampled.singular
    np.testing.assert_allclose(solution.evaluate(POINTS), 1.0, atol=1e-9)


def test_laws_of_the_matrix():
    scene, _ = slit("flux")
    form = solved(scene, 0.2, tips="singular").discretized
    matrix = form.stiffness(scene.problem.terms()).matrix
    assert (matrix != matrix.T).nnz == 0
    whole = ck.Scene(PLATE, ck.Poisson(0.0), scene.boundaries)
    free = solved(whole, 0.2, tips="singular").discretized
    ones = np.append(np.ones(free.size - 1), 0.0)
    drift = free.stiffness(whole.problem.terms()).matrix @ ones
    assert np.abs(drift).max() < 1e-13
    assert ones @ free.mass.matrix @ ones == pytest.approx(4.0, rel=1e-12)


def test_a_saved_solution_is_read_the_same(tmp_path):
    scene, _ = slit("value")
    solution = solved(scene, 0.2, tips="singular")
    solution.save(tmp_path / "slit.npz")
    np.testing.assert_array_equal(
        ck.load(tmp_path / "slit.npz", scene=scene).evaluate(POINTS), solution.evaluate(POINTS)
    )


def test_a_treatment_that_does_not_exist():
    scene, _ = slit("flux")
    with pytest.raises(ck.InputError, match="'extended' or 'singular', got 'blunt'"):
        solved(scene, 0.2, tips="blunt")
