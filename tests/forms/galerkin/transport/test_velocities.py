"""Velocities: smooth solutions at every cell number, layers at outflow, what is carried across curves, totals."""

from functools import cache

import numpy as np
import pytest
from model_problems import max_error, on_circle, order_of, rotation, sphere_points

import cpmkit as ck

CIRCLE = ck.source("analytic.circle")
SPHERE = ck.source("analytic.sphere")
AXIS = np.array([1.0, 2.0, 2.0]) / 3
CUT = ck.source("analytic.point", at=[1, 0])


def u(x):
    return x[:, 0] * x[:, 1] + x[:, 2]


def tangential(field, x):
    return field - x * np.sum(x * field, axis=1)[:, None]


def slope(x):
    return tangential(np.stack([x[:, 1], x[:, 0], np.ones(len(x))], axis=1), x)


def laplacian(x):
    return -6 * x[:, 0] * x[:, 1] - 2 * x[:, 2]


def about_an_axis(speed):
    return lambda x: speed * np.cross(AXIS, x)


def to_a_pole(speed):
    """About an axis and towards z = 1; its divergence is -2 z ``speed``."""
    return lambda x: speed * (np.cross(AXIS, x) + tangential(np.broadcast_to([0.0, 0.0, 1.0], x.shape), x))


def around(speed):
    return lambda x: speed * np.stack([-x[:, 1], x[:, 0]], axis=1)


def advected(speed):
    """An equation on the sphere that ``u`` solves."""
    v = about_an_axis(speed)
    return ck.Elliptic(lambda x: -laplacian(x) + np.sum(v(x) * slope(x), axis=1) + u(x), velocity=v, c=1.0)


@cache
def on_sphere(h):
    """The whole sphere, discretised once for all equations."""
    return ck.prepare(ck.Scene(SPHERE, ck.ScreenedPoisson(1.0)), h)


def error(problem, h):
    """The greatest error of an equation that ``u`` solves."""
    return np.abs(on_sphere(h).solve(problem=problem).evaluate(sphere_points()) - u(sphere_points())).max()


SPACINGS = (0.4, 0.28, 0.2)


@pytest.mark.parametrize("cell_number", [0.1, 1, 10, 100])
def test_a_smooth_solution_at_every_cell_number(cell_number):
    """The speed grows as the spacing falls, so that the cell number stays."""
    errors = [error(advected(cell_number / h), h) for h in SPACINGS]
    assert errors[-1] <= 1.2e-3
    assert order_of(SPACINGS, errors) >= 2.2


@pytest.mark.slow
@pytest.mark.parametrize("cell_number", [0.1, 1, 10, 100])
def test_a_smooth_solution_at_a_tenth(cell_number):
    assert error(advected(cell_number / 0.1), 0.1) <= 2e-4


def test_a_diffusivity_that_varies_is_felt_beyond_a_cell_number_of_one():
    v = about_an_axis(20.0)

    def a(x):
        return 1.5 + 0.9 * x[:, 0] * x[:, 2]

    def f(x):
        of_a = 0.9 * np.stack([x[:, 2], 0 * x[:, 0], x[:, 0]], axis=1)
        return -a(x) * laplacian(x) + np.sum((v(x) - of_a) * slope(x), axis=1) + u(x)

    errors = [error(ck.Elliptic(f, diffusivity=a, velocity=v, c=1.0), h) for h in SPACINGS]
    assert errors[-1] <= 1.2e-3
    assert order_of(SPACINGS, errors) >= 2.2


@pytest.mark.parametrize("cell_number", [10, 100, 1000])
def test_a_layer_at_the_outflow_is_left_out_without_overshoot(cell_number):
    """Along a circle cut at a point, v u' - a u'' = v and u = 0 at the cut: u = t up to a layer thinner than h."""
    h = 0.1
    cut = ck.Boundary("cut", CUT, both=ck.Dirichlet(0.0))
    speed = cell_number / h
    scene = ck.Scene(CIRCLE, ck.Elliptic(speed, velocity=around(speed)), [cut])
    t = np.linspace(1e-4, 2 * np.pi - 1e-4, 2000)
    for origin in ([0.0, 0.0], [0.37, 0.81], [0.5, 0.2]):
        solution = ck.solve(scene, h, origin=np.multiply(h, origin))
        assert ["layer" in sentence for sentence in solution.warnings] == [True]
        found = solution.evaluate(on_circle(t))
        assert found.max() <= 1.02 * 2 * np.pi
        assert found.min() >= -0.02 * 2 * np.pi
        assert np.abs(found - t)[t < 2 * np.pi - 3 * h].max() <= 0.01 * 2 * np.pi


