"""Closest points with noise: it is measured, tolerances follow it, and it is warned of by its size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bare import Bare
from extremes.bare_curves import case
from extremes.curve_arcs import graph_counts
from extremes.noisy import Noisy
from made_cases import CASES, source_of

import cpmkit as ck
from cpmkit.manifold.local_source import measure_noise
from cpmkit.plugin import localize

SPHERE = ck.source("analytic.sphere", center=[0, 0, 0])


def noise_of(source, spacing):
    return measure_noise(localize(source, np.zeros(source.dim)), spacing).noise


@pytest.mark.parametrize("size", [1e-7, 1e-4, 1e-2])
def test_noise_is_measured(size):
    assert noise_of(Noisy(SPHERE, size), 0.1) == pytest.approx(size / np.sqrt(3), rel=0.3)


#: One of each kind; what takes long to be made has a run of its own.
KINDS = {one.kind: one for one in CASES if "far from zero" not in str(one)}.values()
DEAR = ("levelset", "klein", "pointcloud")


@pytest.mark.parametrize(
    "case",
    [pytest.param(one, marks=[pytest.mark.slow] * one.kind.startswith(DEAR)) for one in KINDS],
    ids=str,
)
def test_sources_of_plugins_have_none(case):
    source = source_of(case)
    spacing = float(np.ptp(source.bounds, axis=0).max()) / 20
    if source.manifold_dim in (1, 2):
        assert noise_of(source, spacing) == 0


class Biased(Bare):
    """Feet that are wrong by a smooth function of the query."""

    def closest_point(self, x, /):
        answer = self.source.closest_point(x)
        return replace(answer, points=answer.points + 0.01 * np.sin(x[:, [1, 2, 0]]))


def test_an_error_that_varies_smoothly_is_no_noise():
    assert noise_of(Biased(SPHERE), 0.1) < 1e-6


def sphere_errors(size, spacing):
    """Return the largest error of u = x, as a share of its range, the floor of the estimate, and the warnings."""
    scene = ck.Scene(Noisy(SPHERE, size), ck.ScreenedPoisson(lambda x: 3 * x[:, 0]))
    solution = ck.solve(scene, spacing=spacing, form="galerkin")
    points = np.random.default_rng(0).normal(size=(400, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    error = float(np.abs(solution.evaluate(points) - points[:, 0]).max()) / 2
    return error, solution.discretized.source_error(), solution.warnings


@pytest.mark.parametrize(
    ("size", "spacing"),
    [(1e-3, 0.24), *(pytest.param(*one, marks=pytest.mark.slow) for one in [(1e-4, 0.24), (1e-4, 0.12), (1e-3, 0.12)])],
)
def test_a_noisy_sphere_is_as_right_as_its_noise_allows(size, spacing):
    error, floor, warnings = sphere_errors(size, spacing)
    assert error < 2e-3
    assert floor > 0.3 * error
    noisy = [text for text in warnings if "uncertain by about 0.0005" in text and "take none below 0.1" in text]
    assert len(noisy) == (size > 1e-3 * np.sqrt(3) * spacing)


@pytest.mark.parametrize("kind", ["circle", "ellipse", "T"])
@pytest.mark.parametrize("share", [1e-6, 4e-3])
def test_noisy_curves_have_the_right_ends_and_loops(kind, share):
    one = case(kind, 10)
    scene = ck.Scene(Noisy(one.curve, share * one.spacing), ck.ScreenedPoisson(1.0))
    sampled = ck.discretize(scene, one.spacing, form="galerkin").sampled
    assert graph_counts(sampled.mesh.cells) == one.curve.truth
    assert sampled.samples.weights.sum() == pytest.approx(one.curve.length, rel=5e-3)


def test_no_smaller_spacing_is_advised_where_noise_is_the_fault():
    circles = [ck.source("analytic.circle", center=[x, 0], radius=r) for x, r in ((0, 1.0), (3, 0.01))]
    scene = ck.Scene(Noisy(ck.source("union", members=circles), 5e-4), ck.ScreenedPoisson(1.0))
    message = " ".join(ck.discretize(scene, 0.2, form="galerkin").sampled.warnings)
    assert "is too small for the lattice" in message
    assert "compute closest points more exactly" in message
    assert "use a smaller spacing" not in message
