"""Boundaries at one place and fluxes at points are warned of or refused."""

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


def test_a_short_ring_around_a_limb_is_warned_of_by_its_bends_and_the_galerkin_form_separates_its_sides():
    torus = ck.source("analytic.torus", major=0.5, minor=0.15)
    around = ck.source("analytic.circle", center=[0.5, 0, 0], radius=0.15, normal=[0, 1, 0])
    ring = ck.Boundary("ring", around, left=ONE, right=ZERO)
    assert any("bends more sharply than the band is wide" in text for text in solved([ring], torus, 0.1).warnings)
    separated = ck.solve(ck.Scene(torus, ck.Laplace(), [ring]), 0.1, form="galerkin")
    points = around.mesh(0.02)[0]
    for side, value in (("left", 1.0), ("right", 0.0)):
        assert np.abs(separated.evaluate(points, side={"ring": side}) - value).max() < 1e-2
