"""Split cells cover the same places, share their edges, keep their shape, and carry boundaries along."""

import numpy as np
import pytest
from sample_shapes import equator, grid, octahedron, pieces, with_cut

from cpmkit.mesh.adjacency import cut_corners, half_facets, repair
from cpmkit.mesh.cell_quadrature import quadrature
from cpmkit.mesh.subdivision import split_at_knot_planes, subdivide
from cpmkit.plugin import Mesh


def least_angles(mesh):
    corners = mesh.vertices[mesh.cells]
    after, before = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    cosine = np.einsum("mkd,mkd->mk", after, before)
    cosine /= np.linalg.norm(after, axis=2) * np.linalg.norm(before, axis=2)
    return np.rad2deg(np.arccos(cosine.max(axis=1)))


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("length", [1.0, 0.31, 0.1])
def test_no_edge_is_long_and_the_area_stays(unit, length):
    mesh = octahedron(1, unit)
    fine = subdivide(mesh, length * unit)
    edges = fine.edges
    assert edges.lengths(fine.vertices).max() <= length * unit * (1 + 1e-8)
    assert (np.bincount(edges.of_cells.ravel()) == 2).all()
    assert len(fine.vertices) - len(edges.ends) + len(fine.cells) == 2
    assert quadrature(fine).weights.sum() == pytest.approx(quadrature(mesh).weights.sum(), rel=1e-13)
    assert (fine.vertices[: len(mesh.vertices)] == mesh.vertices).all()
    assert least_angles(fine).min() >= 0.5 * least_angles(mesh).min()


def test_needles_are_cut_across():
    needles = grid(1, 1, 1.0, 0.01)
    pieces = subdivide(needles, 0.02)
    assert len(pieces.cells) < 300
    assert np.median(least_angles(pieces)) > 20 * least_angles(needles).max()


@pytest.mark.parametrize("seed", range(6))
def test_needles_beside_other_triangles_share_their_edges(seed):
    from scipy.spatial import Delaunay

    rng = np.random.default_rng(seed)
    flat = np.concatenate([rng.uniform(size=(60, 2)), [[0, 0], [0, 1], [1, 0], [1, 1]]])
    stretched = np.column_stack([flat * [4.0, 0.1 + 0.3 * seed], np.zeros(len(flat))])
    mesh = repair(Mesh.of(stretched, Delaunay(flat).simplices.astype(np.int64)))[0]
    ends = mesh.edges.ends
    cut = ends[rng.permutation(len(ends))[:40]]
    turned = np.where(rng.integers(2, size=(40, 1)) == 1, cut, cut[:, ::-1])
    mesh = Mesh(mesh.vertices, mesh.cells, None, turned, np.arange(40), np.arange(40) % 3 == 0)
    fine = subdivide(mesh, 0.07)
    edges = fine.edges
    assert edges.lengths(fine.vertices).max() <= 0.07
    assert quadrature(fine).weights.sum() == pytest.approx(quadrature(mesh).weights.sum(), rel=1e-12)
    uses = np.bincount(edges.of_cells.ravel())
    rim = fine.vertices[edges.ends[uses == 1]]
    assert uses.max() == 2
    side = stretched.max(axis=0)
    assert (((np.abs(rim) < 1e-12) | (np.abs(rim - side) < 1e-12))[..., :2].any(axis=2)).all()
    assert np.linalg.norm(rim[:, 1] - rim[:, 0], axis=1).sum() == pytest.approx(2 * side.sum(), rel=1e-12)
    way = fine.vertices[fine.cut[:, 1]] - fine.vertices[fine.cut[:, 0]]
    total = np.stack([np.bincount(fine.owner, way[:, k]) for k in range(3)], axis=1)
    assert total == pytest.approx(mesh.vertices[turned[:, 1]] - mesh.vertices[turned[:, 0]], abs=1e-12)
    lengths = np.bincount(fine.owner, np.linalg.norm(way, axis=1))
    assert lengths == pytest.approx(np.linalg.norm(total, axis=1), rel=1e-12)
    assert (fine.beyond_tip == (fine.owner % 3 == 0)).all()
    seen = half_facets(fine)
    assert (np.bincount(seen.cut[seen.cut >= 0], minlength=len(fine.cut)) >= 1).all()


def test_pieces_are_wound_like_their_triangle():
    fine = subdivide(grid(2, 3), 0.13)
    p, q, r = (fine.vertices[fine.cells[:, k]] for k in range(3))
    assert (np.cross(q - p, r - p)[:, 2] > 0).all()


