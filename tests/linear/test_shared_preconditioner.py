"""A preconditioner serves the equations that follow: the same solutions in more iterations, or one of their own."""

import numpy as np
import pytest

import cpmkit as ck

SPHERE = ck.source("analytic.sphere")


def turning(rate):
    problem = ck.Elliptic("x + z", diffusivity=0.05, velocity=lambda x: rate * np.cross([0.0, 0.0, 1.0], x), c=1.0)
    return ck.Scene(SPHERE, problem)


def test_equations_that_share_a_preconditioner_have_the_solutions_of_any():
    prepared = ck.prepare(turning(1.0), 0.2, form="galerkin", solver="multigrid")
    sharing, points = prepared.sharing_preconditioner(), SPHERE.closest_point(np.eye(3)).points
    more = {}
    for rate in (1.0, 1.1, 1.2, -6.0):
        first, second = (scene.solve(problem=turning(rate).problem) for scene in (prepared, sharing))
        assert second.evaluate(points) == pytest.approx(first.evaluate(points), abs=1e-8)
        more[rate] = second.report.iterations - first.report.iterations
    assert more[1.0] == more[-6.0] == 0  # the last is too different, and has one of its own
    assert 0 < more[1.1] <= more[1.2] < 15
