"""Errors of solutions whose spacing is nearly the largest: coarser lattices that do not exist are not asked for."""

import pytest

import cpmkit as ck
from cpmkit.errors import ResolutionError

SCENE = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson("x"))


def test_a_lattice_less_coarse_is_taken_where_twice_the_spacing_is_too_much():
    solution = ck.solve(SCENE, 0.5)
    at = SCENE.surface.closest_point([[1.0, 0, 0], [0, 1, 0.5], [-1, 1, 1]]).points
    true = abs(solution.evaluate(at) - at[:, 0] / 3).max()
    assert 0.3 * true < solution.error.largest.max() < 0.1


def test_the_refusal_names_the_spacing_that_was_given():
    with pytest.raises(ResolutionError, match=r"The error at spacing=0\.75 is estimated .* Use spacing=0\.375 or less"):
        ck.solve(SCENE, 0.75).error  # noqa: B018
