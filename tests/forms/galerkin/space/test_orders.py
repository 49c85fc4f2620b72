"""Solutions and eigenvalues on the sphere and on circles converge, at the orders the form is built for."""

import numpy as np
import pytest
from galerkin_scenes import SHIFT, plane_circle, space_circle, sphere
from galerkin_systems import stiffness
from scipy.sparse.linalg import eigsh, splu

from cpmkit.forms.galerkin.options import STABILISATIONS
from cpmkit.forms.galerkin.space.energy import load, mass, stiffness_with_floor, values_at_samples


def order(spacings, errors):
    return -np.polyfit(np.log(1 / np.array(spacings)), np.log(errors), 1)[0]


def factors(matrix):
    # Of symmetric positive matrices: no pivoting, and the ordering that is made for them.
    options = {"SymmetricMode": True}
    return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)


def coordinate_errors(space, factor, strength):
    """The largest and the rms error of -Lap u + u = factor x, whose solution is the coordinate x."""
    s = space.samples
    x = s.points[:, :1] - SHIFT[0]
    u = factors(stiffness_with_floor(space, 1.0, strength, c=1.0)).solve(load(space, factor * x))
    error = values_at_samples(space, u) - x
    return np.abs(error).max(), np.sqrt(s.weights @ error[:, 0] ** 2 / s.weights.sum())


@pytest.mark.parametrize("name", ["default", "accurate"])
def test_a_screened_poisson_problem_on_the_sphere(name):
    spacings = (0.3, 0.2, 0.13)
    # Samples this dense sum what is inside a cell exactly enough: the splines' own order shows.
    dense = [
        coordinate_errors(sphere(0.2 * h).moved(SHIFT).space(h), 3.0, STABILISATIONS[2][name])[1] for h in spacings
    ]
    assert order(spacings, dense) > 2.5
    largest, rms = coordinate_errors(sphere(0.08).moved(SHIFT).space(0.16), 3.0, STABILISATIONS[2][name])
    assert rms < 2e-4
    assert largest < 1.2e-3


@pytest.mark.parametrize("circle", [plane_circle, space_circle])
def test_a_screened_poisson_problem_on_circles(circle):
    spacings = (0.4, 0.2, 0.1, 0.05, 0.025)
    errors = [coordinate_errors(circle(h).space(h), 2.0, STABILISATIONS[2]["default"])[1] for h in spacings]
    assert order(spacings, errors) > 2.3
    assert errors[-1] < 2e-7


def eigenvalue_errors(drawn, h, exact):
    space = drawn.space(h)
    K, M = stiffness(space, 1.0, STABILISATIONS[2]["default"]), mass(space, 1.0)
    found = np.sort(eigsh(K.tocsc(), len(exact), M.tocsc(), sigma=-0.5, v0=np.ones(space.dof_map.size))[0])
    assert abs(found[0]) < 1e-10
    return np.abs(found[1:] / exact[1:] - 1)


def test_eigenvalues_of_the_sphere():
    exact = np.concatenate([np.full(2 * k + 1, k * (k + 1.0)) for k in range(4)])
    spacings = (0.4, 0.25, 0.16)
    errors = np.array([eigenvalue_errors(sphere(0.5 * h).moved(SHIFT), h, exact) for h in spacings])
    assert order(spacings, errors[:, -1]) > 2.5
    assert errors[-1, :3].max() < 2e-4
    assert errors[-1, -1] < 6e-4


@pytest.mark.parametrize("circle", [plane_circle, space_circle])
def test_eigenvalues_of_circles(circle):
    exact = np.concatenate([[0], np.repeat(np.arange(1.0, 6) ** 2, 2)])
    spacings = (0.4, 0.2, 0.1, 0.05)
    errors = np.array([eigenvalue_errors(circle(h), h, exact).max() for h in spacings])
    assert order(spacings, errors) > 3
