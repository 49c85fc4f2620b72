"""A circle cut at two points: coupled or unlike sides, whatever contrast, resistance and Robin factors, order 2.5."""

import numpy as np
import pytest
from model_problems import on_circle, order_of
from small_galerkin import circle_mesh, small
from two_materials import CUTS, SECOND, angle, circle_problem, on_a

import cpmkit as ck

SPACINGS = (0.2, 0.1, 0.05)


def exact(x, cell):
    s = angle(x)
    return np.where(on_a(s), np.sin(2 * s) + 1, 0.5 * np.cos(3 * s))


def errors(scene, place, mesh=circle_mesh):
    found = []
    for spacing in SPACINGS:
        origin = spacing * np.asarray(place)
        found.append(small(scene, mesh(spacing, CUTS, origin), spacing, origin).error(exact))
    return found


@pytest.mark.parametrize("contrast", [1.0, 10.0, 1000.0, 1e-3])
@pytest.mark.parametrize("resistance", [0.0, 0.3, 1e6])
def test_coupled_sides(contrast, resistance):
    scene = circle_problem(1.0, contrast, resistance)[0]
    found = errors(scene, (0.3, 0.7))
    assert order_of(SPACINGS, found) > 2.8
    assert found[1] < 2e-4  # whatever the contrast


def dirichlet(value, slope, factor):
    return ck.Dirichlet(value)


def neumann(value, slope, factor):
    return ck.Neumann(slope)


def robin(value, slope, factor):
    return ck.Robin(factor, 1.0, factor * slope + value)


def negative(value, slope, factor):
    return ck.Robin(-factor, -1.0, -factor * slope - value)


def variable(value, slope, factor):
    return ck.Robin(factor, lambda x: 2.0 + x[:, 0], lambda x: factor * slope + (2.0 + x[:, 0]) * value)


def unlike(on_left, on_right, factor=1.0, k_a=1.0, k_b=5.0):
    """The circle of two materials with a condition on each side of each cut, which u of the tests keeps."""
    coupled = circle_problem(k_a, k_b)[0]
    end = 2 * np.pi
    a = {s: (np.sin(2 * s) + 1, 2 * np.cos(2 * s)) for s in (0.0, SECOND)}
    b = {s: (0.5 * np.cos(3 * s), -1.5 * np.sin(3 * s)) for s in (SECOND, end)}
    points = [ck.source("analytic.point", at=on_circle(np.array([CUTS[0] + s]))[0]) for s in (0.0, SECOND)]
    sides = [(b[end], a[0.0]), (a[SECOND], b[SECOND])]
    cuts = [
        ck.Boundary(name, point, left=on_left(left[0], left[1], factor), right=on_right(right[0], -right[1], factor))
        for name, point, (left, right) in zip(("first", "second"), points, sides, strict=True)
    ]
    return ck.Scene(coupled.surface, coupled.problem, cuts)


@pytest.mark.parametrize(
    ("left", "right", "factor"),
    [
        (dirichlet, dirichlet, 1.0),
        (dirichlet, neumann, 1.0),
        (neumann, dirichlet, 1.0),
        (neumann, neumann, 1.0),
        *[(robin, robin, 10.0**power) for power in (-6, -3, -1, 0, 1, 3, 6)],
        (negative, dirichlet, 0.1),
        (variable, neumann, 0.2),
    ],
)
def test_unlike_sides(left, right, factor):
    found = errors(unlike(left, right, factor), (0.3, 0.7))
    assert order_of(SPACINGS, found) > 2.5
    assert found[1] < 4e-4


def reversed_winding(*arguments):
    from dataclasses import replace

    mesh = circle_mesh(*arguments)
    return replace(mesh, cells=mesh.cells[:, ::-1].copy())


def test_winding_names_no_side():
    scene = unlike(dirichlet, neumann)
    assert np.allclose(errors(scene, (0.3, 0.7)), errors(scene, (0.3, 0.7), reversed_winding), rtol=1e-6)


@pytest.mark.parametrize("conditions", [(dirichlet, robin, 1e-3), (robin, neumann, 1e3), (dirichlet, dirichlet, 1.0)])
def test_definite_at_any_position(conditions):
    scene = unlike(*conditions, k_b=1000.0)
    for place in np.random.default_rng(0).uniform(size=(12, 2)):
        one = small(scene, circle_mesh(0.1, CUTS, 0.1 * place), 0.1, 0.1 * place)
        terms = one.conditions.matrix
        assert (terms != terms.T).nnz == 0
        assert one.definite()


@pytest.mark.parametrize("resistance", [0.0, 1.0, 1e6])
def test_couplings_are_definite_at_any_position(resistance):
    scene = circle_problem(1.0, 1000.0, resistance)[0]
    for place in np.random.default_rng(1).uniform(size=(12, 2)):
        one = small(scene, circle_mesh(0.1, CUTS, 0.1 * place), 0.1, 0.1 * place)
        terms = one.conditions.matrix
        assert (terms != terms.T).nnz == 0
        assert one.definite()


def test_constants_pass_fluxes_and_couplings():
    for scene in (unlike(neumann, neumann), circle_problem(1.0, 10.0, 0.5)[0]):
        one = small(scene, circle_mesh(0.1, CUTS), 0.1)
        terms = one.conditions.matrix
        if scene.boundaries[0].across is None:
            assert abs(terms).max() == 0
        else:
            assert np.abs(terms @ np.ones(terms.shape[0])).max() < 1e-12 * abs(terms).max()


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_units_do_not_matter(unit):
    def scene(size):
        point = ck.source("analytic.point", at=size * on_circle(np.array([CUTS[0]]))[0])
        cut = ck.Boundary("cut", point, left=ck.Dirichlet(2.0), right=ck.Robin(0.3 * size, 1.0, 0.5))
        problem = ck.ScreenedPoisson(lambda x: x[:, 0] / size**3, 1.0 / size**2)
        return ck.Scene(ck.source("analytic.circle", radius=size), problem, [cut])

    found = [
        small(scene(size), circle_mesh(0.1 * size, CUTS[:1], radius=size), 0.1 * size).solved() for size in (1.0, unit)
    ]
    assert np.allclose(*found, rtol=1e-6, atol=1e-7)
