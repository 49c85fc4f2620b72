"""Constants are taken out of a system: what solvers resolve is relative to what varies."""

import numpy as np
import pytest
from scipy.sparse import csr_array, diags_array, eye_array

import cpmkit as ck
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.operators import Bordered, ComplexShift
from cpmkit.linear.solver_options import make_solver
from cpmkit.plugin import Border, CsrOperator, judge

N = 60
TOLERANCE = 1e-8
SOLVERS = [make_solver(name, {}) for name in ("direct", "reference", "multigrid")]


def laplacian(n=N, ends=1.0):
    """-u'' by differences, with ``ends`` that hold a value."""
    matrix = diags_array([np.full(n - 1, -1.0), np.full(n, 2.0), np.full(n - 1, -1.0)], offsets=[-1, 0, 1]).tolil()
    matrix[0, 0] = matrix[n - 1, n - 1] = 1.0 + ends
    return csr_array(matrix.tocsr())


def made(matrix=None):
    return CsrOperator(laplacian() if matrix is None else matrix, symmetric=True)


def exact(operator, u, shift):
    """Return b for u + shift, and that u."""
    return operator.apply(u + shift), u + shift


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("shift", [1e3, 1e7, -1e9])
def test_what_varies_is_solved_to_the_tolerance_wherever_zero_lies(solver, shift):
    operator, u = made(), np.sin(np.linspace(0, 7, N))[:, None]
    b, wanted = exact(operator, u, shift)
    constants = ConstantFunctions.from_functions(operator, np.ones((N, 1)))
    found, report = constants.solve(solver.prepare(operator), b, TOLERANCE)
    assert report.converged
    assert report.residual <= report.tolerance == TOLERANCE
    assert np.abs(found - wanted).max() <= 1e3 * (TOLERANCE * np.ptp(u) + np.finfo(float).eps * abs(shift))


def test_each_channel_has_a_constant_of_its_own_and_a_guess_is_moved_with_it():
    operator, u = made(), np.stack([np.sin(np.arange(N)), np.cos(np.arange(N))], axis=1)
    b, wanted = exact(operator, u, [1e8, 0.0])
    found, report = ConstantFunctions.from_functions(operator, np.ones((N, 1))).solve(
        make_solver("reference", {}).prepare(operator), b, TOLERANCE, wanted
    )
    assert report.iterations == 0  # the guess is the solution
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-6)


def test_a_solution_that_is_constant_is_exact_and_takes_no_iterations():
    operator = made()
    b = operator.apply(np.full((N, 1), 0.3))
    found, report = ConstantFunctions.from_functions(operator, np.ones((N, 1))).solve(
        make_solver("reference", {}).prepare(operator), b, TOLERANCE
    )
    assert report.iterations == 0
    np.testing.assert_allclose(found, 0.3, rtol=1e-14)


def test_what_rounding_makes_of_b_is_not_resolved():
    operator, small = made(), 1e-13
    b = operator.apply(1.0 + small * np.sin(np.arange(N))[:, None])
    target = []

    class Prepared:
        def solve(self, rest, tolerance, guess=None, progress=None):
            target.append((rest, tolerance))
            return make_solver("direct", {}).prepare(operator).solve(rest, tolerance)

    _, report = ConstantFunctions.from_functions(operator, np.ones((N, 1))).solve(Prepared(), b, 1e-12)
    rest, tolerance = target[0]
    scale = np.linalg.norm(b) / np.abs(b).max()  # b is scaled by a power of two near its largest entry
    assert tolerance * np.linalg.norm(rest) == pytest.approx(8.9e-16 * scale, rel=1.0)
    assert report.tolerance == 1e-12
    assert report.residual <= 1e-12


@pytest.mark.parametrize("scale", [1e-300, 1e-200, 1e200, 1e290])
@pytest.mark.parametrize("solver", [make_solver("direct", {}), make_solver("reference", {})])
def test_scaled_data_have_the_scaled_solution(scale, solver):
    operator, b = made(), np.sin(np.arange(N))[:, None]
    constants, prepared = ConstantFunctions.from_functions(operator, np.ones((N, 1))), solver.prepare(operator)
    one, many = (constants.solve(prepared, data, 1e-12)[0] for data in (b, scale * b))
    np.testing.assert_allclose(many / scale, one, rtol=1e-7, atol=1e-7 * np.abs(one).max())


