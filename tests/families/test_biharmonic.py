"""The biharmonic equation is solved in both forms, on closed manifolds and with supports, whatever the solver."""

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


@pytest.mark.parametrize(("form", "order", "most"), [("collocation", 1.9, 2e-4), ("galerkin", 2.8, 2e-6)])
def test_row_24_circle(form, order, most):
    spacings = (0.1, 0.05, 0.025, 0.0125)
    errors = [max_error(*on_circle_problem(), h, form=form) for h in spacings]
    assert errors[-1] <= most
    assert order_of(spacings, errors) >= order


@pytest.mark.parametrize("c", [1e-3, 1.0, 1e4, 1e8])
@pytest.mark.parametrize(("form", "other"), [("collocation", "reference"), ("galerkin", "multigrid")])
def test_both_solvers_agree(c, form, other):
    scene, points, exact = on_circle_problem(c)
    found = [ck.solve(scene, 0.05, form=form, solver=solver) for solver in ("direct", other)]
    values = [one.evaluate(points) for one in found]
    assert values[0] == pytest.approx(values[1], abs=1e-7)
    assert np.abs(values[0] - exact).max() <= 1e-3
    assert form == "collocation" or found[1].report.iterations <= 40


@pytest.mark.parametrize(("form", "order", "most"), [("collocation", 1.8, 5e-3), ("galerkin", 2.7, 1e-4)])
@pytest.mark.parametrize("c", [0.0, 1.0])
def test_a_supported_arc_and_its_laplacian(c, form, order, most):
    def laplacian(x):
        return -4 * np.sin(2 * angle(x)) - np.cos(angle(x))

    scene = ck.Scene(
        ARC,
        ck.Biharmonic(lambda x: c * value(angle(x)) + fourth(angle(x)), c=c),
        edge=ck.SimplySupported(lambda x: value(angle(x)), laplacian),
    )
    spacings, points = (0.1, 0.05, 0.025), on_circle(ON_ARC)
    solutions = [ck.solve(scene, h, form=form) for h in spacings]
    errors = [np.abs(one.evaluate(points) - value(ON_ARC)).max() for one in solutions]
    assert order_of(spacings, errors) >= order
    of_laplacian = [np.abs(one.laplacian(points) - laplacian(points)).max() for one in solutions]
    assert of_laplacian[-1] <= most
    assert order_of(spacings, of_laplacian) >= order


FORMS = pytest.mark.parametrize(("form", "order"), [("collocation", 1.8), ("galerkin", 2.7)])


def rms_over_origins(scene, exact, spacings, form, points):
    return [
        np.sqrt(np.mean([max_error(scene, points, exact, h, origin=h * o, form=form) ** 2 for o in origins(2)[:3]]))
        for h in spacings
    ]


@FORMS
def test_dirichlet_is_a_support_without_bending(form, order):
    k = 2 * np.pi / 2.4
    scene = ck.Scene(ARC, ck.Biharmonic(lambda x: k**4 * np.sin(k * (angle(x) - 0.3)), c=0), edge=ck.Dirichlet(0))
    errors = rms_over_origins(scene, np.sin(k * (ON_ARC - 0.3)), (0.1, 0.05, 0.025), form, on_circle(ON_ARC))
    assert order_of((0.1, 0.05, 0.025), errors) >= order


@FORMS
def test_neumann_is_a_guide(form, order):
    k = np.pi / 2.4
    scene = ck.Scene(ARC, ck.Biharmonic(lambda x: (1 + k**4) * np.cos(k * (angle(x) - 0.3))), edge=ck.Neumann(0))
    errors = rms_over_origins(scene, np.cos(k * (ON_ARC - 0.3)), (0.1, 0.05, 0.025), form, on_circle(ON_ARC))
    assert order_of((0.1, 0.05, 0.025), errors) >= order


@FORMS
def test_slopes_at_the_ends_fix_the_mean_of_the_laplacian(form, order):
    """u = t^2 / 2 up to a constant on an arc that is guided at both ends: Lap u = 1, and nothing else says so."""
    slope = {0: 0.0, 1: 2.4}
    scene = ck.Scene(ARC, ck.Biharmonic(0.0, c=0), edge={end: ck.Neumann(data) for end, data in slope.items()})
    points, exact, spacings = on_circle(ON_ARC), (ON_ARC - 0.3) ** 2 / 2, (0.1, 0.05, 0.025)
    solutions = [ck.solve(scene, h, form=form) for h in spacings]
    values = [one.evaluate(points) for one in solutions]
    errors = [np.ptp(u - exact) for u in values]
    assert order_of(spacings, errors) >= order
    assert np.abs(solutions[-1].laplacian(points) - 1).max() <= 1e-4
    assert not any(one.warnings for one in solutions)


@FORMS
def test_on_closed_manifolds_without_c_the_mean_is_zero(form, order):
    scene = ck.Scene(CIRCLE, ck.Biharmonic([lambda x: fourth(angle(x)), lambda x: 1 + fourth(angle(x))], c=0))
    spacings, errors = (0.1, 0.05, 0.025), []
    for h in spacings:
        with pytest.warns(ck.CpmkitWarning, match="add up to 1 times the measure"):
            solution = ck.solve(scene, h, form=form)
        assert solution.imbalances[0].value == pytest.approx((0, 1), abs=1e-2)
        errors.append(np.abs(solution.evaluate(on_circle(T)) - value(T)[:, None]).max())
    assert order_of(spacings, errors) >= order


def u(x):
    return x[:, 0] * x[:, 1] + x[:, 2]


