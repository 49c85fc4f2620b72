"""A flux that depends on the solution is met by Newton's method, inside and at edges."""

import numpy as np
import pytest
from arc_problems import arc_problem, slope, tilted_circle, value
from model_problems import max_error, on_circle, order_of, sphere_points

import cpmkit as ck

SPACINGS = (0.1, 0.05, 0.025)
#: By form, what an order that is fitted to three spacings exceeds.
ORDERS = {"collocation": 1.8, "galerkin": 2.8}
forms = pytest.mark.parametrize("form", ORDERS)


@forms
def test_ends_that_radiate(form):
    """du/db = g - u |u|^3 at both ends of an arc; g such that the solution is known."""

    def end(t, outward):
        u = float(value(on_circle(np.array([t])))[0])
        given = outward * slope(t) + u * abs(u) ** 3
        return ck.NonlinearFlux(lambda v: given - v * np.abs(v) ** 3)

    problem = arc_problem({0: end(0.3, -1), 1: end(2.7, 1)})
    errors = [max_error(*problem, h, form=form) for h in SPACINGS]
    assert order_of(SPACINGS, errors) >= ORDERS[form]
    assert errors[-1] <= (5e-4 if form == "collocation" else 5e-6)


def sphere_problem(guess=1.0, derivative=None):
    """-Lap u + u = f, u = exp(w) on the sphere; du/db = g(x) - u^3 on the left of a small circle, Dirichlet right."""
    circle, axis = tilted_circle()

    def u(x):
        return np.exp(x @ axis)

    def f(x):
        w = x @ axis
        return u(x) * (1 - (1 - w * w) + 2 * w)

    def flux(v, x):
        w = x @ axis
        return -np.sqrt(1 - w * w) * u(x) + u(x) ** 3 - v**3

    left = ck.NonlinearFlux(flux, slope=derivative, guess=guess)
    boundary = ck.Boundary("circle", circle, left=left, right=ck.Dirichlet(u), left_of=axis)
    points = sphere_points()
    return ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(f, c=1.0), [boundary]), points, u(points)


@pytest.mark.parametrize("form", [pytest.param("collocation", marks=pytest.mark.slow), "galerkin"])
def test_one_side_of_a_circle_on_the_sphere(form):
    spacings = (0.2, 0.14, 0.1) if form == "collocation" else (0.28, 0.2, 0.14)
    errors = [max_error(*sphere_problem(), h, form=form) for h in spacings]
    assert order_of(spacings, errors) >= ORDERS[form]


def test_newton_is_quick_and_says_so():
    solution = ck.solve(sphere_problem(derivative=lambda v, x: -3 * v**2)[0], 0.25)
    steps = int(solution.report.reason.split("converged in ")[1].split()[0])
    assert steps <= 7
    assert solution.scene.boundaries[0].condition("left").kind == "nonlinear flux"
    far = ck.solve(sphere_problem(guess=5.0)[0], 0.25)
    np.testing.assert_allclose(far.values, solution.values, atol=1e-7)


def test_a_linear_flux_is_robin():
    circle, axis = tilted_circle()
    f = ck.ScreenedPoisson(lambda x: x[:, 0], c=1.0)

    def solved(condition):
        boundary = ck.Boundary("circle", circle, left=condition, right=ck.Neumann(0.0), left_of=axis)
        scene = ck.Scene(ck.source("analytic.sphere"), f, [boundary])
        return ck.solve(scene, 0.2, solver_tolerance=1e-10).values  # Newton's method goes on to that

    robin = solved(ck.Robin(1.0, 2.0, 3.0))
    np.testing.assert_allclose(solved(ck.NonlinearFlux(lambda u: 3 - 2 * u)), robin, atol=1e-7)


def test_what_does_not_settle_raises():
    """du/db = u^2 + 1 on an arc has no solution that stays finite."""
    arc = ck.source("analytic.arc", start=0.0, end=2.0)
    scene = ck.Scene(arc, ck.Laplace(), edge={0: ck.Dirichlet(0.0), 1: ck.NonlinearFlux(lambda u: u**2 + 1)})
    with pytest.raises(ck.CpmkitError, match=r"did not converge|too coarse for the nonlinear flux"):
        ck.solve(scene, 0.02)


def test_several_channels_are_refused():
    arc = ck.source("analytic.arc", start=0.0, end=2.0)
    edge = {0: ck.Dirichlet([0.0, 1.0]), 1: ck.NonlinearFlux(lambda u: -u)}
    with pytest.raises(ck.SceneError, match="a nonlinear flux takes one channel, the scene has 2"):
        ck.solve(ck.Scene(arc, ck.Laplace(), edge=edge), 0.1)


def test_a_flux_of_the_wrong_shape_is_refused():
    arc = ck.source("analytic.arc", start=0.0, end=2.0)
    edge = {0: ck.Dirichlet(0.0), 1: ck.NonlinearFlux(lambda u: np.zeros((len(u), 2)))}
    with pytest.raises(ck.InputError, match=r"must return finite numbers of shape .*, got shape"):
        ck.solve(ck.Scene(arc, ck.Laplace(), edge=edge), 0.1)
    with pytest.raises(ck.InputError, match="flux of NonlinearFlux must be a function"):
        ck.NonlinearFlux(2.0)


