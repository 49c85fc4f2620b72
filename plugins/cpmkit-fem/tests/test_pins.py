"""With fem-pinned, vertices form a wall without gaps along a curve, on meshes of any quality, but not past its ends."""

import numpy as np
import pytest
from cpmkit_fem.cell_mesh import CellMesh
from cpmkit_fem.gaps import ends_in_gaps
from cpmkit_fem.nearest import pinned_parts
from cpmkit_fem.triangulation import triangulation
from model_problems import order_of, rotation, sphere_poisson
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import cpmkit as ck


def pinned(vertices, faces, curve):
    surface = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    scene = ck.Scene(surface, ck.Laplace(), [ck.Boundary("curve", curve, both=ck.Dirichlet(0.0))])
    mesh = triangulation(surface, None)
    (part,) = pinned_parts(scene, mesh)
    return mesh, part.vertex_numbers


@pytest.mark.parametrize("height", [1.0, 0.3])
def test_no_path_along_edges_avoids_the_pins(octahedron, height):
    vertices, faces = octahedron(2)
    vertices = vertices * [1, 1, height]  # pushed back onto the sphere: far from Delaunay where height is small
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    rng = np.random.default_rng(0)
    for _ in range(20):
        normal, offset = rng.normal(size=3), rng.uniform(-0.4, 0.4)
        normal /= np.linalg.norm(normal)
        circle = ck.source("analytic.circle", normal=normal, center=offset * normal, radius=np.sqrt(1 - offset**2))
        mesh, pins = pinned(vertices, faces, circle)
        edges = mesh.edges
        open_edges = edges[~np.isin(edges, pins).any(axis=1)]
        n = len(mesh.nodes)
        _, piece = connected_components(
            coo_array((np.ones(len(open_edges)), open_edges.T), shape=(n, n)), directed=False
        )
        side = mesh.nodes @ normal - offset
        free = np.setdiff1d(np.arange(n), pins)
        left, right = (set(piece[free[sign * side[free] > 0.25]]) for sign in (1, -1))
        assert not left & right


@pytest.mark.parametrize("height", [1.0, 0.3])
def test_an_open_curve_pins_nothing_past_its_ends(octahedron, height):
    vertices, faces = octahedron(3)
    vertices = vertices * [1, 1, height]
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    angle = np.linspace(0.3, 1.4, 200)
    curve = ck.source("mesh.polyline", points=np.stack([np.cos(angle), np.sin(angle), 0.04 + 0 * angle], axis=1))
    mesh, pins = pinned(vertices, faces, curve)
    reached = np.arctan2(mesh.nodes[pins, 1], mesh.nodes[pins, 0])
    assert 0.1 < reached.min() < 0.4
    assert 1.3 < reached.max() < 1.6
    assert curve.closest_point(mesh.nodes[pins]).distance.max() < mesh.longest_edges.max()


def test_a_point_pins_one_vertex(octahedron):
    vertices, faces = octahedron(3)
    mesh, pins = pinned(vertices, faces, ck.source("analytic.point", at=vertices[30] + 0.01))
    np.testing.assert_array_equal(mesh.nodes[pins], vertices[30:31])


@pytest.mark.parametrize(("shift", "count"), [(0.0, 0), (0.5, 1)])
def test_an_edge_around_the_end_of_a_curve_is_not_crossed(shift, count):
    curve = ck.source("mesh.polyline", points=[[0, 0, 0], [1, 0, 0]])
    vertices = np.array([[shift - 0.05, -0.4, 0], [shift - 0.05, 0.6, 0], [shift - 2, 0.1, 0]])
    ends = ends_in_gaps(curve, CellMesh(vertices, np.array([[0, 1, 2]]), 2), np.array([2]))
    assert ends.tolist() == [0] * count


def test_it_is_of_first_order_and_says_so():
    scene, points, exact = sphere_poisson([rotation()[0]])
    spacings, errors = [0.2, 0.1, 0.05, 0.025], []
    for spacing in spacings:
        solution = ck.solve(scene, spacing, backend="fem-pinned")
        errors.append(np.abs(solution.evaluate(points) - exact).max())
        assert "first order" in solution.warnings[0]
    assert solution.summary()["discretization"]["backend"] == "fem-pinned"
    assert 0.8 < order_of(spacings, errors) < 1.6


@pytest.mark.parametrize(("left", "right"), [(ck.Dirichlet(1), ck.Dirichlet(2)), (ck.Neumann(), ck.Neumann())])
def test_what_one_value_a_vertex_cannot_hold(left, right):
    equator = ck.Boundary("equator", ck.source("analytic.circle", normal=[0, 0, 1]), left=left, right=right)
    with pytest.raises(ck.SceneError, match=r"'equator' has .* one value a vertex .*; use backend='fem'"):
        ck.solve(ck.Scene(ck.source("analytic.sphere"), ck.Laplace(), [equator]), 0.3, backend="fem-pinned")
