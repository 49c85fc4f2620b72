"""Multigrid finds what the direct solver finds, in as many iterations on finer lattices, or says why not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from galerkin_systems import circle_beside, mass_of, sphere_space, stiffness_of, two_spheres
from scipy.sparse import csr_array, diags_array, random_array

from cpmkit.errors import ConvergenceError, SceneError
from cpmkit.forms.free_constants import free_pieces
from cpmkit.forms.galerkin.space import energy
from cpmkit.forms.galerkin.space.levels import coarser_levels
from cpmkit.linear import csr_matrices
from cpmkit.linear.csr_matrices import SymmetricCsr, UnsignedCsr, coarse_operator
from cpmkit.linear.direct import DirectSolver
from cpmkit.linear.jacobi import JacobiSolver
from cpmkit.linear.multigrid import cycle
from cpmkit.linear.multigrid.cycle import needs_float64
from cpmkit.linear.multigrid.solver import MultigridSolver
from cpmkit.linear.operators import Bordered
from cpmkit.linear.preconditioned import PreconditionedCG, stop_by_preconditioned_residual
from cpmkit.plugin import CsrOperator

NOWHERE = np.zeros(0, dtype=np.int64)
sphere = cache(sphere_space)


def load(space, *functions):
    return energy.load(space, np.stack([f(*space.samples.points.T) for f in functions], axis=1))


def plus(operator, matrix):
    return CsrOperator((operator.matrix + matrix).tocsr(), symmetric=True)


def smooth(x, y, z):
    return 3 * z + x * y


def iterations(space, operator, beside=NOWHERE, tolerance=1e-10):
    u, report = (
        MultigridSolver().prepare(operator, coarser_levels(space.dof_map, beside)).solve(load(space, smooth), tolerance)
    )
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
    operator = Bordered(stiffness, free_pieces(stiffness, lambda: mass_of(space)))
    on_one = np.arange(len(space.dof_map.cells) // 2)
    assert iterations(space, operator, on_one) <= 25


def test_it_finds_what_the_direct_solver_finds():
    space = sphere(0.1)
    beside, penalty = circle_beside(space, 0.31)
    operator = plus(stiffness_of(space), penalty)
    b = load(space, smooth, lambda x, y, z: np.sign(x), lambda x, y, z: 0 * x)
    u, report = MultigridSolver().prepare(operator, coarser_levels(space.dof_map, beside)).solve(b, 1e-11)
    exact, _ = DirectSolver().prepare(operator).solve(b, 1e-10)
    assert abs(u - exact).max() < 1e-9 * abs(exact).max()
    assert not u[:, 2].any()
    assert report.operator_applications >= 5 * report.iterations


def test_constants_free_on_two_pieces_are_those_of_the_direct_solver():
    space = two_spheres(0.2)
    stiffness, mass = stiffness_of(space), mass_of(space)
    for border in (free_pieces(stiffness, lambda: mass), free_pieces(stiffness, lambda: None)):
        assert border.indicator.shape[1] == 2
        operator = Bordered(stiffness, border)
        b = load(space, smooth, lambda x, y, z: x + 2)  # which has no solution: the border takes the means
        u, report = MultigridSolver().prepare(operator, coarser_levels(space.dof_map, NOWHERE)).solve(b, 1e-11)
        exact, _ = DirectSolver().prepare(operator).solve(b, 1e-10)
        assert abs(u - exact).max() < 1e-9 * abs(exact).max()
        assert report.iterations <= 28
        again = MultigridSolver().prepare(operator, coarser_levels(space.dof_map, NOWHERE)).solve(b, 1e-9, exact)[1]
        assert again.iterations == 0


def test_the_cycle_is_symmetric_and_positive():
    space = sphere(0.1)
    beside, penalty = circle_beside(space, 0.31)
    for operator, strip in ((stiffness_of(space, 1.0), NOWHERE), (plus(stiffness_of(space, 1.0), penalty), beside)):
        cycle = MultigridSolver().prepare(operator, coarser_levels(space.dof_map, strip)).preconditioner
        x = np.random.default_rng(0).standard_normal((space.dof_map.size, 8))
        products = x.T @ cycle.apply(x)
        assert abs(products - products.T).max() < 1e-12 * abs(products).max()
        assert np.linalg.eigvalsh(products).min() > 0


def test_a_guess_near_the_solution_saves_iterations():
    space = sphere(0.1)
    prepared = MultigridSolver().prepare(stiffness_of(space, 1.0), coarser_levels(space.dof_map, NOWHERE))
    b = load(space, smooth)
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
def test_where_nothing_is_asked_for_it_stops_by_the_error(share):
    space = sphere(0.1)
    operator = stiffness_of(space, 1.0)
    strict = MultigridSolver().prepare(operator, coarser_levels(space.dof_map, NOWHERE))
    b = load(space, smooth)
    exact, _ = strict.solve(b, 1e-13)
    solver, tolerance = stop_by_preconditioned_residual(strict)
    # A guess whose residual alone would do, though its error would not, is gone on from.
    guess = exact + share * np.random.default_rng(0).standard_normal(exact.shape) if share else None
    u, report = solver.solve(b, tolerance, guess)
    _, slow = strict.solve(b, 1e-10, guess)
    assert report.residual <= tolerance == 1e-6
    assert energy_error(operator, u, exact) < 1e-7
    assert 0 < report.iterations <= slow.iterations - (0 if share else 4)


def test_other_solvers_and_what_is_asked_for_stay_by_the_residual():
    space = sphere(0.16)
    operator, levels = stiffness_of(space, 1.0), coarser_levels(space.dof_map, NOWHERE)
    for solver in (DirectSolver(), JacobiSolver()):
        assert stop_by_preconditioned_residual(solver.prepare(operator, levels)) is None
    _, report = MultigridSolver().prepare(operator, levels).solve(load(space, smooth), 1e-12)
    assert report.residual <= 1e-12


@pytest.mark.parametrize("shift", [1.0, 8.0, 200.0])
def test_an_indefinite_system_is_told(shift):
    space = sphere(0.1)
    with pytest.raises(ConvergenceError, match="indefinite") as caught:
        iterations(space, plus(stiffness_of(space), -shift * mass_of(space).matrix))
    assert not caught.value.report.converged


def test_a_strip_of_the_wrong_sign_is_told():
    space = sphere(0.1)
    beside, penalty = circle_beside(space, 0.31)
    with pytest.raises(ConvergenceError, match=r"indefinite.*beside boundaries"):
        iterations(space, plus(stiffness_of(space, 1.0), -0.2 * penalty), beside)


def test_an_interval_that_is_too_small_gives_no_wrong_answer(monkeypatch):
    space = sphere(0.1)
    operator = stiffness_of(space, 1.0)
    monkeypatch.setattr(csr_matrices, "MIN_SHARED_ENTRIES", 0)
    monkeypatch.setattr(csr_matrices, "thread_count", lambda: 2)
    for share in (0.8, 0.5, 0.3):
        monkeypatch.setattr(cycle, "EIGENVALUE_MARGIN", share)
        with pytest.raises(ConvergenceError) as caught:
            iterations(space, operator)
        assert not caught.value.report.converged


def test_what_it_cannot_solve_is_refused_with_what_can(monkeypatch):
    space = sphere(0.1)
    matrix = stiffness_of(space, 1.0).matrix
    with pytest.raises(SceneError, match="solver='direct'"):
        MultigridSolver().prepare(CsrOperator(matrix, symmetric=False))
    assert (
        MultigridSolver().prepare(CsrOperator(matrix, symmetric=True)).solve(load(space, smooth), 1e-10)[1].iterations
        == 1
    )
    monkeypatch.setattr("cpmkit.linear.multigrid.solver.MAX_FACTORISED", space.dof_map.size - 1)
    with pytest.raises(SceneError, match="coarser levels"):
        MultigridSolver().prepare(CsrOperator(matrix, symmetric=True))


def test_too_few_iterations_are_told():
    space = sphere(0.1)
    with pytest.raises(ConvergenceError, match="max_iterations"):
        MultigridSolver(3).prepare(stiffness_of(space, 1.0), coarser_levels(space.dof_map, NOWHERE)).solve(
            load(space, smooth), 1e-10
        )


@pytest.mark.parametrize(("shape", "density"), [((40, 30, 20), 0.2), ((300, 5, 200), 0.4), ((7, 200, 3), 0.9)])
def test_sparse_products_are_those_of_scipy(shape, density):
    a, b = (random_array(sides, density=density, format="csr", rng=3) for sides in (shape[:2], shape[1:]))
    product = UnsignedCsr.of(a) @ UnsignedCsr.of(b)
    assert abs(product.to_csr() - a @ b).max() < 1e-14
    x = np.random.default_rng(0).standard_normal((shape[1], 3))
    assert np.allclose(UnsignedCsr.of(a).apply(x), a @ x)
    assert np.allclose(UnsignedCsr.of(a).apply_transposed(a @ x), a.T @ (a @ x))


def test_coarser_matrices_made_in_parts_are_whole(monkeypatch):
    rng = np.random.default_rng(3)
    dense = [np.where(rng.random(shape) < 0.1, rng.standard_normal(shape), 0.0) for shape in ((90, 90), (90, 31))]
    a, p = (csr_array(one) for one in (dense[0] + dense[0].T, dense[1]))
    monkeypatch.setattr(csr_matrices, "MIN_COARSE_ROWS", 4)
    coarse = coarse_operator(a, p).full().to_csr()
    assert np.allclose(coarse.toarray(), (p.T @ a @ p).toarray(), atol=1e-13)
    assert coarse.count_nonzero() == (p.T @ a @ p).count_nonzero()


@pytest.mark.parametrize("density", [0.0, 0.05, 0.6])
def test_products_of_upper_halves_are_those_of_the_whole(density):
    rng = np.random.default_rng(3)
    half = random_array((60, 60), density=density, format="csr", rng=3)
    a, p = (half + half.T).tocsr(), random_array((60, 17), density=0.2, format="csr", rng=4)
    rows, x, b = SymmetricCsr.of(a), rng.standard_normal((60, 3)), rng.standard_normal((60, 3))
    assert np.allclose(rows.residual(x, b), b - a @ x)
    assert np.allclose(rows.apply(x[:, :1].copy()), a @ x[:, :1])
    assert np.array_equal(rows.diagonal, a.diagonal())
    inverse, move = rng.random(60), rng.standard_normal((60, 3))
    moved = 0.5 * move + 2.0 * inverse[:, None] * (b - a @ x)
    assert np.allclose(rows.step(x, b, inverse, 0.5, 2.0, move), x + moved)
    assert np.allclose(move, moved)
    coarse = rows.galerkin_product(p).full().to_csr().toarray()
    assert np.allclose(coarse, (p.T @ a @ p).toarray())
    assert np.array_equal(coarse, coarse.T)
    some = np.array([7, 59, 0])
    assert np.array_equal(rows.rows_of(some).toarray(), a[some].toarray())


def test_sweeps_solve_one_equation_after_the_other():
    rng = np.random.default_rng(3)
    half = random_array((40, 40), density=0.1, format="csr", rng=3)
    a = (half + half.T).toarray() + 5 * np.eye(40)
    rows, x, b = SymmetricCsr.of(csr_array(a)), rng.standard_normal((40, 2)), rng.standard_normal((40, 2))
    inverse = np.where(rng.random(40) < 0.2, 0.0, 1 / a.diagonal())
    for order, swept in ((range(39, -1, -1), "up"), (range(40), "down")):
        expected = x.copy()
        for i in [*order, *order]:
            expected[i] += inverse[i] * (b[i] - a[i] @ expected)
        if swept == "down":
            assert np.allclose(rows.sweep_forward(x, b, inverse, 2), expected)
            continue
        found, rest = rows.sweep_backward(x, b, inverse, 2)
        assert np.allclose(found, expected)
        assert np.allclose(rest, b - a @ expected)


def test_a_preconditioner_with_less_rounding_is_tried_before_a_system_is_refused():
    n = 60
    matrix = csr_array(diags_array([-np.ones(n - 1), 3.0 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1]))

    class Scaled:
        products = 0

        def __init__(self, sign):
            self.sign = sign

        def apply(self, b):
            return self.sign * b / 3.0

    rough = PreconditionedCG(CsrOperator(matrix), UnsignedCsr.of(matrix), None, Scaled(-1.0), 100, "multigrid")
    b = np.ones((n, 1))
    with pytest.raises(ConvergenceError, match="wrong sign"):
        rough.solve(b, 1e-10)
    u, report = replace(rough, more_exact=lambda: Scaled(1.0)).solve(b, 1e-10)
    assert report.converged
    assert np.abs(matrix @ u - b).max() < 1e-9


def test_entries_of_32_bits_are_left_out_where_a_diagonal_spans_too_much():
    assert needs_float64(np.array([1e-7, 1.0]))
    assert not needs_float64(np.array([1e-4, 1.0]))
    assert not needs_float64(np.array([0.0, 1e-4, 1.0]))
