"""Contoured surfaces have their nodes on creases that closest points alone define."""

import dataclasses

import numpy as np
import pytest
from lens import Lens
from model_problems import order_of
from scipy.spatial.transform import Rotation

import cpmkit as ck

pytestmark = pytest.mark.filterwarnings("ignore::cpmkit.CpmkitWarning")


@pytest.mark.parametrize("h", [0.1, 0.05])
def test_nodes_at_a_crease_are_on_it(h):
    lens = Lens()
    ties = ck.discretize(ck.Scene(lens, ck.ScreenedPoisson(1.0)), h).diagnosis().ties
    assert np.linalg.norm(np.diff(ties, axis=1), axis=2).sum() == pytest.approx(2 * np.pi * lens.radius, rel=0.01)
    assert np.abs(ties[..., 2]).max() < 1e-6 * h
    assert np.abs(np.hypot(ties[..., 0], ties[..., 1]) - lens.radius).max() < 1e-5 * h


def turning(degrees):
    """Return a lens whose caps turn by an angle where they meet."""
    return Lens(float(np.sin(np.radians(degrees) / 2)))


@pytest.mark.parametrize("degrees", [10, 47, *(pytest.param(one, marks=pytest.mark.slow) for one in (20, 35, 74))])
def test_a_lens_is_of_high_order_and_its_error_is_known(degrees):
    lens, spacings, errors = turning(degrees), (0.2, 0.1, 0.05), []
    x = lens.closest_point(np.random.default_rng(0).normal(size=(500, 3))).points
    for h in spacings:
        solution = ck.solve(ck.Scene(lens, ck.ScreenedPoisson(lens.load)), h, origin=np.full(3, 0.123 * h))
        errors.append(np.sqrt(np.mean((solution.evaluate(x) - x[:, 2]) ** 2)) / (2 - 2 * lens.c))
        if h == 0.1:
            assert solution.error.rms[0] > 0.5 * errors[-1]
    assert order_of(spacings, errors) > 2.5
    assert errors[-1] < 3e-6


@dataclasses.dataclass
class Placed:
    """A lens, turned about zero and moved."""

    lens: Lens
    turn: np.ndarray
    shift: np.ndarray
    dim = 3
    manifold_dim = 2
    exact = True

    @property
    def bounds(self):
        return np.stack([self.shift - self.lens.radius, self.shift + self.lens.radius])

    def closest_point(self, x):
        feet = self.lens.closest_point((x - self.shift) @ self.turn)
        return ck.ClosestPoints(feet.points @ self.turn.T + self.shift, feet.distance, feet.edge)


@pytest.mark.parametrize(
    ("degrees", "h", "seed"),
    [(10, 0.2, 1), (14, 0.1, 3), (20, 0.2, 4), (35, 0.2, 2), (74, 0.1, 1), (89, 0.1, 1), (89, 0.05, 0), (110, 0.1, 4)],
)
def test_a_crease_has_no_gap_and_no_spur(degrees, h, seed):
    """Each position once had one: where a crease was far from the edges across it, or its vertices crowded."""
    lens = turning(degrees)
    turn, shift = Rotation.random(random_state=seed).as_matrix(), np.random.default_rng(seed).uniform(size=3) * h
    scene = ck.Scene(Placed(lens, turn, shift), ck.ScreenedPoisson(1.0))
    ties = ck.discretize(scene, h, origin=np.full(3, 0.123 * h)).diagnosis().ties
    assert np.linalg.norm(np.diff(ties, axis=1), axis=2).sum() == pytest.approx(2 * np.pi * lens.radius, rel=2e-3)
    assert (np.unique(ties.reshape(-1, 3).round(9), axis=0, return_counts=True)[1] == 2).all()


def test_curvature_and_creases_below_the_threshold_are_not_cut():
    thin = ck.source("levelset.expression", phi="x**2 + y**2 + 9*z**2 - 1", bounds=[[-1.1] * 3, [1.1] * 3])
    for surface in (turning(4), thin):
        assert not len(ck.discretize(ck.Scene(surface, ck.ScreenedPoisson(1.0)), 0.1).diagnosis().ties)
