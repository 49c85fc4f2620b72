"""On the Dziuk surface, given as a level set, problems with curves and points inside converge at second order."""

import numpy as np
import pytest
from cpmkit_levelset import dziuk
from model_problems import order_of, sphere_points

import cpmkit as ck

FINE, COARSE = (0.2, 0.1, 0.05), (0.28, 0.2, 0.14)
AXIS = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])
DZIUK = dziuk()


def on_dziuk(p):
    """The sphere's points moved onto the surface: (x - z^2, y, z) is of length one."""
    return p + np.stack([p[:, 2] ** 2, 0 * p[:, 0], 0 * p[:, 0]], axis=1)


POINTS = on_dziuk(sphere_points(2000))


def u(p):
    return p[:, 0] * p[:, 1]


def minus_laplacian(p):
    """-Lap u = 2 n1 n2 + k (n1 x2 + n2 x1) with the mean curvature k = div n."""
    x, y, z = p.T
    s = x - z**2
    g = np.stack([2 * s, 2 * y, 2 * z - 4 * z * s], axis=1)
    length = np.linalg.norm(g, axis=1)
    n = g / length[:, None]
    hzz = 2 - 4 * s + 8 * z**2
    curved = 2 * n[:, 0] ** 2 + 2 * n[:, 1] ** 2 + hzz * n[:, 2] ** 2 - 8 * z * n[:, 0] * n[:, 2]
    k = (4 + hzz - curved) / length
    return 2 * n[:, 0] * n[:, 1] + k * (n[:, 0] * y + n[:, 1] * x)


def plane_cut(first=0, last=None):
    """Points ``first`` to ``last`` of 6,000 on the cut with the plane AXIS . x = 0.1, by bisection along rays."""
    angle = 2 * np.pi * np.arange(6000) / 6000
    start = np.cross(AXIS, [0, 1, 0.1])
    start /= np.linalg.norm(start)
    across = np.cross(AXIS, start)
    ray = np.cos(angle)[:, None] * start + np.sin(angle)[:, None] * across
    low, high = np.zeros(6000), np.full(6000, 3.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        x, y, z = (0.1 * AXIS + middle[:, None] * ray).T
        outside = (x - z**2) ** 2 + y**2 + z**2 > 1
        low, high = np.where(outside, low, middle), np.where(outside, middle, high)
    points = 0.1 * AXIS + low[:, None] * ray
    return points[first:last]


def errors(problem, boundary, spacings, **options):
    scene = ck.Scene(DZIUK, problem, [boundary])
    found = []
    for spacing in spacings:
        solution = ck.solve(scene, spacing, origin=np.zeros(3), **options)
        found.append(float(np.abs(solution.evaluate(POINTS) - u(POINTS)).max()))
    return found


SCREENED = ck.ScreenedPoisson(lambda p: minus_laplacian(p) + u(p))
POISSON = ck.Poisson(minus_laplacian)


CIRCLES = {
    "closed": ck.source("analytic.circle", center=[0, 0, 0]),
    "open arc": ck.source("analytic.arc", center=[0, 0, 0], start=-0.75 * np.pi, end=0.25 * np.pi),
}


@pytest.mark.slow  # always: degrees 2 and 3 on the closed circle, as a study
@pytest.mark.parametrize(("name", "bounds"), [("closed", (9e-3, 2.2e-3)), ("open arc", (8e-3, 2e-3))])
def test_screened_poisson_with_zero_neumann_on_the_unit_circle(name, bounds):
    found = errors(SCREENED, ck.Boundary("circle", CIRCLES[name], both=ck.Neumann(0.0)), FINE)
    assert found[1] <= bounds[0]
    assert found[2] <= bounds[1]
    assert order_of(FINE, found) >= 1.9


def cut_errors(ends, spacings, **options):
    curve = ck.source("mesh.polyline", points=plane_cut(*ends), closed=ends[1] is None)
    return errors(POISSON, ck.Boundary("cut", curve, both=ck.Dirichlet(u)), spacings, **options)


@pytest.mark.slow
@pytest.mark.parametrize("ends", [(0, None), (500, 3600)], ids=["closed", "open"])
def test_poisson_with_dirichlet_data_on_a_plane_cut(ends):
    found = cut_errors(ends, FINE)
    assert found[2] <= 2.5e-3
    assert order_of(FINE, found) >= 1.8


@pytest.mark.slow
def test_poisson_with_dirichlet_data_on_an_open_cut_at_coarse_spacings():
    found = cut_errors((500, 3600), COARSE, form="collocation")
    assert found[-1] <= 2e-2
    assert order_of(COARSE, found) >= 1.8


def point_errors(spacings, **options):
    at = DZIUK.closest_point(np.array([[0.6, 0.7, 0.5]])).points[0]
    point = ck.Boundary("point", ck.source("analytic.point", at=at), both=ck.Dirichlet(u))
    return errors(POISSON, point, spacings, **options)


@pytest.mark.slow
def test_poisson_with_a_dirichlet_point():
    found = point_errors(FINE)
    assert found[2] <= 6e-3
    assert order_of(FINE, found) >= 1.3


def test_poisson_with_a_dirichlet_point_at_coarse_spacings():
    found = point_errors(COARSE, form="collocation")
    assert found[-1] <= 3e-2
    assert order_of(COARSE, found) >= 1.3
