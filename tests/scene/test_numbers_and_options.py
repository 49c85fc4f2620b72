"""Numbers are numbers, orders and options are what is offered: anything else is refused in a sentence."""

from functools import partial

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.linear.solver_options import make_solver

CIRCLE = ck.source("analytic.circle")
EASY = ck.Scene(CIRCLE, ck.ScreenedPoisson(1.0))


@pytest.mark.parametrize("kind", [ck.Dirichlet, ck.Neumann, partial(ck.Robin, 1.0, 1.0)])
@pytest.mark.parametrize("order", [0, 5, 7, "high", 2.0, True])
def test_an_order_of_a_condition_that_is_not_offered_is_refused(kind, order):
    with pytest.raises(ck.InputError, match=r"order of \w+ must be a whole number from 1 to 2"):
        kind(0.0, order=order)


@pytest.mark.parametrize("order", [0, 5, "high", 2.0, True])
def test_an_order_of_a_special_condition_that_is_not_offered_is_refused(order):
    for made in (ck.Steklov, ck.SimplySupported, partial(ck.NonlinearFlux, abs)):
        with pytest.raises(ck.InputError, match=r"order of \w+ must be a whole number from 1 to 2"):
            made(order=order)


@pytest.mark.parametrize("value", [True, b"1.0", None, np.nan, [1.0, b"2"], np.array([True])])
def test_what_is_no_number_is_no_datum(value):
    pin = ck.Boundary("pin", ck.source("analytic.point", at=[1, 0]), both=ck.Dirichlet(value))
    with pytest.raises(ck.InputError, match="boundary 'pin' must be a finite number"):
        ck.Scene(CIRCLE, ck.Laplace(), [pin])


def test_a_callable_may_return_truth_values_and_no_text():
    above = ck.solve(ck.Scene(CIRCLE, ck.ScreenedPoisson(lambda x: x[:, 0] > -2)), 0.2)
    np.testing.assert_allclose(above.evaluate([[1, 0]]), 1.0)
    with pytest.raises(ck.InputError, match="the right-hand side f must return numbers"):
        ck.Scene(CIRCLE, ck.Poisson(lambda x: np.full(len(x), "1.0")))


@pytest.mark.parametrize(
    "make",
    [
        lambda: ck.Robin(True, 1.0),
        lambda: ck.Robin(1.0, b"1"),
        lambda: ck.Elliptic(c=b"1"),
        lambda: ck.Elliptic(c=True),
        lambda: ck.Elliptic(diffusivity=True),
        lambda: ck.Heat(0.0, "1", 0.1),
        lambda: ck.Heat(0.0, 1.0, True),
        lambda: ck.Heat(0.0, 1.0, 0.1, c=b"1"),
        lambda: ck.Heat(0.0, 1.0, 0.1, frames=["0.5"]),
        lambda: ck.Heat(0.0, 1.0, 0.1, frames=True),
        lambda: ck.Eigen(near=True),
        lambda: ck.Eigen(c=b"1"),
        lambda: ck.Biharmonic(0.0, c=True),
        lambda: ck.NonlinearFlux(abs, guess="1"),
        lambda: ck.Transmission(resistance=False),
        lambda: ck.Transmission(left=b"2"),
    ],
)
def test_true_and_text_are_no_numbers(make):
    with pytest.raises(ck.InputError, match=r"got "):
        make()


@pytest.mark.parametrize("tolerance", [1.0, 2.0, np.inf, True, "1e-8", 0.0])
def test_a_tolerance_that_solves_nothing_is_refused(tolerance):
    for ask in (ck.solve, ck.explain):
        with pytest.raises(ck.InputError, match="tolerance must be"):
            ask(EASY, 0.2, solver="reference", solver_tolerance=tolerance)


@pytest.mark.parametrize("count", [0, -1, 1.5, "a", True])
def test_a_number_of_iterations_that_is_none_is_refused(count):
    for solver in ("reference", "auto"):
        with pytest.raises(ck.InputError, match=r"max_iterations of the solver .* whole number of at least 1"):
            ck.solve(EASY, 0.2, solver=solver, max_iterations=count)


def test_a_parameter_t_with_a_default_is_not_the_time():
    """The closure binds it: du/dt = 5 for 0.1 is 0.5, and steady problems take it, too."""
    heat = ck.Heat(0.0, 0.1, 0.05, f=lambda y, t=5.0: t + 0 * y[:, 0])
    np.testing.assert_allclose(ck.solve(ck.Scene(CIRCLE, heat), 0.2).evaluate([[1, 0]]), 0.5, rtol=1e-9)
    bound = ck.ScreenedPoisson(partial(lambda y, t: t + 0 * y[:, 0], t=5.0))
    np.testing.assert_allclose(ck.solve(ck.Scene(CIRCLE, bound), 0.2).evaluate([[1, 0]]), 5.0, rtol=1e-9)
    warming = ck.Heat(0.0, 0.1, 0.05, f=lambda y, *, t: 10 * t + 0 * y[:, 0], scheme="crank-nicolson", start="plain")
    np.testing.assert_allclose(ck.solve(ck.Scene(CIRCLE, warming), 0.2).evaluate([[1, 0]]), 0.05, rtol=1e-9)


def test_a_guess_is_put_right_where_the_right_side_is_zero():
    """BiCGSTAB with b = 0: there is no relative residual to aim at, and u = 0 is the solution."""
    scene = ck.Scene(CIRCLE, ck.ScreenedPoisson([lambda x: x[:, 0], 0.0]))
    system = ck.assemble(ck.discretize(scene, 0.2))
    guess = np.ones_like(system.right_side)
    u, report = make_solver("reference", {}).prepare(system.operator).solve(system.right_side, 1e-10, guess)
    assert report.converged
    assert np.abs(u[:, 0]).max() > 0.1
    np.testing.assert_array_equal(u[:, 1], 0.0)


@pytest.mark.parametrize("problem", [ck.Eigen(4), ck.Biharmonic("x"), ck.Heat("x", 0.1, 0.05)])
def test_only_steady_equations_have_a_system_to_assemble(problem):
    with pytest.raises(ck.InputError, match="takes the scene of a steady equation"):
        ck.assemble(ck.discretize(ck.Scene(CIRCLE, problem), 0.2))


@pytest.mark.parametrize("wrong", [3.0, "3", None, [3], True])
def test_a_degree_and_an_order_are_whole_numbers(wrong):
    for option in ("degree", "order"):
        with pytest.raises(ck.InputError, match=f"{option} must be .* got "):
            ck.solve(EASY, 0.2, **{option: wrong})
