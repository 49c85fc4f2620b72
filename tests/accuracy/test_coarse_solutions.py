"""Estimates by a coarser solution and by the solution alone, and by both together."""

import numpy as np
import pytest
from model_problems import sphere_points

import cpmkit as ck
from cpmkit.accuracy.error_estimate import estimate_alone, estimate_from
from cpmkit.accuracy.estimate import shifted_origin

SPHERE, AT = ck.source("analytic.sphere"), sphere_points(2000)
#: Solutions u, and k with -Lap u = k u, or the load of -Lap u + u.
HARMONICS = {
    "quadratic": (lambda x: x[:, 0] * x[:, 1], 6),
    "cubic": (lambda x: x.prod(axis=1), 12),
    "quintic": (lambda x: 63 * x[:, 2] ** 5 - 70 * x[:, 2] ** 3 + 15 * x[:, 2], 30),
}


def pairs(u, k):
    """Yield a solution, one at 2.5 times its spacing, and the true root mean square error as a share of the range."""
    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: (k + 1) * u(x)))
    for number, spacing in enumerate((0.25, 0.2, 0.16), 1):
        fine, coarse = (
            ck.solve(scene, h, estimate=False, origin=shifted_origin(scene, h, number + place))
            for place, h in enumerate((spacing, 2.5 * spacing))
        )
        off = (fine.evaluate(AT) - u(AT)) / np.ptp(u(AT))
        yield fine, coarse, float(np.sqrt(np.mean(off**2)))


def test_both_together_are_seldomer_too_small_than_either():
    found = []
    for u, k in HARMONICS.values():
        for fine, coarse, true in pairs(u, k):
            alone, apart = estimate_alone(fine), estimate_from(fine, [coarse])
            both = estimate_from(fine, [coarse], alone=alone)
            expected = float(np.max(alone.rms / apart.unit))
            found.append(np.array([apart.of("rms"), expected, both.of("rms")]) / true)
    apart, expected, both = np.log(found).T
    assert both.min() > max(apart.min(), expected.min())
    assert np.std(both) < np.std(apart)
    assert np.log(0.8) < both.min() <= both.max() < np.log(2.3)


def test_errors_at_points_follow_the_estimate():
    u, k = HARMONICS["cubic"]
    estimate = ck.estimate_error(ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: (k + 1) * u(x))), 0.2)
    alone = estimate_from(estimate.solution, estimate.coarse_solutions)
    assert estimate.factor[0] == pytest.approx(estimate.largest[0] / alone.largest[0])
    at = estimate.at_points(AT)
    assert at.max() == pytest.approx(estimate.error[0], rel=0.3)
    np.testing.assert_allclose(at, estimate.factor[0] * alone.at_points(AT))


def test_what_a_solution_says_alone_takes_no_more_than_a_share_away():
    """A solution that is constant but for what is not resolved says nothing of its error."""
    estimate = ck.estimate_error(ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: x[:, 0])), 0.2)
    silent = estimate_alone(estimate.solution)
    none = type(silent)(0 * silent.rms, 0 * silent.largest, False)
    apart = estimate_from(estimate.solution, estimate.coarse_solutions)
    both = estimate_from(estimate.solution, estimate.coarse_solutions, alone=none)
    np.testing.assert_allclose(both.rms, 0.45 * apart.rms)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_estimates_are_shares_whatever_the_unit(scale):
    first, other = (
        ck.estimate_error(ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x, by=by: by * x.prod(axis=1))), 0.25)
        for by in (1.0, scale)
    )
    np.testing.assert_allclose(first.rms, other.rms, rtol=1e-5)
    np.testing.assert_allclose(scale * first.error, other.error, rtol=1e-5)
