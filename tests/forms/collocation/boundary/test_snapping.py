"""A boundary beside the surface is snapped to it: the answer is that of the snapped curve, and the distance is told."""

import numpy as np
import pytest
from model_problems import rotation, sphere_poisson

import cpmkit as ck


def great_circle(radius):
    return ck.source("analytic.circle", center=[0, 0, 0], radius=radius, normal=rotation()[:, 0])


def scene(curve):
    smooth, points, exact = sphere_poisson([rotation()[:, 0]])
    data = smooth.boundaries[0].condition("left")
    return ck.Scene(smooth.surface, smooth.problem, [ck.Boundary("cut", curve, both=data)]), points, exact


@pytest.mark.parametrize("radius", [0.98, 1.1])
def test_the_answer_is_that_of_the_curve_on_the_surface(radius):
    """Data are read where the curve was snapped to."""
    answers = []
    for curve in (great_circle(1.0), great_circle(radius)):
        problem, points, exact = scene(curve)
        answers.append(ck.solve(problem, 0.1, form="collocation").evaluate(points))
    assert np.abs(answers[0] - exact).max() < 5e-3
    assert np.abs(answers[1] - answers[0]).max() < 1e-6


def test_the_distance_is_reported():
    problem, _, _ = scene(great_circle(1.02))
    assert "snapped by up to 0.02" in str(ck.explain(problem, 0.1, form="collocation", dry_run=True))
    solution = ck.solve(problem, 0.1, form="collocation")
    assert solution.warnings == ()
    assert solution.summary()["discretization"]["snapped_by"]["cut"] == pytest.approx(0.02)
    problem, _, _ = scene(great_circle(1.1))
    assert any(
        "'cut' lies up to 0.1 off the surface, 1 spacings" in message
        for message in ck.solve(problem, 0.1, form="collocation").warnings
    )


def test_a_boundary_outside_the_tube_is_refused():
    problem, _, _ = scene(great_circle(1.6))
    with pytest.raises(ck.CpmkitError, match=r"up to 0\.6 away from the surface"):
        ck.solve(problem, 0.1, form="collocation")
