"""Small symmetric positive matrices are factorised densely, others as before."""

import numpy as np
import pytest
from scipy.sparse import csr_array, eye_array, random_array

import cpmkit as ck
from cpmkit.linear.dense import DENSE_UNKNOWNS, Cholesky, cholesky
from cpmkit.linear.factorization import factorize
from cpmkit.linear.multigrid_exact import Indefinite, PositiveFactors
from cpmkit.linear.operators import CsrOperator


def positive(n):
    half = random_array((n, n), density=min(5 / n, 1), rng=np.random.default_rng(0))
    return (half @ half.T + eye_array(n)).tocsr()


@pytest.mark.parametrize("n", [1, 50, DENSE_UNKNOWNS, DENSE_UNKNOWNS + 1])
def test_both_kinds_solve(n):
    matrix, b = positive(n), np.random.default_rng(1).normal(size=(n, 2))
    factors = factorize(CsrOperator(matrix, True))
    assert isinstance(factors.lu, Cholesky) == (n <= DENSE_UNKNOWNS)
    np.testing.assert_allclose(matrix @ factors.solve(b), b, atol=1e-10)
    np.testing.assert_allclose(matrix @ PositiveFactors.of(matrix, "here").solve(b), b, atol=1e-10)


@pytest.mark.parametrize("bad", [-1.0, np.nan])
def test_what_is_not_positive_is_left_to_pivots(bad):
    matrix = csr_array(np.diag([1.0, 2.0, bad]))
    assert cholesky(matrix) is None
    with pytest.raises(Indefinite, match="1 eigenvalues of the wrong sign there" if bad < 0 else "singular there"):
        PositiveFactors.of(matrix, "there")
    if bad < 0:
        np.testing.assert_allclose(factorize(CsrOperator(matrix, True)).solve(np.ones((3, 1)))[:, 0], [1, 0.5, -1])


def test_what_is_not_symmetric_is_not_asked():
    matrix = csr_array(np.array([[2.0, 1.0], [0.0, 2.0]]))
    factors = factorize(CsrOperator(matrix, False))
    assert not isinstance(factors.lu, Cholesky)
    np.testing.assert_allclose(factors.solve(np.array([[3.0], [2.0]]))[:, 0], [1.0, 1.0])


def test_a_free_constant_is_bordered_as_before():
    circle = ck.source("analytic.circle")
    solution = ck.solve(ck.Scene(circle, ck.Poisson(lambda x: x[:, 0])), 0.1, form="galerkin", solver="direct")
    assert solution.discretized.size <= DENSE_UNKNOWNS
    at = circle.mesh(0.05)[0]
    np.testing.assert_allclose(solution.evaluate(at), at[:, 0], atol=1e-3)
    assert abs(solution.evaluate(at).mean()) < 1e-3
