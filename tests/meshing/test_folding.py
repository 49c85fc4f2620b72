"""A boundary that bends by more than the height of a triangle beside it does not turn that triangle over."""

import numpy as np
from sample_shapes import with_cut

import cpmkit as ck
from cpmkit.meshing.untangling import flip_third_edges, is_folded, untangle_vertices
from cpmkit.plugin import Mesh

FLAT = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-3, 0], [0.5, -1, 0]])
MESH = Mesh.of(FLAT, np.array([[0, 1, 2], [1, 0, 3]]))


def test_what_turns_a_triangle_over_is_put_back():
    up = FLAT + [[0, 0.02, 0], [0, 0.02, 0], [0, 0, 0], [0, 0, 0]]
    np.testing.assert_array_equal(untangle_vertices(MESH, FLAT, up), FLAT)
    down = FLAT - [[0, 0.02, 0], [0, 0.02, 0], [0, 0, 0], [0, 0, 0]]
    np.testing.assert_array_equal(untangle_vertices(MESH, FLAT, down), down)


def test_an_edge_that_bends_over_the_opposite_corner_folds_its_triangle():
    corners = FLAT[MESH.cells]
    middles = 0.5 * (np.roll(corners, -1, axis=1) + np.roll(corners, -2, axis=1))
    assert not is_folded(MESH.vertices[MESH.cells], middles).any()
    middles[:, 2, 1] += 0.02  # the common edge, opposite to the last corner of either
    assert is_folded(MESH.vertices[MESH.cells], middles).tolist() == [True, False]


def test_an_edge_on_a_boundary_is_not_flipped():
    thin = np.array([0]), np.array([2])  # the corner opposite to the common edge
    assert flip_third_edges(MESH, *thin).cells.tolist() != MESH.cells.tolist()
    assert flip_third_edges(with_cut(MESH, [[1, 0]]), *thin).cells.tolist() == MESH.cells.tolist()


def test_nothing_beside_a_circle_counts_twice():
    """The areas on both sides of a small circle of the unit sphere, at a position where two triangles turned over."""
    normal = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0][2]
    circle = ck.source("analytic.circle", center=0.3 * normal, radius=np.sqrt(0.91), normal=normal)
    boundary = ck.Boundary("circle", circle, left=ck.Neumann(0.0), right=ck.Neumann(0.0))
    scene = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(1.0), [boundary])
    weights = ck.discretize(scene, 0.1, form="galerkin").sampled.samples.weights
    assert abs(weights.sum() - 4 * np.pi) < 3e-4 * 0.1**2
