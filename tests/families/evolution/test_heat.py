"""Heat in time: orders in space and time, data that move, starts and steps of any length."""

import functools
import math

import numpy as np
import pytest
from model_problems import angle_after, on_circle, order_of, sphere_points

import cpmkit as ck
from cpmkit.families.evolution.stepping import build_semidiscrete

FORMS = pytest.mark.parametrize("form", ["collocation", "galerkin"])
THETA_C = 1.022 * np.pi
SCHEMES = {"backward-euler": 1, "bdf2": 2, "crank-nicolson": 2}
travelled = angle_after(THETA_C, (0.0, 0.0))


def cut(**sides):
    at = on_circle(np.array([THETA_C]))[0]
    return ck.Boundary("cut", ck.source("analytic.point", at=at), **sides)


def circle_scene(problem, *boundaries):
    return ck.Scene(ck.source("analytic.circle"), problem, boundaries)


def around(n=1000, margin=1e-6):
    s = np.linspace(margin, 2 * np.pi - margin, n)
    return s, on_circle(THETA_C + s)


def plane_circle(normal, through):
    normal = np.asarray(normal) / np.linalg.norm(normal)
    height = normal @ through
    return ck.source("analytic.circle", center=height * normal, normal=normal, radius=math.sqrt(1 - height**2))


P = 0.27 * np.array([math.cos(0.221) * math.sin(0.132), math.sin(0.221) * math.sin(0.132), math.cos(0.132)])
SPHERE = {
    "Dirichlet": (plane_circle([1.1, 1.234, 1.321], -P), ck.Dirichlet(lambda x, t: np.exp(-2 * t) * x[:, 2])),
    "Neumann": (plane_circle([0, 1, 0], np.zeros(3)), ck.Neumann(0.0)),
}


def sphere_errors(name, spacings, order):
    """u = exp(-2 t) z by plain Crank-Nicolson, about ten steps a spacing, until t = 0.1."""
    curve, condition = SPHERE[name]
    points, errors = sphere_points(), []
    for h in spacings:
        problem = ck.Heat(
            lambda x: x[:, 2], until=0.1, step=0.1 / math.ceil(1 / h), scheme="crank-nicolson", start="plain"
        )
        scene = ck.Scene(ck.source("analytic.sphere"), problem, [ck.Boundary("curve", curve, both=condition)])
        solution = ck.solve(scene, h, order=order)
        assert solution.steps == math.ceil(1 / h)
        errors.append(np.abs(solution.evaluate(points) - np.exp(-0.2) * points[:, 2]).max())
    return errors


@pytest.mark.parametrize(("name", "bound"), [("Dirichlet", 4e-3), ("Neumann", 2.2e-3)])
def test_second_order_on_the_sphere_cheaply(name, bound):
    spacings = (0.25, 0.2, 0.14)
    errors = sphere_errors(name, spacings, 2)
    assert errors[-1] <= bound
    assert order_of(spacings, errors) >= 1.9


@pytest.mark.slow
@pytest.mark.parametrize(("name", "bounds"), [("Dirichlet", (2e-3, 4e-4)), ("Neumann", (1.1e-3, 2.5e-4))])
def test_second_order_on_the_sphere(name, bounds):
    spacings = (0.2, 0.1, 0.05)
    errors = sphere_errors(name, spacings, 2)
    assert errors[1] <= bounds[0]
    assert errors[2] <= bounds[1]
    assert order_of(spacings, errors) >= 1.9


@pytest.mark.parametrize("name", SPHERE)
def test_first_order_on_the_sphere_cheaply(name):
    errors = sphere_errors(name, (0.3, 0.25, 0.18), 1)
    assert 0.6 <= order_of((0.3, 0.25, 0.18), errors) <= 1.6
    assert errors[-1] <= 7e-2


@pytest.mark.slow
@pytest.mark.parametrize(("name", "bound"), [("Dirichlet", 2e-2), ("Neumann", 1.1e-2)])
def test_first_order_on_the_sphere(name, bound):
    errors = sphere_errors(name, (0.2, 0.1, 0.05), 1)
    assert errors[-1] <= bound
    assert order_of((0.2, 0.1, 0.05), errors) >= 0.85


