"""Curves by finite elements: exact solutions along their length s, on which -u'' + u = f, with second order.

On a circle that is cut at one point s runs from 0, on the right of the point, to the whole length, on its left.
"""

import numpy as np
import pytest
from model_problems import on_circle, order_of

import cpmkit as ck

SPACINGS = (0.2, 0.1, 0.05)
CUT = 0.4
CIRCLE = ck.source("analytic.circle")
ANGLE = np.linspace(1e-5, 2 * np.pi - 1e-5, 500)
HELIX_SPEED = np.hypot(1.0, 1 / (2 * np.pi))


def errors_of(scene, points, exact, spacings=SPACINGS, **options):
    solutions = [ck.solve(scene, h, backend="fem", **options) for h in spacings]
    assert all(one.warnings == () for one in solutions)
    return [np.abs(one.evaluate(points) - exact).max() for one in solutions]


def u(s):
    return np.sin(1.5 * s) + 0.3 * s


def slope(s):
    return 1.5 * np.cos(1.5 * s) + 0.3


def equation(s_of):
    """Return the equation that u solves."""
    return ck.ScreenedPoisson(lambda x: 2.25 * np.sin(1.5 * s_of(x)) + u(s_of(x)))


def condition(kind, s, sign):
    """Return the condition that u keeps at s, out of a part of the curve that lies below it or, ``sign`` -1, above."""
    value, out = float(u(s)), float(sign * slope(s))
    return {
        "dirichlet": lambda: ck.Dirichlet(value),
        "neumann": lambda: ck.Neumann(out),
        "robin": lambda: ck.Robin(2.0, 3.0, 2 * out + 3 * value),
        "nonlinear": lambda: ck.NonlinearFlux(lambda v, _: out - v**3 + value**3, lambda v, _: -3 * v**2),
    }[kind]()


def after_cut(x):
    return np.mod(np.arctan2(x[:, 1], x[:, 0]) - CUT, 2 * np.pi)


def boundary_at(angle, name="cut", **conditions):
    return ck.Boundary(name, ck.source("analytic.point", at=on_circle(np.array([angle]))[0]), **conditions)


def test_a_closed_curve_has_no_conditions():
    def f(x):
        return 10 * np.sin(3 * np.arctan2(x[:, 1], x[:, 0]))

    scene, points, exact = ck.Scene(CIRCLE, ck.ScreenedPoisson(f)), on_circle(ANGLE), np.sin(3 * ANGLE)
    linear, quadratic = errors_of(scene, points, exact), errors_of(scene, points, exact, degree=2)
    assert order_of(SPACINGS, linear) > 1.9
    assert order_of(SPACINGS, quadratic) > 2.8
    assert linear[-1] < 6e-3
    assert quadratic[-1] < 3e-5


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(
    ("left", "right"),
    [("dirichlet", "dirichlet"), ("neumann", "dirichlet"), ("robin", "neumann"), ("nonlinear", "robin")],
)
def test_a_point_has_a_condition_on_each_side(left, right, degree):
    cut = boundary_at(CUT, left=condition(left, 2 * np.pi, 1), right=condition(right, 0.0, -1))
    scene = ck.Scene(CIRCLE, equation(after_cut), [cut])
    found = errors_of(scene, on_circle(CUT + ANGLE), u(ANGLE), degree=degree)
    assert order_of(SPACINGS, found) > degree + 0.8
    assert found[-1] < (4e-3 if degree == 1 else 3e-5)
    at = on_circle(np.array([CUT]))
    solution = ck.solve(scene, 0.05, backend="fem")
    sides = [solution.evaluate(at, side)[0] for side in ("left", "right", None)]
    np.testing.assert_allclose(sides, [u(2 * np.pi), u(0.0), u(2 * np.pi)], atol=4e-3)


@pytest.mark.parametrize(
    "ends", [("dirichlet", "neumann"), ("robin", "dirichlet"), ("nonlinear", "robin"), ("neumann", "nonlinear")]
)
def test_ends_of_an_arc(ends):
    arc = ck.source("analytic.arc", start=0.3, end=3.3, center=[2, 1])

    def s(x):
        return np.arctan2(x[:, 1] - 1, x[:, 0] - 2) % (2 * np.pi) - 0.3

    edge = {0: condition(ends[0], 0.0, -1), 1: condition(ends[1], 3.0, 1)}
    along = np.linspace(0, 3, 200)
    found = errors_of(ck.Scene(arc, equation(s), edge=edge), on_circle(0.3 + along, 1.0, (2, 1)), u(along))
    assert order_of(SPACINGS, found) > 1.8
    assert found[-1] < 5e-3