def test_a_layer_that_the_spacing_resolves_gives_no_warning():
    cut = ck.Boundary("cut", CUT, both=ck.Dirichlet(0.0))
    resolved = ck.solve(ck.Scene(CIRCLE, ck.Elliptic(5.0, velocity=around(5.0)), [cut]), 0.1)
    t = np.linspace(0.01, 2 * np.pi - 0.01, 500)
    exact = t - 2 * np.pi * np.expm1(5 * t) / np.expm1(10 * np.pi)
    assert not resolved.warnings
    assert np.abs(resolved.evaluate(on_circle(t)) - exact).max() <= 5e-3 * 2 * np.pi


def test_advection_across_a_curve_takes_the_value_of_the_side_that_it_comes_from():
    """A velocity round a sphere that a great circle cuts, u = 1 at its left and 0 at its right: both are carried on."""
    ring = ck.source("analytic.circle", center=[0, 0, 0], radius=1.0, normal=[0, 1, 0])
    cut = ck.Boundary("ring", ring, left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0))
    swift = ck.Elliptic(0.0, velocity=lambda x: 1e3 * np.cross([0, 0, 1.0], x))
    found = ck.solve(ck.Scene(SPHERE, swift, [cut]), 0.2)
    at = sphere_points()
    at = at[(np.abs(at[:, 2]) < 0.8) & (np.abs(at[:, 1]) > 0.1)]
    assert np.abs(found.evaluate(at) - (at[:, 1] > 0)).max() <= 0.02


@pytest.mark.parametrize("jump", [0.0, 2.0])
def test_a_velocity_goes_on_through_a_transmission(jump):
    cut = ck.Boundary("cut", CUT, across=ck.Transmission(jump=jump))
    here = ck.Boundary("here", ck.source("analytic.point", at=[-1, 0]), both=ck.Dirichlet(1.0))
    swift = ck.Elliptic(0.0, velocity=around(1e4))
    found = ck.solve(ck.Scene(CIRCLE, swift, [cut, here]), 0.1)
    before, after = on_circle(np.array([5.0])), on_circle(np.array([1.0]))
    passed = [float(found.evaluate(at)[0]) for at in (before, after)]
    left = float(found.evaluate([[1, 0]], "left")[0] - found.evaluate([[1, 0]], "right")[0])
    assert passed[0] == pytest.approx(1.0, abs=1e-3)
    assert abs(passed[1] - passed[0]) == pytest.approx(jump, abs=5e-3)
    assert left == pytest.approx(jump, abs=5e-3)


def test_the_conservative_form_is_the_other_one_with_its_divergence_in_c():
    v, speed = to_a_pole(15.0), 15.0

    def f(x):
        return -laplacian(x) + np.sum(v(x) * slope(x), axis=1) + (3 - 2 * x[:, 2]) * speed * u(x)

    forms = {True: 3 * speed, False: lambda x: (3 - 2 * x[:, 2]) * speed}
    for conservative, c in forms.items():
        problem = ck.Elliptic(f, velocity=v, c=c, conservative=conservative)
        errors = [error(problem, h) for h in SPACINGS]
        assert errors[-1] <= 2.4e-3
        assert order_of(SPACINGS, errors) >= 2.0


