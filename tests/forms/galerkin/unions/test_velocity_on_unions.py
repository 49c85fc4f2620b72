"""A velocity on unions of members of different dimension: what it takes through junctions, and to ends of curves."""

import numpy as np
import pytest
from union_problems import BALL, RING, ROD, SPHERE, VESSEL, Problem, in_ball, on_ring, on_sphere, rod_on_sphere

import cpmkit as ck

RADIUS, LENGTH = 0.05, 2.0
ALONG_THE_VESSEL = np.array([1.1, -0.1, 0.75]) / np.linalg.norm([1.1, -0.1, 0.75])


def rotation(x):
    """The velocity of a rotation about the x axis, which flows through the equator."""
    return 3 * np.stack([0 * x[:, 0], -x[:, 2], x[:, 1]], axis=1)


def flow_through_the_equator(conservative):
    """u = x + |z| on the sphere and v = x on its equator."""
    both = ck.source("union", members=[SPHERE, RING])
    of_sphere = lambda x: 3 * (x[:, 0] + np.abs(x[:, 2])) + 3 * np.sign(x[:, 2]) * x[:, 1]  # noqa: E731
    f = ck.MemberData(both, [of_sphere, lambda x: 3 * x[:, 0] - 2])
    a = ck.MemberData(both, [1.0, 2.0])
    problem = ck.Elliptic(f=f, diffusivity=a, c=1.0, velocity=rotation, conservative=conservative)
    return Problem(ck.Scene(both, problem), {1: lambda x: x[:, 0], 2: lambda x: x[:, 0] + np.abs(x[:, 2])})


@pytest.mark.parametrize("conservative", [True, False])
def test_flow_through_a_junction_keeps_the_order(conservative):
    problem, points = flow_through_the_equator(conservative), {1: on_ring(), 2: on_sphere()}
    errors = []
    for spacing in (0.2, 0.1, 0.05):
        solution = ck.solve(problem.scene, spacing, solver="multigrid", estimate=False)
        assert solution.report.iterations <= 20
        errors.append(problem.largest_error(solution, points))
    assert errors[-1] < 3e-5
    assert np.log2(errors[0] / errors[-1]) / 2 > 2.2


def rod_with_flow(speed, conservative, resistance):
    """Return what flows into the sphere, and the value at the rod's end there, for the value 1 at its far end.

    The rod's equation is solved in closed form; the value on the circle of its radius is G times what flows in.
    """
    value, middle, _ = rod_on_sphere(RADIUS)  # of a rod with c = 1 and no flow
    g = value * np.sinh(1) / (middle - value * np.cosh(1))
    if conservative:  # the sphere gets F = v' - w v, and v = -F / w + C exp(w (x - 3))
        # at the joint the diffusive part F + w v has the resistance: v - G F = R (F + w v)
        e, one = np.exp(-speed * LENGTH), 1 - resistance * speed
        flow, factor = np.linalg.solve([[-1 / speed, 1.0], [-one / speed - g - resistance, one * e]], [1.0, 0.0])
        return flow, -flow / speed + factor * e
    factor = 1 / (1 - np.exp(-speed * LENGTH) * (1 - (g + resistance) * speed))
    flow = speed * factor * np.exp(-speed * LENGTH)
    return flow, (g + resistance) * flow


@pytest.mark.parametrize("resistance", [0.0, 0.7])
@pytest.mark.parametrize("conservative", [True, False])
@pytest.mark.parametrize("speed", [-3.0, 2.0])  # to the sphere, and from it
def test_a_rod_brings_what_its_velocity_takes_along_at_any_spacing(speed, conservative, resistance):
    both = ck.source("union", members=[SPHERE, ROD])
    problem = ck.Elliptic(
        c=ck.MemberData(both, [1.0, 0.0]),
        velocity=ck.MemberData(both, [0.0, [speed, 0, 0]]),
        conservative=conservative,
    )
    junction = ck.Junction(radius=RADIUS, resistance=resistance)
    scene = ck.Scene(both, problem, edge={1001: ck.Dirichlet(1.0)}, junctions=junction)
    flow, value = rod_with_flow(speed, conservative, resistance)
    for spacing in (0.2, 0.1):
        solution = ck.solve(scene, spacing, estimate=False)
        assert any("end of a curve near (1, 0, 0)" in text for text in solution.warnings) != conservative
        assert solution.integrate(dim=2) == pytest.approx(flow, rel=0.02 * (spacing / 0.2) ** 1.5)
        assert solution.of_dimension(1).evaluate([1, 0, 0]) == pytest.approx(value, rel=0.02 * (spacing / 0.2) ** 1.5)


@pytest.mark.parametrize("curve", [RING, ROD], ids=["ring", "rod"])
def test_a_conservative_velocity_keeps_the_total(curve):
    both = ck.source("union", members=[SPHERE, curve])

    def to_the_sphere(x):
        return np.outer(np.minimum(x[:, 0] - 2.9, 0), [1.0, 0, 0])

    velocity = rotation if curve is RING else ck.MemberData(both, [rotation, to_the_sphere])
    heat = ck.Heat(
        initial=lambda x: np.exp(-4 * ((x - [1.0, 0.6, 0]) ** 2).sum(axis=1)),
        until=0.2,
        step=0.01,
        frames=3,
        velocity=velocity,
        conservative=True,
    )
    junction = ck.Junction(radius=None if curve is RING else RADIUS)
    solution = ck.solve(ck.Scene(both, heat, junctions=junction), 0.2, estimate=False)
    totals = [frame.integrate(dim=1) + frame.integrate(dim=2) for frame in solution.frames]
    np.testing.assert_allclose(totals, totals[0], rtol=1e-11)


@pytest.mark.parametrize("conservative", [True, False])
def test_constants_pass_along_a_vessel(conservative):
    both = ck.source("union", members=[BALL, VESSEL])
    velocity = ck.MemberData(both, [0.0, (20 * ALONG_THE_VESSEL).tolist()])
    problem = ck.Elliptic(f=0.5, c=0.5, velocity=velocity, conservative=conservative)
    scene = ck.Scene(both, problem, edge={1000: ck.Dirichlet(1.0)}, junctions=ck.Junction(radius=0.02))
    solution = ck.solve(scene, 0.2, estimate=False)
    np.testing.assert_allclose(solution.evaluate(in_ball(300)), 1.0, atol=1e-10)
    assert solution.of_dimension(1).evaluate([0.0, 0.05, 0.4]) == pytest.approx(1.0, abs=1e-10)
