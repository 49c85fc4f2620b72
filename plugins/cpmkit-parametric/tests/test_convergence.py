"""Equations on parametric curves and on the Moebius strip converge at second order."""

from __future__ import annotations

import numpy as np
import pytest
from cpmkit_parametric import helix, moebius, torus_knot
from model_problems import order_of

import cpmkit as ck


def arc_errors(curve, length, wave, spacings):
    """-u'' + u = f in arc length s, u = cos(wave s); at free ends u' is zero."""
    t = np.linspace(0, 1, 20_001)
    lower, upper = curve.map.lower[0], curve.map.upper[0]
    points = curve.map.value(t[:, None])
    arc = np.concatenate([[0.0], np.cumsum(speed_integrals(curve, t))])
    assert arc[-1] == pytest.approx(length, rel=1e-9)

    def u(x):
        local = curve.closest_point(np.ascontiguousarray(x)).local[:, 0]
        return np.cos(wave * np.interp((local - lower) / (upper - lower), t, arc))

    scene = ck.Scene(curve, ck.ScreenedPoisson(lambda x: (wave**2 + 1) * u(x), c=1.0))
    probe = points[::37]
    return [np.abs(ck.solve(scene, h).evaluate(probe) - np.cos(wave * arc[::37])).max() for h in spacings]


def speed_integrals(curve, t):
    """Simpson's rule for the arc length of each interval."""

    def speed(s):
        return np.linalg.norm(curve.map.jet(s[:, None])[1][:, 0], axis=1)

    middle = 0.5 * (t[1:] + t[:-1])
    return np.diff(t) * (speed(t[:-1]) + 4 * speed(middle) + speed(t[1:])) / 6


def test_screened_poisson_on_a_helix_with_free_ends():
    made, spacings = helix(turns=1.5, pitch=2.0), (0.1, 0.05, 0.025)
    length = 1.5 * np.hypot(2 * np.pi, 2.0)
    errors = arc_errors(made, length, 2 * np.pi / length, spacings)
    assert order_of(spacings, errors) >= 1.8
    assert errors[-1] < 1e-3


def test_screened_poisson_on_a_trefoil():
    made, spacings = torus_knot(a=2, b=3, major=2.0), (0.1, 0.05, 0.025)
    t = np.linspace(0, 2 * np.pi, 4001)[:-1]
    # the trapezoidal rule, exact to rounding for a periodic function
    speed = np.sqrt(9 + 4 * (2 + np.cos(3 * t)) ** 2)
    length = 2 * np.pi * speed.mean()
    errors = arc_errors(made, length, 2 * 2 * np.pi / length, spacings)
    assert order_of(spacings, errors) >= 1.8
    assert errors[-1] < 1e-3


def strip_values(spacing):
    """-Lap u = 1 on the strip with a free rim, u = x on its core circle."""
    core = ck.source("analytic.circle", normal=[0, 0, 1], radius=1.0)
    scene = ck.Scene(
        moebius(half_width=0.35),
        ck.Poisson(1.0),
        [ck.Boundary("core", core, both=ck.Dirichlet(lambda x: x[:, 0]))],
    )
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 97)[:-1], np.linspace(-0.33, 0.33, 23), indexing="ij")
    around = 1 + v * np.cos(u / 2)
    points = np.stack([around * np.cos(u), around * np.sin(u), v * np.sin(u / 2)], axis=-1).reshape(-1, 3)
    return ck.solve(scene, spacing).evaluate(points)


@pytest.fixture(scope="module")
def coarse_strips():
    return [strip_values(spacing) for spacing in (0.1, 0.05)]


def test_solutions_on_the_moebius_strip_differ_little_between_grids(coarse_strips):
    first, second = coarse_strips
    assert np.abs(first - second).max() < 6e-3
    assert np.abs(first - second).mean() < 1e-3


@pytest.mark.slow
def test_differences_on_the_moebius_strip_fall_at_second_order(coarse_strips):
    first, second = coarse_strips
    third = strip_values(0.025)
    steps = [np.abs(first - second), np.abs(second - third)]
    assert steps[1].max() < 1.5e-3
    assert np.log2(steps[0].max() / steps[1].max()) > 1.8
    assert np.log2(steps[0].mean() / steps[1].mean()) > 1.8