def sphere_problem(c, boundaries=()):
    f = ck.Biharmonic(lambda x: (36 + c) * x[:, 0] * x[:, 1] + (4 + c) * x[:, 2], c=c)
    return ck.Scene(SPHERE, f, boundaries), sphere_points(), u(sphere_points())


@pytest.mark.parametrize(
    ("form", "solver", "order", "most"),
    [("collocation", "reference", 1.8, 1e-2), ("galerkin", "multigrid", 2.6, 1e-3)],
)
@pytest.mark.parametrize(("c", "cut"), [(1.0, False), (1.0, True), (0.0, True), (0.0, False)])
def test_sphere(c, cut, form, solver, order, most):
    circle = ck.source("analytic.circle", center=[0, 0, 0], radius=1.0, normal=rotation()[0])
    support = ck.SimplySupported(u, lambda x: -6 * x[:, 0] * x[:, 1] - 2 * x[:, 2])
    problem = sphere_problem(c, [ck.Boundary("circle", circle, both=support)] if cut else [])
    spacings = (0.25, 0.18, 0.125) if form == "collocation" else (0.34, 0.24, 0.17)
    errors = [max_error(*problem, h, solver=solver, form=form) for h in spacings]
    assert errors[-1] <= most
    assert order_of(spacings, errors) >= order


@FORMS
def test_two_sides_with_supports_of_their_own(form, order):
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
    errors = rms_over_origins(scene, exact(t), spacings, form, on_circle(0.4 + t))
    assert errors[-1] <= 2e-3
    assert order_of(spacings, errors) >= order


@pytest.mark.parametrize("c", [1.0, 1e4])
def test_a_constant_is_a_constant(c):
    scene = ck.Scene(SPHERE, ck.Biharmonic(c, c=c))
    for form, most in (("collocation", 1e-7), ("galerkin", 1e-8)):
        solution = ck.solve(scene, 0.3, form=form)
        assert solution.evaluate(sphere_points(200)) == pytest.approx(1.0, abs=most)
        assert solution.laplacian(sphere_points(200)) == pytest.approx(0.0, abs=most * c)


def test_moved_and_scaled_it_is_the_same():
    """With lengths ten times as large and c a ten thousandth, u is the same at the same points, and moved besides."""
    points, found = sphere_points(200), []
    for scale, shift in ((1.0, 0.0), (10.0, np.array([300.0, -20.0, 7.0]))):
        sphere = ck.source("analytic.sphere", center=[0, 0, 0] + shift * np.ones(3), radius=scale)
        problem = ck.Biharmonic(lambda x, a=scale, b=shift: u((x - b) / a) / a**4, c=3.0 / scale**4)
        solution = ck.solve(ck.Scene(sphere, problem), 0.3 * scale, form="galerkin")
        found.append((solution.evaluate(scale * points + shift), scale**2 * solution.laplacian(scale * points + shift)))
    for one, other in zip(*found, strict=True):
        assert other == pytest.approx(one, abs=1e-9)


def test_a_level_set_is_the_sphere_that_it_describes():
    described = ck.source("levelset.expression", phi="x**2 + y**2 + z**2 - 1", bounds=[[-1.2] * 3, [1.2] * 3])
    problem = ck.Biharmonic(lambda x: 37 * x[:, 0] * x[:, 1] + 5 * x[:, 2])
    found = [ck.solve(ck.Scene(surface, problem), 0.25) for surface in (SPHERE, described)]
    points = sphere_points(500)
    for read in ("evaluate", "laplacian"):
        one, other = (getattr(solution, read)(points) for solution in found)
        assert np.abs(one - other).max() <= 5e-3 * np.ptp(one)


def test_auto_takes_splines_and_multigrid_on_surfaces():
    solution = ck.solve(sphere_problem(1.0)[0], 0.2)
    assert solution.discretized.form == "galerkin"
    assert solution.report.solver == "multigrid"
    assert ck.explain(sphere_problem(1.0)[0], 0.2, dry_run=True).solver == "multigrid"


def test_channels_are_solved_together():
    scene = ck.Scene(CIRCLE, ck.Biharmonic([lambda x: 2 * x[:, 0], 1.0]))
    for form, solver in (("collocation", "direct"), ("collocation", "reference"), ("galerkin", "multigrid")):
        found = ck.solve(scene, 0.05, solver=solver, form=form).evaluate(on_circle(T))
        assert found[:, 0] == pytest.approx(np.cos(T), abs=2e-3)
        assert found[:, 1] == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("condition", [ck.Robin(1.0, 1.0), ck.Steklov()])
def test_conditions_that_leave_the_laplacian_free_are_refused(condition):
    with pytest.raises(ck.SceneError, match="a biharmonic problem takes SimplySupported"):
        ck.Scene(ARC, ck.Biharmonic(1.0), edge=condition)


def test_no_other_equation_takes_a_support():
    with pytest.raises(ck.SceneError, match="only a biharmonic problem takes"):
        ck.Scene(ARC, ck.Poisson(1.0), edge=ck.SimplySupported())


def test_c_must_not_be_below_zero():
    with pytest.raises(ck.InputError, match="c of biharmonic"):
        ck.Biharmonic(1.0, c=-1.0)


def test_not_converging_raises():
    with pytest.raises(ck.ConvergenceError, match="did not converge"):
        ck.solve(on_circle_problem()[0], 0.1, solver="reference", max_iterations=2)
    assert ck.solve(on_circle_problem()[0], 0.1, solver_tolerance=1e-18).report.converged  # rounding is accepted


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