def test_pieces_where_a_constant_is_free_are_apart_from_those_that_hold_a_value():
    from scipy.sparse import block_diag

    operator = made(csr_array(block_diag([laplacian(ends=0.0), laplacian()]).tocsr()))
    on = np.repeat([1.0, 0.0], N)
    border = Border(csr_array(on[:, None]), csr_array(on[None, :] / N))
    whole = Bordered(operator, border)
    u = np.sin(np.arange(2 * N))[:, None]
    u[:N] -= u[:N].mean()
    wanted = u + 1e9 * (1 - on)[:, None]
    found, _ = ConstantFunctions.from_functions(whole, np.ones((2 * N, 1))).solve(
        make_solver("direct", {}).prepare(whole), operator.apply(wanted), 1e-10
    )
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-4)  # 1e9 times rounding and the condition number


@pytest.mark.parametrize("solver", SOLVERS)
def test_pieces_that_nothing_couples_are_solved_to_the_tolerance_each(solver):
    from scipy.sparse import block_diag

    operator = made(csr_array(block_diag([laplacian()] * 4).tocsr()))
    constant, size = (np.repeat(one, N)[:, None] for one in ([1e9, 0.0, 1e-20, 0.0], [1.0, 1e-6, 1e-20, 0.0]))
    wanted = constant + size * np.sin(np.linspace(0, 28, 4 * N))[:, None]
    constants = ConstantFunctions.from_functions(operator, np.ones((4 * N, 1)))
    found, report = constants.solve(solver.prepare(operator), operator.apply(wanted), TOLERANCE)
    assert report.residual <= report.tolerance == TOLERANCE
    assert np.all(np.abs(found - wanted) <= 1e3 * (TOLERANCE * size + np.finfo(float).eps * constant))


def test_complex_systems_have_complex_constants():
    operator = ComplexShift(made(laplacian(ends=0.0)), 0.5)
    u = np.sin(np.arange(N))[:, None] + 1j * np.cos(np.arange(N))[:, None]
    wanted = u + 1e8 * (1 + 2j)
    constants = ConstantFunctions.from_functions(operator, np.ones((N, 1)))
    found, report = constants.solve(make_solver("direct", {}).prepare(operator), operator.apply(wanted), 1e-10)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-5)
    assert report.residual <= 1e-10


def test_a_mean_that_is_a_sum_that_cancels_is_warned_of():
    tiny = made((laplacian(ends=0.0) + 1e-10 * eye_array(N)).tocsr())
    f = np.sin(2 * np.pi * np.arange(N) / N)[:, None]
    constants = ConstantFunctions.from_functions(tiny, np.ones((N, 1)))
    u, _ = constants.solve(make_solver("direct", {}).prepare(tiny), f + 1e-7, TOLERANCE)
    assert "divided by a small c" in constants.cancellation_warnings(f + 1e-7, u)[0]
    firm = f + 1e-3  # does not cancel: the mean is as good as f
    assert (
        constants.cancellation_warnings(
            firm, constants.solve(make_solver("direct", {}).prepare(tiny), firm, TOLERANCE)[0]
        )
        == ()
    )


class TestRounding:
    """A direct solve is judged by what rounding leaves, and a singular matrix is refused all the same."""

    def test_a_residual_that_rounding_leaves_is_accepted(self):
        n = 40_000  # the condition number is about n squared
        operator = made(laplacian(n))
        b = np.ones((n, 1))
        u, report = make_solver("direct", {}).prepare(operator).solve(b, 1e-10)
        assert report.residual > report.tolerance
        assert report.converged
        assert "left by rounding" in report.reason
        x = np.arange(1, n + 1)
        np.testing.assert_allclose(u[:, 0], x * (n + 1 - x) / 2, rtol=1e-6)

    def test_more_than_rounding_leaves_is_refused(self):
        operator, b = made(), np.ones((N, 1))
        u = make_solver("direct", {}).prepare(operator).solve(b, 1e-10)[0]
        with pytest.raises(ck.ConvergenceError, match=r"left by rounding; do this\."):
            judge(operator, b, u * (1 + 1e-9), "direct", 1e-10, 0, 1, "do this")

    @pytest.mark.parametrize("noise", [0.0, 1e-17])
    def test_a_singular_matrix_is_refused(self, noise):
        matrix = (laplacian(300, ends=0.0) * 0.7 + noise * eye_array(300)).tocsr()
        with pytest.raises((ck.SceneError, ck.ConvergenceError)):
            make_solver("direct", {}).prepare(made(matrix)).solve(np.ones((300, 1)), 1e-10)

    def test_a_border_has_rounding_of_its_own(self):
        n = 20_000
        ones = csr_array(np.ones((n, 1)))
        operator = Bordered(made(laplacian(n, ends=0.0)), Border(ones, csr_array(ones.T / n)))
        b = np.where(np.arange(n) < n // 2, 1.0, -1.0)[:, None]
        u, report = make_solver("direct", {}).prepare(operator).solve(b, 1e-13)
        assert report.converged
        assert report.residual > 1e-13
        assert abs(u.mean()) < 1e-3 * np.ptp(u)
