"""Limbs as near to each other as stencils are wide: warned of, refused where the operator has a wrong sign."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit import ClosestPoints
from cpmkit.forms.data_checks import Imbalance

AXES = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


class Capsule:
    """A tube of a diameter with round ends, by its closest points; ``aside`` along the second axis."""

    dim, manifold_dim, exact = 3, 2, True

    def __init__(self, diameter, aside):
        self.start, self.end = AXES[1] * aside - 3 * AXES[0], AXES[1] * aside + 3 * AXES[0]
        self.radius = diameter / 2
        ends = np.stack([self.start, self.end])
        self.bounds = np.stack([ends.min(axis=0) - self.radius, ends.max(axis=0) + self.radius])

    def centre(self, x):
        along = np.clip((x - self.start) @ (self.end - self.start) / 36, 0, 1)
        return self.start + along[:, None] * (self.end - self.start)

    def closest_point(self, x):
        away = x - self.centre(x)
        length = np.linalg.norm(away, axis=1)
        unit = np.where(length[:, None] > 1e-12, away / np.maximum(length, 1e-12)[:, None], AXES[2])
        return ClosestPoints(self.centre(x) + self.radius * unit, np.abs(length - self.radius), np.full(len(x), -1))

    def normals(self, feet):
        return (feet.points - self.centre(feet.points)) / self.radius


def two(diameter, gap, problem):
    aside = (diameter + gap) / 2
    members = [Capsule(diameter, -aside), Capsule(diameter, aside)]
    return ck.Scene(ck.source("union", members=members), problem)


def one_and_nothing(points):
    return 1.0 * (points @ AXES[1] > 0)


@pytest.mark.parametrize(("diameter", "gap"), [(1.8, 1.5), (2, 2), (4, 1.5)])
def test_limbs_side_by_side_are_warned_of_and_the_galerkin_form_separates_them(diameter, gap):
    """-Lap u + u = f with f = 1 on one and 0 on the other: so is u."""
    scene = two(diameter, gap, ck.ScreenedPoisson(one_and_nothing))
    solution = ck.solve(scene, 1.0, form="collocation")
    assert any("bends more sharply than the band is wide" in text for text in solution.warnings)
    points = solution.discretized.points
    error = np.abs(solution.evaluate(points) - one_and_nothing(points)).max()
    assert error > 1e-3
    galerkin = ck.solve(scene, 1.0, form="galerkin").evaluate(points)
    assert np.abs(galerkin - one_and_nothing(points)).max() <= 1e-6


@pytest.mark.parametrize(
    "problem",
    [ck.Heat(one_and_nothing, until=4000.0, step=10.0), ck.Wave(one_and_nothing, until=200.0, step=0.4)],
    ids=lambda problem: problem.kind,
)
def test_a_run_that_grows_without_a_cause_is_refused(problem):
    with pytest.raises(ck.ResolutionError, match="grows without a cause: at time"):
        ck.solve(two(2, 2, problem), 1.0, form="collocation")


def test_an_eigenvalue_of_the_wrong_sign_is_refused():
    with pytest.raises(ck.ResolutionError, match=r"eigenvalue of the wrong sign, -0\.0.*; use form=.galerkin."):
        ck.solve(two(2, 2, ck.Eigen(3)), 1.0, form="collocation")
    eigen = ck.solve(two(2, 2, ck.Eigen(3)), 1.0, form="galerkin")
    assert eigen.eigenvalues[:2] == pytest.approx([0, 0], abs=1e-6)


def test_heat_that_leaks_gives_a_warning_and_heat_that_stays_none():
    """Of a tube 1.5 spacings thick it is not kept, of a sphere it is, with a source that is added to it and without."""

    def warm(points):
        return np.exp(-((points - 3.5 * AXES[0] - AXES[1]) ** 2).sum(axis=1) / 2)

    tube = ck.solve(ck.Scene(Capsule(1.5, 0.0), ck.Heat(warm, until=1.0, step=0.1)), 1.0, form="collocation")
    (message,) = [
        text for text in tube.warnings if text.startswith("Heat was gained on a piece that nothing flows out of")
    ]
    assert "3.7% of the heat there" in message
    for f in (0.0, 2.0):
        heat = ck.Heat(lambda x: np.exp(x[:, 2]), until=0.5, step=0.1, f=f)
        assert not ck.solve(ck.Scene(ck.source("analytic.sphere"), heat), 0.2, form="collocation").warnings


def test_a_mean_that_was_far_off_says_by_how_much_the_rest_may_be_off():
    (message,) = Imbalance("mean", value=(0.33,), size=(0.3,), explained=0.01).warnings
    assert "the rest of the solution may be off by up to 110.0% of its range" in message
