"""Solutions are compared at some of a form's points: there each form says what it says of all."""

import numpy as np
import pytest

import cpmkit as ck

SPHERE, HALF = ck.source("analytic.sphere"), ck.source("analytic.arc", normal=[0, 0, 1], start=0.0, end=np.pi)
SLIT = ck.Boundary("slit", HALF, left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0))


@pytest.mark.parametrize(
    "options",
    [
        {"form": "galerkin"},
        {"form": "galerkin", "tips": "singular"},
        {"form": "galerkin", "refine": "auto"},
        {"form": "collocation"},
        {"backend": "fem"},
    ],
    ids=str,
)
def test_some_points_are_those_of_all(options):
    solution = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson("x"), [SLIT]), 0.3, **options)
    form = solution.discretized
    rows, points = form.some_points(50)
    np.testing.assert_array_equal(points, form.points[rows])
    assert len(rows) == 50
    values = form.at_points(solution.values, rows)
    np.testing.assert_allclose(values, form.at_points(solution.values)[rows], rtol=0, atol=1e-12)
