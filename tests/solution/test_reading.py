"""A solution is read anywhere on the manifold, from the side that is asked for."""

import warnings

import numpy as np
import pytest
from model_problems import circle_jump, on_circle, sphere_points

import cpmkit as ck

CUT = on_circle(np.array([1.022 * np.pi]))


@pytest.fixture(scope="module")
def jump():
    return ck.solve(circle_jump()[0], 0.02)


def test_a_point_on_the_boundary_has_two_values(jump):
    assert jump.evaluate(CUT, side="left") == pytest.approx([22.0], abs=2e-3)
    assert jump.evaluate(CUT, side="right") == pytest.approx([2.0], abs=2e-3)
    assert jump.evaluate(CUT, side={"cut": "right"}) == pytest.approx([2.0], abs=2e-3)
    assert jump.evaluate(CUT) == pytest.approx([22.0], abs=2e-3)


def test_a_side_says_nothing_about_points_off_the_boundary(jump):
    points = on_circle(np.linspace(0, 6, 50))
    np.testing.assert_array_equal(jump.evaluate(points, side="right"), jump.evaluate(points))


def test_left_is_where_the_curve_comes_from(jump):
    theta = 1.022 * np.pi + np.array([-0.01, 0.01])
    assert np.sign(jump.signed_distance("cut", on_circle(theta))).tolist() == [1.0, -1.0]
    np.testing.assert_allclose(np.abs(jump.signed_distance("cut", on_circle(theta))), 0.01, rtol=1e-3)
    far = ck.solve(circle_jump()[0], 0.02, form="collocation")
    assert np.isnan(far.signed_distance("cut", on_circle(np.array([0.0])))).all()


def test_far_from_a_boundary_its_side_is_still_reported(jump):
    """The form of splines reads distances from the boundary itself, which ends nowhere here: there is no tube."""
    across = on_circle(np.array([1.022 * np.pi - 1.0, 1.022 * np.pi + 1.0]))
    assert np.sign(jump.signed_distance("cut", across)).tolist() == [1.0, -1.0]


def test_points_off_the_manifold_give_the_value_at_their_feet(jump):
    theta = np.linspace(0, 2, 20)
    np.testing.assert_allclose(jump.evaluate(1.03 * on_circle(theta)), jump.evaluate(on_circle(theta)), atol=1e-12)


@pytest.mark.parametrize(("form", "reach"), [("collocation", "the tube's radius"), ("galerkin", "3 spacings, 0.06,")])
def test_points_far_from_the_manifold_are_refused(form, reach):
    solution = ck.solve(circle_jump()[0], 0.02, form=form)
    with pytest.raises(ck.InputError, match=f"points must lie within {reach}.* of the manifold to be read"):
        solution.evaluate([[2.0, 0.0]])


@pytest.mark.parametrize("points", [[[np.nan, 0.0]], [[1.0, 0.0, 0.0]], [1.0], "here"])
def test_points_that_are_none(jump, points):
    with pytest.raises(ck.InputError, match="points must"):
        jump.evaluate(points)


@pytest.mark.parametrize("side", ["up", {"cut": "up"}, {"nose": "left"}])
def test_sides_that_are_none(jump, side):
    with pytest.raises(ck.InputError):
        jump.evaluate(CUT, side=side)


def test_no_points_give_no_values(jump):
    assert jump.evaluate(np.zeros((0, 2))).shape == (0,)


def test_channels_are_solved_together_and_equal_single_solves():
    def solved(value):
        circle = ck.source("analytic.circle", center=[0, 0, 0.1], radius=np.sqrt(0.99), normal=[0, 0, 1])
        scene = ck.Scene(
            ck.source("analytic.sphere"),
            ck.Laplace(),
            [ck.Boundary("c", circle, left=ck.Dirichlet(value), right=ck.Dirichlet(0.0))],
        )
        return ck.solve(scene, 0.12, solver_tolerance=1e-12).evaluate(sphere_points(200))

    together = solved([1.0, lambda x: x[:, 0], 3.0])
    assert together.shape == (200, 3)
    np.testing.assert_allclose(together[:, 0], solved(1.0), atol=1e-9)
    np.testing.assert_allclose(together[:, 1], solved(lambda x: x[:, 0]), atol=1e-9)


def test_left_on_a_surface_is_at_the_left_hand_under_the_outward_normal():
    circle = ck.source("analytic.circle", center=[0, 0, 0], radius=1.0, normal=[0, 0, 1])  # runs east
    scene = ck.Scene(
        ck.source("analytic.sphere"),
        ck.Laplace(),
        [ck.Boundary("equator", circle, left=ck.Dirichlet(1.0), right=ck.Dirichlet(2.0))],
    )
    solution = ck.solve(scene, 0.15)
    assert solution.evaluate([[0, 0, 1.0], [0, 0, -1.0]]) == pytest.approx([1.0, 2.0], abs=1e-7)  # left is north
    assert solution.signed_distance("equator", [[1.0, 0, 0.1]]) > 0


def test_both_solvers_agree():
    scene, points, _ = circle_jump()
    direct = ck.solve(scene, 0.05, solver="direct").evaluate(points)
    np.testing.assert_allclose(ck.solve(scene, 0.05, solver="reference").evaluate(points), direct, atol=1e-6)


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
def test_the_flux_of_a_side_whose_end_has_two_values_is_reported_as_infinite(form):
    """At an end with one value on both sides it is finite, and a curve from edge to edge has no end."""
    ball = ck.source("analytic.sphere")
    slit = ck.source("analytic.arc", center=[0, 0, 0], radius=1.0, normal=[1, 0, 0], start=0.3, end=1.5)
    arc = ck.source("analytic.arc", center=[0, 0, 0], radius=1.0, normal=[1, 0, 0], start=0.0, end=np.pi)
    cap = ck.source("analytic.cap", height=0.0)
    bump = ck.Dirichlet(f"1 + (y - {np.cos(0.3):.17g})*(y - {np.cos(1.5):.17g})")
    for surface, curve, left, infinite in (
        (ball, slit, ck.Dirichlet(-1.0), True),
        (ball, slit, bump, False),
        (ball, slit, ck.Neumann(0.0), False),
        (cap, arc, ck.Dirichlet(-1.0), False),
    ):
        cut = ck.Boundary("cut", curve, left=left, right=ck.Dirichlet(1.0))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ck.CpmkitWarning)
            solution = ck.solve(ck.Scene(surface, ck.ScreenedPoisson(0.0), [cut]), 0.2, form=form)
        for read in (
            lambda solution=solution: solution.flux("cut", "left"),
            lambda solution=solution: solution.flux_density("cut", "left", [[0.0, 0.8, 0.6]]),
        ):
            with warnings.catch_warnings(record=True) as issued:
                warnings.simplefilter("always")
                read()
            assert len(issued) == infinite
            for warning in issued:
                assert "The flux of each side of boundary 'cut' is infinite" in str(warning.message)
                assert warning.filename == __file__
