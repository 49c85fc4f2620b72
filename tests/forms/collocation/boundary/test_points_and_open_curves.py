"""Points on a surface and open curves, for which no side is global, converge too."""

import numpy as np
from model_problems import max_error, order_of, rotation, sphere_points

import cpmkit as ck

SPACINGS = (0.2, 0.14, 0.1)
#: With the solver that larger systems are solved by.
OPTIONS = {"form": "collocation", "solver": "reference"}


def u(x):
    return x[:, 0] * x[:, 1] + x[:, 2]


def poisson(boundaries):
    scene = ck.Scene(
        ck.source("analytic.sphere"), ck.Poisson(lambda x: 6 * x[:, 0] * x[:, 1] + 2 * x[:, 2]), boundaries
    )
    return scene, sphere_points(), u(sphere_points())


def tilted_arc():
    q = rotation()
    arc = ck.source("analytic.arc", center=(0, 0, 0), radius=1.0, start=0.0, end=2.0, normal=q[:, 0], x_axis=q[:, 1])
    return ck.Boundary("arc", arc, both=ck.Dirichlet(u))


def test_an_open_arc():
    problem = poisson([tilted_arc()])
    errors = [max_error(*problem, h, **OPTIONS) for h in SPACINGS]
    assert errors[-1] <= 3e-3
    assert order_of(SPACINGS, errors) >= 1.8


def test_a_point():
    point = ck.source("analytic.point", at=rotation()[:, 0])
    problem = poisson([ck.Boundary("pin", point, both=ck.Dirichlet(u))])
    errors = [max_error(*problem, h, **OPTIONS) for h in SPACINGS]
    assert errors[-1] <= 1e-2
    assert order_of(SPACINGS, errors) >= 1.3


def test_an_arc_and_a_point_at_its_end():
    q = rotation()
    end = np.cos(2.0) * q[:, 1] + np.sin(2.0) * np.cross(q[:, 0], q[:, 1])
    pin = ck.Boundary("pin", ck.source("analytic.point", at=end), both=ck.Dirichlet(u))
    problem = poisson([tilted_arc(), pin])
    errors = [max_error(*problem, h, **OPTIONS) for h in SPACINGS]
    assert errors[-1] <= 3e-3
    assert order_of(SPACINGS, errors) >= 1.8


def test_a_tiny_closed_curve():
    axis = rotation()[:, 2]
    radius = 0.15  # one and a half spacings
    circle = ck.source("analytic.circle", center=np.sqrt(1 - radius**2) * axis, radius=radius, normal=axis)
    problem = poisson([ck.Boundary("ring", circle, both=ck.Dirichlet(u))])
    assert max_error(*problem, 0.1, form="collocation") <= 1e-2


def test_a_wall_that_runs_into_the_rim():
    cap = ck.source("analytic.cap", height=0.0)
    half = ck.source(
        "analytic.arc", center=(0, 0, 0), radius=1.0, start=0.0, end=np.pi, normal=(0, 1, 0), x_axis=(-1, 0, 0)
    )

    def exact(x):  # even in z, so that nothing flows through the rim
        return x[:, 0] * x[:, 1] + x[:, 2] ** 2

    def f(x):
        return 6 * x[:, 0] * x[:, 1] + 6 * x[:, 2] ** 2 - 2

    scene = ck.Scene(cap, ck.Poisson(f), [ck.Boundary("half circle", half, both=ck.Dirichlet(exact))])
    points = sphere_points()
    points = points[points[:, 2] >= 0]
    errors = [max_error(scene, points, exact(points), h, **OPTIONS) for h in SPACINGS]
    assert errors[-1] <= 1e-2
    assert order_of(SPACINGS, errors) >= 1.7


def test_a_point_above_which_nodes_stand_is_felt_like_any_other():
    pin = ck.Boundary("pin", ck.source("analytic.point", at=(0, 0, -1)), both=ck.Dirichlet(u))
    problem = poisson([pin])
    # The lattice's node zero is the sphere's centre.
    errors = [max_error(*problem, h, **OPTIONS) for h in SPACINGS]
    assert errors[-1] <= 4e-3
    assert order_of(SPACINGS, errors) >= 1.7


def test_a_point_beside_other_values_is_felt_and_warned_of():
    ring = ck.Boundary(
        "ring",
        ck.source("analytic.circle", center=(0, 0, 0.6), radius=0.8, normal=(0, 0, 1)),
        both=ck.Dirichlet(0.1),
    )
    pin = ck.Boundary("pin", ck.source("analytic.point", at=(0, 0, -1)), both=ck.Dirichlet(1.0))
    solution = ck.solve(ck.Scene(ck.source("analytic.sphere"), ck.Laplace(), [ring, pin]), 0.1, form="collocation")
    assert 0.7 < solution.evaluate([[0, 0, -1.0]])[0] < 1.1
    assert solution.evaluate(sphere_points()).min() >= 0.1 - 1e-6
    assert any("'pin'" in warning and "small circle" in warning for warning in solution.warnings)
