"""A piece of the manifold on which nothing fixes the solution is found and refused by name."""

import pytest

import cpmkit as ck


def circle(name, height, **sides):
    source = ck.source("analytic.circle", center=[0, 0, height], radius=(1 - height**2) ** 0.5, normal=[0, 0, 1])
    return ck.Boundary(name, source, **sides)


def scene(*boundaries, surface=None, problem=None, **options):
    return ck.Scene(surface or ck.source("analytic.sphere"), problem or ck.Poisson(0.0), boundaries, **options)


FREE, FIXED = ck.Neumann(0.0), ck.Dirichlet(1.0)


def test_a_closed_surface_without_conditions():
    with pytest.raises(
        ck.SceneError, match=r"Nothing fixes the solution on a piece .* 100% of the band has only Neumann"
    ):
        ck.solve(scene(), 0.2)


def test_the_neumann_side_of_a_curve():
    # Its normal points up, so its left is inside: the head over your left hand is the pole.
    with pytest.raises(ck.SceneError, match=r"bounded by 'wall' \(left\)") as error:
        ck.solve(scene(circle("wall", 0.5, left=FREE, right=FIXED)), 0.15)
    assert "(right)" not in str(error.value)


def test_a_band_between_two_walls_is_named_and_the_pinned_caps_are_not():
    walls = [circle("low", -0.4, left=FREE, right=FIXED), circle("high", 0.4, left=FIXED, right=FREE)]
    with pytest.raises(ck.SceneError, match=r"'low' \(left\), 'high' \(right\)"):
        ck.solve(scene(*walls), 0.1)


def test_dirichlet_data_anywhere_on_the_piece_pin_it():
    pin = ck.Boundary("pin", ck.source("analytic.point", at=[0, 0, 1.0]), both=FIXED)
    solution = ck.solve(scene(circle("wall", 0.5, left=FREE, right=FIXED), pin), 0.15)
    assert solution.evaluate([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]) == pytest.approx([1.0, 1.0], abs=1e-8)


def test_an_open_curve_cuts_nothing_off():
    arc = ck.source("analytic.arc", center=[0, 0, 0], radius=1.0, start=0.2, end=2.0, normal=[0.3, 0.5, 0.8])
    half = ck.Boundary("arc", arc, left=FREE, right=FIXED)
    assert ck.solve(scene(half), 0.15).evaluate([[0, 0, -1.0]]) == pytest.approx([1.0], abs=1e-8)


def test_a_dirichlet_edge_pins():
    cap = ck.source("analytic.cap", height=0.1)
    with pytest.raises(ck.SceneError, match="Nothing fixes"):
        ck.solve(scene(surface=cap), 0.15)
    assert ck.solve(scene(surface=cap, edge=FIXED), 0.15).evaluate([[0, 0, 1.0]]) == pytest.approx([1.0], abs=1e-8)


def test_screening_pins_everything():
    solution = ck.solve(scene(problem=ck.ScreenedPoisson(2.0, c=4.0)), 0.2)
    assert solution.evaluate([[0, 0, 1.0]]) == pytest.approx([0.5], abs=1e-9)
