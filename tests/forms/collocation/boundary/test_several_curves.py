"""Curves that cross or come near each other: what suffers is local, and a narrow strip is reported."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from model_problems import circle_jump, max_error, on_circle, order_of, rotation, sphere_points, sphere_poisson

import cpmkit as ck


def great_circle(normal):
    return ck.source("analytic.circle", center=[0, 0, 0], radius=1.0, normal=normal)


def crossing(values, spacing=0.05):
    """Two great circles with constant values; where they cross, four sectors meet."""
    turn = rotation()
    circles = [
        ck.Boundary(name, great_circle(turn[:, k]), left=ck.Dirichlet(left), right=ck.Dirichlet(right))
        for k, (name, (left, right)) in enumerate(values.items())
    ]
    return ck.solve(ck.Scene(ck.source("analytic.sphere"), ck.Laplace(), circles), spacing, form="collocation"), turn


@cache
def crossing_equal_values():
    """The solution, that is constant, with equal values on two circles that cross; the tests only read it."""
    return crossing({"one": (1.0, 1.0), "other": (1.0, 1.0)}, 0.1)[0]


@pytest.mark.slow
def test_outside_that_radius_the_sectors_do_not_suffer():
    """u = a + b atan2(w2, w1) in each quarter, w along the circles' normals: harmonic, and constant on each curve."""
    turn = rotation()
    values = {"first": (1.0, 2.0), "second": (-1.0, 0.0)}
    points = sphere_points(6000)
    w = points @ turn
    left, up = w[:, 0] > 0, w[:, 1] > 0
    on_first = np.where(left, 1.0, 2.0)
    on_second = np.where(up, -1.0, 0.0)
    # between the curves the angle around the third axis runs from one to the other
    angle = np.arctan2(np.abs(w[:, 1]), np.abs(w[:, 0]))  # 0 on the second circle, pi/2 on the first
    exact = on_second + (on_first - on_second) * 2 * angle / np.pi
    errors = []
    spacings = (0.1, 0.067, 0.05)
    for h in spacings:
        solution, _ = crossing(values, h)
        away = np.sqrt(1 - w[:, 2] ** 2) > 8 * 0.1
        errors.append(np.abs(solution.evaluate(points) - exact)[away].max())
    assert order_of(spacings, errors) >= 1.0, errors


def strip(gap, h=0.025):
    """A circle cut twice, ``gap`` spacings apart, values 0 and 10 in the strip, 2 and 5 outside."""
    ends = np.array([1.0, 1.0 + gap * h])
    points = on_circle(ends)
    cuts = [
        ck.Boundary("one", ck.source("analytic.point", at=points[0]), left=ck.Dirichlet(2.0), right=ck.Dirichlet(0.0)),
        ck.Boundary("two", ck.source("analytic.point", at=points[1]), left=ck.Dirichlet(10.0), right=ck.Dirichlet(5.0)),
    ]
    return ck.solve(ck.Scene(ck.source("analytic.circle"), ck.Laplace(), cuts), h, form="collocation"), ends


@pytest.mark.parametrize("gap", [0.2, 0.5, 0.9])
def test_a_strip_narrower_than_a_spacing_is_reported(gap):
    solution, (start, stop) = strip(gap)
    told = [text for text in solution.warnings if "run side by side" in text]
    assert len(told) == 1
    assert f"{gap:.2g} spacings apart" in told[0]
    rest = np.linspace(stop + 1e-3, start + 2 * np.pi - 1e-3, 400)
    exact = 5 - 3 * (rest - stop) / (2 * np.pi - (stop - start))
    np.testing.assert_allclose(solution.evaluate(on_circle(rest)), exact, atol=2e-3)


def test_a_strip_of_four_spacings_is_solved():
    solution, (start, stop) = strip(4.0)
    assert not [text for text in solution.warnings if "side by side" in text]
    share = np.linspace(0.01, 0.99, 50)
    np.testing.assert_allclose(solution.evaluate(on_circle(start + share * (stop - start))), 10 * share, atol=1e-2)


