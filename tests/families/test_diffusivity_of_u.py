"""Diffusivities that depend on u: orders and steps, laws of total variation, conditions, and refusals."""

import numpy as np
import pytest
from model_problems import order_of, sphere_points

import cpmkit as ck
from cpmkit.errors import ConvergenceError, InputError, SceneError

SPHERE, CIRCLE = ck.source("analytic.sphere"), ck.source("analytic.circle", center=(0, 0))
POINTS = sphere_points(500)
W, MEAN = np.array([0.3, 1.0, -0.5]), 0.4
HEIGHT = 0.3
REGULAR = 0.1
CUT = {"left": ck.Dirichlet(1.0), "right": ck.Dirichlet(0.0)}


def u(x):
    return x @ W + MEAN


def right_side(a, by_value, by_slope, c=1.0):
    """f for u on the unit sphere, where |grad u|^2 = |W|^2 - (W . x)^2 and Lap u = -2 W . x."""

    def f(x):
        along = x @ W
        s = np.sqrt(W @ W - along**2)
        v = u(x)
        return 2 * a(v, s) * along - by_value(v, s) * s**2 + by_slope(v, s) * s * along + c * v

    return f


def power(p):
    def a(_, s):
        return (s**2 + REGULAR**2) ** (p / 2 - 1)

    return a, lambda v, s: 0 * v, lambda _, s: (p - 2) * s * (s**2 + REGULAR**2) ** (p / 2 - 2)


def errors_and_steps(problem, spacings):
    found = []
    for spacing in spacings:
        solution = ck.solve(ck.Scene(SPHERE, problem), spacing)
        off = solution.evaluate(POINTS) - u(POINTS)
        found.append((np.sqrt(np.mean(off**2)) / np.ptp(u(POINTS)), len(solution.history)))
    return zip(*found, strict=True)


def squared(_given=True):
    f = right_side(lambda v, s: 1 + v**2, lambda v, s: 2 * v, lambda v, s: 0 * v)
    return ck.NonlinearDiffusion(lambda v: 1 + v**2, f, c=1.0, by_value=(lambda v: 2 * v) if _given else None)


def test_one_plus_the_square_of_u():
    spacings = (0.5, 0.4, 0.3)
    errors, steps = errors_and_steps(squared(), spacings)
    assert order_of(spacings, errors) > 2
    assert errors[-1] < 3e-4
    assert max(steps) <= 6


@pytest.mark.slow
@pytest.mark.parametrize("p", [1.5, 3.0, 4.0])
def test_p_laplacians(p):
    spacings = (0.3, 0.2, 0.133)
    problem = ck.PLaplacian(p, right_side(*power(p)), 1.0, regularization=REGULAR)
    errors, steps = errors_and_steps(problem, spacings)
    assert order_of(spacings, errors) > 2
    assert max(steps) <= 9


@pytest.mark.parametrize("p", [1.5, 4.0])
def test_p_laplacians_coarsely(p):
    problem = ck.PLaplacian(p, right_side(*power(p)), 1.0, regularization=REGULAR)
    errors, steps = errors_and_steps(problem, (0.4,))
    assert errors[0] < 1e-3
    assert steps[0] <= 9


def test_differences_and_lagging_give_what_derivatives_give():
    def found(**given):
        problem = ck.NonlinearDiffusion(lambda v, s: 1 + v**2 + s, lambda x: 2 * x[:, 0], 1.0, **given)
        return ck.solve(ck.Scene(CIRCLE, problem), 0.1).values

    exact = found(by_value=lambda v, _: 2 * v, by_slope=lambda _, s: 1 + 0 * s)
    assert np.abs(found() - exact).max() < 1e-8 * np.abs(exact).max()
    assert np.abs(found(method="lagged") - exact).max() < 1e-5 * np.abs(exact).max()


@pytest.mark.parametrize("a", [lambda v: 2.5 + 0 * v, lambda v, s: 2.5 + 0 * s, lambda v, s, x: 2.5 + 0 * x[:, 0]])
def test_a_constant_is_the_linear_problem(a):
    ring = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), left=ck.Robin(1.0, 2.0, 1.0), right=ck.Neumann(1))
    f = {"f": lambda x: x[:, 1], "c": 1.0}
    found = ck.solve(ck.Scene(CIRCLE, ck.NonlinearDiffusion(a, **f), [ring]), 0.1)
    linear = ck.solve(ck.Scene(CIRCLE, ck.Elliptic(diffusivity=2.5, **f), [ring]), 0.1)
    assert np.abs(found.values - linear.values).max() < 1e-9
    assert found.flux("cut", "left") == pytest.approx(linear.flux("cut", "left"), abs=1e-9)


