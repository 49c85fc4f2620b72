"""A triangle mesh stands for the smooth surface that it samples: second order, down to a second-order floor.

Row 20 of the acceptance table: u = z on a sphere given as a mesh, by -Lap u + u = 3 z.
"""

import numpy as np
import pytest
from model_problems import octahedron, order_of, sphere_points

import cpmkit as ck


def error(rounds, spacing, closest="smooth"):
    vertices, faces = octahedron(rounds)
    mesh = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest=closest)
    scene = ck.Scene(mesh, ck.ScreenedPoisson(lambda x: 3 * x[:, 2] / np.linalg.norm(x, axis=1), c=1.0))
    points = sphere_points()
    return np.abs(ck.solve(scene, spacing).evaluate(points) - points[:, 2]).max()


def test_second_order_on_a_mesh_of_4098_vertices():
    assert len(octahedron(5)[0]) == 4098
    errors = [error(5, h) for h in (0.3, 0.2, 0.14)]
    assert errors[-1] <= 2e-4
    assert order_of((0.3, 0.2, 0.14), errors) >= 1.8


@pytest.mark.slow
def test_the_floor_of_a_coarse_mesh_falls_with_the_square_of_its_edges():
    floors = [error(rounds, 0.05) for rounds in (2, 3, 4)]
    assert floors[0] / floors[1] > 2.5
    assert floors[1] / floors[2] > 2.5


def test_facets_have_a_floor_that_no_spacing_removes():
    faceted = [error(4, h, "faceted") for h in (0.2, 0.1)]
    assert min(faceted) > 10 * error(4, 0.1)
    assert faceted[1] > 0.3 * faceted[0]


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
def test_a_two_sided_curve_on_a_mesh(closest):
    vertices, faces = octahedron(5)
    theta = np.linspace(0, 2 * np.pi, 361)
    ring = np.stack([np.cos(theta), np.sin(theta), 0.3 + 0 * theta], axis=1)
    ring[-1] = ring[0]
    mesh = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest=closest)
    on = mesh.closest_point(ring / np.linalg.norm(ring, axis=1, keepdims=True)).points
    on[-1] = on[0]
    curve = ck.source("mesh.polyline", points=on)
    scene = ck.Scene(mesh, ck.Laplace(), [ck.Boundary("ring", curve, left=ck.Dirichlet(1.0), right=ck.Dirichlet(5.0))])
    points = sphere_points()
    north = points[:, 2] > 0.3 / np.sqrt(1.09) + 1e-3
    south = points[:, 2] < 0.3 / np.sqrt(1.09) - 1e-3
    values = ck.solve(scene, 0.15, solver_tolerance=1e-10).evaluate(points)
    np.testing.assert_allclose(values[north], 1.0, atol=1e-7)
    np.testing.assert_allclose(values[south], 5.0, atol=1e-7)