def test_two_circles_on_a_sphere_half_a_spacing_apart():
    axis, h = rotation()[:, 2], 0.1
    heights = (0.2, 0.2 + 0.5 * h)
    circles = [
        ck.Boundary(
            f"at {height:g}",
            ck.source("analytic.circle", center=height * axis, radius=np.sqrt(1 - height**2), normal=axis),
            left=ck.Dirichlet(left),
            right=ck.Dirichlet(right),
            left_of=axis,
        )
        for height, left, right in zip(heights, (1.0, 3.0), (2.0, 4.0), strict=True)
    ]
    solution = ck.solve(ck.Scene(ck.source("analytic.sphere"), ck.Laplace(), circles), h, form="collocation")
    assert [text for text in solution.warnings if "run side by side" in text]
    points = sphere_points()
    w = points @ axis
    values = solution.evaluate(points)
    np.testing.assert_allclose(values[w > heights[1] + 1e-6], 3.0, atol=1e-6)
    np.testing.assert_allclose(values[w < heights[0] - 1e-6], 2.0, atol=1e-6)
    between = (w > heights[0] + 1e-6) & (w < heights[1] - 1e-6)
    assert between.sum() > 20
    assert np.all((values[between] >= 1.0) & (values[between] <= 4.0))


def test_curves_that_meet_at_an_angle_enclose_no_strip():
    assert not crossing_equal_values().discretized.tables.layout.parallel_pairs
    assert max_error(*sphere_poisson(rotation().T[:2]), 0.1) <= 6e-3


def geodesic(*corners):
    """Points along great arcs through the corners, turned out of the lattice's planes."""
    corners = [np.array(corner) / np.linalg.norm(corner) for corner in corners]
    arcs = []
    for a, b in pairwise(corners):
        angle = np.arccos(a @ b)
        t = np.linspace(0, angle, 500)[:, None]
        arcs.append((np.sin(angle - t) * a + np.sin(t) * b) / np.sin(angle))
    points = np.concatenate([arcs[0], *(arc[1:] for arc in arcs[1:])])
    return points @ rotation().T


def poisson_on(curves):
    scene, points, exact = sphere_poisson([])

    def u(x):
        return x[:, 0] * x[:, 1] + x[:, 2]

    boundaries = [ck.Boundary(f"curve {k}", curve, both=ck.Dirichlet(u)) for k, curve in enumerate(curves)]
    return ck.Scene(scene.surface, scene.problem, boundaries), points, exact


def test_a_curve_that_ends_on_another():
    stem = ck.source("mesh.polyline", points=geodesic((0, 1, 0), (1, 1, 0.2)))
    problem = poisson_on([great_circle(rotation()[:, 0]), stem])
    spacings = (0.2, 0.14, 0.1)
    errors = [max_error(*problem, h, form="collocation", solver="reference") for h in spacings]
    assert errors[-1] <= 4e-3
    assert order_of(spacings, errors) >= 1.8


@pytest.mark.slow
def test_a_triangle_of_great_arcs():
    """Its corners turn by more than a right angle: the oriented test keeps second order."""
    corners = (1, 0, 0.2), (0, 1, 0.2), (0.3, 0.3, 1)
    triangle = ck.source("mesh.polyline", points=geodesic(*corners, corners[0])[:-1], closed=True)
    problem = poisson_on([triangle])
    spacings = (0.2, 0.1, 0.05)
    errors = [max_error(*problem, h, form="collocation") for h in spacings]
    assert errors[-1] <= 1.6e-3
    assert order_of(spacings, errors) >= 1.7


def test_jumps_of_twenty_and_five_three_spacings_apart():
    """-u'' = 2 cos s, cut at s = 0 and at three spacings; on each part the linear function that its ends ask for."""
    h = 0.0125
    gap = 3 * h
    ends = {"left": ck.Dirichlet(22.0), "right": ck.Dirichlet(2.0)}
    scene, points, _ = circle_jump(**ends)
    middle = 2 * np.cos(gap) + 3.0
    second = ck.Boundary(
        "second",
        ck.source("analytic.point", at=on_circle(np.array([1.022 * np.pi + gap]))[0]),
        left=ck.Dirichlet(middle),
        right=ck.Dirichlet(middle + 5.0),
    )
    t = np.linspace(1e-6, 2 * np.pi - 1e-6, 2000)
    short = 2 * np.cos(t) + 3.0 * t / gap
    share = (t - gap) / (2 * np.pi - gap)
    long = 2 * np.cos(t) + (8.0 * (1 - share) + 20.0 * share)
    values = ck.solve(
        ck.Scene(scene.surface, scene.problem, [*scene.boundaries, second]), h, form="collocation"
    ).evaluate(points)
    error = np.abs(values - np.where(t < gap, short, long))
    assert error[t < gap].max() <= 2e-4
    assert error[t >= gap].max() <= 2e-4
