"""Points and vertices are boundaries and origins as they are."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.applications.heat import origins_of

VERTICES, FACES = ck.source("analytic.sphere").mesh(0.4)
MESH = ck.source("mesh.triangles", vertices=VERTICES, faces=FACES)
ONE = ck.Dirichlet(1.0)


def places(surface, given):
    (boundary,) = ck.Scene(surface, ck.Laplace(), [ck.Boundary("pins", given, both=ONE)]).boundaries
    assert boundary.source.manifold_dim == 0
    return boundary.source.mesh(1.0)[0]


@pytest.mark.parametrize(
    ("given", "numbers"),
    [
        (VERTICES[[0, 9]], [0, 9]),
        (VERTICES[[0, 9]].tolist(), [0, 9]),
        (VERTICES[5], [5]),
        (7, [7]),
        (np.int64(7), [7]),
        ([3, 8], [3, 8]),
        (np.array([3, 8, 11, 2]), [3, 8, 11, 2]),
        ([[0, 0, 1]], None),
    ],
)
def test_points_and_vertices_are_a_boundary_and_origins(given, numbers):
    exact = VERTICES[numbers] if numbers else np.array([[0.0, 0, 1]])
    np.testing.assert_array_equal(places(MESH, given), exact)
    np.testing.assert_allclose(origins_of(given, MESH).points, MESH.closest_point(exact).points)


def test_points_lie_on_any_surface_and_curve():
    np.testing.assert_array_equal(places(ck.source("analytic.sphere"), [[0.0, 0, 1]]), [[0, 0, 1]])
    np.testing.assert_array_equal(places(ck.source("analytic.circle"), [[1.0, 0], [0, 1]]), [[1, 0], [0, 1]])
    np.testing.assert_array_equal(origins_of([0, 0, 1], ck.source("analytic.sphere")).points, [[0, 0, 1]])


def test_three_numbers_that_are_no_place_near_the_surface_are_vertices():
    numbers = [4, len(VERTICES) - 1, len(VERTICES) - 2]
    np.testing.assert_array_equal(places(MESH, numbers), VERTICES[numbers])


def test_a_value_holds_at_a_vertex():
    pin = ck.Boundary("pin", 4, both=0.25)
    solution = ck.solve(ck.Scene(MESH, ck.Laplace(), [pin]), spacing=0.4)
    np.testing.assert_allclose(solution.evaluate(VERTICES[:3]), 0.25, atol=1e-6)


@pytest.mark.parametrize(
    ("surface", "given", "message"),
    [
        (MESH, [0, 0, 1], r"is \[0, 0, 1\], which may be a point or 3 numbers of vertices; give \[\[0, 0, 1\]\] for"),
        (MESH, len(VERTICES), f"must name vertices from 0 to {len(VERTICES) - 1}, got {len(VERTICES)}"),
        (MESH, [0, -1], "must name vertices from 0 to .*, got -1"),
        (ck.source("analytic.sphere"), 5, r"is \[5\], numbers of vertices, and the surface is no mesh; give points"),
    ],
)
def test_what_is_no_vertex_or_may_be_a_point_is_refused(surface, given, message):
    with pytest.raises(ck.CpmkitError, match=message):
        places(surface, given)
    with pytest.raises(ck.CpmkitError, match=message):
        origins_of(given, surface)


def test_what_is_neither_points_nor_vertices_is_refused():
    message = (
        r"or points \(k, d\), or numbers of the surface's vertices, or "
        r"ck\.source\('mesh\.polyline', points=\.\.\.\) for the curve along points, got"
    )
    for given in ("ring", None, [[1.0, 2.0], [3.0]], np.ones((2, 3, 3)), 0.5):
        with pytest.raises(ck.CpmkitError, match=message):
            ck.Boundary("pins", given, both=ONE)


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
@pytest.mark.parametrize("sides", [(1.0, 1.0), (2.0, -1.0), ("across", "across")])
def test_boundaries_of_other_classes_solve_like_those_of_the_core(form, sides):
    class Equator:
        name, left_of = "equator", None
        source = ck.source("analytic.circle", center=[0, 0, 0], normal=[0, 0, 1], radius=1.0)
        conditions = dict.fromkeys(ck.plugin.SIDES, ck.Transmission(jump=1.0))

        def condition(self, side):
            return self.conditions[side]

    if sides[0] != "across":
        Equator.conditions = {side: ck.Dirichlet(value) for side, value in zip(("left", "right"), sides, strict=True)}
    given = {"across": Equator.conditions["left"]} if sides[0] == "across" else Equator.conditions
    sphere, problem = ck.source("analytic.sphere"), ck.ScreenedPoisson(lambda x: x[:, 0] + x[:, 2])
    values = [
        ck.solve(ck.Scene(sphere, problem, [boundary]), 0.25, form=form).evaluate([[0.6, 0.0, 0.8], [0.0, 0.6, -0.8]])
        for boundary in (Equator(), ck.Boundary("equator", Equator.source, **given))
    ]
    np.testing.assert_array_equal(*values)