def test_boundaries_are_split_with_their_edges():
    mesh = octahedron(1)
    order = np.array([[0, 1], [1, 3], [3, 4], [4, 0]])  # along the equator, in corners of the octahedron
    middle = [equator(mesh)[k] for k in range(8)]
    cut = []
    for a, b in order:
        between = next(
            i
            for i in range(6, len(mesh.vertices))
            if [min(a, i), i] in [m.tolist() for m in middle] and [min(b, i), i] in [m.tolist() for m in middle]
        )
        cut += [[a, between], [between, b]]
    mesh = with_cut(mesh, cut)
    extends = np.arange(8) % 2 == 1
    mesh = Mesh(mesh.vertices, mesh.cells, None, mesh.cut, np.arange(8), extends)
    fine = subdivide(mesh, 0.15)
    assert pieces(cut_corners(fine)) == 2
    assert (fine.cut[:, 1] == np.roll(fine.cut[:, 0], -1)).all()
    assert (fine.beyond_tip == (fine.owner % 2 == 1)).all()
    assert (np.bincount(half_facets(fine).cut, minlength=len(fine.cut)) == 2).all()
    way = fine.vertices[fine.cut[:, 1]] - fine.vertices[fine.cut[:, 0]]
    given = (mesh.vertices[mesh.cut[:, 1]] - mesh.vertices[mesh.cut[:, 0]])[fine.owner]
    assert np.linalg.norm(way, axis=1) @ np.linalg.norm(given, axis=1) == pytest.approx(np.sum(way * given), rel=1e-12)


def test_segments_are_cut_in_equal_parts():
    mesh = Mesh.of(np.array([[0.0, 0, 0], [1, 0, 0], [1, 0.3, 0]]), np.array([[0, 1], [1, 2]]))
    fine = subdivide(with_cut(mesh, [[1]]), 0.25)
    lengths = np.linalg.norm(np.diff(fine.vertices[fine.cells], axis=1), axis=2)
    assert lengths.ravel() == pytest.approx([0.25] * 4 + [0.15] * 2)
    assert (fine.cells[1:, 0] == fine.cells[:-1, 1]).all()
    assert fine.cut.tolist() == [[1]]


@pytest.mark.parametrize("spacing", [0.3, 0.07])
def test_segments_end_on_knot_planes(spacing):
    angle = 2 * np.pi * np.arange(50) / 50
    points = np.stack([np.cos(angle), np.sin(angle), 0.3 * np.sin(3 * angle)], axis=1)
    mesh = Mesh.of(points, np.stack([np.arange(50), (np.arange(50) + 1) % 50], axis=1))
    fine = split_at_knot_planes(mesh, spacing)
    z = fine.vertices[fine.cells] / spacing
    low, high = z.min(axis=1), z.max(axis=1)
    assert (np.ceil(high + 0.5 - 1e-5) - 1 <= np.floor(low + 0.5 + 1e-5)).all()
    assert quadrature(fine).weights.sum() == pytest.approx(quadrature(mesh).weights.sum(), rel=1e-13)
    assert (np.bincount(fine.cells.ravel()) == 2).all()


def test_segments_in_a_knot_plane_or_ending_on_one_stay_whole():
    mesh = Mesh.of(np.array([[0.5, 0.6], [0.5, 1.4], [1.5, 1.4]]), np.array([[0, 1], [1, 2]]))
    assert len(split_at_knot_planes(mesh, 1.0).cells) == 2


def test_needles_with_edges_of_just_twice_the_length_leave_no_crack():
    """Rounding must not tell the triangles beside an edge apart: one would halve its half, the other leave it."""
    turn, across = np.meshgrid(np.linspace(0, 2 * np.pi, 120, endpoint=False), np.linspace(-0.3, 0.3, 7), indexing="ij")
    vertices = np.stack([np.cos(turn), np.sin(turn), across], axis=-1).reshape(-1, 3)
    number = np.arange(840).reshape(120, 7)
    after = np.roll(number, -1, axis=0)
    a, b, c, d = number[:, :-1], after[:, :-1], after[:, 1:], number[:, 1:]
    cells = np.concatenate([np.stack(one, axis=-1).reshape(-1, 3) for one in ((a, b, c), (a, c, d))])
    mesh = Mesh.of(vertices, cells)
    lengths = mesh.edges.lengths(vertices)
    for length in (lengths.max() / 2, np.median(lengths) / 2, lengths.min() / 4):
        for by in (1 - 1e-15, 1.0, 1 + 1e-15):
            fine = subdivide(mesh, by * length)
            edges = fine.edges
            rim = edges.ends[np.bincount(edges.of_cells.ravel()) == 1]
            assert np.abs(np.abs(fine.vertices[rim][..., 2]) - 0.3).max() < 1e-12
