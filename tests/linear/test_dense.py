"""Small symmetric positive matrices are factorised densely, others as before."""

import numpy as np
import pytest
from scipy.sparse import csr_array, eye_array, random_array

import cpmkit as ck
from cpmkit.linear.direct import (
    DENSE_UNKNOWNS,
    Cholesky,
    IndefiniteError,
    PositiveFactors,
    cholesky,
    factorize_operator,
)
from cpmkit.plugin import CsrOperator


def positive(n):
    half = random_array((n, n), density=min(0.3, 8 / n**0.5), rng=np.random.default_rng(0))
    return (half @ half.T + eye_array(n)).tocsr()


@pytest.mark.parametrize("n", [1, 50, DENSE_UNKNOWNS, DENSE_UNKNOWNS + 1])
def test_both_kinds_solve(n):
    matrix, b = positive(n), np.random.default_rng(1).normal(size=(n, 2))
    factors = factorize_operator(CsrOperator(matrix, True))
    assert isinstance(factors.lu, Cholesky) == (n <= DENSE_UNKNOWNS)
    np.testing.assert_allclose(matrix @ factors.solve(b), b, atol=1e-10)
    np.testing.assert_allclose(matrix @ factors.solve(b[:, 0]), b[:, 0], atol=1e-10)
    np.testing.assert_allclose(matrix @ PositiveFactors.of(matrix, "here").solve(b), b, atol=1e-10)


def test_sparse_matrices_have_sparse_factors():
    assert cholesky(eye_array(100).tocsr()) is None
    assert not isinstance(factorize_operator(CsrOperator(eye_array(100).tocsr(), True)).lu, Cholesky)


@pytest.mark.parametrize("bad", [-1.0, np.nan])
def test_what_is_not_positive_is_left_to_pivots(bad):
    matrix = csr_array(np.diag([1.0, 2.0, bad]) + 1e-9)
    assert cholesky(matrix) is None
    with pytest.raises(IndefiniteError, match="1 eigenvalues of the wrong sign there" if bad < 0 else "singular there"):
        PositiveFactors.of(matrix, "there")
    if bad < 0:
        np.testing.assert_allclose(
            factorize_operator(CsrOperator(matrix, True)).solve(np.ones((3, 1)))[:, 0], [1, 0.5, -1], atol=1e-6
        )


def test_what_is_not_symmetric_is_not_asked():
    matrix = csr_array(np.array([[2.0, 1.0], [0.0, 2.0]]))
    factors = factorize_operator(CsrOperator(matrix, False))
    assert not isinstance(factors.lu, Cholesky)
    np.testing.assert_allclose(factors.solve(np.array([[3.0], [2.0]]))[:, 0], [1.0, 1.0])


def test_complex_right_sides_are_solved_and_complex_matrices_left_to_pivots():
    matrix, b = positive(40), np.random.default_rng(1).normal(size=(40, 2)) * (1 + 2j)
    np.testing.assert_allclose(matrix @ cholesky(matrix).solve(b), b, atol=1e-10)
    shifted = CsrOperator((matrix + 1j * eye_array(40)).tocsr(), True)
    assert not isinstance(factorize_operator(shifted).lu, Cholesky)


def test_a_free_constant_is_bordered_as_before():
    sphere = ck.source("analytic.sphere")
    scene = ck.Scene(sphere, ck.Poisson(lambda x: 2 * x[:, 0]))
    dense, other = (
        ck.solve(scene, 0.35, form="galerkin", solver=solver, solver_tolerance=1e-12)
        for solver in ("direct", "multigrid")
    )
    assert dense.discretized.size <= DENSE_UNKNOWNS
    at = sphere.mesh(0.2)[0]
    np.testing.assert_allclose(dense.evaluate(at), other.evaluate(at), atol=1e-9)
    assert np.abs(dense.evaluate(at) - at[:, 0]).max() < 1e-2