def test_a_conservative_velocity_keeps_the_total_and_a_flow_through_a_rim_takes_its_share():
    heat = {"until": 0.05, "step": 0.01, "conservative": True, "frames": 5}
    solution = on_sphere(0.3).solve(problem=ck.Heat(lambda x: 1 + x[:, 0], velocity=to_a_pole(20.0), **heat))
    totals = np.array([frame.totals for frame in solution.frames])
    assert np.ptp(totals) <= 1e-9 * abs(totals).max()
    arc = ck.source("analytic.arc", center=(0, 0), radius=1.0, start=0.0, end=3.0)
    steady = ck.Elliptic(lambda x: x[:, 1], velocity=around(5.0), c=1.0, conservative=True)
    solution = ck.solve(ck.Scene(arc, steady), 0.1, solver_tolerance=1e-12)
    total = solution.integrate()
    ends = solution.evaluate(on_circle(np.array([0.0, 3.0])))
    assert abs(ends[1] - ends[0]) >= 0.1
    assert 1 - np.cos(3.0) - total == pytest.approx(5.0 * (ends[1] - ends[0]), abs=1e-6)


def test_heat_that_a_velocity_carries_is_of_second_order_in_time_and_place():
    """exp(-t) times the first mode, carried about an axis by a turn."""
    turn, end = 8.0, 0.25
    normal, other = rotation()[0], rotation()[1]
    v = lambda x: turn * np.cross(normal, x)  # noqa: E731
    angle, points = turn * end, sphere_points()
    carried_to = np.cos(angle) * other + np.sin(angle) * np.cross(normal, other)
    spacings = (0.4, 0.28, 0.2)
    errors = []
    for h in spacings:
        heat = ck.Heat(lambda x: x @ other, until=end, step=h / 32, kappa=0.1, velocity=v)
        errors.append(max_error(ck.Scene(SPHERE, heat), points, np.exp(-0.2 * end) * (points @ carried_to), h))
    assert errors[-1] <= 5e-3
    assert order_of(spacings, errors) >= 1.9


def test_the_iteration_agrees_with_the_factorisation_at_every_cell_number():
    """Also where constants are free, and with two channels."""
    for cell_number, c in ((1, 1.0), (100, 0.0)):
        v = about_an_axis(cell_number / 0.2)
        f = [lambda x: x[:, 0] * x[:, 1], lambda x: x[:, 2]]
        scene = ck.Scene(SPHERE, ck.Elliptic(f, velocity=v, c=c))
        by = {name: ck.solve(scene, 0.2, solver=name) for name in ("direct", "multigrid")}
        assert 0 < by["multigrid"].report.iterations <= 30
        assert np.abs(by["multigrid"].values - by["direct"].values).max() <= 1e-7 * np.abs(by["direct"].values).max()


def test_constants_are_solutions():
    problem = ck.Elliptic(2.0, velocity=about_an_axis(300.0), c=2.0)
    assert on_sphere(0.3).solve(problem=problem).evaluate(sphere_points()) == pytest.approx(1.0, abs=1e-9)


def test_problems_that_are_not_supported_are_refused():
    fast = ck.Elliptic(1.0, velocity=to_a_pole(1.0), c=1.0, conservative=True)
    with pytest.raises(ck.SceneError, match="not div"):
        ck.solve(ck.Scene(SPHERE, fast), 0.3, form="collocation")
    with pytest.raises(ck.SceneError, match="takes no velocity"):
        ck.solve(ck.Scene(SPHERE, advected(1.0)), 0.3, tips="singular")
    arc = ck.source("analytic.arc", center=(0, 0), radius=1.0, start=0.0, end=3.0)
    without = ck.prepare(ck.Scene(arc, ck.ScreenedPoisson(1.0)), 0.2)
    with pytest.raises(ck.SceneError, match="prepare it with this problem"):
        without.solve(problem=ck.Elliptic(1.0, velocity=around(1.0), c=1.0, conservative=True))
    with pytest.raises(ck.SceneError, match="no velocity beside"):
        ck.solve(ck.Scene(SPHERE, ck.Elliptic(1.0, np.diag([1.0, 2.0, 3.0]), about_an_axis(1.0), 1.0)), 0.3)
    for velocity in (to_a_pole(3.0), about_an_axis(30.0)):
        with pytest.raises(ck.SceneError, match="Nothing fixes the size"):
            on_sphere(0.3).solve(problem=ck.Elliptic(0.0, velocity=velocity, conservative=True))
    with pytest.raises(ck.InputError, match="there is none"):
        ck.Elliptic(1.0, conservative=True)
    with pytest.raises(ck.InputError, match="True or False"):
        ck.Heat(1.0, until=1.0, step=0.1, velocity=to_a_pole(1.0), conservative=1)
