"""Boundaries at one place, fluxes at points, open ends and sharp tips are warned of or refused."""

import numpy as np
import pytest

import cpmkit as ck

SPHERE = ck.source("analytic.sphere")
ONE, ZERO = ck.Dirichlet(1.0), ck.Dirichlet(0.0)


def ring(height=0.3, direction=(0, 0, 1)):
    radius = np.sqrt(1 - height**2)
    return ck.source("analytic.circle", center=[0, 0, height], radius=radius, normal=list(direction))


def solved(boundaries, surface=SPHERE, spacing=0.2, problem=None):
    return ck.solve(ck.Scene(surface, problem or ck.Laplace(), boundaries), spacing, form="collocation")


def test_two_boundaries_at_one_place_with_different_values_contradict_each_other():
    twice = [ck.Boundary("a", ring(), both=ck.Dirichlet(1.0)), ck.Boundary("b", ring(), both=ck.Dirichlet(5.0))]
    with pytest.raises(ck.SceneError, match=r"'a' and 'b' lie at the same place, near \(.*, 0.3\), and hold different"):
        solved(twice)
    point = ck.source("analytic.point", at=[0, 1])
    with pytest.raises(ck.SceneError, match="at the same place, near"):
        solved(
            [ck.Boundary("a", point, both=ONE), ck.Boundary("b", point, both=ZERO)], ck.source("analytic.circle"), 0.1
        )


@pytest.mark.parametrize("reverse", [False, True])
def test_two_at_one_place_that_agree_give_a_warning_and_are_solved(reverse):
    one = ck.Boundary("a", ring(), left=ONE, right=ZERO)
    left, right = (ck.Dirichlet(0.0), ck.Dirichlet(1.0)) if reverse else (ck.Dirichlet(1.0), ck.Dirichlet(0.0))
    other = ck.Boundary("b", ring(direction=(0, 0, -1 if reverse else 1)), left=left, right=right)
    solution = solved([one, other])
    assert any("hold the same; one of them is enough" in text for text in solution.warnings)
    np.testing.assert_allclose(solution.evaluate([[0, 0, 1], [0, 0, -1]]), [1.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("condition", [ck.Neumann(1.0), ck.Robin(1.0, 2.0, 3.0)])
def test_a_flux_at_a_point_of_a_surface_is_refused(condition):
    point = ck.Boundary("well", ck.source("analytic.point", at=[0, 0, 1]), both=condition)
    with pytest.raises(ck.SceneError, match=r"boundary 'well': a .* condition at a point.*PointSource"):
        solved([point], problem=ck.ScreenedPoisson(1.0))


def arc(stop):
    return ck.source("analytic.arc", center=[0, 0, 0.3], radius=np.sqrt(0.91), start=0, end=stop, normal=[0, 0, 1])


def ends(solution):
    return [text for text in solution.warnings if "with different values on its sides" in text]


def test_open_ends_with_different_values_give_a_warning_with_their_place():
    (message,) = ends(solved([ck.Boundary("open", arc(2.0), left=ONE, right=ZERO)]))
    assert "'open' ends near (" in message
    assert "and at its other end" in message
    assert not ends(solved([ck.Boundary("open", arc(2.0), both=ONE)]))
    assert not ends(solved([ck.Boundary("closed", ring(), left=ONE, right=ZERO)]))


def lens(height):
    x = np.linspace(-0.6, 0.6, 300)
    upper = np.stack([x, height * (0.36 - x**2)], axis=1)
    return ck.source("mesh.polyline", points=np.concatenate([upper, upper[::-1] * [1, -1]]), closed=True)


def test_flanks_of_a_tip_that_face_each_other_give_a_warning_and_those_of_a_blunt_one_none():
    square = ck.source("analytic.box", lower=[-1, -1], upper=[1, 1])
    for height, told in ((0.25, 1), (2.0, 0)):
        solution = solved([ck.Boundary("lens", lens(height), left=ONE, right=ZERO)], square, 0.1)
        assert len([text for text in solution.warnings if "'lens' comes back to itself near" in text]) == told


def test_a_short_ring_around_a_limb_is_warned_of_by_its_bends_and_the_galerkin_form_separates_its_sides():
    torus = ck.source("analytic.torus", major=0.5, minor=0.15)
    around = ck.source("analytic.circle", center=[0.5, 0, 0], radius=0.15, normal=[0, 1, 0])
    ring = ck.Boundary("ring", around, left=ONE, right=ZERO)
    assert any("bends more sharply than the band is wide" in text for text in solved([ring], torus, 0.1).warnings)
    separated = ck.solve(ck.Scene(torus, ck.Laplace(), [ring]), 0.1, form="galerkin")
    points = around.mesh(0.02)[0]
    for side, value in (("left", 1.0), ("right", 0.0)):
        assert np.abs(separated.evaluate(points, side={"ring": side}) - value).max() < 1e-2


def test_a_narrow_tip_gives_a_warning_wherever_the_lattice_lies():
    """A wedge of 30 degrees along an axis of the lattice, whose medial axis passes nodes or runs between them."""
    box, spacing = ck.source("analytic.box", lower=[-1, -0.5], upper=[0.2, 0.5]), 0.05
    rise = 0.8 * np.tan(np.radians(15))
    wedge = ck.source("mesh.polyline", points=[[-0.8, -rise], [0, 0], [-0.8, rise]])
    scene = ck.Scene(box, ck.Laplace(), [ck.Boundary("wedge", wedge, left=ONE, right=ZERO)])
    for origin in [*np.random.default_rng(0).uniform(0, spacing, (3, 2)), [0.0, spacing / 2]]:
        made = ck.discretize(scene, spacing, form="collocation", origin=origin)
        (flanks,) = [one for one in made.tables.layout.meetings if one.kind == "flanks"]
        assert 0 < flanks.size < 2 * spacing
        assert np.linalg.norm(flanks.point) < 2 * spacing / np.tan(np.radians(15))
