"""Open meshes as people store them: a mountain with one ragged rim, an aeroplane with 27 windows and doors cut out."""

import numpy as np
from cpmkit_mesh import edge_loop, feature_edges, triangles

import cpmkit as ck


def lengths(mesh):
    step = np.linalg.norm(np.diff(mesh.vertices[mesh.adjacency.boundary], axis=1)[:, 0], axis=1)
    return np.bincount(mesh.adjacency.loop, step)


def total(curve):
    return np.linalg.norm(np.diff(curve.vertices[curve.segments], axis=1), axis=2).sum()


def test_every_hole_of_the_aeroplane_is_a_loop(real_mesh):
    mesh = triangles(file=real_mesh("plane_holes.obj"))
    assert len(mesh.vertices) == 8519
    assert len(lengths(mesh)) == 27
    assert (np.diff(lengths(mesh)) <= 0).all()
    for loop in (0, 13, 26):
        hole = edge_loop(surface=mesh, loop=loop)
        assert hole.closed
        np.testing.assert_allclose(total(hole), lengths(mesh)[loop])
        middle = hole.vertices.mean(axis=0)
        feet = mesh.closest_point(middle + 0.02 * (hole.vertices - middle))
        assert np.mean(feet.edge == loop) > 0.9  # whoever looks out of the window has its frame nearest
    np.testing.assert_allclose(lengths(mesh)[1:].mean(), 1.77, rtol=0.02)
    np.testing.assert_allclose(total(edge_loop(surface=mesh)), lengths(mesh).sum())


def test_the_aeroplane_has_creases_and_says_so(real_mesh):
    mesh = triangles(file=real_mesh("plane_holes.obj"))
    (sentence,) = mesh.advice(0.15).closest_point_warnings
    assert "edges of the mesh turn by more than 40 degrees, the sharpest by 132 near" in sentence
    creases = feature_edges(surface=mesh)
    assert len(creases.segments) == int((mesh.inner_edges.angle > np.deg2rad(40)).sum())
    assert total(feature_edges(surface=mesh, chain=0)) < total(creases)


def test_meshes_of_smooth_things_are_not_reported(real_mesh):
    for name, spacing in (("spot.obj", 0.05), ("mountain.obj", 0.6)):
        advice = triangles(file=real_mesh(name)).advice(spacing)
        assert (*advice.warnings, *advice.closest_point_warnings) == ()


def test_a_ring_on_the_mountain_parts_its_summit_from_its_rim(real_mesh):
    """Between ring and rim nothing flows out, so one value reigns; inside, all lie between the ring's extremes."""
    mesh = triangles(file=real_mesh("mountain.obj"))
    rim = edge_loop(surface=mesh)
    assert len(rim.segments) == 636
    np.testing.assert_allclose(total(rim), 143.6, rtol=1e-3)
    middle, angle = mesh.bounds.mean(axis=0), np.linspace(0, 2 * np.pi, 241)
    above = middle + 8 * np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=1)
    points = mesh.closest_point(above).points
    ring = ck.source("mesh.polyline", points=points[:-1], closed=True)
    data = ck.Dirichlet(lambda x: 1 + 0.5 * np.sin(x[:, 0]))
    vertices = mesh.vertices[::7]
    far = np.linalg.norm((vertices - middle)[:, [0, 2]], axis=1)
    for edge, lowest in ((ck.Neumann(0.0), 2.0), (ck.Dirichlet(1.8), 1.8)):
        scene = ck.Scene(mesh, ck.Laplace(), [ck.Boundary("ring", ring, left=data, right=ck.Dirichlet(2.0))], edge=edge)
        values = ck.solve(scene, 1.6).evaluate(vertices)
        inside, outside = values[far < 4], values[far > 13]
        assert 0.5 - 1e-3 < inside.min() < inside.max() < 1.5 + 1e-3
        assert lowest - 1e-3 < outside.min() < outside.max() < 2.0 + 1e-3
