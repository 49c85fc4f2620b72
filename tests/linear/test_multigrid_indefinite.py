"""Waves and complex shifts are solved by minimal residuals with a multigrid cycle, as by factors, in as many steps."""

import numpy as np
import pytest
from model_problems import rotation, sphere_points

import cpmkit as ck
from cpmkit.linear.krylov import gmres
from cpmkit.plugin import no_progress

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


@pytest.mark.parametrize("kind", [np.float64, np.complex128])
def test_as_many_steps_as_unknowns_solve_any_system(kind):
    rng = np.random.default_rng(0)
    parts = [rng.normal(size=(30, 30)) + 3 * np.eye(30) for _ in range(2)]
    matrix = (parts[0] + (1j * parts[1] if kind is np.complex128 else 0)).astype(kind)
    b = rng.normal(size=(30, 3)).astype(kind)
    b[:, 1] = matrix @ np.eye(30)[:, 4]  # the preconditioner below finds it at once
    inverse = np.linalg.inv(matrix + np.diag(rng.normal(size=30)) * (np.arange(30) != 4))
    target = 1e-12 * np.linalg.norm(b, axis=0)
    x, taken = gmres(lambda u: matrix @ u, lambda u: inverse @ u, b, target, 30, no_progress)
    assert taken <= 30
    np.testing.assert_allclose(matrix @ x, b, atol=1e-10)


def test_the_residual_never_grows_with_the_steps():
    rng = np.random.default_rng(1)
    matrix = rng.normal(size=(40, 40))
    b = rng.normal(size=(40, 2))
    sizes = []
    for most in range(1, 30):
        x, _ = gmres(lambda u: matrix @ u, lambda u: u, b, np.full(2, 1e-300), most, no_progress)
        sizes.append(np.linalg.norm(b - matrix @ x, axis=0))
    assert (np.diff(sizes, axis=0) <= 1e-12).all()