@functools.cache
def evolved(time, form):
    """The semi-discrete solution by the matrix exponential."""
    from scipy.linalg import expm

    scene = circle_scene(ck.Heat(HILL, until=time, step=time), HILL_CUT)
    form = ck.discretize(scene, 0.125, form=form)
    problem = build_semidiscrete(form, scene.problem)
    M = problem.apply_mass(np.eye(form.size))
    A, b = np.linalg.solve(M, problem.stiffness.to_csr().toarray()), np.linalg.solve(M, problem.forcing(0.0))
    rest = np.linalg.solve(A, b)
    return rest + expm(-time * A) @ (form.interpolate(HILL, "u0") - rest)


def HILL(x):
    s = travelled(x)
    return np.sin(s / 2) + 0.3 * np.sin(s) + s


HILL_CUT = cut(left=ck.Dirichlet(2 * np.pi), right=ck.Dirichlet(0.0))


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("frames", [0, [0.13, 0.37]])
@FORMS
def test_order_in_time(scheme, frames, form):
    """Also where frames shorten some steps."""
    steps, errors = (0.1, 0.05, 0.025, 0.0125), []
    for step in steps:
        heat = ck.Heat(HILL, until=0.5, step=step, scheme=scheme, frames=frames)
        solution = ck.solve(circle_scene(heat, HILL_CUT), 0.125, form=form)
        errors.append(np.abs(solution.values - evolved(0.5, form)).max())
    assert abs(order_of(steps[1:], errors[1:]) - SCHEMES[scheme]) <= 0.3
    assert errors[-1] <= {1: 2e-2, 2: 1e-3}[SCHEMES[scheme]]


def moving(x, t):
    s = travelled(x)
    return np.exp(-t) * np.sin(s - t) + 0.2 * s * t


def flux(s, t):
    return np.exp(-t) * np.cos(s - t) + 0.2 * t


def source(x, t):
    """u_t - u'' of ``moving``: the sine decays as its curvature wants, and what is left is its travel."""
    s = travelled(x)
    return -np.exp(-t) * np.cos(s - t) + 0.2 * s


MOVING_SIDES = {
    "Dirichlet": {
        "left": ck.Dirichlet(lambda x, t: np.exp(-t) * np.sin(-t) + 0.4 * np.pi * t),
        "right": ck.Dirichlet(lambda x, t: np.exp(-t) * np.sin(-t)),
    },
    "Neumann": {"left": ck.Neumann(lambda x, t: flux(0.0, t)), "right": ck.Neumann(lambda x, t: -flux(0.0, t))},
    "mixed": {
        "left": ck.Robin(1.0, 2.0, lambda x, t: flux(0.0, t) + 2 * (np.exp(-t) * np.sin(-t) + 0.4 * np.pi * t)),
        "right": ck.Dirichlet(lambda x, t: np.exp(-t) * np.sin(-t)),
    },
}


@pytest.mark.parametrize("name", MOVING_SIDES)
@pytest.mark.parametrize("scheme", ["bdf2", "crank-nicolson"])
@FORMS
def test_data_that_move_on_both_sides(name, scheme, form):
    spacings, errors = (0.2, 0.1, 0.05), []
    _, points = around()
    for h in spacings:
        heat = ck.Heat(lambda x: moving(x, 0.0), until=1.0, step=0.2 * h, f=source, scheme=scheme)
        solution = ck.solve(circle_scene(heat, cut(**MOVING_SIDES[name])), h, form=form)
        errors.append(np.abs(solution.evaluate(points) - moving(points, 1.0)).max())
    assert order_of(spacings, errors) >= 1.75
    assert errors[-1] <= 5e-4


def test_advection_with_decay():
    """u = exp(-(kappa + c) t) cos(theta - t) is carried once around by a velocity of one."""
    spacings, errors = (0.2, 0.1, 0.05), []
    points = on_circle(np.linspace(0, 2 * np.pi, 500))
    for h in spacings:
        heat = ck.Heat(
            lambda x: x[:, 0],
            until=1.5,
            step=0.2 * h,
            kappa=0.3,
            velocity=lambda x: np.stack([-x[:, 1], x[:, 0]], axis=1),
            c=0.2,
        )
        exact = np.exp(-0.75) * (points @ [np.cos(1.5), np.sin(1.5)])
        errors.append(np.abs(ck.solve(circle_scene(heat), h).evaluate(points) - exact).max())
    assert order_of(spacings, errors) >= 1.9
    assert errors[-1] <= 1e-4


