"""How large errors may be by one solution alone: third differences, and within a few times the error itself."""

import numpy as np
import pytest
from model_problems import sphere_points

import cpmkit as ck

SPHERE = ck.source("analytic.sphere")
AT = sphere_points(2000)
SCENE = ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: 7 * x[:, 0] * x[:, 1]))


@pytest.mark.parametrize("dim", [2, 3])
def test_of_curves_too(dim):
    kind, keys = ("analytic.circle", {}) if dim == 2 else ("parametric.helix", {})
    scene = ck.Scene(ck.source(kind, **keys), ck.ScreenedPoisson(lambda x: x[:, 0]))
    solution = ck.solve(scene, 0.2, form="galerkin", estimate=False)
    estimate = solution.discretized.estimate(solution.values)
    rms, largest = estimate.rms, estimate.largest
    assert rms.shape == largest.shape == (1,)
    assert 0 < rms[0] < largest[0] < 0.1


@pytest.mark.parametrize("spacing", [0.3, 0.2, 0.15])
def test_it_is_within_a_few_times_the_error(spacing):
    for seed in range(4):
        origin = np.random.default_rng(seed).uniform(0, spacing, 3)
        solution = ck.solve(SCENE, spacing, form="galerkin", origin=origin, estimate=False)
        off = solution.evaluate(AT) - AT[:, 0] * AT[:, 1]
        estimate = solution.discretized.estimate(solution.values)
        assert 0.5 < estimate.rms[0] / np.sqrt(np.mean(off**2)) < 2
        assert 0.5 < estimate.largest[0] / np.abs(off).max() < 2


def test_it_goes_with_the_solution_and_not_with_the_unit():
    solution = ck.solve(SCENE, 0.3, form="galerkin", estimate=False)
    two = np.hstack([solution.values, 3 * solution.values + 5])
    estimate = solution.discretized.estimate(two)
    for found in (estimate.rms, estimate.largest):
        assert found[1] == pytest.approx(3 * found[0], rel=1e-9)


@pytest.mark.parametrize(("width", "unresolved"), [(0.05, True), (0.5, False)])
def test_a_peak_that_is_not_resolved_gives_a_warning(width, unresolved):
    peak = ck.ScreenedPoisson(lambda x: np.exp(-np.sum((x - [0.6, 0, 0.8]) ** 2, axis=1) / (2 * width**2)))
    compared = ck.estimate_error(ck.Scene(SPHERE, peak), 0.2, form="galerkin")
    estimate = compared.solution.discretized.estimate(compared.solution.values)
    assert estimate.unresolved is unresolved
    assert ("hardly resolves" in compared.slow) is unresolved


def test_colours_that_jump_at_curves_are_no_peaks():
    ring = ck.source("analytic.circle", radius=0.8, center=[0, 0, 0.6])
    jump = ck.Boundary("ring", ring, left=ck.Dirichlet(0.0), right=ck.Dirichlet(lambda x: 1 + x[:, 0]))
    solution = ck.solve(ck.Scene(SPHERE, ck.Laplace(), [jump]), 0.07, form="galerkin", estimate=False)
    assert not solution.discretized.estimate(solution.values).unresolved


def test_a_wave_that_is_not_resolved_gives_a_warning():
    """sin 6z: a wave of an arc of 1.05."""
    unresolved = []
    for spacing in (0.3, 0.1):
        wave = ck.ScreenedPoisson(lambda x: (1 + 36 * (1 - x[:, 2] ** 2)) * np.sin(6 * x[:, 2]))
        solution = ck.solve(ck.Scene(SPHERE, wave), spacing, form="galerkin", estimate=False)
        unresolved.append(solution.discretized.estimate(solution.values).unresolved)
    assert unresolved == [True, False]


def test_where_nothing_was_measured_there_is_no_estimate():
    for options in ({"form": "galerkin", "degree": 1}, {"form": "galerkin", "degree": 3}, {"form": "collocation"}):
        solution = ck.solve(SCENE, 0.3, estimate=False, **options)
        assert solution.discretized.estimate(solution.values) is None
