"""Conditions of one scene after another: channels, data at vertices, other data for one preparation, edges, points."""

import numpy as np
import pytest
from cut_meshes import icosphere
from plane_zones import PLATE, POINTS, flat
from sphere_zones import CIRCLE, SPHERE, on_left, sphere_points

import cpmkit as ck

AT = sphere_points(500)


def solve(scene, spacing=0.2, **options):
    return ck.solve(scene, spacing, form="galerkin", **options)


def colours(left, right):
    return ck.Scene(
        SPHERE, ck.Laplace(), [ck.Boundary("C", CIRCLE, left=ck.Dirichlet(left), right=ck.Dirichlet(right))]
    )


def test_channels():
    found = solve(colours([0.1, 0.5, 0.9], [1.0, 0.0, 0.25])).evaluate(AT)
    exact = np.where(on_left(AT)[:, None], [0.1, 0.5, 0.9], [1.0, 0.0, 0.25])
    np.testing.assert_allclose(found, exact, atol=1e-6)


def test_data_at_vertices():
    ico = icosphere(4)
    mesh = ck.source("mesh.triangles", vertices=ico.vertices, faces=ico.cells, closest="faceted")
    given = ck.VertexData(mesh, ico.vertices[:, 0])
    one, other = (
        solve(ck.Scene(mesh, ck.Laplace(), [ck.Boundary("C", CIRCLE, both=ck.Dirichlet(data))]))
        for data in (given, lambda x: x[:, 0])
    )
    np.testing.assert_allclose(one.evaluate(AT), other.evaluate(AT), atol=2e-3)


def test_edges_by_loop():
    cylinder = ck.source("analytic.cylinder", radius=0.5, length=1.0)
    solution = solve(ck.Scene(cylinder, ck.Laplace(), edge={0: ck.Dirichlet(1.0), 1: ck.Dirichlet(3.0)}), 0.1)
    heights = np.linspace(-0.5, 0.5, 11)
    at = np.stack([0.5 * np.ones(11), np.zeros(11), heights], axis=1)
    found = solution.evaluate(at)
    np.testing.assert_allclose(found if found[0] < found[-1] else found[::-1], 2 + 2 * heights, atol=1e-3)
    assert solution.flux("edge") == pytest.approx(0.0, abs=1e-3)


def test_a_value_at_a_point_that_agrees_costs_nothing():
    exact = lambda x: flat(x)[:, 0]  # noqa: E731
    pin = ck.Boundary("pin", ck.source("analytic.point", at=POINTS[0]), both=ck.Dirichlet(float(exact(POINTS[:1])[0])))
    with_pin, without = (
        solve(ck.Scene(PLATE, ck.Laplace(), pins, edge=ck.Dirichlet(exact)), 0.1) for pins in ([pin], [])
    )
    off = [np.abs(one.evaluate(POINTS) - exact(POINTS)).max() for one in (with_pin, without)]
    assert off[0] < 1.05 * off[1] < 1.1e-3  # samples that straddle knot planes
    assert "too small for the equation" in " ".join(with_pin.warnings)
