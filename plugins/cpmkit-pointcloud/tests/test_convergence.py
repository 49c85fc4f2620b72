"""A solution on a cloud converges at second order, like one on the sphere that it samples, in a band as small."""

import numpy as np
import pytest
from cpmkit_pointcloud.conformance import sphere_samples
from model_problems import order_of, sphere_points

import cpmkit as ck


def height(x):
    return x[:, 2] / np.linalg.norm(x, axis=1)


def solved(surface, spacing):
    """-Lap u + u = 3 z, u = z, with u given on a tilted circle; the largest error and the number of unknowns."""
    axis = np.array([0.3, 0.5, 1.0]) / np.linalg.norm([0.3, 0.5, 1.0])
    circle = ck.source("analytic.circle", center=0.3 * axis, radius=np.sqrt(0.91), normal=axis)
    boundary = ck.Boundary("circle", circle, both=ck.Dirichlet(height))
    scene = ck.Scene(surface, ck.ScreenedPoisson(lambda x: 3 * height(x), c=1.0), [boundary])
    solution, points = ck.solve(scene, spacing), sphere_points()
    return np.abs(solution.evaluate(points) - points[:, 2]).max(), solution.work.unknowns


@pytest.mark.parametrize(
    ("options", "spacings", "bound"),
    [
        ({}, (0.4, 0.28, 0.2), 6e-4),
        pytest.param({}, (0.2, 0.1, 0.05), 6e-4, marks=pytest.mark.slow),
        pytest.param({"degree": 4}, (0.2, 0.1, 0.05), 6e-4, marks=pytest.mark.slow),
    ],
    ids=["coarse", "degree 2", "degree 4"],
)
def test_second_order_on_random_samples_of_a_sphere(options, spacings, bound):
    cloud = np.random.default_rng(6).normal(size=(5000, 3))
    cloud /= np.linalg.norm(cloud, axis=1, keepdims=True)
    surface = ck.source("pointcloud.points", points=cloud, **options)
    errors, unknowns = zip(*[solved(surface, spacing) for spacing in spacings], strict=True)
    assert order_of(spacings, errors) >= 1.8
    assert errors[-1] <= bound
    assert unknowns[-1] <= 1.01 * solved(ck.source("analytic.sphere"), spacings[-1])[1]


def test_plain_samples_have_an_error_that_no_spacing_removes():
    surface = ck.source("pointcloud.points", points=sphere_samples(5000), method="nearest")
    errors = [solved(surface, spacing)[0] for spacing in (0.3, 0.15)]
    assert min(errors) > 5e-2


def test_plain_samples_are_no_manifold_to_integrate_over():
    """Alone, moved, or in a union, ``auto`` takes the other form and says why."""
    cloud = ck.source("pointcloud.points", points=sphere_samples(500), method="nearest")
    other = ck.source("analytic.sphere", center=[5.0, 0, 0])
    for surface in (cloud, ck.source("moved", of=cloud, scale=2.0), ck.source("union", members=[cloud, other])):
        scene = ck.Scene(surface, ck.ScreenedPoisson(1.0))
        described = ck.discretize(scene, 0.4).describe()
        assert described["form"] == "collocation"
        assert "single samples" in described["form_reason"]
        with pytest.raises(ck.SceneError, match="single samples; fit a surface to them, or use form='collocation'"):
            ck.solve(scene, 0.4, form="galerkin")


def test_on_an_open_cloud_the_error_falls_with_the_distance_between_samples():
    """u = z^2 on a half sphere, with no flux through the equator, which a cloud knows to one sample distance."""
    square = ck.ScreenedPoisson(lambda x: 7 * height(x) ** 2 - 2, c=1.0)
    points = sphere_points()[:1400]
    errors = []
    for count in (500, 8000):
        cloud = ck.source("pointcloud.points", points=sphere_samples(2 * count)[:count], closed=False)
        values = ck.solve(ck.Scene(cloud, square), 0.2).evaluate(points)
        errors.append(np.abs(values - points[:, 2] ** 2).max())
    assert errors[1] < 0.08
    assert errors[0] / errors[1] > 3.0
