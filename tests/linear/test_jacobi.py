"""The diagonal where a mass dominates, the cycle elsewhere: equal answers, in any unit, and never a wrong one."""

from functools import cache

import numpy as np
import pytest
from galerkin_systems import circle_beside, mass_of, sphere_space, stiffness_of
from model_problems import sphere_points

import cpmkit as ck
from cpmkit.errors import ConvergenceError, SceneError
from cpmkit.forms.galerkin.space.levels import coarser_levels
from cpmkit.linear.solver_options import make_solver
from cpmkit.plugin import CsrOperator

H = 0.16
sphere = cache(sphere_space)
RING = ck.Boundary(
    "ring", ck.source("analytic.circle", center=[0, 0, 0.28], radius=0.96, normal=[0, 0, 1]), both=ck.Dirichlet(1.0)
)


def stepped(share, beside=False):
    """M + h^2 S + factor A for a step of ``share`` spacings squared, levels and a right-hand side."""
    space = sphere(H)
    stiffness = stiffness_of(space)
    strip = np.zeros(0, dtype=np.int64)
    matrix = mass_of(space).matrix + ((share + 1e-2) * H**2) * stiffness.matrix
    if beside:
        strip, penalty = circle_beside(space, 0.31)
        matrix = matrix + share * H**2 * penalty
    b = mass_of(space).matrix @ np.random.default_rng(0).normal(size=(space.dof_map.size, 2))
    return CsrOperator(matrix.tocsr(), symmetric=True), coarser_levels(space.dof_map, strip), b


@pytest.mark.parametrize("beside", [False, True])
def test_it_finds_what_the_cycle_finds_beside_conditions_too(beside):
    operator, levels, b = stepped(1.0, beside)
    found, report = make_solver("jacobi", {}).prepare(operator, levels).solve(b, 1e-12)
    expected, _ = make_solver("multigrid", {}).prepare(operator, levels).solve(b, 1e-12)
    np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())
    assert report.solver == "jacobi"
    assert report.residual <= 1e-12
    assert report.iterations < 150


def heat_run(share, unit=1.0):
    """Two steps of ``share`` spacings squared on a sphere of this radius."""
    spacing, ball = 0.3 * unit, ck.source("analytic.sphere", radius=unit)
    step = share * spacing**2
    heat = ck.Heat(lambda x: x[:, 0] / unit + x[:, 1] * x[:, 2] / unit**2, until=2 * step, step=step)
    return ck.solve(ck.Scene(ball, heat), spacing, form="galerkin")


@pytest.fixture
def no_factors(monkeypatch):
    monkeypatch.setattr("cpmkit.linear.solver_options.DIRECT_BESIDE_MULTIGRID", {})


@pytest.mark.usefixtures("no_factors")
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_short_steps_take_the_diagonal_in_any_unit(unit):
    taken = [heat_run(share, unit).report.solver for share in (0.05, 5.0, 1000.0)]
    assert taken == ["jacobi", "jacobi", "multigrid"]


@pytest.mark.usefixtures("no_factors")
def test_where_it_takes_too_long_the_cycle_solves_and_nothing_is_remembered(monkeypatch):
    plain = heat_run(1.0).values
    monkeypatch.setattr("cpmkit.linear.preconditioned.MAX_BEFORE_MULTIGRID", 5)
    first, again = heat_run(1.0), heat_run(1.0)
    assert first.report.solver == "multigrid"
    assert first.report.iterations > 5
    np.testing.assert_array_equal(first.values, again.values)
    np.testing.assert_allclose(first.values, plain, atol=1e-6 * np.abs(plain).max())


def test_what_it_cannot_solve_is_refused():
    operator, levels, b = stepped(1.0)
    with pytest.raises(ConvergenceError, match="max_iterations"):
        make_solver("jacobi", {"max_iterations": 3}).prepare(operator, levels).solve(b, 1e-10)
    turned = CsrOperator((-1 * operator.matrix).tocsr(), symmetric=True)
    with pytest.raises(ConvergenceError, match=r"indefinite.*diagonal"):
        make_solver("jacobi", {}).prepare(turned, levels)
    space = sphere(H)
    shifted = CsrOperator((stiffness_of(space).matrix - 30 * mass_of(space).matrix).tocsr(), symmetric=True)
    with pytest.raises(ConvergenceError):
        make_solver("jacobi", {}).prepare(shifted, levels).solve(b, 1e-10)
    with pytest.raises(SceneError, match="solver 'jacobi' solves real symmetric systems"):
        make_solver("jacobi", {}).prepare(CsrOperator(operator.matrix))


def test_runs_in_time_are_those_of_the_other_solvers():
    heat = ck.Heat(lambda x: x[:, 0] + x[:, 1] * x[:, 2], until=0.15, step=0.05)
    scene, at = ck.Scene(ck.source("analytic.sphere"), heat, [RING]), sphere_points(200)
    runs = {name: ck.solve(scene, 0.25, form="galerkin", solver=name) for name in ("jacobi", "multigrid", "direct")}
    for name, run in runs.items():
        assert run.report.solver == name
        np.testing.assert_allclose(run.evaluate(at), runs["direct"].evaluate(at), atol=1e-8)
