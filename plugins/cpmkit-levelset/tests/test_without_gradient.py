"""Functions without a gradient: feet as with it, and a warning where differences cannot give one."""

import warnings

import numpy as np
import pytest

import cpmkit as ck

BOX = [[-1.5, -1.5, -0.6], [1.5, 1.5, 0.6]]
QUERIES = np.random.default_rng(3).uniform(*BOX, (500, 3))


def torus_distance(p):
    return np.hypot(np.hypot(p[:, 0], p[:, 1]) - 1, p[:, 2]) - 0.4


def test_feet_on_a_signed_distance_are_those_in_closed_form():
    made = ck.source("levelset.callable", phi=torus_distance, bounds=BOX)
    found = made.closest_point(QUERIES)
    exact = ck.source("analytic.torus", major=1.0, minor=0.4).closest_point(QUERIES)
    away = np.linalg.norm(QUERIES - exact.points, axis=1) < 0.38  # not from the circle in the tube's middle
    assert np.abs(found.points - exact.points)[away].max() < 1e-9
    assert made.slope_error < 1e-9
    assert not made.advice(0.1).warnings


def test_a_distance_to_a_source_makes_its_offset():
    dome = ck.source("analytic.cap", height=0.3)
    phi = lambda p: dome.closest_point(p).distance - 0.2  # noqa: E731 - as a user writes it
    bounds = dome.bounds + 0.25 * np.array([[-1.0], [1.0]])
    made = ck.source("levelset.callable", phi=phi, bounds=bounds, resolution=16)
    found = made.closest_point(np.random.default_rng(1).uniform(*bounds, (100, 3)))
    assert np.abs(dome.closest_point(found.points).distance - 0.2).max() < 1e-9


def test_what_has_no_gradient_warns():
    noise = lambda p: torus_distance(p) + 1e-4 * np.sin(1e4 * p[:, 0])  # noqa: E731
    made = ck.source("levelset.callable", phi=noise, bounds=BOX, resolution=32)
    (message,) = made.advice(0.1).warnings
    assert "taken by differences" in message
    assert "gradient=" in message


def test_single_precision_is_reported():
    made = ck.source("levelset.callable", phi=lambda p: torus_distance(p.astype(np.float32)), bounds=BOX)
    assert 1e-6 < made.slope_error < 1e-2


def test_sympy_expressions_are_formulas():
    sympy = pytest.importorskip("sympy")
    x, y, z = sympy.symbols("x y z")
    phi = sympy.sin(x) * sympy.cos(y) + z**2 + x**2 + y**2 - 1
    made = ck.source("levelset.expression", phi=phi, bounds=[[-2, -2, -2], [2, 2, 2]])
    same = ck.source("levelset.expression", phi=str(phi), bounds=[[-2, -2, -2], [2, 2, 2]])
    assert np.array_equal(made.closest_point(QUERIES).points, same.closest_point(QUERIES).points)


def test_a_solution_on_it_is_that_of_the_torus():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = ck.source("levelset.callable", phi=torus_distance, bounds=BOX, resolution=24)
        found, exact = (
            ck.solve(ck.Scene(one, ck.ScreenedPoisson("x*z")), 0.3)
            for one in (made, ck.source("analytic.torus", minor=0.4))
        )
    points = ck.source("analytic.torus", minor=0.4).mesh(0.3)[0]
    values = exact.evaluate(points)
    assert np.abs(found.evaluate(points) - values).max() < 2e-3 * np.abs(values).max()
