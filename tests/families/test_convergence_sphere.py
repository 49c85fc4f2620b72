"""On the sphere, Poisson's equation with Dirichlet data on great circles converges at the order asked for."""

import numpy as np
import pytest
from model_problems import max_error, order_of, rotation, sphere_poisson

import cpmkit as ck

SPACINGS = (0.3, 0.2, 0.14)
TILTED = [rotation()[:, 0]]
CROSSING = [rotation()[:, 0], rotation()[:, 1]]


#: One circle, and two that cross: what holds beside two holds beside one.
CIRCLES = [pytest.param(TILTED, id="tilted", marks=pytest.mark.slow), pytest.param(CROSSING, id="crossing")]


@pytest.mark.parametrize("normals", CIRCLES)
def test_second_order(normals):
    problem = sphere_poisson(normals)
    errors = [max_error(*problem, h) for h in SPACINGS]
    assert errors[-1] <= 5e-4
    assert order_of(SPACINGS, errors) >= 1.8


@pytest.mark.parametrize("normals", CIRCLES)
def test_first_order(normals):
    problem = sphere_poisson(normals)
    errors = [max_error(*problem, h, order=1) for h in SPACINGS]
    assert errors[-1] <= 0.12
    assert 0.8 <= order_of(SPACINGS, errors) <= 1.4


@pytest.mark.slow
def test_a_circle_in_a_plane_of_nodes_is_no_special_case():
    problem = sphere_poisson([[1.0, 0.0, 0.0]])
    errors = [max_error(*problem, h, origin=np.zeros(3)) for h in SPACINGS]
    assert errors[-1] <= 2e-3
    assert order_of(SPACINGS, errors) >= 1.8


def test_the_lattices_origin_changes_the_error_only_within_the_schemes_own():
    scene, points, exact = sphere_poisson(TILTED)
    solutions = [
        ck.solve(scene, 0.2, origin=0.2 * o).evaluate(points) for o in np.random.default_rng(7).uniform(0, 1, (4, 3))
    ]
    spread = max(np.abs(a - solutions[0]).max() for a in solutions[1:])
    assert spread <= 2 * max(np.abs(u - exact).max() for u in solutions)
    assert max(np.abs(u - exact).max() for u in solutions) <= 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("normals", [TILTED, CROSSING], ids=["tilted", "crossing"])
def test_second_order_rms_over_origins(normals):
    scene, points, exact = sphere_poisson(normals)
    shifts = np.random.default_rng(1).uniform(0, 1, (6, 3))
    spacings = (0.2, 0.1, 0.05, 0.025)
    errors = [
        np.sqrt(np.mean([max_error(scene, points, exact, h, origin=h * o) ** 2 for o in shifts])) for h in spacings
    ]
    assert order_of(spacings, errors) >= 1.9
