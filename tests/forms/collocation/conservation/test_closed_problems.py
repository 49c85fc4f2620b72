"""Where nothing flows out, collocation is of second order, and the Galerkin form, whose fluxes balance, exacter."""

import pytest
from closed_problems import (
    on_circle_up_to_a_constant,
    on_circle_with_coefficients,
    on_half_sphere,
    on_sphere,
    on_torus,
    on_two_spheres,
)
from model_problems import order_of

#: Of a problem over a count of positions of the lattice: the largest rms errors at the finest spacing, of collocation
#: and of the Galerkin form.
MOST = {
    on_sphere: (7e-3, 2e-4, 1),
    on_torus: (5e-3, 7e-5, 1),
    on_half_sphere: (2e-2, 2e-4, 1),
    on_two_spheres: (1.5e-2, 3e-4, 1),
    on_circle_with_coefficients: (2e-4, 3.5e-6, 4),
    on_circle_up_to_a_constant: (2.5e-4, 4.5e-6, 4),
}


@pytest.mark.parametrize(
    "problem", [pytest.param(one, marks=[pytest.mark.slow] * (one is on_torus), id=one.__name__) for one in MOST]
)
def test_both_forms_converge(problem):
    known, (most, most_of_galerkin, count) = problem(), MOST[problem]
    plain, galerkin = known.errors(count, form="collocation"), known.errors(count, form="galerkin")
    assert plain[-1] <= most
    assert problem is on_half_sphere or order_of(known.spacings, plain) >= 1.8
    assert galerkin[-1] <= most_of_galerkin
    assert order_of(known.spacings, galerkin) >= 2.7
