"""Multigrid finds what the direct solver finds, in as many iterations on finer lattices, or says why not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from galerkin_systems import circle_beside, mass_of, sphere_space, stiffness_of, two_spheres
from scipy.sparse import csr_array, eye_array
from scipy.sparse.csgraph import connected_components

import cpmkit as ck
from cpmkit.errors import ConvergenceError, SceneError
from cpmkit.forms.galerkin.space.energy import load
from cpmkit.forms.galerkin.space.levels import coarser_levels
from cpmkit.linear.operators import Bordered
from cpmkit.linear.solver_options import make_solver
from cpmkit.plugin import Border, CsrOperator

NOWHERE = np.zeros(0, dtype=np.int64)
sphere = cache(sphere_space)


def right_side(space, *functions):
    return load(space, np.stack([f(*space.samples.points.T) for f in functions], axis=1))


def plus(operator, matrix):
    return CsrOperator((operator.matrix + matrix).tocsr(), symmetric=True)


def multigrid(operator, levels=(), **options):
    return make_solver("multigrid", options).prepare(operator, levels)


def smooth(x, y, z):
    return 3 * z + x * y


def border_of(stiffness, weights):
    """The constants of each piece, and its mean with these weights."""
    indicator = np.eye(2)[connected_components(stiffness.matrix)[1]]
    means = (weights.matrix @ indicator) / (indicator.T @ (weights.matrix @ indicator)).diagonal()
    return Border(csr_array(indicator), csr_array(means.T))


def iterations(space, operator, beside=NOWHERE, tolerance=1e-10):
    u, report = multigrid(operator, coarser_levels(space.dof_map, beside)).solve(right_side(space, smooth), tolerance)
    assert report.residual <= tolerance
    assert np.isfinite(u).all()
    return report.iterations


def test_iterations_do_not_grow():
    taken = [iterations(space, stiffness_of(space, 1.0)) for space in map(sphere, (0.16, 0.1, 0.07))]
    assert max(taken) <= 25
    assert taken[-1] <= taken[0] + 3


@pytest.mark.slow
def test_iterations_do_not_grow_up_to_a_third_of_a_million():
    taken = [iterations(space, stiffness_of(space, 1.0)) for space in map(sphere_space, (0.05, 0.025, 0.0137))]
    assert max(taken) <= 25
    assert taken[-1] <= taken[0] + 3


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_no_unit_of_length_matters(unit):
    space = sphere_space(0.16 * unit, unit)
    one, other = sphere(0.16), stiffness_of(space, 1 / unit**2)
    assert abs(iterations(space, other) - iterations(one, stiffness_of(one, 1.0))) <= 1
    assert iterations(space, CsrOperator(unit**2 * other.matrix, symmetric=True)) == iterations(space, other)


@pytest.mark.parametrize("seed", range(10))
def test_no_place_of_the_lattice_matters(seed):
    space = sphere_space(0.15, shift=np.random.default_rng(seed).uniform(-1, 1, 3))
    assert iterations(space, stiffness_of(space, 1.0)) <= 25


def test_a_strip_hides_its_penalties():
    with_strip, without = [], []
    for space in map(sphere, (0.16, 0.1, 0.07)):
        beside, penalty = circle_beside(space, 0.31)
        operator = plus(stiffness_of(space, 1.0), penalty)
        with_strip.append(iterations(space, operator, beside))
        without.append(iterations(space, operator))
    assert max(with_strip) <= 25
    assert all(long > 2 * short for long, short in zip(without, with_strip, strict=True))


def test_a_strip_without_penalties_that_holds_whole_pieces_does_no_harm():
    space = two_spheres(0.2)
    stiffness = stiffness_of(space)
    operator = Bordered(stiffness, border_of(stiffness, mass_of(space)))
    on_one = np.arange(len(space.dof_map.cells) // 2)
    assert iterations(space, operator, on_one) <= 25


def test_it_finds_what_the_direct_solver_finds():
    space = sphere(0.1)
    beside, penalty = circle_beside(space, 0.31)
    operator = plus(stiffness_of(space), penalty)
    b = right_side(space, smooth, lambda x, y, z: np.sign(x), lambda x, y, z: 0 * x)
    u, report = multigrid(operator, coarser_levels(space.dof_map, beside)).solve(b, 1e-11)
    exact, _ = make_solver("direct", {}).prepare(operator).solve(b, 1e-10)
    assert abs(u - exact).max() < 1e-9 * abs(exact).max()
    assert not u[:, 2].any()
    assert report.operator_applications >= 5 * report.iterations


def test_constants_free_on_two_pieces_are_those_of_the_direct_solver():
    space = two_spheres(0.2)
    stiffness, mass = stiffness_of(space), mass_of(space)
    for weights in (mass, CsrOperator(eye_array(stiffness.size).tocsr(), symmetric=True)):
        operator = Bordered(stiffness, border_of(stiffness, weights))
        b = right_side(space, smooth, lambda x, y, z: x + 2)  # which has no solution: the border takes the means
        u, report = multigrid(operator, coarser_levels(space.dof_map, NOWHERE)).solve(b, 1e-11)
        exact, _ = make_solver("direct", {}).prepare(operator).solve(b, 1e-10)
        assert abs(u - exact).max() < 1e-9 * abs(exact).max()
        assert report.iterations <= 28
        again = multigrid(operator, coarser_levels(space.dof_map, NOWHERE)).solve(b, 1e-9, exact)[1]
        assert again.iterations == 0


def test_the_cycle_is_symmetric_and_positive():
    space = sphere(0.1)
    beside, penalty = circle_beside(space, 0.31)
    for operator, strip in ((stiffness_of(space, 1.0), NOWHERE), (plus(stiffness_of(space, 1.0), penalty), beside)):
        cycle = multigrid(operator, coarser_levels(space.dof_map, strip)).preconditioner
        x = np.random.default_rng(0).standard_normal((space.dof_map.size, 8))
        products = x.T @ cycle.apply(x)
        assert abs(products - products.T).max() < 1e-12 * abs(products).max()
        assert np.linalg.eigvalsh(products).min() > 0


def test_a_guess_near_the_solution_saves_iterations():
    space = sphere(0.1)
    prepared = multigrid(stiffness_of(space, 1.0), coarser_levels(space.dof_map, NOWHERE))
    b = right_side(space, smooth)
    u, first = prepared.solve(b, 1e-10)
    kept = u.copy()
    near, second = prepared.solve(1.001 * b, 1e-10, u)
    assert second.iterations < first.iterations
    assert (u == kept).all()
    assert abs(near - 1.001 * u).max() < 1e-8 * abs(u).max()


def energy_error(operator, u, exact):
    """Return the error in the energy's norm, as a share of the solution's."""
    off = u - exact
    return float(np.sqrt((off * operator.apply(off)).sum() / (exact * operator.apply(exact)).sum()))


@pytest.mark.parametrize("share", [0.0, 1e-7])
def test_without_a_tolerance_it_stops_by_the_error(share):
    scene = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(lambda x: smooth(*x.T)))
    free, strict = (ck.prepare(scene, 0.1, solver="multigrid", solver_tolerance=tol) for tol in (None, 1e-10))
    operator = ck.assemble(free.discretized).operator
    exact = ck.prepare(scene, 0.1, solver="direct").solve()
    # A guess whose residual alone would do, though its error would not, is gone on from.
    noise = np.random.default_rng(0).standard_normal(exact.values.shape)
    guess = replace(exact, values=exact.values + share * noise) if share else None
    stopped, slow = free.solve(guess=guess), strict.solve(guess=guess)
    assert stopped.report.residual <= stopped.report.tolerance == 1e-6
    assert energy_error(operator, stopped.values, exact.values) < 1e-7
    assert 0 < stopped.report.iterations <= slow.report.iterations - (0 if share else 4)
    for solver in ("direct", "jacobi"):  # others stop by the residual
        assert ck.prepare(scene, 0.16, solver=solver).solve().report.residual <= 1e-8


@pytest.mark.parametrize("shift", [1.0, 8.0, 200.0])
def test_an_indefinite_system_is_refused(shift):
    space = sphere(0.1)
    with pytest.raises(ConvergenceError, match="indefinite") as caught:
        iterations(space, plus(stiffness_of(space), -shift * mass_of(space).matrix))
    assert not caught.value.report.converged


def test_a_strip_of_the_wrong_sign_is_refused():
    space = sphere(0.1)
    beside, penalty = circle_beside(space, 0.31)
    with pytest.raises(ConvergenceError, match=r"indefinite.*beside boundaries"):
        iterations(space, plus(stiffness_of(space, 1.0), -0.2 * penalty), beside)


def test_an_interval_that_is_too_small_gives_no_wrong_answer(monkeypatch):
    space = sphere(0.1)
    operator = stiffness_of(space, 1.0)
    monkeypatch.setattr("cpmkit.linear.csr_matrices.MIN_SHARED_ENTRIES", 0)  # matrices that all threads multiply
    monkeypatch.setenv("CPMKIT_THREADS", "2")
    for share in (0.8, 0.5, 0.3):
        monkeypatch.setattr("cpmkit.linear.multigrid.solver.EIGENVALUE_MARGIN", share)
        with pytest.raises(ConvergenceError) as caught:
            iterations(space, operator)
        assert not caught.value.report.converged


def test_what_it_cannot_solve_is_refused_with_what_can(monkeypatch):
    space = sphere(0.1)
    matrix = stiffness_of(space, 1.0).matrix
    with pytest.raises(SceneError, match="solver='direct'"):
        multigrid(CsrOperator(matrix, symmetric=False))
    assert multigrid(CsrOperator(matrix, symmetric=True)).solve(right_side(space, smooth), 1e-10)[1].iterations == 1
    monkeypatch.setattr("cpmkit.linear.multigrid.solver.MAX_FACTORISED", space.dof_map.size - 1)
    with pytest.raises(SceneError, match="coarser levels"):
        multigrid(CsrOperator(matrix, symmetric=True))


def test_too_few_iterations_are_refused():
    space = sphere(0.1)
    with pytest.raises(ConvergenceError, match="max_iterations"):
        multigrid(stiffness_of(space, 1.0), coarser_levels(space.dof_map, NOWHERE), max_iterations=3).solve(
            right_side(space, smooth), 1e-10
        )


@pytest.mark.parametrize("size", [1e3, 1e6])
def test_large_penalties_are_resolved_in_any_precision(size):
    space = sphere(0.1)
    beside, penalty = circle_beside(space, 0.31)
    operator, b = plus(stiffness_of(space, 1.0), size * penalty), right_side(space, smooth)
    u, report = multigrid(operator, coarser_levels(space.dof_map, beside)).solve(b, 1e-9)
    exact, _ = make_solver("direct", {}).prepare(operator).solve(b, 1e-10)
    assert abs(u - exact).max() < 1e-6 * abs(exact).max()
    assert report.iterations <= 25