def test_nothing_need_pin_the_solution():
    """A closed surface keeps its heat."""
    scene = ck.Scene(ck.source("analytic.sphere"), ck.Heat(lambda x: 1 + x[:, 2], until=5.0, step=0.1))
    assert np.abs(ck.solve(scene, 0.25).evaluate(sphere_points(50)) - 1).max() < 1e-3


def start_error(h, form, monkeypatch=None):
    """Error after five steps of 1e-12 on an arc with Dirichlet ends, and on a circle with a Dirichlet cut."""
    if monkeypatch is not None:
        monkeypatch.setattr("cpmkit.forms.collocation.form.Collocation._apply_formulas", lambda self, u, datum: u)

    def u(x):
        return np.sin(2 * np.arctan2(x[:, 1], x[:, 0])) + x[:, 0]

    heat = ck.Heat(u, until=5e-12, step=1e-12)
    arc = ck.Scene(ck.source("analytic.arc", center=(0, 0), start=0.3, end=2.7), heat, edge=ck.Dirichlet(u))
    points = on_circle(np.linspace(0.3, 2.7, 1000))
    ends = np.abs(ck.solve(arc, h, form=form).evaluate(points) - u(points)).max()
    _, points = around()
    solution = ck.solve(circle_scene(ck.Heat(HILL, until=5e-12, step=1e-12), HILL_CUT), h, form=form)
    return ends, np.abs(solution.evaluate(points) - HILL(points)).max()


def test_the_shortest_steps_keep_the_initial_data(monkeypatch):
    """Ghosts that start by their own relation leave a second-order error; at their feet's values, a first-order one."""
    spacings = (0.1, 0.05, 0.025)
    ends, inside = np.transpose([start_error(h, "collocation") for h in spacings])
    assert order_of(spacings, ends) >= 1.8
    assert np.all(inside <= 2e-4)
    ends_at_feet, inside_at_feet = np.transpose([start_error(h, "collocation", monkeypatch) for h in spacings])
    assert np.all(ends_at_feet >= 8 * ends)
    assert np.all(inside_at_feet >= 20 * inside)


def test_the_shortest_steps_keep_the_initial_data_of_splines():
    spacings = (0.1, 0.05, 0.025)
    for errors in np.transpose([start_error(h, "galerkin") for h in spacings]):
        assert order_of(spacings, errors) >= 2.5
        assert errors[-1] <= 1e-5


@pytest.mark.parametrize("scheme", ["backward-euler", "bdf2"])
@FORMS
def test_the_longest_steps_lead_to_the_steady_state(scheme, form):
    boundary = cut(left=ck.Dirichlet(3.0), right=ck.Dirichlet(1.0))
    heat = ck.Heat(HILL, until=5e4, step=1e4, f=lambda x: x[:, 0], scheme=scheme)
    steady = circle_scene(ck.Poisson(lambda x: x[:, 0]), boundary)
    _, points = around()
    solution = ck.solve(circle_scene(heat, boundary), 0.05, form=form)
    assert solution.warnings == ()
    assert np.abs(solution.evaluate(points) - ck.solve(steady, 0.05, form=form).evaluate(points)).max() <= 1e-6


@FORMS
def test_crank_nicolson_with_the_longest_steps_rings_and_says_so(form):
    boundary = cut(left=ck.Dirichlet(3.0), right=ck.Dirichlet(1.0))
    steady = ck.solve(circle_scene(ck.Laplace(), boundary), 0.05, form=form).values
    swings = {}
    for start in ("plain", "smooth"):
        heat = ck.Heat(HILL, until=5e4, step=1e4, scheme="crank-nicolson", start=start)
        solution = ck.solve(circle_scene(heat, boundary), 0.05, form=form)
        swings[start] = np.abs(solution.values - steady).max()
        assert any("swing" in messages and "'bdf2'" in messages for messages in solution.warnings) == (start == "plain")
    assert swings["plain"] > 0.3
    assert swings["smooth"] < 1e-4


