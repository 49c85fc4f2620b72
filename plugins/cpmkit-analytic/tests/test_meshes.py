"""Meshes lie on the manifold, are watertight up to the edges, wound outwards, and as fine as asked."""

from __future__ import annotations

import numpy as np
import pytest
from cpmkit_analytic import arc, cap, circle, cylinder, point, segment, sphere, torus

SURFACES = {
    "sphere": (sphere(center=[1, 2, 3], radius=2.0), 0, 4 * np.pi * 4, 2),
    "small cap": (cap(radius=2.0, height=1.5, axis=[1, 1, 1]), 1, 2 * np.pi * 2 * 0.5, 1),
    "large cap": (cap(radius=1.0, height=-0.95), 1, 2 * np.pi * 1.95, 1),
    "torus": (torus(major=2.0, minor=0.5, axis=[1, 0, 2]), 0, 4 * np.pi**2, 0),
    "narrow torus": (torus(major=1.0, minor=0.99), 0, 4 * np.pi**2 * 0.99, 0),
    "cylinder": (cylinder(radius=0.5, length=3.0), 2, 3 * np.pi, 0),
}


def directed(cells):
    return np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]])


def as_keys(edges):
    return edges[:, 0] * (edges.max() + 1) + edges[:, 1]


def cross(vertices, cells):
    a, b, c = vertices[cells.T]
    return 0.5 * np.cross(b - a, c - a)


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("spacing", [100.0, 0.7, 0.05])
def test_a_triangulation_is_watertight_up_to_its_rims(name, spacing):
    source, rims, _, euler = SURFACES[name]
    vertices, cells = source.mesh(spacing)
    assert np.array_equal(np.unique(cells), np.arange(len(vertices)))
    edges = directed(cells)
    forward, backward = as_keys(edges), as_keys(edges[:, ::-1])
    assert len(np.unique(forward)) == len(forward)  # each edge at most once in each direction
    alone = edges[~np.isin(backward, forward)]
    assert len(np.unique(alone)) == len(alone)
    # beside a point of a rim, about half of all queries lie beyond it
    beside = vertices[:, None] + 1e-9 * np.random.default_rng(2).normal(size=(len(vertices), 20, 3))
    edge = source.closest_point(beside.reshape(-1, 3)).edge.reshape(len(vertices), 20).max(axis=1)
    assert np.array_equal(np.flatnonzero(edge >= 0), np.unique(alone))
    assert np.array_equal(np.unique(edge[alone[:, 0]]), np.arange(rims))
    count = len(np.unique(np.sort(edges, axis=1), axis=0))
    assert len(vertices) - count + len(cells) == euler


@pytest.mark.parametrize("name", SURFACES)
def test_triangles_are_wound_outwards_and_fill_the_area(name):
    source, _, area, _ = SURFACES[name]
    vertices, cells = source.mesh(0.05)
    assert source.closest_point(vertices).distance.max() < 1e-14
    normals = cross(vertices, cells)
    outward = source.normals(source.closest_point(vertices[cells].mean(axis=1)))
    assert (np.einsum("nd,nd->n", normals, outward) > 0.8 * np.linalg.norm(normals, axis=1)).all()
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(area, rel=5e-3)


@pytest.mark.parametrize("name", SURFACES)
def test_edges_are_of_about_the_spacing(name):
    source = SURFACES[name][0]
    vertices, cells = source.mesh(0.05)
    edges = directed(cells)
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    assert length.max() < 1.5 * 0.05
    assert np.median(length) > 0.8 * 0.05


def test_a_curve_is_a_chain_of_segments_in_the_direction_of_travel():
    for source, closed in ((circle(), True), (arc(start=1, end=3), False), (segment(start=[0, 0], end=[1, 2]), False)):
        vertices, cells = source.mesh(0.1)
        assert np.array_equal(cells[:, 0], np.arange(len(cells)))
        assert np.array_equal(cells[:, 1], (np.arange(len(cells)) + 1) % len(vertices))
        assert len(vertices) == len(cells) + (not closed)
        assert source.closest_point(vertices).distance.max() < 1e-15
        steps = vertices[cells[:, 1]] - vertices[cells[:, 0]]
        assert (np.linalg.norm(steps, axis=1) <= 0.1 * (1 + 1e-12)).all()
        assert (np.linalg.norm(steps, axis=1) > 0.09).all()
        tangents = source.tangents(source.closest_point(vertices[cells[:, 0]]))
        assert (np.einsum("nd,nd->n", steps, tangents) > 0).all()
    assert len(segment(start=[0, 0], end=[1, 0]).mesh(0.1)[1]) == 10  # not 11 for round-off


def test_a_point_is_one_vertex_and_one_cell():
    vertices, cells = point(at=[1.0, 2.0, 3.0]).mesh(0.1)
    assert vertices.tolist() == [[1.0, 2.0, 3.0]]
    assert cells.tolist() == [[0]]


@pytest.mark.parametrize("spacing", [0.0, -1.0, np.nan, np.inf, "fine"])
def test_a_spacing_that_is_not_above_zero_is_refused(spacing):
    with pytest.raises(ValueError, match="spacing must be"):
        sphere().mesh(spacing)
