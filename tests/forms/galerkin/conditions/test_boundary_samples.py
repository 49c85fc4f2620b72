"""Boundary samples lie on the facets, sum to their length, and point out of their cells, thin ones as well."""

from dataclasses import replace

import numpy as np
import pytest

from cpmkit.forms.galerkin.conditions.boundary_samples import boundary_samples
from cpmkit.mesh.adjacency import cut_corners, half_facets
from cpmkit.plugin import Mesh


def sampled(mesh, rims=False, points=None):
    return boundary_samples(mesh, half_facets(mesh), cut_corners(mesh), rims, points)


def hexagon(inward=0.0):
    """Six triangles about the middle of the plane, a curved cut from corner 0 over the middle to corner 3."""
    angles = np.pi / 3 * np.arange(6)
    vertices = np.append(np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1), [[0, 0, 0]], axis=0)
    cells = np.stack([np.full(6, 6), np.arange(6), (np.arange(6) + 1) % 6], axis=1)
    corners = vertices[cells]
    middles = 0.5 * (np.roll(corners, -1, axis=1) + np.roll(corners, -2, axis=1))
    cut = np.array([[0, 6], [6, 3]])
    for cell, facet in ((0, 2), (5, 1), (2, 1), (3, 2)):  # the cells beside the cut, and their edges on it
        middles[cell, facet, 1] += inward
    return Mesh(vertices, cells, middles, cut, np.zeros(2, dtype=np.int64), np.zeros(2, dtype=bool))


def test_length_and_directions_of_a_curved_cut():
    samples = sampled(hexagon(0.05))
    assert len(samples) == 4 * 6
    for half in np.unique(samples.half):
        on = samples.half == half
        x = np.linspace(0, 1, 1001)
        arc = np.hypot(np.diff(x), np.diff(4 * 0.05 * x * (1 - x))).sum()
        assert samples.weights[on].sum() == pytest.approx(arc, rel=1e-4)
        x = np.abs(samples.points[on, 0])
        assert samples.points[on, 1] == pytest.approx(4 * 0.05 * x * (1 - x))
        slope = 4 * 0.05 * (1 - 2 * x) * np.sign(samples.points[on, 0])
        up = np.stack([-slope, np.ones(6), np.zeros(6)], axis=1) / np.hypot(slope, 1)[:, None]
        above = samples.cell[on][0] < 3
        assert np.allclose(samples.conormals[on], -up if above else up)
    assert np.allclose(np.abs(samples.normals[:, 0]), [0, 0, 1])


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("height", [1e-2, 1e-4, 1e-7])
def test_a_curved_edge_of_a_thin_triangle(height, unit):
    """Beside the cut a vertex nearer to it than the cut's own bend: the conormal is that of the cells around."""
    mesh = hexagon(0.05)
    between = np.array([-0.5, height, 0.0])
    vertices = unit * np.append(mesh.vertices, [between], axis=0)
    cells = np.append(mesh.cells[[0, 1, 3, 4, 5]], [[6, 7, 3], [6, 2, 7], [2, 3, 7]], axis=0)
    corners = vertices[cells]
    middles = 0.5 * (np.roll(corners, -1, axis=1) + np.roll(corners, -2, axis=1))
    for old, new in ((0, 0), (5, 4), (3, 2)):
        middles[new] = unit * mesh.midpoints[old]
    middles[5, 1] = unit * mesh.midpoints[2, 1]
    samples = sampled(replace(mesh, vertices=vertices, cells=cells, midpoints=middles))
    thin = samples.cell == 5
    assert thin.sum() == 6
    assert (samples.conormals[thin, 1] < -0.9).all()
    assert np.allclose(samples.conormals[samples.cell == 2], -samples.conormals[thin][::-1], atol=1e-9) or np.allclose(
        samples.conormals[samples.cell == 2], -samples.conormals[thin], atol=1e-9
    )


def test_rims_are_sampled_where_conditions_need_them():
    mesh = hexagon()
    samples = sampled(mesh, rims=True)
    rim = samples.owner < 0
    assert rim.sum() == 6 * 6
    assert samples.weights[rim].sum() == pytest.approx(6.0)
    assert (np.sum(samples.conormals * samples.points, axis=1)[rim] > 0.8).all()
    assert (samples.facet[rim] == -1).all()


def test_ends_and_cuts_of_a_curve():
    x = np.array([[0.0, 0, 0], [1, 0, 0], [2, 1, 0]])
    mesh = Mesh(
        x, np.array([[0, 1], [2, 1]]), None, np.array([[1]]), np.zeros(1, dtype=np.int64), np.zeros(1, dtype=bool)
    )
    samples = sampled(mesh, rims=True)
    order = np.argsort(samples.cell * 4 - samples.owner)
    samples = samples.take(order)
    r = np.sqrt(0.5)
    assert np.allclose(samples.points, x[[1, 0, 1, 2]])
    assert np.allclose(samples.conormals, [[1, 0, 0], [-1, 0, 0], [-r, -r, 0], [r, r, 0]])
    assert (samples.weights == 1).all()
    assert samples.normals.shape == (4, 2, 3)
    assert np.abs(np.einsum("bcd,bd->bc", samples.normals, samples.conormals)).max() < 1e-15


def test_points_of_a_surface_read_one_of_their_triangles():
    samples = sampled(hexagon(), points={3: np.array([6])})
    last = samples.take(samples.half < 0)
    assert len(last) == 1
    assert last.owner[0] == 3
    assert np.allclose(last.points, 0)
    assert np.allclose(last.conormals, 0)
    assert (last.as_samples.weights == 0).all()
