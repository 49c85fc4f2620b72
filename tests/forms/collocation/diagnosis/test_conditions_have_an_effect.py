"""What is given means something, or is refused: edges that are not there, a beta that vanishes, conductivities."""

from functools import partial

import numpy as np
import pytest
from bare import Bare
from model_problems import max_error, on_circle
from two_materials import circle_problem

import cpmkit as ck

CIRCLE = ck.source("analytic.circle")
ARC = ck.source("analytic.arc", start=0.3, end=2.7)


FORMS = pytest.mark.parametrize("form", ["collocation", "galerkin"])


def nothing(x):
    return 0 * x[:, 0]


@FORMS
@pytest.mark.parametrize("edge", [ck.Dirichlet(5.0), {0: ck.Dirichlet(5.0)}, {7: ck.Neumann()}, ck.Neumann(1.0)])
def test_a_condition_on_the_edge_of_a_closed_curve_is_refused(edge, form):
    scene = ck.Scene(CIRCLE, ck.ScreenedPoisson(1.0), edge=edge)
    for ask in (ck.solve, partial(ck.explain, dry_run=True)):
        with pytest.raises(ck.SceneError, match=r"closed.*leave it out"):
            ask(scene, 0.1, form=form)


@FORMS
@pytest.mark.parametrize("edge", [ck.Neumann(), ck.Neumann(0.0), {}])
def test_a_wall_on_the_edge_of_a_closed_curve_is_fine(edge, form):
    assert ck.solve(ck.Scene(CIRCLE, ck.ScreenedPoisson(1.0), edge=edge), 0.2, form=form).evaluate(
        [[1, 0]]
    ) == pytest.approx(1.0)


@FORMS
def test_a_loop_that_is_not_there_is_refused_by_its_number(form):
    edge = {0: ck.Dirichlet(5.0), 1: ck.Neumann(), 7: ck.Neumann()}
    with pytest.raises(ck.SceneError, match=r"loop 7, and the manifold has no such loop.*: its loops are 0, 1"):
        ck.solve(ck.Scene(ARC, ck.Laplace(), edge=edge), 0.1, form=form)
    for key in ("7", -1, 1.5):
        with pytest.raises(ck.InputError, match="a key of `edge`, the number of a loop, must be a whole number"):
            ck.solve(
                ck.Scene(ARC, ck.Laplace(), edge={0: ck.Dirichlet(5.0), 1: ck.Neumann(), key: ck.Neumann()}),
                0.1,
                form=form,
            )


def test_a_loop_too_short_for_the_spacing_is_refused():
    """A hole of a twentieth of the spacing, which no node sees, and a smaller spacing does."""
    holed = ck.source("analytic.cap", height=-np.sqrt(1 - 1e-4), axis=[1, 2.3, 4.1])
    scene = ck.Scene(holed, ck.ScreenedPoisson(1.0), edge=ck.Dirichlet(1.0))
    with pytest.raises(ck.SceneError, match=r"has no edge at spacing=0.2: .* use a smaller spacing if the edge"):
        ck.solve(scene, 0.2, form="collocation")


def test_a_surface_without_a_mesh_is_refused_with_both_remedies():
    with pytest.raises(ck.SceneError, match=r"as far as nodes lie past its edge; leave it out, .*a smaller spacing"):
        ck.solve(ck.Scene(Bare(CIRCLE), ck.ScreenedPoisson(1.0), edge=ck.Dirichlet(1.0)), 0.1, form="collocation")


@pytest.mark.parametrize("edge", [None, {0: None}, [(ck.Transmission(), "x < 0"), 0.0], ck.Transmission()])
def test_what_is_no_condition_of_an_edge_is_refused(edge):
    with pytest.raises(ck.SceneError, match=r"`edge` must be Dirichlet, .* or a table with one of them for each loop"):
        ck.Scene(ARC, ck.Laplace(), edge=edge)


@FORMS
@pytest.mark.parametrize("sides", [("both",), ("left", "right")])
def test_a_beta_that_vanishes_everywhere_is_refused(sides, form):
    robin = ck.Robin(1.0, nothing, 1.0)
    cut = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), **dict.fromkeys(sides, robin))
    with pytest.raises(ck.InputError, match=r"beta of Robin of boundary 'cut' is zero at all \d+ points; use Neumann"):
        ck.solve(ck.Scene(CIRCLE, ck.ScreenedPoisson(1.0), [cut]), 0.1, form=form)
    with pytest.raises(ck.InputError, match=r"beta of Robin of the edge's condition is zero"):
        ck.solve(ck.Scene(ARC, ck.ScreenedPoisson(1.0), edge={0: robin, 1: ck.Neumann()}), 0.1, form=form)


