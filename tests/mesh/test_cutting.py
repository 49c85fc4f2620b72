"""Cut along boundaries a mesh falls into what they part: tips, junctions, rims and one-sided strips alike."""

import numpy as np
from sample_shapes import equator, grid, moebius, octahedron, pieces, with_cut

from cpmkit.mesh.adjacency import cut_corners, half_facets
from cpmkit.plugin import Mesh


def corners_at(mesh, vertex):
    return len(np.unique(cut_corners(mesh)[mesh.cells == vertex]))


def test_an_uncut_mesh_keeps_its_vertices():
    mesh = octahedron(2)
    corners = cut_corners(mesh)
    assert len(np.unique(np.stack([corners.ravel(), mesh.cells.ravel()]), axis=1).T) == len(mesh.vertices)
    assert corners.max() + 1 == len(mesh.vertices)
    assert len(half_facets(mesh).cell) == 0


def test_the_equator_parts_a_sphere():
    mesh = octahedron(2)
    mesh = with_cut(mesh, equator(mesh))
    corners = cut_corners(mesh)
    assert pieces(corners) == 2
    assert corners.max() + 1 == len(mesh.vertices) + len(mesh.cut)
    seen = half_facets(mesh)
    assert (np.bincount(seen.cut) == 2).all()
    ends = mesh.facets[seen.cell, seen.facet]
    assert (ends[seen.along > 0] == mesh.cut[seen.cut[seen.along > 0]]).all()
    assert (ends[seen.along < 0] == mesh.cut[seen.cut[seen.along < 0]][:, ::-1]).all()
    assert (np.bincount(seen.cut, seen.along) == 0).all()


def test_a_slit_leaves_one_piece_and_its_tips_whole():
    mesh = grid(6, 6)
    slit = with_cut(mesh, [[16, 23], [23, 30], [30, 37]])
    assert pieces(cut_corners(slit)) == 1
    assert [corners_at(slit, vertex) for vertex in (16, 23, 30, 37)] == [1, 2, 2, 1]
    open_slit = with_cut(mesh, [[2, 9], [9, 16]])
    assert [corners_at(open_slit, vertex) for vertex in (2, 9, 16)] == [2, 2, 1]


def test_junctions_have_a_corner_for_each_sector():
    mesh = grid(6, 6)
    y = with_cut(mesh, [[24, 25], [24, 17], [24, 32]])
    assert corners_at(y, 24) == 3
    x = with_cut(mesh, [[24, 25], [24, 17], [23, 24], [24, 31]])
    assert corners_at(x, 24) == 4


def test_the_core_of_a_one_sided_strip_has_two_sides_and_leaves_one_piece():
    mesh, core = moebius()
    mesh = with_cut(mesh, core)
    corners = cut_corners(mesh)
    assert pieces(corners) == 1
    assert corners.max() + 1 == len(mesh.vertices) + len(core)
    seen = half_facets(mesh)
    assert (np.bincount(seen.cut[seen.cut >= 0]) == 2).all()
    assert (seen.cut < 0).sum() == 2 * len(core)


def test_edges_of_three_sheets_join_or_part_them_all():
    vertices = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0.5], [-1, 1, 0.5], [-1, -1, 0.5]], dtype=float)
    mesh = Mesh.of(vertices, np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]]))
    assert corners_at(mesh, 0) == 1
    separated = with_cut(mesh, [[0, 1]])
    assert corners_at(separated, 0) == 3
    seen = half_facets(separated)
    assert seen.along[seen.cut == 0].tolist() == [-1, -1, 1] or seen.along[seen.cut == 0].tolist() == [1, 1, -1]
    assert (seen.cut >= 0).sum() == 3


def test_points_part_curves():
    mesh = Mesh.of(np.array([[k, 0.0] for k in range(5)]), np.array([[0, 1], [1, 2], [2, 3], [2, 4]]))
    cut = with_cut(mesh, [[2]])
    assert pieces(cut_corners(mesh)) == 1
    assert pieces(cut_corners(cut)) == 3
    seen = half_facets(cut)
    at = seen.cut == 0
    assert seen.cell[at].tolist() == [1, 2, 3]
    assert seen.along[at].tolist() == [1, -1, -1]
    assert sorted(mesh.facets[seen.cell, seen.facet][~at, 0].tolist()) == [0, 3, 4]


def test_an_edge_that_no_cell_has_cuts_nothing():
    mesh = grid(1, 1)
    cells = [set(cell) for cell in mesh.cells.tolist()]
    absent = next([a, b] for a in range(4) for b in range(a) if not any({a, b} <= cell for cell in cells))
    cut = with_cut(mesh, [absent])
    np.testing.assert_array_equal(cut_corners(cut), cut_corners(mesh))
    assert (half_facets(cut).cut == -1).all()
