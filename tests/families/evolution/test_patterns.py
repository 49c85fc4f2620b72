"""Patterns of a reaction do not feel how the surface lies in the lattice."""

import numpy as np
import pytest
from model_problems import order_of
from scipy.spatial.transform import Rotation

import cpmkit as ck

TURN = Rotation.random(random_state=0).as_matrix()
SPACINGS = (0.28, 0.24, 0.2)


def reaction(u):
    """Barrio's: it grows stripes of .65 on the unit sphere at this kappa."""
    cubic = 0.899 * 3.5 * u[:, 0] * u[:, 1] ** 2
    return np.stack([0.899 * u[:, 0] + u[:, 1] - cubic, -0.91 * u[:, 1] - 0.899 * u[:, 0] + cubic], axis=1)


def grown(spacing, turn, until, step):
    """Return the pattern that grows from waves of nine radians in all directions, on a sphere turned by ``turn``."""
    rng = np.random.default_rng(3)
    waves = rng.normal(size=(2, 60, 3))
    waves *= 9 / np.linalg.norm(waves, axis=2, keepdims=True)
    phases = rng.uniform(0, 2 * np.pi, (2, 60))

    def noise(x):
        return 0.3 * np.cos(np.einsum("pd,cwd->pcw", x @ turn, waves) + phases).mean(axis=2)

    run = ck.ReactionDiffusion(noise, reaction, kappa=[0.002064, 0.004], until=until, step=step)
    return ck.solve(ck.Scene(ck.source("analytic.sphere"), run), spacing, solver_tolerance=1e-6, estimate=False)


def points_of_sphere(count):
    points = np.random.default_rng(0).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def directions(solution, points):
    """Return the histogram (12,) of the angles of the pattern's gradient to the meridians, weighed by its square."""
    slopes = solution.gradient(points)[:, 0]
    east = np.cross([0, 0, 1], points)
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    angles = np.arctan2((slopes * np.cross(points, east)).sum(axis=1), (slopes * east).sum(axis=1)) % np.pi
    return np.histogram(angles, 12, (0, np.pi), weights=(slopes**2).sum(axis=1) / (slopes**2).sum())[0]


def test_a_turned_sphere_grows_the_same_pattern_to_the_order_of_the_method():
    points = points_of_sphere(2000)
    off = []
    for spacing in SPACINGS:
        here, turned = grown(spacing, np.eye(3), 15.0, 3.0), grown(spacing, TURN, 15.0, 3.0)
        u = here.evaluate(points)[:, 0]
        off.append(np.sqrt(((turned.evaluate(points @ TURN.T)[:, 0] - u) ** 2).mean() / u.var()))
    assert off[-1] < 0.05
    assert order_of(SPACINGS, off) > 2.5


@pytest.mark.slow
def test_stripes_have_the_same_directions_on_a_turned_lattice():
    points = points_of_sphere(20_000)
    here, turned = grown(0.14, np.eye(3), 300.0, 1.0), grown(0.14, TURN, 300.0, 1.0)
    tangents = directions(here, points)
    # the gradient of the turned pattern, turned back
    back = _Turned(turned)
    assert np.abs(directions(back, points) - tangents).max() < 0.25 * tangents.mean()


class _Turned:
    """A solution on the turned sphere, read on the sphere as it was."""

    def __init__(self, solution):
        self.solution = solution

    def gradient(self, points):
        return self.solution.gradient(points @ TURN.T) @ TURN