@pytest.mark.parametrize("order", [1, 2])
def test_a_linear_flux_at_the_ends_of_an_arc_is_robin(order):
    arc = ck.source("analytic.arc", start=0.3, end=2.7)

    def solved(condition):
        scene = ck.Scene(arc, ck.Poisson(lambda x: x[:, 0]), edge={0: condition, 1: ck.Dirichlet(1.0)})
        return ck.solve(scene, 0.05, order=order).evaluate(on_circle(np.linspace(0.3, 2.7, 50)))

    robin = solved(ck.Robin(1.0, 2.0, 3.0))
    tolerance = 1e-7 if order <= 2 else 1e-4  # where a ghost reads several points, u is interpolated at the end
    np.testing.assert_allclose(solved(ck.NonlinearFlux(lambda u: 3 - 2 * u)), robin, atol=tolerance)


@pytest.mark.parametrize("form", ["collocation", "galerkin"])
def test_newton_asks_for_no_closest_point_again(form):
    """Queries do not depend on the number of steps: those of the same scene with a Neumann condition."""
    arc = ck.source("analytic.arc", start=0.3, end=2.7)

    def solved(condition):
        scene = ck.Scene(arc, ck.ScreenedPoisson(1.0), edge={0: condition, 1: ck.Dirichlet(1.0)})
        return ck.solve(scene, 0.05, form=form)

    once = solved(ck.Neumann(1.0)).work
    for flux in (lambda u: 1 - u, lambda u: 1 - u**3, lambda u: np.exp(-3 * u)):
        solution = solved(ck.NonlinearFlux(flux))
        assert solution.report.iterations == 0
        assert "converged in" in solution.report.reason
        assert solution.work.closest_point_queries == once.closest_point_queries
        assert getattr(solution.work, "queries", None) == getattr(once, "queries", None)


def test_one_flux_on_both_sides_of_a_boundary():
    """A cut through a circle that loses heat on both sides, as Robin conditions do."""
    cut = ck.source("analytic.point", at=[1, 0])

    def solved(condition):
        scene = ck.Scene(ck.source("analytic.circle"), ck.Poisson(1.0), [ck.Boundary("cut", cut, both=condition)])
        return ck.solve(scene, 0.05).evaluate(on_circle(np.linspace(0.1, 6.1, 50)))

    np.testing.assert_allclose(solved(ck.NonlinearFlux(lambda u: -2 * u)), solved(ck.Robin(1.0, 2.0)), atol=1e-7)


def test_a_flux_at_a_point_of_a_surface_is_taken_or_refused_as_robin_is():
    pin = ck.source("analytic.point", at=[0, 0, 1])

    def answer(condition):
        scene = ck.Scene(ck.source("analytic.sphere"), ck.Poisson(0.0), [ck.Boundary("pin", pin, both=condition)])
        try:
            return ck.solve(scene, 0.2).values
        except ck.CpmkitError as error:
            return str(error).replace("Robin", "").replace("NonlinearFlux", "")

    robin, flux = answer(ck.Robin(1.0, 2.0)), answer(ck.NonlinearFlux(lambda u: -2 * u))
    if isinstance(robin, str):
        assert isinstance(flux, str)
        assert "give `both`" not in flux
    else:
        np.testing.assert_allclose(flux, robin, atol=1e-7)


@pytest.mark.parametrize(
    ("form", "solver"), [("collocation", "direct"), ("collocation", "reference"), ("galerkin", "direct")]
)
def test_a_flux_that_does_not_change_with_u_fixes_no_constant(form, solver):
    """It is a Neumann condition; where the data do not balance, as from a guess at which it is flat, it is refused."""
    arc, x = ck.source("analytic.arc", start=0.3, end=2.7), on_circle(np.linspace(0.3, 2.7, 50))

    def solved(condition):
        return ck.solve(ck.Scene(arc, ck.Poisson(1.0), edge=condition), 0.1, form=form, solver=solver).evaluate(x)

    np.testing.assert_allclose(solved(ck.NonlinearFlux(lambda u: 0 * u - 1.2)), solved(ck.Neumann(-1.2)), atol=1e-7)
    assert solved(ck.NonlinearFlux(lambda u: -(u**3))).min() > 1.0
    with pytest.raises(ck.SceneError, match=r"does not change with u at the values .*; give another guess"):
        solved(ck.NonlinearFlux(lambda u: -(u**3), guess=0.0))


@pytest.mark.parametrize("form", ["collocation", "galerkin"])
def test_different_fluxes_at_one_place_are_refused(form):
    circle, axis = tilted_circle()
    boundaries = [
        ck.Boundary(name, circle, left=ck.NonlinearFlux(flux), right=ck.Dirichlet(1.0), left_of=axis)
        for name, flux in (("one", lambda u: -u), ("other", lambda u: -2 * u))
    ]
    with pytest.raises(ck.SceneError, match=r"'one' and 'other' lie at the same place,? .*differ"):
        ck.solve(ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(1.0), boundaries), 0.2, form=form)


def test_an_equation_in_time_does_not_take_it():
    with pytest.raises(ck.SceneError, match="the edge's condition: 'nonlinear flux' needs a steady equation"):
        ck.Scene(
            ck.source("analytic.arc", start=0.0, end=2.0),
            ck.Heat(1.0, until=1.0, step=0.1),
            edge=ck.NonlinearFlux(lambda u: -u),
        )
