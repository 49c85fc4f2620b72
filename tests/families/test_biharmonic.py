"""The biharmonic equation is solved to second order on closed manifolds and with supports, whatever the solver."""

import numpy as np
import pytest
from model_problems import max_error, on_circle, order_of, origins, rotation, sphere_points

import cpmkit as ck

CIRCLE = ck.source("analytic.circle", center=(0, 0))
SPHERE = ck.source("analytic.sphere")
ARC = ck.source("analytic.arc", center=(0, 0), radius=1.0, start=0.3, end=2.7)
T = np.linspace(0, 2 * np.pi, 999)
ON_ARC = np.linspace(0.3, 2.7, 999)


def angle(x):
    return np.arctan2(x[:, 1], x[:, 0])


def value(t):
    return np.sin(2 * t) + np.cos(t)


def fourth(t):
    return 16 * np.sin(2 * t) + np.cos(t)


def on_circle_problem(c=1.0):
    scene = ck.Scene(CIRCLE, ck.Biharmonic(lambda x: c * value(angle(x)) + fourth(angle(x)), c=c))
    return scene, on_circle(T), value(T)


def test_row_24_circle():
    spacings = (0.1, 0.05, 0.025, 0.0125)
    errors = [max_error(*on_circle_problem(), h) for h in spacings]
    assert errors[-1] <= 2e-4
    assert order_of(spacings, errors) >= 1.9


def test_fourth_order():
    spacings = (0.1, 0.05, 0.025)
    errors = [max_error(*on_circle_problem(), h, order=4, degree=5) for h in spacings]
    assert errors[-1] <= 3e-6
    assert order_of(spacings, errors) >= 3.7


@pytest.mark.parametrize("c", [1e-3, 1.0, 1e4])
def test_both_solvers_agree(c):
    found = [max_error(*on_circle_problem(c), 0.05, solver=solver) for solver in ("direct", "reference")]
    assert found[0] == pytest.approx(found[1], rel=1e-3)
    assert found[0] <= 1e-3


@pytest.mark.parametrize("c", [0.0, 1.0])
def test_a_supported_arc_and_its_laplacian(c):
    def laplacian(x):
        return -4 * np.sin(2 * angle(x)) - np.cos(angle(x))

    scene = ck.Scene(
        ARC,
        ck.Biharmonic(lambda x: c * value(angle(x)) + fourth(angle(x)), c=c),
        edge=ck.SimplySupported(lambda x: value(angle(x)), laplacian),
    )
    spacings, points = (0.1, 0.05, 0.025), on_circle(ON_ARC)
    solutions = [ck.solve(scene, h) for h in spacings]
    errors = [np.abs(one.evaluate(points) - value(ON_ARC)).max() for one in solutions]
    assert order_of(spacings, errors) >= 1.8
    of_laplacian = [np.abs(one.laplacian(points) - laplacian(points)).max() for one in solutions]
    assert of_laplacian[-1] <= 5e-3
    assert order_of(spacings, of_laplacian) >= 1.8


def rms_over_origins(scene, exact, spacings):
    points = on_circle(ON_ARC)
    return [
        np.sqrt(np.mean([max_error(scene, points, exact, h, origin=h * o) ** 2 for o in origins(2)[:8]]))
        for h in spacings
    ]


def test_dirichlet_is_a_support_without_bending():
    k = 2 * np.pi / 2.4
    scene = ck.Scene(ARC, ck.Biharmonic(lambda x: k**4 * np.sin(k * (angle(x) - 0.3)), c=0), edge=ck.Dirichlet(0))
    errors = rms_over_origins(scene, np.sin(k * (ON_ARC - 0.3)), (0.1, 0.05, 0.025))
    assert order_of((0.1, 0.05, 0.025), errors) >= 1.8


def test_neumann_is_a_guide():
    k = np.pi / 2.4
    scene = ck.Scene(ARC, ck.Biharmonic(lambda x: (1 + k**4) * np.cos(k * (angle(x) - 0.3))), edge=ck.Neumann(0))
    errors = rms_over_origins(scene, np.cos(k * (ON_ARC - 0.3)), (0.1, 0.05, 0.025))
    assert order_of((0.1, 0.05, 0.025), errors) >= 1.8


def u(x):
    return x[:, 0] * x[:, 1] + x[:, 2]


def sphere_problem(c, boundaries=()):
    f = ck.Biharmonic(lambda x: (36 + c) * x[:, 0] * x[:, 1] + (4 + c) * x[:, 2], c=c)
    return ck.Scene(SPHERE, f, boundaries), sphere_points(), u(sphere_points())