def test_a_beta_that_vanishes_at_one_end_alone_pins_nothing_there():
    """One condition on both ends of two arcs: on the lower one beta is zero, and its constant is free."""
    lower = ck.source("analytic.arc", center=[0, -3], start=3.4, end=6.0)
    both = ck.source("union", members=[ARC, lower])
    robin = ck.Robin(1.0, lambda x: np.where(x[:, 1] > 0, 2.0, 0.0), lambda x: np.where(x[:, 1] > 0, 6.0, 0.0))
    solution = ck.solve(ck.Scene(both, ck.Laplace(), edge=robin), 0.1, form="collocation")
    np.testing.assert_allclose(solution.evaluate([[0, 1], [0, -4]]), [3.0, 0.0], atol=1e-9)
    assert len(solution.imbalances) == 1


def test_a_callable_c_that_is_zero_on_a_piece_pins_nothing_there():
    """-u'' = cos t has the solution cos t up to a constant, of which the mean is chosen, as for c = 0."""
    u = [
        ck.solve(ck.Scene(CIRCLE, ck.Elliptic(lambda x: x[:, 0], c=c)), 0.1, form="collocation").evaluate(
            on_circle(np.linspace(0, 6, 50))
        )
        for c in (nothing, 0.0)
    ]
    np.testing.assert_allclose(u[0], u[1], atol=1e-9)
    far = ck.source("union", members=[CIRCLE, ck.source("analytic.circle", center=[4, 0])])
    screened = ck.Elliptic(lambda x: np.where(x[:, 0] > 2, 3.0, 0.0), c=lambda x: np.where(x[:, 0] > 2, 1.0, 0.0))
    solution = ck.solve(ck.Scene(far, screened), 0.1, form="collocation")
    np.testing.assert_allclose(solution.evaluate([[1, 0], [5, 0]]), [0.0, 3.0], atol=1e-8)


def without_conductivities(scene):
    """The scene with the conductivities of its transmissions left out."""
    left_out = [
        ck.Boundary(one.name, one.source, across=ck.Transmission(one.across.jump, one.across.flux, None, None, 0.7))
        for one in scene.boundaries
    ]
    return ck.Scene(scene.surface, scene.problem, left_out)


@pytest.mark.parametrize("order", [1, 2])
def test_conductivities_left_out_are_those_of_the_problem(order):
    scene, points, exact = circle_problem(5.0, 1.0, 0.7)
    told = ck.solve(scene, 0.05, order=order).evaluate(points)
    derived = ck.solve(without_conductivities(scene), 0.05, order=order).evaluate(points)
    np.testing.assert_allclose(derived, told, atol=1e-9)
    assert np.abs(told - exact).max() <= (0.2 if order == 1 else 2e-2)


def test_conductivities_of_a_smooth_diffusivity_are_of_second_order():
    """-(a u')' + u = f with a = exp(cos t) and u = sin t: a seam across which nothing happens changes little."""
    seam = ck.Boundary("seam", ck.source("analytic.point", at=[0, 1]), across=ck.Transmission())

    def f(x):
        a, s = np.exp(x[:, 0]), x[:, 1]
        return a * s + a * s * x[:, 0] + s

    t = np.linspace(0.01, 6.2, 500)
    problem = ck.Elliptic(f, diffusivity=lambda x: np.exp(x[:, 0]), c=1.0)
    errors = [
        max_error(ck.Scene(CIRCLE, problem, [seam]), on_circle(t), np.sin(t), h, form="collocation")
        for h in (0.1, 0.05, 0.025)
    ]
    assert errors[-1] <= 2e-3
    assert np.log2(errors[0] / errors[-1]) / 2 >= 1.7


@pytest.mark.parametrize(
    ("left", "right", "side"), [(1.0, None, "left"), (None, 2.0, "right"), (10.0, 10.0, "left"), (None, 5.0, "right")]
)
def test_conductivities_that_contradict_the_problem_are_refused(left, right, side):
    """At the second cut the left has the diffusivity 5, the right 1."""
    scene, _, _ = circle_problem(5.0, 1.0)
    cut = ck.Boundary("second", scene.boundaries[1].source, across=ck.Transmission(left=left, right=right))
    with pytest.raises(
        ck.SceneError, match=rf"boundary 'second' gives the conductivity .* on its {side} near .* leave"
    ):
        ck.solve(ck.Scene(scene.surface, scene.problem, [scene.boundaries[0], cut]), 0.1, form="collocation")


def test_a_constant_diffusivity_contradicts_other_conductivities():
    seam = ck.Boundary("seam", ck.source("analytic.point", at=[0, 1]), across=ck.Transmission(left=5.0, right=1.0))
    with pytest.raises(ck.SceneError, match=r"conductivity 5 on its left .* where the problem's diffusivity is 1"):
        ck.solve(ck.Scene(CIRCLE, ck.ScreenedPoisson(1.0), [seam]), 0.1, form="collocation")