@FORMS
def test_inconsistent_initial_data_stay_bounded(form):
    boundary = cut(left=ck.Dirichlet(1.0), right=ck.Dirichlet(-1.0))
    for scheme in SCHEMES:
        heat = ck.Heat(0.0, until=0.2, step=0.02, scheme=scheme, frames=10)
        solution = ck.solve(circle_scene(heat, boundary), 0.05, form=form)
        assert max(np.abs(frame.values).max() for frame in solution.frames[1:]) <= 2.2


def test_channels_share_a_run():
    heat = ck.Heat([lambda x: x[:, 0], lambda x: x[:, 1], 2.0], until=0.3, step=0.02)
    together = ck.solve(circle_scene(heat), 0.1)
    alone = ck.solve(circle_scene(ck.Heat(lambda x: x[:, 1], until=0.3, step=0.02)), 0.1)
    points = on_circle(np.linspace(0, 6, 40))
    assert together.evaluate(points).shape == (40, 3)
    np.testing.assert_allclose(together.evaluate(points)[:, 1], alone.evaluate(points), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("form", "solver"), [("collocation", "reference"), ("galerkin", "multigrid")])
def test_iterative_and_direct_solvers_agree_and_work_is_counted(form, solver):
    scene = circle_scene(ck.Heat(HILL, until=0.2, step=0.02), HILL_CUT)
    direct, iterative = (ck.solve(scene, 0.05, form=form, solver=one) for one in ("direct", solver))
    _, at = around()
    np.testing.assert_allclose(iterative.evaluate(at), direct.evaluate(at), rtol=0, atol=1e-7)
    assert direct.report.iterations == 0
    assert direct.work.operator_applications == direct.steps + 1 == 11  # the first step is two
    assert iterative.work.operator_applications >= 2 * iterative.report.iterations > 0
    assert iterative.report.residual <= 1e-10


def test_a_step_that_does_not_converge_reports_the_time():
    scene = circle_scene(ck.Heat(HILL, until=3.0, step=1.0))
    with pytest.raises(ck.ConvergenceError, match=r"^At time 1, step 1 of 3: .*did not converge"):
        ck.solve(scene, 0.05, form="collocation", solver="reference", max_iterations=2)


def test_data_at_rest_are_read_once():
    target = []

    def f(x):
        target.append(len(x))
        return x[:, 0]

    counts = []
    for steps in (2, 8):
        target.clear()
        heat = ck.Heat(0.0, until=0.1, step=0.1 / steps, f=f)
        ck.solve(circle_scene(heat, cut(left=ck.Dirichlet(f), right=ck.Dirichlet(0.0))), 0.1)
        counts.append(len(target))
    assert counts[0] == counts[1]


@pytest.mark.parametrize(
    ("until", "step", "frames", "steps"),
    [(1.0, 0.3, (0.0, 0.5), 4), (0.7, 0.1, tuple(np.linspace(0, 0.7, 8)), 7), (1e-12, 1.0, (), 1)],
)
def test_steps_end_at_frames_and_at_the_end(until, step, frames, steps):
    """The first has steps to 0.3, 0.5, 0.8 and 1."""
    solution = ck.solve(circle_scene(ck.Heat(HILL, until=until, step=step, frames=frames)), 0.3)
    assert (solution.time, solution.steps) == (until, steps)
    np.testing.assert_allclose([frame.time for frame in solution.frames], frames, rtol=1e-15)


def test_wrong_arguments_are_answered():
    wrong = [
        ({"until": 0}, "until of heat must be a finite number above zero"),
        ({"step": -1}, "step of heat must be"),
        ({"scheme": "explicit"}, "bdf2 or backward-euler or crank-nicolson, got 'explicit'"),
        ({"start": "rough"}, "start of heat must be smooth or plain"),
        ({"kappa": 0}, "kappa of heat must be"),
        ({"kappa": lambda x, t: 1.0}, "kappa of heat must not depend on t"),
        ({"frames": [2.0]}, "frames of heat must be"),
        ({"frames": -1}, "frames of heat must be"),
        ({"step": 1e-12}, "makes 1e\\+12 steps"),
    ]
    for keys, messages in wrong:
        with pytest.raises(ck.InputError, match=messages):
            ck.Heat(**{"initial": 0.0, "until": 1.0, "step": 0.1, **keys})
