"""Interpolation of degree p reproduces polynomials of degree p, and constants to rounding."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit import InputError
from cpmkit.grid.band import (
    reading_radius,
    stencil_cells,
    tensor_offsets,
    tensor_weights,
)


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
@pytest.mark.parametrize("dim", [2, 3])
def test_polynomials_are_reproduced(degree, dim):
    rng = np.random.default_rng(degree)
    points = rng.uniform(-5, 5, (200, dim))
    points[:20] = np.round(points[:20])  # on nodes
    cells, fractions = stencil_cells(0.1 * points, 0.1, degree)
    nodes = cells[:, None] + tensor_offsets(degree, dim)
    powers = rng.integers(0, degree + 1, (8, dim))
    for power in powers:
        values = np.prod((nodes / 5.0) ** power, axis=2)
        read = np.sum(tensor_weights(fractions, degree) * values, axis=1)
        np.testing.assert_allclose(read, np.prod((points / 5.0) ** power, axis=1), atol=1e-11)


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
def test_weights_sum_to_one(degree):
    fractions = np.random.default_rng(1).uniform(0, 1, (500, 3))
    np.testing.assert_allclose(tensor_weights(fractions, degree).sum(axis=1), 1, atol=1e-14)


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
@pytest.mark.parametrize("dim", [2, 3])
def test_a_stencil_reads_within_its_radius(degree, dim):
    points = np.random.default_rng(2).uniform(-3, 3, (5000, dim))
    cells, _ = stencil_cells(points, 1.0, degree)
    reach = np.linalg.norm(cells[:, None] + tensor_offsets(degree, dim) - points[:, None], axis=2).max()
    assert 0.9 * reading_radius(dim, degree) < reach <= reading_radius(dim, degree)


@pytest.mark.parametrize("degree", [1, 0, 6, 2.5, "3", True])
def test_other_degrees_are_refused(degree):
    scene = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(1.0))
    with pytest.raises(InputError, match="degree must be one of 2, 3, 4, 5"):
        ck.discretize(scene, 0.2, form="collocation", degree=degree)
