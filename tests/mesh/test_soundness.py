"""A sound mesh hangs together exactly where its cells share edges, whatever its unit and order."""

import numpy as np
import pytest
from sample_shapes import grid, joined, moebius, octahedron, pieces

from cpmkit.mesh.adjacency import RepairReport, repair
from cpmkit.mesh.cell_quadrature import quadrature
from cpmkit.plugin import Mesh


def shuffled(mesh, seed=0):
    rng = np.random.default_rng(seed)
    turned = np.take_along_axis(mesh.cells, (rng.integers(3, size=(len(mesh.cells), 1)) + np.arange(3)) % 3, 1)
    return Mesh.of(mesh.vertices, turned[rng.permutation(len(mesh.cells))])


def parted(mesh, noise=0.0):
    """Return the mesh with vertices of each triangle's own."""
    rng = np.random.default_rng(1)
    vertices = mesh.vertices[mesh.cells].reshape(-1, 3)
    size = np.ptp(vertices)
    return Mesh.of(
        vertices + noise * size * rng.uniform(-1, 1, vertices.shape), np.arange(len(vertices)).reshape(-1, 3)
    )


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("noise", [0.0, 1e-7])
def test_separate_triangles_are_welded_to_a_closed_mesh(unit, noise):
    whole = octahedron(3, unit)
    mesh, repaired = repair(shuffled(parted(whole, noise)))
    assert (len(mesh.vertices), len(mesh.cells)) == (len(whole.vertices), len(whole.cells))
    assert repaired == RepairReport(3 * len(whole.cells) - len(whole.vertices), 0, 0)
    edges = np.unique(np.sort(mesh.facets.reshape(-1, 2), axis=1), axis=0, return_counts=True)[1]
    assert (edges == 2).all()


def test_a_sound_mesh_stays_as_it_is():
    mesh, repaired = repair(octahedron(2))
    assert repaired == RepairReport(0, 0, 0)
    again, _ = repair(mesh)
    assert (again.cells == mesh.cells).all()
    assert (again.vertices == mesh.vertices).all()


def test_spheres_that_touch_at_a_vertex_are_separated():
    one = octahedron(2)
    other = Mesh.of(one.vertices + [2.0, 0.0, 0.0], one.cells)
    mesh, repaired = repair(joined(one, other))
    assert repaired == RepairReport(1, 0, 1)
    assert pieces(mesh.cells) == 2
    assert len(mesh.vertices) == 2 * len(one.vertices)


def test_a_pinched_neck_is_split_though_the_surface_is_connected():
    mesh = grid(6, 6)
    cells = np.where(mesh.cells == 40, 8, mesh.cells)  # (5, 5) is drawn to (1, 1)
    vertices = mesh.vertices.copy()
    pinched, repaired = repair(Mesh.of(vertices, cells))
    assert repaired.fans == 1
    assert pieces(pinched.cells) == 1
    assert len(pinched.vertices) == len(vertices)


def test_doubled_and_collapsed_triangles_count_once():
    mesh = octahedron(2)
    folded = np.concatenate([mesh.cells, mesh.cells[5:9][:, [1, 0, 2]], [[3, 3, 4]]])
    repaired_mesh, repaired = repair(Mesh.of(mesh.vertices, folded))
    assert repaired == RepairReport(0, 5, 0)
    assert quadrature(repaired_mesh).weights.sum() == pytest.approx(quadrature(mesh).weights.sum(), rel=1e-14)


def test_three_sheets_hang_together_along_their_edge():
    vertices = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0.5], [-1, 1, 0.5], [-1, -1, 0.5]], dtype=float)
    mesh, repaired = repair(Mesh.of(vertices, np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]])))
    assert repaired == RepairReport(0, 0, 0)
    assert pieces(mesh.cells) == 1


def test_one_sided_strips_are_one_piece():
    mesh, repaired = repair(moebius()[0])
    assert repaired == RepairReport(0, 0, 0)
    assert pieces(mesh.cells) == 1


def test_curves_stay_joined_where_three_segments_meet():
    vertices = np.array([[0, 0], [1, 0], [0, 0], [0, 1], [-1, 0], [0, 1e-9]], dtype=float)
    mesh, repaired = repair(Mesh.of(vertices, np.array([[0, 1], [2, 3], [4, 5], [3, 2]])))
    assert repaired == RepairReport(2, 1, 0)
    assert pieces(mesh.cells) == 1
    assert len(mesh.vertices) == 4