def test_values_on_both_sides_of_a_point():
    """With a = 1 + u, u + u^2 / 2 is linear along the circle."""
    cut = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), **CUT)
    theta = np.linspace(0.01, 2 * np.pi - 0.01, 60)
    points = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    exact = np.sqrt(1 + 3 * theta / (2 * np.pi)) - 1
    spacings, errors = (0.2, 0.1, 0.05), []
    for spacing in spacings:
        solution = ck.solve(ck.Scene(CIRCLE, ck.NonlinearDiffusion(lambda v: 1 + v), [cut]), spacing)
        errors.append(np.abs(solution.evaluate(points) - exact).max())
        assert len(solution.history) <= 5
    assert order_of(spacings, errors) > 2
    assert solution.flux("cut", "left") == pytest.approx(1.5 / (2 * np.pi) / 2, rel=1e-5)


@pytest.mark.parametrize("left", [ck.Neumann(0.5), ck.Robin(1.0, 2.0, 3.0)])
def test_newton_stays_quadratic_beside_slopes_that_are_given(left):
    cut = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), left=left, right=ck.Dirichlet(0.0))
    problem = ck.NonlinearDiffusion(lambda v: 1 + v**2, lambda x: x[:, 0], 1.0)
    assert len(ck.solve(ck.Scene(CIRCLE, problem, [cut]), 0.1).history) <= 6


@pytest.mark.filterwarnings("ignore::cpmkit.CpmkitWarning")
def test_a_free_constant_and_the_mean():
    """Nothing fixes a constant: the solution is the one of mean zero, a constant part of f is left out, and told."""
    found = [
        ck.solve(ck.Scene(CIRCLE, ck.PLaplacian(3.0, lambda x, k=k: x[:, 0] + k, regularization=REGULAR)), 0.1)
        for k in (0.0, 0.5)
    ]
    assert all(abs(solution.integrate()) < 1e-9 for solution in found)
    assert np.abs(found[0].values - found[1].values).max() < 1e-7
    assert found[1].warnings
    assert not found[0].warnings


@pytest.mark.parametrize("problem", [
    ck.NonlinearDiffusion(lambda v, s: 1 + v**2 + s, 2.0, 2.0),
    ck.PLaplacian(4.0, 2.0, 2.0, regularization=1e-2),
    ck.TotalVariation(1.0, 2.0, 1e-2),
])  # fmt: skip
def test_constants_stay(problem):
    assert np.abs(ck.solve(ck.Scene(CIRCLE, problem), 0.2).evaluate([[1, 0], [0, -1]]) - 1).max() < 1e-7


def step(x):
    return 1.0 * (x[:, 1] > HEIGHT)


def test_total_variation_lessens_its_energy_and_keeps_a_step():
    """The exact solution has plateaus 1 - 2 / (c A) and 2 / (c B), A and B the lengths of the arcs."""
    c, scene = 20.0, {}
    for method in ("lagged", "newton"):
        scene[method] = ck.solve(ck.Scene(CIRCLE, ck.TotalVariation(step, c, 0.01, method=method)), 0.05)
    lagged, newton = scene["lagged"], scene["newton"]
    energies = np.array([one.energy for one in lagged.history])
    assert len(energies) > 5
    assert np.all(np.diff(energies) <= 1e-8 * np.abs(energies).max())
    assert newton.history[-1].energy == pytest.approx(energies[-1], rel=1e-7)
    assert np.abs(lagged.values - newton.values).max() < 1e-4
    theta = np.linspace(0, 2 * np.pi, 600)
    points = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    values, arc = newton.evaluate(points), np.pi - 2 * np.arcsin(HEIGHT)
    above, below = values[points[:, 1] > HEIGHT + 0.2], values[points[:, 1] < HEIGHT - 0.2]
    assert np.abs(above - 1 + 2 / (c * arc)).max() < 0.01
    assert np.abs(below - 2 / (c * (2 * np.pi - arc))).max() < 0.01


def test_what_is_refused(monkeypatch):
    scene = ck.Scene(CIRCLE, ck.NonlinearDiffusion(lambda v: 1 + v**2, 1.0, 1.0))
    with pytest.raises(SceneError, match="no diffusivity that depends on u"):
        ck.solve(scene, 0.2, form="collocation")
    with pytest.raises(InputError, match="must be a function of u"):
        ck.NonlinearDiffusion(2.0)
    with pytest.raises(InputError, match="at least 1"):
        ck.PLaplacian(0.5, regularization=0.1)
    with pytest.raises(InputError, match="newton or lagged"):
        ck.PLaplacian(3, regularization=0.1, method="picard")
    with pytest.raises(InputError, match="above zero"):
        ck.solve(ck.Scene(CIRCLE, ck.NonlinearDiffusion(lambda v: v - 5, 1.0, 1.0)), 0.2)
    with pytest.raises(SceneError, match="one channel"):
        ck.solve(ck.Scene(CIRCLE, ck.NonlinearDiffusion(lambda v: 1 + v**2, [1.0, 2.0], 1.0)), 0.2)
    monkeypatch.setattr("cpmkit.families.quasilinear.MOST_STEPS", {"lagged": 5})
    problem = ck.PLaplacian(6.0, lambda x: 5 * x[:, 0], 1.0, regularization=1e-3, method="lagged")
    with pytest.raises(ConvergenceError, match="did not converge in 5 steps"):
        ck.solve(ck.Scene(CIRCLE, problem), 0.2)
