"""Small symmetric positive matrices are factorised densely, others as before: both solve."""

import numpy as np
import pytest
from scipy.sparse import csr_array, eye_array, random_array

import cpmkit as ck
from cpmkit.linear.solver_options import make_solver
from cpmkit.plugin import CsrOperator


def positive(n):
    half = random_array((n, n), density=min(0.3, 8 / n**0.5), rng=np.random.default_rng(0))
    return (half @ half.T + eye_array(n)).tocsr()


def solved(matrix, b, symmetric=True):
    return make_solver("direct", {}).prepare(CsrOperator(matrix, symmetric)).solve(b, 1e-10)[0]


@pytest.mark.parametrize("n", [1, 50, 640, 641])
def test_both_kinds_solve(n):
    matrix, b = positive(n), np.random.default_rng(1).normal(size=(n, 2))
    np.testing.assert_allclose(matrix @ solved(matrix, b), b, atol=1e-10)


def test_matrices_that_are_not_positive_or_not_symmetric_are_solved_with_pivots():
    matrix = csr_array(np.diag([1.0, 2.0, -1.0]) + 1e-9)
    np.testing.assert_allclose(solved(matrix, np.ones((3, 1)))[:, 0], [1, 0.5, -1], atol=1e-6)
    matrix = csr_array(np.array([[2.0, 1.0], [0.0, 2.0]]))
    np.testing.assert_allclose(solved(matrix, np.array([[3.0], [2.0]]), symmetric=False)[:, 0], [1.0, 1.0])


def test_complex_right_sides_and_complex_matrices_are_solved():
    matrix, b = positive(40), np.random.default_rng(1).normal(size=(40, 2)) * (1 + 2j)
    np.testing.assert_allclose(matrix @ solved(matrix, b), b, atol=1e-10)
    shifted = (matrix + 1j * eye_array(40)).tocsr()
    np.testing.assert_allclose(shifted @ solved(shifted, b), b, atol=1e-10)


def test_a_free_constant_is_bordered_as_before():
    sphere = ck.source("analytic.sphere")
    scene = ck.Scene(sphere, ck.Poisson(lambda x: 2 * x[:, 0]))
    dense, other = (
        ck.solve(scene, 0.35, form="galerkin", solver=solver, solver_tolerance=1e-12)
        for solver in ("direct", "multigrid")
    )
    at = sphere.mesh(0.2)[0]
    np.testing.assert_allclose(dense.evaluate(at), other.evaluate(at), atol=1e-9)
    assert np.abs(dense.evaluate(at) - at[:, 0]).max() < 1e-2
