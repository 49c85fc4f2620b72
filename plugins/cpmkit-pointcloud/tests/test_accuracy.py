"""Feet converge to the sampled surface at the order of the patches, whatever the density, duplicates or noise."""

import numpy as np
import pytest
from cpmkit_pointcloud import points
from cpmkit_pointcloud.conformance import ellipse_samples, sphere_samples, torus_samples
from model_problems import order_of

COUNTS = (1000, 4000, 16000)
SPACINGS = 1 / np.sqrt(COUNTS)


def unit(x):
    return x / np.linalg.norm(x, axis=1, keepdims=True)


def on_torus(x):
    ring = x * [1, 1, 0] / np.hypot(x[:, 0], x[:, 1])[:, None]
    return ring + 0.4 * unit(x - ring)


def off(cloud, distance=0.05, count=1000):
    """Queries at up to ``distance`` from the samples."""
    rng = np.random.default_rng(3)
    return cloud[rng.integers(0, len(cloud), count)] + distance * rng.uniform(-1, 1, (count, 3)) / np.sqrt(3)


def rms(source, x, exact):
    feet = source.closest_point(x)
    return np.sqrt(np.mean(np.sum((feet.points - exact) ** 2, axis=1)))


def torus_errors(**options):
    clouds = [torus_samples(count) for count in COUNTS]
    return [rms(points(points=cloud, **options), off(cloud), on_torus(off(cloud))) for cloud in clouds]


@pytest.mark.parametrize(
    ("degree", "order", "finest"),
    [(1, 1.2, 1.6e-3), (2, 2.0, 3.4e-5), pytest.param(4, 4.0, 1.7e-6, marks=pytest.mark.slow)],
)
def test_order_on_a_torus_of_random_samples(degree, order, finest):
    errors = torus_errors(degree=degree)
    assert order_of(SPACINGS, errors) >= order
    assert errors[-1] <= finest


def test_plain_samples_are_of_first_order():
    x = torus_samples(1000, seed=7)
    errors = [rms(points(points=torus_samples(count), method="nearest"), x, x) for count in COUNTS]
    assert 0.8 <= order_of(SPACINGS, errors) <= 1.2
    assert errors[-1] > 100 * rms(points(points=torus_samples(COUNTS[-1])), x, x)


@pytest.mark.parametrize(("degree", "order"), [(2, 2.5), (4, 4.5)])
def test_order_on_an_even_sphere(degree, order):
    clouds = [sphere_samples(count) for count in (250, 1000, 4000)]
    errors = [rms(points(points=cloud, degree=degree), off(cloud), unit(off(cloud))) for cloud in clouds]
    assert order_of([4, 2, 1], errors) >= order


@pytest.mark.parametrize(("degree", "order"), [(2, 2.0), (4, 4.0)])
def test_order_on_a_curve_in_the_plane(degree, order):
    """Feet of points on the curve: those of others are not known in closed form."""
    angle = np.linspace(0, 2 * np.pi, 3001)
    exact = np.stack([np.cos(angle), 0.6 * np.sin(angle)], axis=1)
    errors = [
        points(points=ellipse_samples(count), degree=degree).closest_point(exact).distance.max()
        for count in (40, 80, 160)
    ]
    assert order_of([4, 2, 1], errors) >= order


def test_uneven_density_costs_only_what_the_sparse_part_costs():
    rng = np.random.default_rng(4)
    z, angle = 2 * rng.uniform(size=8000) ** 3 - 1, rng.uniform(0, 2 * np.pi, 8000)
    around = np.sqrt(1 - z * z)
    cloud = np.stack([around * np.cos(angle), around * np.sin(angle), z], axis=1)
    source, x = points(points=cloud), 1.03 * sphere_samples(4000)
    assert rms(source, x, unit(x)) < 1e-4
    assert source.closest_point(x).doubtful.mean() < 1e-2


def test_duplicates_are_left_out_and_counted():
    cloud = torus_samples(2000)
    once, often = points(points=cloud), points(points=np.concatenate([cloud, cloud[::-1], cloud[:7]]))
    assert (once.duplicates, often.duplicates) == (0, 2007)
    x = off(cloud)
    np.testing.assert_allclose(often.closest_point(x).points, once.closest_point(x).points, atol=1e-13)
    assert often.closest_point(x).element.max() < 2000


@pytest.mark.parametrize("noise", [1e-4, pytest.param(1e-3, marks=pytest.mark.slow)])
def test_noise_is_averaged(noise):
    rng = np.random.default_rng(5)
    cloud = unit(rng.normal(size=(5000, 3)))
    cloud = cloud + noise * rng.normal(size=cloud.shape)
    x = 1.03 * sphere_samples(1000)
    few, many = (rms(points(points=cloud, neighbours=count), x, unit(x)) for count in (30, 60))
    assert many < few < 0.8 * noise
