"""What ends inside a multiplet is told, and errors of eigenvalues are estimated, multiplets as a whole."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.solution.modes import compare_modes

CIRCLE, SPHERE = ck.source("analytic.circle"), ck.source("analytic.sphere")


def test_a_multiplet_that_is_cut_is_reported_with_the_count_that_has_it_whole():
    messages = r"count=6 ends inside a multiplet: 3 further .* near 6\.00.*; use count=9"
    with pytest.warns(ck.CpmkitWarning, match=messages):
        ck.solve(ck.Scene(SPHERE, ck.Eigen(6)), 0.2)
    circles = ck.source("union", members=[ck.source("analytic.circle", center=[3.0 * k, 0]) for k in range(8)])
    with pytest.warns(ck.CpmkitWarning, match="at least 6 further eigenvalues .* use count=8 or more"):
        ck.solve(ck.Scene(circles, ck.Eigen(2)), 0.2)


@pytest.mark.parametrize("near", [None, 4.1])
def test_whole_multiplets_are_not_reported(near):
    assert not ck.solve(ck.Scene(CIRCLE, ck.Eigen(5, near=near)), 0.1).warnings


@pytest.mark.parametrize(
    ("form", "least"), [pytest.param("collocation", 0.4, marks=pytest.mark.slow), ("galerkin", 1.0)]
)
def test_errors_of_eigenvalues_are_estimated(form, least):
    exact = np.repeat([0, 2, 6], [1, 3, 5])
    estimate = ck.estimate_error(ck.Scene(SPHERE, ck.Eigen(9)), 0.125, form=form)
    errors = np.abs(estimate.solution.eigenvalues - exact)
    ratio = estimate.error[1:] / errors[1:]
    assert estimate.error.shape == (9,)
    assert estimate.error[0] <= 1e-10
    assert least <= ratio.min()
    assert ratio.max() <= 3.0
    assert "error about" in str(estimate)


def test_a_mode_that_the_coarse_grid_does_not_have_has_no_estimate():
    fine, coarse = (ck.solve(ck.Scene(CIRCLE, ck.Eigen(count)), 0.1) for count in (5, 3))
    differences, _ = compare_modes(fine, coarse, fine.discretized.points)
    assert np.isfinite(differences).tolist() == [True, True, True, False, False]
