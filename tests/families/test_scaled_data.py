"""Data times a number have the solution times that number, or are refused: no square is lost or overflows."""

import numpy as np
import pytest

import cpmkit as ck

CIRCLE = ck.source("analytic.circle")


def screened(scale):
    return ck.Scene(CIRCLE, ck.ScreenedPoisson(lambda p: scale * p[:, 0]))


def imposed(scale):
    point = ck.source("analytic.point", at=[1, 0])
    ends = ck.Boundary("cut", point, left=ck.Dirichlet(scale), right=ck.Dirichlet(2 * scale))
    return ck.Scene(CIRCLE, ck.Poisson(lambda p: scale * p[:, 0]), [ends])


def heat(scale):
    return ck.Scene(CIRCLE, ck.Heat(lambda p: scale * p[:, 0], until=0.2, step=0.1))


def coefficients(scale):
    return ck.Scene(CIRCLE, ck.Elliptic(lambda p: p[:, 0], c=scale, diffusivity=scale))


FORMS = [("galerkin", "multigrid"), ("galerkin", "direct"), ("collocation", "reference")]


@pytest.mark.parametrize(("form", "solver"), FORMS)
@pytest.mark.parametrize("make", [screened, imposed, heat])
@pytest.mark.parametrize("scale", [1e-300, 1e-160, 1e90])
def test_the_solution_of_scaled_data_is_scaled(make, scale, form, solver):
    plain, scaled = (ck.solve(make(one), 0.2, form=form, solver=solver) for one in (1.0, scale))
    points = CIRCLE.mesh(0.5)[0]
    np.testing.assert_allclose(scaled.evaluate(points) / scale, plain.evaluate(points), rtol=0, atol=1e-7)
    assert scaled.warnings == plain.warnings


@pytest.mark.parametrize("scale", [1e-200, 1e90])
def test_scaled_coefficients_have_the_solution_divided(scale):
    points = CIRCLE.mesh(0.5)[0]
    plain, scaled = (ck.solve(coefficients(one), 0.2).evaluate(points) for one in (1.0, scale))
    np.testing.assert_allclose(scaled * scale, plain, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("make", [screened, imposed, heat])
@pytest.mark.parametrize("form", ["galerkin", "collocation"])
def test_data_whose_squares_overflow_are_refused(make, form):
    with pytest.raises(ck.InputError, match=r"must be at most 1e\+100 in size, .* choose another unit\."):
        ck.solve(make(1e120), 0.2, form=form)


def test_accurate_stabilisation_gains_little_on_a_smooth_surface():
    """What the documentation of ``stabilisation`` says: nothing but iterations on lattices that are fine enough."""
    scene = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(lambda p: 7 * p[:, 0] * p[:, 1]))
    points = np.random.default_rng(0).normal(size=(200, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    exact = points[:, 0] * points[:, 1]
    errors = [
        np.sqrt(np.mean((ck.solve(scene, 0.15, stabilisation=name).evaluate(points) - exact) ** 2))
        for name in ("default", "accurate")
    ]
    assert 0.75 < errors[1] / errors[0] < 1.05