def test_a_helix_in_space_and_conditions_by_position():
    helix = ck.source("parametric.helix")
    length = 4 * np.pi * HELIX_SPEED

    def s(x):
        return 2 * np.pi * x[:, 2] * HELIX_SPEED

    edge = [(condition("dirichlet", 0.0, -1), "z < 1"), (condition("robin", length, 1), "z > 1")]
    t = np.linspace(0, 4 * np.pi, 300)
    points = np.stack([np.cos(t), np.sin(t), t / (2 * np.pi)], axis=1)
    found = errors_of(ck.Scene(helix, equation(s), edge=edge), points, u(HELIX_SPEED * t))
    assert order_of(SPACINGS, found) > 1.8
    assert found[-1] < 5e-3


def test_a_polyline_is_its_own_mesh_and_linear_functions_are_exact():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [1, 2, 0.5]])
    line = ck.source("mesh.polyline", points=points)
    pin = ck.Boundary("pin", ck.source("analytic.point", at=[1, 1, 0]), left=ck.Dirichlet(4.0), right=ck.Neumann(-1.0))
    scene = ck.Scene(line, ck.Laplace(), [pin], edge={0: ck.Dirichlet(0.0), 1: ck.Dirichlet(7.0)})
    solution = ck.solve(scene, backend="fem")
    assert len(solution.values) == 6
    read = solution.evaluate([[0.5, 0, 0], [1, 0.5, 0], [1, 1.5, 0], [1, 2, 0.25]])
    np.testing.assert_allclose(read, [1.0, 3.0, 6.0, 6.75], atol=1e-9)


def test_a_curve_of_a_level_set_reads_as_the_galerkin_form_does():
    ellipse = ck.source("levelset.expression", phi="x**2/4 + y**2 - 1", bounds=[[-3, -2], [3, 2]])
    at = ck.source("analytic.point", at=[2, 0])
    seam = ck.Boundary("seam", at, left=ck.Dirichlet(1.0), right=ck.Neumann(2.0), left_of=[1.9, 0.3])
    scene = ck.Scene(ellipse, ck.ScreenedPoisson("x*y"), [seam])
    points = np.array([[0, 1], [-2, 0], [0, -1], [1.999, 0.03], [1.999, -0.03]])
    own, other = ck.solve(scene, 0.03, backend="fem"), ck.solve(scene, 0.05, form="galerkin")
    np.testing.assert_allclose(own.evaluate(points), other.evaluate(points), atol=2e-3)


def test_two_materials_with_jump_flux_and_resistance_agree_with_the_galerkin_form():
    half = ck.Boundary(
        "half", ck.source("analytic.point", at=[-1, 0]), across=ck.Transmission(0.5, 1.0, resistance=0.3)
    )
    free = ck.Boundary("free", ck.source("analytic.point", at=[1, 0]), across=ck.Transmission())
    problem = ck.Elliptic(lambda x: 1 + x[:, 0], lambda x: np.where(x[:, 1] > 0, 1.0, 10.0), c=1.0)
    scene = ck.Scene(CIRCLE, problem, [half, free])
    points = on_circle(np.linspace(0.01, 6.2, 50))
    exact = ck.solve(scene, 0.05, form="galerkin").evaluate(points)
    found = errors_of(scene, points, exact)
    assert order_of(SPACINGS, found) > 1.7
    assert found[-1] < 3e-3


def test_eigenvalues_of_a_circle_are_squares():
    spacings, wanted = SPACINGS, np.array([0, 1, 1, 4, 4])
    found = [np.abs(ck.solve(ck.Scene(CIRCLE, ck.Eigen(count=5)), h, backend="fem").eigenvalues - wanted).max()
             for h in spacings]  # fmt: skip
    assert order_of(spacings, found) > 1.9
    assert found[-1] < 5e-3


def test_eigenvalues_at_the_ends_of_a_segment():
    """Linear functions: 0, and 2 over the length."""
    segment = ck.source("analytic.segment", start=[0, 0], end=[3, 4])
    solution = ck.solve(ck.Scene(segment, ck.Eigen(count=2), edge=ck.Steklov()), 0.5, backend="fem")
    np.testing.assert_allclose(solution.eigenvalues, [0, 2 / 5], atol=1e-9)


def test_heat_and_waves_go_along_a_curve():
    def start(x):
        return x[:, 0]

    for problem, factor in (
        (ck.Heat(start, until=0.5, step=0.01), np.exp(-0.5)),
        (ck.Wave(start, until=0.5, step=0.01, scheme="implicit"), np.cos(0.5)),
    ):
        solution = ck.solve(ck.Scene(CIRCLE, problem), 0.1, backend="fem")
        np.testing.assert_allclose(solution.evaluate(on_circle(ANGLE)), factor * np.cos(ANGLE), atol=5e-3)


