"""Waves and complex shifts are solved by minimal residuals with a multigrid cycle, as by factors, in as many steps."""

import numpy as np
import pytest
from model_problems import rotation, sphere_points

import cpmkit as ck

SPHERE = ck.source("analytic.sphere")
CIRCLE = ck.source("analytic.circle", center=[0, 0, 0], radius=1.0, normal=rotation()[0])


def bump(x):
    return np.exp(-8 * ((x[:, 0] - 1) ** 2 + x[:, 1] ** 2 + x[:, 2] ** 2))


SCENES = {
    "closed": ck.Scene(SPHERE, ck.Helmholtz([bump, lambda x: x[:, 2]], 3.0)),
    "cut": ck.Scene(
        SPHERE,
        ck.Helmholtz(bump, 3.0),
        [ck.Boundary("cut", CIRCLE, left=ck.Dirichlet(1.0), right=ck.Robin(1.0, 3.0, 0.0))],
    ),
    "in part": ck.Scene(SPHERE, ck.Elliptic(bump, diffusivity=lambda x: 1.5 + x[:, 0], c=lambda x: 3 - 14 * x[:, 1])),
    "a rim": ck.Scene(ck.source("analytic.cap"), ck.Helmholtz(bump, 3.0), edge=ck.Dirichlet(lambda x: x[:, 0])),
}


@pytest.mark.parametrize("name", SCENES)
def test_waves_are_those_of_factors_in_twenty_steps_or_so(name):
    points = np.abs(sphere_points(500)) * [1, -1, 1]
    found = {solver: ck.solve(SCENES[name], 0.2, solver=solver) for solver in ("direct", "multigrid")}
    expected = found["direct"].evaluate(points)
    assert np.abs(found["multigrid"].evaluate(points) - expected).max() <= 1e-7 * np.abs(expected).max()
    assert found["multigrid"].report.solver == "multigrid"
    assert 2 <= found["multigrid"].report.iterations <= 32


@pytest.mark.parametrize("spacing", [0.15, pytest.param(0.075, marks=pytest.mark.slow)])
def test_steps_do_not_grow_with_the_unknowns_nor_with_the_waves(spacing):
    prepared = ck.prepare(ck.Scene(SPHERE, ck.Helmholtz(bump, 1.0)), spacing, solver="multigrid")
    for radians in (0.1, 0.3, 0.75):
        solution = prepared.solve(problem=ck.Helmholtz(bump, radians / spacing))
        assert 2 <= solution.report.iterations <= 22


def test_a_coarsest_level_too_large_to_be_factorised_is_refused(monkeypatch):
    monkeypatch.setattr("cpmkit.linear.multigrid.solver.MAX_FACTORISED_WAVES", 1_000)
    with pytest.raises(ck.SceneError, match=r"it has 1,4\d\d of the 5,7\d\d unknowns, where up to 1,000 are accepted"):
        ck.solve(ck.Scene(SPHERE, ck.Helmholtz(bump, 5.0)), 0.1, solver="multigrid")
