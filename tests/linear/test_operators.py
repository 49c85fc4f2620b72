"""Every operator is one linear map, whichever way it is asked: products, rows of them, shifts and the matrix agree."""

import numpy as np
import pytest
from scipy.sparse import csr_array

import cpmkit as ck
from cpmkit.linear.operators import Bordered, ComplexShift
from cpmkit.plugin import CsrOperator

RNG = np.random.default_rng(0)
CIRCLE = ck.source("analytic.circle")
CUT = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), left=ck.Robin(1.0, 2.0), right=ck.Neumann(0.0))


def of(problem, boundaries=()):
    form = ck.discretize(ck.Scene(CIRCLE, problem, list(boundaries)), 0.1)
    return form, form.stiffness(problem.terms())


def bordered():
    form, stiffness = of(ck.Poisson(1.0))
    return Bordered(stiffness, form.free_constants(stiffness))


OPERATORS = {
    "constant": lambda: of(ck.ScreenedPoisson(1.0), [CUT])[1],
    "varying": lambda: of(ck.Elliptic(1.0, diffusivity=lambda x: 2 + x[:, 0], c=lambda x: x[:, 1] ** 2), [CUT])[1],
    "bordered": bordered,
    "complex": lambda: ComplexShift(of(ck.ScreenedPoisson(1.0))[1], 3.0),
    "csr": lambda: CsrOperator(csr_array(RNG.normal(size=(40, 40)))),
}


def dense(operator):
    matrix = operator.to_csr().toarray()
    if isinstance(operator, Bordered):
        matrix = matrix + operator.apply(np.eye(operator.size)) - operator.operator.apply(np.eye(operator.size))
    return matrix


@pytest.mark.parametrize("name", OPERATORS)
def test_products_rows_and_the_matrix_agree(name):
    operator = OPERATORS[name]()
    n = operator.size
    matrix, rows = dense(operator), RNG.choice(n, 7, replace=False)
    size = np.abs(matrix).sum(axis=1).max()
    for shape in ((n,), (n, 3)):
        u = RNG.normal(size=shape) + (1j * RNG.normal(size=shape) if name == "complex" else 0)
        image = operator.apply(u)
        np.testing.assert_allclose(image, matrix @ u, atol=1e-12 * size)
        np.testing.assert_allclose(operator.apply_rows(u, rows), image[rows], atol=1e-12 * size)
    assert operator.nonzeros > 0
    assert not operator.symmetric or np.allclose(matrix, matrix.T)


@pytest.mark.parametrize("name", ["constant", "varying", "csr"])
def test_shifts_are_those_of_the_matrix(name):
    operator = OPERATORS[name]()
    matrix, one = operator.to_csr().toarray(), np.eye(operator.size)
    size = np.abs(matrix).max()
    np.testing.assert_allclose(operator.scaled_plus_mass(0.3).to_csr().toarray(), one + 0.3 * matrix, atol=1e-12 * size)
    np.testing.assert_allclose(
        operator.minus_shifted_mass(0.7).to_csr().toarray(), matrix - 0.7 * one, atol=1e-12 * size
    )


def test_a_shift_by_what_steklov_conditions_bring():
    disc = ck.source("solid", of=CIRCLE)
    problem = ck.Eigen(3)
    form = ck.discretize(ck.Scene(disc, problem, edge=ck.Steklov()), 0.2)
    stiffness = form.stiffness(problem.terms())
    mass = form.boundary_mass(stiffness)
    expected = stiffness.to_csr() - 1.7 * mass.matrix
    found = stiffness.minus_shifted_mass(1.7, mass).to_csr()
    np.testing.assert_allclose(found.toarray(), expected.toarray(), atol=1e-11 * np.abs(expected.toarray()).max())


@pytest.mark.parametrize("form", ["collocation", "galerkin"])
def test_rows_read_values_and_gradients(form):
    scene = ck.Scene(CIRCLE, ck.ScreenedPoisson(lambda x: 2 * x[:, 0]), [CUT])
    solution, points = ck.solve(scene, 0.05, form=form), np.array([[0.6, 0.8], [-1.0, 0.0], [0.0, -1.0]])
    form, u = solution.discretized, solution.values
    np.testing.assert_allclose(form.evaluation_matrix(points) @ u[:, 0], solution.evaluate(points), atol=1e-13)
    np.testing.assert_allclose(form.gradient(u, points)[:, 0], solution.gradient(points), atol=1e-10)


@pytest.mark.parametrize(("form", "apart", "kept"), [("collocation", 0.05, 0.0), ("galerkin", 0.05, 1e-4)])
def test_what_is_known_at_points_is_put_back(form, apart, kept):
    """By rounds, to the order of the spacing, or as splines in mean square, to their error."""
    scene = ck.Scene(CIRCLE, ck.ScreenedPoisson(lambda x: 2 * x[:, 0]), [CUT])
    solution = ck.solve(scene, 0.05, form=form)
    form, u = solution.discretized, solution.values
    again = form.project(form.at_points(u))
    np.testing.assert_allclose(form.at_points(again), form.at_points(u), atol=kept)
    assert np.abs(again - u).max() < apart * np.ptp(u)
