"""The floor that a cloud names is the error that it leaves in a solution, within a factor of three."""

from functools import cache

import numpy as np
import pytest
from cpmkit_pointcloud import points
from cpmkit_pointcloud.conformance import sphere_samples
from model_problems import sphere_points, sphere_poisson

import cpmkit as ck

ORIGIN = [0.013, 0.021, -0.007]


def random_sphere(count, noise=0.0):
    rng = np.random.default_rng(11)
    cloud = rng.normal(size=(count, 3))
    return cloud / np.linalg.norm(cloud, axis=1, keepdims=True) + noise * rng.normal(size=cloud.shape)


@cache
def random_cloud(count, noise=0.0, **options):
    """The surface through random samples: a value, made once for all tests."""
    return points(points=random_sphere(count, noise), **options)


class AccuracyTarget:
    """The unit sphere as closest points alone."""

    dim, manifold_dim, exact, bounds = 3, 2, True, np.array([[-1.0] * 3, [1.0] * 3])

    def closest_point(self, x):
        return ck.source("analytic.sphere").closest_point(x)


def solved(surface, spacing, form="collocation"):
    height = ck.ScreenedPoisson(lambda x: 3 * x[:, 2] / np.linalg.norm(x, axis=1), c=1.0)
    return ck.solve(ck.Scene(surface, height), spacing, form=form, origin=ORIGIN).evaluate(sphere_points())


@cache
def on_the_sphere(spacing, form):
    return solved(AccuracyTarget(), spacing, form)


def left_by(cloud, spacing, form="collocation"):
    """The largest difference to the solution on the sphere itself on the same lattice, as a share of the range."""
    exact, found = on_the_sphere(spacing, form), solved(cloud, spacing, form)
    return np.abs(found - exact).max() / np.ptp(exact)


@pytest.mark.parametrize("spacing", [0.2, pytest.param(0.1, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("count", "noise", "options"),
    [
        (2000, 0.0, {}),
        (2000, 1e-3, {}),
        (2000, 5e-3, {"degree": 3}),
        (10000, 0.0, {"degree": 4}),
        (10000, 1e-4, {"neighbours": 50}),
        (10000, 1e-3, {}),
        (10000, 0.0, {"method": "nearest"}),
    ],
)
def test_the_floor_of_random_samples(count, noise, options, spacing):
    cloud = random_cloud(count, noise, **options)
    assert 1 / 3 < cloud.advice(spacing).floor / left_by(cloud, spacing) < 3


@pytest.mark.parametrize("spacing", [0.2, pytest.param(0.1, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("count", "noise", "options"),
    [
        (2000, 1e-3, {}),
        (2000, 5e-3, {"degree": 3}),
        (10000, 1e-4, {"neighbours": 50}),
        (10000, 1e-3, {}),
    ],
)
def test_the_floor_of_noisy_samples_by_integrals(count, noise, options, spacing):
    cloud = random_cloud(count, noise, **options)
    assert 1 / 3 < cloud.advice(spacing).integral_floor / left_by(cloud, spacing, "galerkin") < 3


def test_the_floor_of_samples_without_noise_by_integrals_is_next_to_nothing():
    cloud = random_cloud(2000)
    assert cloud.advice(0.2).integral_floor < 1e-6
    assert left_by(cloud, 0.2, "galerkin") < 1e-5


@pytest.mark.slow
def test_it_holds_for_conditions_on_a_curve_too():
    scene, where, exact = sphere_poisson([[0.3, 0.5, 1.0]])
    cloud = random_cloud(10000, 1e-3)
    noisy = ck.Scene(cloud, scene.problem, scene.boundaries)
    for form, name, factor in (("collocation", "floor", 3), ("galerkin", "integral_floor", 5)):
        found, smooth = (ck.solve(one, 0.2, form=form).evaluate(where) for one in (noisy, scene))
        wrong = np.abs(found - smooth).max() / np.ptp(exact)
        assert 1 / factor < getattr(cloud.advice(0.2), name) / wrong < factor


def test_a_lattice_finer_than_the_neighbourhoods_follows_the_bumps():
    cloud = random_cloud(2000, 1e-4)
    floors = [cloud.advice(spacing).floor for spacing in (1.0, 0.2, 0.1, 0.05, 1e-6)]
    assert floors == sorted(floors, reverse=True)
    assert floors[2] / floors[3] == pytest.approx(4.0, rel=0.1)
    assert 0.0 < floors[-1] < 1e-2 * floors[0]


def test_the_floor_is_a_share_whatever_the_cloud():
    assert points(points=[[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], closed=False).advice(0.1).floor == 0.0
    assert points(points=[[0.0, 0.0]], method="nearest").advice(0.1).floor == 0.0
    assert points(points=np.random.default_rng(0).uniform(size=(500, 3)), closed=False).advice(1e-3).floor <= 1.0
    even = points(points=sphere_samples(500))
    assert even.advice(0.1).floor == pytest.approx(even.translate(np.array([5.0, 0, 0])).advice(0.1).floor, rel=1e-6)


@pytest.mark.parametrize("spacing", [0.2, 0.1])
def test_data_that_balance_but_for_the_noise_are_accepted_and_others_are_not(spacing):
    cloud = random_cloud(5000, 0.01, neighbours=50)
    solution = ck.solve(ck.Scene(cloud, ck.Poisson("x")), spacing)
    (imbalance,) = solution.imbalances
    assert imbalance.relative > 10 / len(solution.discretized.points)  # more than the spacing explains
    assert not solution.warnings
    with pytest.warns(ck.CpmkitWarning, match="the source's error explain"):
        ck.solve(ck.Scene(cloud, ck.Poisson("x + 0.02")), spacing)
