"""A cylinder with rims and a curve across it: values, slopes and couplings are met at order 2.5 or more."""

import numpy as np
import pytest
from cylinder_problems import CUT, LENGTH, above, below, condition, cylinder_mesh, exact_of, scene, times, unlike
from model_problems import order_of
from small_galerkin import small

import cpmkit as ck

SPACINGS = (0.2, 0.14, 0.1)
FINE = (0.2, 0.1, 0.05)
UNLIKE = [("dirichlet", "dirichlet"), ("neumann", "dirichlet"), ("1e-3", "1e3")]
COUPLED = [("dirichlet", 1.0), ("neumann", 1000.0), ("0.5", 1e-3)]
#: The same at finer spacings is slow.
BOTH = [SPACINGS, pytest.param(FINE, marks=pytest.mark.slow)]


def errors(given, upper=above, spacings=SPACINGS):
    """The root mean squares of the errors; triangles of a quarter of the spacing, as samples are not clipped."""
    found = []
    for spacing in spacings:
        mesh = cylinder_mesh(spacing)
        one = small(given, mesh, spacing, spacing * np.array([0.3, 0.1, 0.7]))
        off = one.solved()[:, 0] - exact_of(mesh, upper)(one.points, one.samples.cell)
        assert np.abs(off).max() < 0.1 * spacing**1.5
        found.append(np.sqrt(np.mean(off**2)))
    return found


@pytest.mark.parametrize("spacings", BOTH)
@pytest.mark.parametrize(("above_kind", "below_kind"), UNLIKE)
def test_unlike_sides(above_kind, below_kind, spacings):
    found = errors(scene(unlike(above_kind, below_kind), None), spacings=spacings)
    assert order_of(spacings, found) > 2.5


def coupled(lower, contrast, resistance=0.2):
    (u_b, s_b, _), (u_a, s_a, _) = below(CUT), above(CUT)
    flow = 0.5 * (contrast * s_a + s_b)  # from the left, above, to the right
    across = ck.Transmission(
        jump=times(u_a - u_b - resistance * flow), flux=times(s_b - contrast * s_a), resistance=resistance
    )
    edge = {
        0: condition(lower, below(0.0)[0], -below(0.0)[1]),
        1: condition("dirichlet", above(LENGTH)[0], above(LENGTH)[1]),
    }
    return scene({"across": across}, edge, contrast)


@pytest.mark.parametrize("spacings", BOTH)
@pytest.mark.parametrize(("lower", "contrast"), COUPLED)
def test_rims_and_couplings(lower, contrast, spacings):
    assert order_of(spacings, errors(coupled(lower, contrast), spacings=spacings)) > 2.5


@pytest.mark.parametrize(
    "given",
    [
        scene(unlike("dirichlet", "dirichlet"), None),
        scene(unlike("1e-3", "1e3"), None, 1000.0),
        coupled("dirichlet", 1.0, 0.0),
        coupled("0.5", 1000.0, 0.0),
        coupled("neumann", 1000.0, 1e6),
    ],
)
def test_definite_and_symmetric_at_any_position(given):
    for place in np.random.default_rng(2).uniform(size=(6, 3)):
        one = small(given, cylinder_mesh(0.4), 0.2, 0.2 * place)
        terms = one.conditions.matrix
        assert (terms != terms.T).nnz == 0
        assert one.definite()