@pytest.mark.parametrize("degree", [1, 2])
def test_a_jump_that_starts_suddenly_brings_no_heat_and_leaves_the_mean_of_a_free_constant(degree):
    seam = boundary_at(CUT, across=ck.Transmission(0.5))
    for problem in (ck.Heat(0.0, until=0.2, step=0.02), ck.Poisson(lambda x: x[:, 0])):
        solution = ck.solve(ck.Scene(CIRCLE, problem, [seam]), 0.1, backend="fem", degree=degree)
        assert solution.integrate() == pytest.approx(0.0, abs=1e-5)  # of 1e-2 if it brought any
        sides = [solution.evaluate(on_circle(np.array([CUT])), side)[0] for side in ("left", "right")]
        assert sides[0] - sides[1] == pytest.approx(0.5, abs=1e-9)


def star(*ends):
    return ck.source("union", members=[ck.source("analytic.segment", start=[0, 0], end=list(end)) for end in ends])


def test_three_curves_meet_at_a_common_vertex():
    """Harmonic: as the potential of three equal resistors whose other ends are held."""
    surface = star([1, 0], [-0.6, 0.8], [-0.6, -0.8])
    edge = [(ck.Dirichlet(3.0), "x > 0"), (ck.Dirichlet(0.0), "x < 0")]
    solution = ck.solve(ck.Scene(surface, ck.Laplace(), edge=edge), 0.1, backend="fem")
    np.testing.assert_allclose(solution.evaluate([[0, 0], [0.5, 0], [-0.3, 0.4]]), [1.0, 2.0, 0.5], atol=1e-9)


def test_a_junction_holds_a_value_on_all_of_its_sides_and_couples_no_two():
    surface, at = star([1, 0], [-0.6, 0.8], [-0.6, -0.8]), ck.source("analytic.point", at=[0, 0])
    imposed = ck.Scene(surface, ck.Laplace(), [ck.Boundary("at", at, both=ck.Dirichlet(2.0))], edge=ck.Dirichlet(0.0))
    solution = ck.solve(imposed, 0.1, backend="fem")
    np.testing.assert_allclose(solution.evaluate([[0.5, 0], [-0.3, 0.4], [-0.3, -0.4]]), 1.0, atol=1e-9)
    seam = ck.Boundary("at", at, across=ck.Transmission())
    with pytest.raises(ck.SceneError, match="'at' couples two sides, and has only one on this mesh, or three"):
        ck.solve(ck.Scene(surface, ck.ScreenedPoisson(1.0), [seam]), 0.1, backend="fem")


@pytest.mark.parametrize("low", [0.0, -0.5])
def test_curves_that_meet_between_vertices_are_refused(low):
    members = [([-1, 0], [1, 0]), ([0.06, low], [0.06, 1])]
    members = [ck.source("analytic.segment", start=start, end=end) for start, end in members]
    scene = ck.Scene(ck.source("union", members=members), ck.ScreenedPoisson(1.0))
    with pytest.raises(ck.InputError, match=r"members 0 and 1 of the union meet near \(0.06, 0\)"):
        ck.solve(scene, 0.15, backend="fem")


def test_what_curves_do_not_take():
    scene = ck.Scene(CIRCLE, ck.ScreenedPoisson(1.0), [boundary_at(0.0, both=ck.Dirichlet(1.0))])
    with pytest.raises(ck.InputError, match="'fem-pinned' pins vertices of surfaces, got a curve"):
        ck.solve(scene, 0.1, backend="fem-pinned")
    far = ck.Boundary("far", ck.source("analytic.point", at=[3, 0]), both=ck.Dirichlet(1.0))
    with pytest.raises(ck.SceneError, match="'far' is up to 2 away"):
        ck.solve(ck.Scene(CIRCLE, ck.Laplace(), [far]), 0.1, backend="fem")


def test_a_solution_is_drawn_and_integrated_on_its_segments(tmp_path):
    cut = boundary_at(CUT, left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0))
    solution = ck.solve(ck.Scene(CIRCLE, ck.Laplace(), [cut]), 0.1, backend="fem")
    mesh = solution.display_mesh()
    assert mesh.segments.shape == (len(mesh.points) - 1, 2)
    assert solution.integrate() == pytest.approx(np.pi, rel=5e-3)
    solution.save(tmp_path / "solution.vtp")
    solution.save(tmp_path / "solution.npz")
    np.testing.assert_array_equal(ck.load(tmp_path / "solution.npz").values, solution.values)
