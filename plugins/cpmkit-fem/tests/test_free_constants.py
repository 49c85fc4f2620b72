"""Where nothing fixes a constant the solution of mean zero is taken, and what of the data has no solution is told."""

import numpy as np
import pytest
from model_problems import order_of, sphere_points

import cpmkit as ck

POINTS = sphere_points(1000)
SPHERE = ck.source("analytic.sphere")


def test_second_order_on_a_closed_surface():
    spacings = [0.2, 0.1, 0.05]
    solutions = [ck.solve(ck.Scene(SPHERE, ck.Poisson(lambda x: 2 * x[:, 2])), h, backend="fem") for h in spacings]
    errors = [np.abs(one.evaluate(POINTS) - POINTS[:, 2]).max() for one in solutions]
    assert 1.8 < order_of(spacings, errors) < 2.2
    for one in solutions:
        assert abs(one.mean()) < 1e-13
        assert one.warnings == ()
        assert one.imbalances[0].relative < 1e-10


def test_what_does_not_balance_is_left_out_of_f():
    scene = ck.Scene(SPHERE, ck.Poisson([lambda x: 2 * x[:, 2] + 1, lambda x: 2 * x[:, 2]]))
    with pytest.warns(ck.CpmkitWarning, match="do not balance"):
        solution = ck.solve(scene, 0.1, backend="fem")
    np.testing.assert_allclose(solution.imbalances[0].value, [1.0, 0.0], atol=1e-10)
    np.testing.assert_allclose(solution.values[:, 0], solution.values[:, 1], atol=1e-10)


def test_each_piece_has_a_constant_of_its_own(octahedron):
    vertices, faces = octahedron(3)
    two = ck.source(
        "mesh.triangles",
        vertices=np.concatenate([vertices, vertices + [5, 0, 0]]),
        faces=np.concatenate([faces, faces + len(vertices)]),
    )
    equator = ck.source("analytic.circle", normal=[0, 0, 1])
    imposed = ck.Boundary("equator", equator, both=ck.Dirichlet(1.0))

    def solved(boundaries):
        return ck.solve(ck.Scene(two, ck.Poisson(lambda x: 2 * x[:, 2]), boundaries), backend="fem")

    both, one = solved([]), solved([imposed])
    assert [len(solution.imbalances) for solution in (both, one)] == [2, 1]
    first, second = np.split(both.values[:, 0], 2)
    np.testing.assert_allclose(first, second, atol=1e-10)
    np.testing.assert_allclose(one.evaluate(vertices + [5, 0, 0]), second, atol=1e-10)
    np.testing.assert_allclose(one.evaluate(vertices), first + 1, atol=1e-2)  # the equator has more vertices there


def test_a_small_c_fixes_the_constant():
    solution = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(1e-7, c=1e-7)), 0.02, backend="fem", solver_tolerance=1e-4)
    assert solution.imbalances == ()
    np.testing.assert_allclose(solution.values, 1.0, rtol=1e-3)