@pytest.mark.parametrize(("c", "cut"), [(1.0, False), (1.0, True), (0.0, True)])
def test_sphere(c, cut):
    circle = ck.source("analytic.circle", center=[0, 0, 0], radius=1.0, normal=rotation()[0])
    support = ck.SimplySupported(u, lambda x: -6 * x[:, 0] * x[:, 1] - 2 * x[:, 2])
    problem = sphere_problem(c, [ck.Boundary("circle", circle, both=support)] if cut else [])
    spacings = (0.2, 0.1414, 0.1)
    errors = [max_error(*problem, h, solver="reference") for h in spacings]
    assert errors[-1] <= 6e-3
    assert order_of(spacings, errors) >= 1.8


def test_two_sides_with_supports_of_their_own():
    """On the circle cut at a point, u and u'' jump there."""
    cut = ck.source("analytic.point", at=on_circle(np.array([0.4]))[0])

    def s(x):
        return np.mod(angle(x) - 0.4, 2 * np.pi)

    def exact(t):
        return t**3 / 50 + np.cos(t / 2)

    sides = {
        "left": ck.SimplySupported(float(exact(2 * np.pi)), float(6 * 2 * np.pi / 50 + 0.25)),
        "right": ck.SimplySupported(1.0, -0.25),
    }
    scene = ck.Scene(CIRCLE, ck.Biharmonic(lambda x: np.cos(s(x) / 2) / 16, c=0), [ck.Boundary("cut", cut, **sides)])
    t = np.linspace(1e-6, 2 * np.pi - 1e-6, 999)
    spacings = (0.1, 0.05, 0.025)
    errors = [
        np.sqrt(np.mean([max_error(scene, on_circle(0.4 + t), exact(t), h, origin=h * o) ** 2 for o in origins(2)[:6]]))
        for h in spacings
    ]
    assert errors[-1] <= 2e-3
    assert order_of(spacings, errors) >= 1.8


def test_channels_are_solved_together():
    scene = ck.Scene(CIRCLE, ck.Biharmonic([lambda x: 2 * x[:, 0], 1.0]))
    for solver in ("direct", "reference"):
        found = ck.solve(scene, 0.05, solver=solver).evaluate(on_circle(T))
        assert found[:, 0] == pytest.approx(np.cos(T), abs=2e-3)
        assert found[:, 1] == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("condition", [ck.Robin(1.0, 1.0), ck.Steklov()])
def test_conditions_that_leave_the_laplacian_free_are_refused(condition):
    with pytest.raises(ck.SceneError, match="a biharmonic problem takes SimplySupported"):
        ck.Scene(ARC, ck.Biharmonic(1.0), edge=condition)


def test_no_other_equation_takes_a_support():
    with pytest.raises(ck.SceneError, match="only a biharmonic problem takes"):
        ck.Scene(ARC, ck.Poisson(1.0), edge=ck.SimplySupported())


def test_a_problem_fixed_up_to_a_constant_is_refused():
    with pytest.raises(ck.SceneError, match="Nothing fixes the solution of the biharmonic problem"):
        ck.solve(ck.Scene(CIRCLE, ck.Biharmonic(lambda x: x[:, 0], c=0)), 0.1)


def test_c_must_not_be_below_zero():
    with pytest.raises(ck.InputError, match="c of a biharmonic problem"):
        ck.Biharmonic(1.0, c=-1.0)


def test_not_converging_raises():
    with pytest.raises(ck.ConvergenceError, match="did not converge"):
        ck.solve(on_circle_problem()[0], 0.1, tolerance=1e-18)


def test_another_back_end_refuses_it():
    with pytest.raises(ck.SceneError, match="use backend='cpm'"):
        ck.solve(ck.Scene(SPHERE, ck.Biharmonic(1.0)), 0.3, backend="fem")


def test_a_scene_file_holds_it(tmp_path):
    text = """
    [surface]
    kind = "analytic.cap"
    edge = {{ {} }}
    [problem]
    kind = "biharmonic"
    f = "x*y"
    c = 0
    """
    (tmp_path / "scene.toml").write_text(text.format('simply_supported = [0, "x"]'))
    scene = ck.load_scene(tmp_path / "scene.toml").scene
    same = ck.Scene(
        ck.source("analytic.cap"),
        ck.Biharmonic(lambda x: x[:, 0] * x[:, 1], c=0.0),
        edge=ck.SimplySupported(0.0, lambda x: x[:, 0]),
    )
    found = [ck.solve(one, 0.25).values for one in (scene, same)]
    assert np.abs(found[0] - found[1]).max() <= 1e-10 * np.abs(found[0]).max()
    assert str(scene.problem) == "Lap^2 u = f"
    (tmp_path / "scene.toml").write_text(text.format("clamped = 0"))
    with pytest.raises(ck.SceneError, match="is clamped"):
        ck.load_scene(tmp_path / "scene.toml")
