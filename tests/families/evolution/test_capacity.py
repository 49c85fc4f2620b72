"""The capacity, a factor of u_t: exact solutions, the total, and forms that have none."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.errors import InputError, SceneError

CIRCLE = ck.source("analytic.circle")


def test_a_number_slows_the_decay():
    heat = ck.Heat("x", until=1.0, step=0.02, capacity=2.5)
    solution = ck.solve(ck.Scene(CIRCLE, heat), 0.05)
    assert solution.evaluate([1, 0]) == pytest.approx(np.exp(-1 / 2.5), rel=2e-4)


def test_a_function_keeps_the_order():
    """u = exp(-t) (2 + x) solves b u_t = Lap u + f."""

    def b(x):
        return 1 + 0.5 * x[:, 1]

    def f(x, t):
        return np.exp(-t) * (x[:, 0] - b(x) * (2 + x[:, 0]))

    errors = []
    at = CIRCLE.closest_point(np.random.default_rng(0).normal(size=(200, 2))).points
    for spacing in (0.4, 0.2, 0.1):
        heat = ck.Heat("2 + x", until=0.5, step=0.5 * spacing**1.5, f=f, capacity=b)
        solution = ck.solve(ck.Scene(CIRCLE, heat), spacing, estimate=False)
        errors.append(np.abs(solution.evaluate(at) - np.exp(-0.5) * (2 + at[:, 0])).max())
    assert errors[-1] < 2e-4
    assert np.log2(errors[0] / errors[-1]) / 2 > 2.6


@pytest.mark.parametrize("degree", [1, 2])
def test_the_total_stays(degree):
    heat = ck.Heat("1 + x*y + z", until=0.3, step=0.02, capacity="1 + 0.5*x", frames=3)
    solution = ck.solve(ck.Scene(ck.source("analytic.sphere"), heat), 0.3, degree=degree, estimate=False)
    np.testing.assert_allclose([frame.totals[0] for frame in solution.frames], solution.totals[0], rtol=1e-11)
    weighted = solution.integrate(lambda x, u: (1 + 0.5 * x[:, :1]) * np.reshape(u, (len(x), -1)))
    np.testing.assert_allclose(weighted, solution.totals[0], rtol=1e-6)


def test_reactions_have_a_capacity():
    growth = ck.ReactionDiffusion(0.1, lambda u: u * (1 - u), kappa=0.1, until=2.0, step=0.02, capacity=2.0)
    solution = ck.solve(ck.Scene(CIRCLE, growth), 0.2)
    assert solution.evaluate([1, 0]) == pytest.approx(1 / (1 + 9 * np.exp(-1.0)), rel=1e-3)


def test_a_vessel_stores_by_its_cross_section():
    """A closed vessel in a ball, heated by 1 per length: values at t = 1 by Laplace inversion of the Bessel series."""
    radius = 0.02
    section = np.pi * radius**2
    ring = ck.source("analytic.circle", normal=[0, 0, 1], radius=0.5)
    both = ck.source("union", members=[ck.source("solid", of=ck.source("analytic.sphere")), ring])
    heat = ck.Heat(
        initial=0.0,
        until=1.0,
        step=0.02,
        f=ck.MemberData(both, [0.0, 1.0]),
        c=ck.MemberData(both, [1.0, 0.0]),
        kappa=ck.MemberData(both, [1.0, section]),
        capacity=ck.MemberData(both, [1.0, section]),
    )
    junction = ck.Junction(radius=radius, resistance=1 / (2 * np.pi * radius * 3))
    solution = ck.solve(ck.Scene(both, heat, junctions=junction), 0.15, estimate=False)
    assert solution.mean(dim=1) == pytest.approx(3.5784, rel=3e-3)
    assert solution.mean(dim=3) == pytest.approx(0.47275, rel=1e-3)
    stored = solution.integrate(dim=3) + section * solution.integrate(dim=1)
    assert solution.totals[0] == pytest.approx(stored, rel=1e-10)


def test_what_is_refused():
    for bad in (-1.0, "x"):
        with pytest.raises(InputError, match="the capacity must be above zero everywhere, got -1"):
            ck.solve(ck.Scene(CIRCLE, ck.Heat(1.0, until=1.0, step=0.1, capacity=bad)), 0.3)
    with pytest.raises(InputError, match="capacity of heat must not depend on t"):
        ck.Heat(1.0, until=1.0, step=0.1, capacity="1 + t")
    heat = ck.Heat(1.0, until=1.0, step=0.1, capacity=2.0)
    with pytest.raises(SceneError, match="has u_t without a capacity"):
        ck.solve(ck.Scene(CIRCLE, heat), 0.3, form="collocation")
    with pytest.raises(SceneError, match="has u_t without a capacity"):
        ck.solve(ck.Scene(ck.source("mesh.polyline", points=[[0, 0], [1, 0], [2, 1]]), heat), backend="fem")
