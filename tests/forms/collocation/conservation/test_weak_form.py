"""Weak forms on quadratic cells, and the polynomials that fluxes are balanced against."""

import numpy as np
import pytest
from model_problems import order_of

import cpmkit as ck
from cpmkit.forms.collocation.conservation.polynomials import Polynomials
from cpmkit.forms.collocation.conservation.weak_form import curved_cells_of, weak_form
from cpmkit.mesh.quadratic_cells import QuadraticCells

SPHERE = ck.source("analytic.sphere")
SPACINGS = (0.2, 0.1, 0.05)


def test_the_weak_form_is_of_fourth_order_on_a_sphere():
    """int |grad z|^2 = 8 pi / 3 and int z^2 = 4 pi / 3, off by what quadratic cells leave."""
    off = []
    for h in SPACINGS:
        curved = curved_cells_of(SPHERE, 2 * h)
        none, every = np.zeros(len(curved.nodes)), np.ones(len(curved.nodes))
        weak, z = weak_form(curved, every, none), curved.nodes[:, 2]
        off.append((abs(z @ weak.form @ z - 8 * np.pi / 3), abs(z @ weak.mass @ z - 4 * np.pi / 3)))
    slope, mass = np.transpose(off)
    assert order_of(SPACINGS, slope) >= 3.5
    assert order_of(SPACINGS, mass) >= 3.5
    assert max(slope[-1], mass[-1]) < 1e-4


@pytest.mark.parametrize("dim", [2, 3])
def test_polynomials_are_summed_as_they_are(dim):
    points, rng = np.random.default_rng(0).uniform(-1, 3, (200, dim)), np.random.default_rng(1)
    polynomials = Polynomials(np.full(dim, -1.0), np.full(dim, 3.0), 4)
    values = polynomials.at(points)
    factors = rng.normal(size=(values.shape[1], 2))
    assert (values[:, 0] == 1).all()
    assert np.linalg.matrix_rank(values) == values.shape[1] == {2: 15, 3: 35}[dim]
    assert polynomials.combined(factors, points) == pytest.approx(values @ factors, abs=1e-12)


@pytest.mark.parametrize("height", [0.0, 1e-13])
def test_cells_without_area_weigh_nothing(height):
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, height, 0]])
    middles = np.array([[0.5, 0, 0], [0.5, 0.5, 0], [0, 0.5, 0], [1.5, height / 2, 0], [1, height / 2, 0]])
    cells = np.array([[0, 1, 2, 4, 5, 6], [0, 1, 3, 4, 7, 8]])
    nodes = np.concatenate([corners, middles])
    weak = weak_form(QuadraticCells(nodes, cells), np.ones(9), np.zeros(9))
    assert np.isfinite(weak.form.data).all()
    x = nodes[:, 0]
    assert x @ weak.form @ x == pytest.approx(0.5)
    assert x @ weak.mass @ x == pytest.approx(1 / 12)
