"""Curves much nearer to each other than the spacing, and not crossing, bound as many zones as topology says."""

from itertools import product

import numpy as np
import pytest
from cut_meshes import cut, icosphere, plate, polyline, zones_and_tips

import cpmkit as ck

AXES = {"aligned": (0.0, 0.0, 1.0), "diagonal": (1.0, 1.0, 1.0), "tilted": (0.3, -0.5, 0.81)}
GAPS = (1e-6, 1e-5, 1e-4, 1e-3, 3e-3, 1e-2)
SPHERE = ck.source("analytic.sphere")
POINTS = np.random.default_rng(0).normal(size=(1000, 3))
POINTS /= np.linalg.norm(POINTS, axis=1)[:, None]


class ByClosestPoints:
    """A curve that does not draw itself."""

    def __init__(self, source):
        self.source, self.closest_point = source, source.closest_point
        self.dim, self.manifold_dim, self.bounds, self.exact = 3, 1, source.bounds, True


def circle(height, axis=AXES["aligned"]):
    axis = np.asarray(axis) / np.linalg.norm(axis)
    return ck.source("analytic.circle", center=height * axis, normal=axis, radius=np.sqrt(1 - height**2))


def arc(height, start, end):
    radius = np.sqrt(1 - height**2)
    return ck.source("analytic.arc", center=[0, 0, height], radius=radius, normal=[0, 0, 1], start=start, end=end)


@pytest.mark.parametrize("gap", [1e-6, 1e-3])
@pytest.mark.parametrize("axis", AXES)
def test_three_circles_on_the_facets_of_a_sphere(axis, gap):
    circles = [circle(k * gap, AXES[axis]) for k in (0, 2, 1)]
    assert zones_and_tips(cut(icosphere(2), *circles).mesh) == (4, 0)


@pytest.mark.parametrize("wrapped", [lambda source: source, ByClosestPoints], ids=["drawn", "traced"])
def test_two_circles(wrapped):
    assert zones_and_tips(cut(icosphere(2), wrapped(circle(0.3)), wrapped(circle(0.30001))).mesh) == (3, 0)


@pytest.mark.parametrize("side", [1, -1])
def test_circles_in_a_plane_inside_and_outside(side):
    rings = [
        ck.source("analytic.circle", center=[0.5, 0.5, 0], normal=[0, 0, 1], radius=0.3 + k) for k in (0, side * 1e-5)
    ]
    assert zones_and_tips(cut(plate(9), *rings).mesh) == (3, 0)


@pytest.mark.parametrize("side", [1, -1])
def test_corners_beside_corners(side):
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1.5, 0]])
    rings = [polyline([0.5, 0.45, 0] + (0.2 + gap) * corners, closed=True) for gap in (0, side * 1e-4)]
    assert zones_and_tips(cut(plate(9), *rings).mesh) == (3, 0)


@pytest.mark.parametrize("angle", [0.01, 0.05, 0.3])
def test_circles_that_cross_keep_their_crossings(angle):
    circles = [circle(0.0), circle(0.0, (0.0, np.sin(angle), np.cos(angle)))]
    assert zones_and_tips(cut(icosphere(3), *circles).mesh) == (4, 0)


@pytest.mark.slow
@pytest.mark.parametrize("gap", GAPS)
def test_circles_at_all_gaps(gap):
    wrong = [
        (axis, height, count, order)
        for axis, height, count, order in product(AXES, (0.0, 0.3, -0.62), (2, 3), (1, -1))
        if zones_and_tips(
            cut(icosphere(3), *[circle(height + k * gap, AXES[axis]) for k in range(count)][::order]).mesh
        )
        != (count + 1, 0)
    ]
    assert not wrong


def rings(gap):
    """Laplace's equation between two circles: 0 below, 5 between, 1 above."""
    values = [(0.3, 5.0, 0.0), (0.3 + gap, 1.0, 5.0)]
    boundaries = [
        ck.Boundary(f"at {z}", circle(z), left=ck.Dirichlet(left), right=ck.Dirichlet(right))
        for z, left, right in values
    ]
    return ck.Scene(SPHERE, ck.Laplace(), boundaries)


def largest_error(solution, spacing):
    far = np.abs(POINTS[:, 2] - 0.3) > 2.2 * spacing
    return np.abs(solution.evaluate(POINTS[far]) - (POINTS[far, 2] > 0.3)).max()


@pytest.mark.parametrize(
    ("spacing", "solver", "gap"), [(0.3, "direct", 1e-5), (0.3, "multigrid", 1e-6), (0.15, "auto", 1e-4)]
)
def test_zones_have_their_constants(spacing, solver, gap):
    solution = ck.solve(rings(gap), spacing, solver=solver)
    assert largest_error(solution, spacing) < 5e-4
    assert not solution.warnings


@pytest.mark.slow
@pytest.mark.parametrize(("spacing", "solver"), [(0.3, "direct"), (0.15, "auto"), (0.15, "direct"), (0.1, "auto")])
def test_zones_have_their_constants_at_all_gaps(spacing, solver):
    for gap, shift in product(GAPS, range(4)):
        origin = np.random.default_rng(shift).uniform(0, spacing, 3)
        assert largest_error(ck.solve(rings(gap), spacing, solver=solver, origin=origin), spacing) < 5e-4


def test_a_jump_across_each_of_two_circles():
    gap, spacing = 1e-5, 0.3
    circles = [circle(0.3), circle(0.3 + gap)]
    boundaries = [
        ck.Boundary(f"ring {k}", at, across=ck.Transmission(jump))
        for k, (at, jump) in enumerate(zip(circles, (5.0, -4.0), strict=True))
    ]
    f = lambda x: np.select([x[:, 2] < 0.3, x[:, 2] < 0.3 + gap], [0.0, 5.0], 1.0)  # noqa: E731
    solution = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(f), boundaries), spacing)
    assert largest_error(solution, spacing) < 5e-3
