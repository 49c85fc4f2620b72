"""A curve beside the surface is projected on it: laws hold on both sides of the projection, at third order."""

import numpy as np
import pytest

import cpmkit as ck

SPHERE, HEIGHT, RADIUS = ck.source("analytic.sphere"), 0.3, np.sqrt(1 - 0.3**2)
ANGLES = np.linspace(0, 2 * np.pi, 200, endpoint=False)
SPACINGS = (0.2, 0.14, 0.1)
#: On the circle of latitude onto which the curve is projected.
PLACES = np.stack([RADIUS * np.cos(ANGLES), RADIUS * np.sin(ANGLES), np.full(200, HEIGHT)], axis=1)


def solution(spacing):
    """The exact solution is z above the circle, and z + 1 below; the curve goes up and down by a tenth."""
    up = "(1 + 0.1*sin(5*t))"
    formulas = [f"{up}*{RADIUS}*cos(t)", f"{up}*{RADIUS}*sin(t)", f"{up}*{HEIGHT}"]
    wave = ck.source("parametric.curve", x=formulas, range=[0, "2*pi"], periodic=True)
    boundary = ck.Boundary("wave", wave, left=ck.Dirichlet("z"), right=ck.Robin(1.0, 1.0, RADIUS + HEIGHT + 1))
    problem = ck.ScreenedPoisson(lambda x: 3 * x[:, 2] + (x[:, 2] < HEIGHT), c=1.0)
    return ck.solve(ck.Scene(SPHERE, problem, [boundary]), spacing, form="galerkin")


@pytest.fixture(scope="module")
def solutions():
    return [solution(spacing) for spacing in SPACINGS]


def test_both_sides_obey_their_laws(solutions):
    for found, accepted in zip(solutions, (2e-4, 8e-5, 4e-5), strict=True):
        on_left, on_right = found.evaluate(PLACES, side="both").T
        assert np.abs(on_left - HEIGHT).max() < accepted
        assert np.abs(on_right - HEIGHT - 1).max() < accepted
        assert np.abs(found.signed_distance("wave", PLACES)).max() < 1e-9
        assert np.abs(found.flux_density("wave", "right", PLACES) - RADIUS).max() < 10 * accepted


def test_the_order_is_that_of_the_form(solutions):
    points = np.random.default_rng(0).normal(size=(1000, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    exact = points[:, 2] + (points[:, 2] < HEIGHT)
    errors = [np.sqrt(np.mean((found.evaluate(points) - exact) ** 2)) for found in solutions]
    assert np.polyfit(np.log(SPACINGS), np.log(errors), 1)[0] > 2.7
