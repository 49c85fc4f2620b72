"""Rows of splines read quadratic functions and their slopes exactly, through any patch, also outside its cell."""

import numpy as np
import pytest
from galerkin_scenes import plane_circle, space_circle, sphere

from cpmkit.forms.galerkin.dof_map import build_dof_map
from cpmkit.forms.galerkin.space.spline_space import derivative_rows, value_rows

H = 0.1


@pytest.fixture(params=["sphere", "plane", "space"])
def dof_map(request):
    drawn = {"sphere": sphere(0.5 * H), "plane": plane_circle(H), "space": space_circle(H)}[request.param]
    return build_dof_map(drawn.samples.points, drawn.contacts, H)


def quadratic(dim):
    """A quadratic function of z = x / h, its slopes in z, and the coefficients of its spline at nodes."""
    rng = np.random.default_rng(1)
    square, linear = rng.normal(size=(dim, dim)), rng.normal(size=dim)
    square = square + square.T

    def value(z):
        return np.einsum("ki,ij,kj->k", z, square, z) + z @ linear + 3.0

    # The spline with coefficients i^2 - 1/4 is z^2; products of different axes are those of linear functions.
    return value, lambda z: 2 * z @ square + linear, lambda i: value(i) - np.trace(square) / 4


def test_quadratic_functions_are_read_exactly(dof_map):
    rng = np.random.default_rng(0)
    value, slopes, coefficients = quadratic(dof_map.dim)
    patch = rng.integers(len(dof_map.cells), size=200)
    z = dof_map.cells[patch] + rng.uniform(-2, 2, (200, dof_map.dim))
    directions = rng.normal(size=z.shape)
    u = coefficients(dof_map.nodes)
    size = np.abs(u).max()
    assert value_rows(dof_map, patch, z * H) @ u == pytest.approx(value(z), abs=1e-12 * size)
    exact = np.einsum("ki,ki->k", directions, slopes(z)) / H
    assert derivative_rows(dof_map, patch, z * H, directions) @ u == pytest.approx(exact, abs=1e-11 * size / H)


def test_constants_are_read_as_they_are_and_have_no_slope(dof_map):
    patch = np.arange(len(dof_map.cells))
    points = dof_map.cells * H
    one = np.ones(dof_map.size)
    assert value_rows(dof_map, patch, points) @ one == pytest.approx(1, abs=1e-14)
    assert derivative_rows(dof_map, patch, points, points + 1) @ one == pytest.approx(0, abs=1e-12)


def test_nothing_is_read_twice_in_a_row_of_a_speck():
    drawn = sphere(0.5 * H, radius=0.9 * H)
    speck = build_dof_map(drawn.samples.points, drawn.contacts, H)
    rows = value_rows(speck, speck.patch[:5], drawn.samples.points[:5])
    assert speck.size == 1
    assert rows.nnz == 5
    assert rows.toarray() == pytest.approx(1)
