"""The display mesh is the surface's own, cut along the boundaries: no cell mixes the values of two sides."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import Delaunay

from cpmkit.errors import InputError
from cpmkit.solution.display_mesh import display_mesh


def areas(mesh):
    a, b, c = (mesh.points[mesh.cells[:, k]] for k in range(3))
    ab, ac = b - a, c - a
    if mesh.points.shape[1] == 2:
        return (ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]) / 2
    return np.linalg.norm(np.cross(ab, ac), axis=1) / 2


def spread(mesh):
    return np.ptp(mesh.values[mesh.cells], axis=1).max()


@pytest.mark.parametrize("offset", [0.43, 0.5, 0.5 + 1e-9, 0.1 + 1e-3])
def test_a_straight_boundary_parts_the_square_and_keeps_its_area(square, offset):
    solution = square(10, line=([1, 0], offset))
    mesh = display_mesh(solution)
    assert spread(mesh) == 0
    area = areas(mesh)
    assert area.min() > 0  # no cell is turned over
    assert area[mesh.values[mesh.cells[:, 0], 0] > 0].sum() == pytest.approx(1 - offset, abs=1e-7)
    assert area.sum() == pytest.approx(1)
    assert len(solution.batches) == 3  # off the curve, on its left, on its right


def test_a_slanted_boundary_through_vertices_and_edges_is_exact(square):
    mesh = display_mesh(square(8, line=([2, -1], 0.5)))
    assert spread(mesh) == 0
    assert areas(mesh)[mesh.values[mesh.cells[:, 0], 0] > 0].sum() == pytest.approx(0.5)


def test_crossing_boundaries_part_into_four(square):
    solution = square(9, upright=([1, 0], 0.37), slanted=([1, 1], 0.8))
    mesh = display_mesh(solution)
    assert spread(mesh) == 0
    area, of_cell = areas(mesh), mesh.values[mesh.cells[:, 0], 0]
    left_of_both = area[of_cell == 11].sum()
    # The corner below the slanted line, right of x = 0.37, is a triangle with legs of 0.43.
    assert area[of_cell == -9].sum() == pytest.approx(0.43**2 / 2)
    assert left_of_both == pytest.approx(0.63 - 0.43**2 / 2)
    assert area.sum() == pytest.approx(1)


def test_the_vertices_of_the_source_come_first_and_stay(torus):
    solution = torus()
    mesh = display_mesh(solution)
    assert mesh.original == len(solution.surface.points)
    np.testing.assert_array_equal(mesh.points[: mesh.original], solution.surface.points)
    assert len(mesh.points) > mesh.original


def test_a_curved_surface_is_split_with_smooth_normals(torus):
    mesh = display_mesh(torus(0.1))
    red = mesh.values[mesh.cells][:, :, 0]
    assert np.ptp(red, axis=1).max() < 0.1  # around the tube it changes by 0.85, at the wave by as much at once
    assert np.ptp(red) > 0.6
    ring = mesh.points * [1, 1, 0]
    expected = mesh.points - ring / np.linalg.norm(ring, axis=1, keepdims=True)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    assert (mesh.normals * expected).sum(axis=1).min() > 0.99


def test_an_open_boundary_cuts_up_to_its_end_and_no_farther(square):
    def half(x):
        return np.where(x[:, 0] < 0.52, x[:, 1] - 0.47, np.nan)

    mesh = display_mesh(square(10, half, line=([0, 1], 0.47)))
    middle = mesh.points[mesh.cells].mean(axis=1)
    mixed = np.ptp(mesh.values[mesh.cells], axis=1)[:, 0] > 0
    assert not mixed[middle[:, 0] < 0.5].any()
    assert (np.abs(mesh.points[mesh.original :, 1] - 0.47) < 1e-12).all()
    assert mesh.points[mesh.original :, 0].max() <= 0.52
    assert areas(mesh).sum() == pytest.approx(1)


def test_a_boundary_without_sides_leaves_the_mesh_as_it_is(square):
    solution = square(4, lambda x: np.full(len(x), np.nan), pin=([1, 0], 0.5))
    mesh = display_mesh(solution)
    np.testing.assert_array_equal(mesh.cells, solution.surface.cells)
    assert solution.batches == [25]


def test_a_change_of_sign_between_two_arms_of_a_curve_is_no_crossing(square):
    # Left of x = 0 and right of x = 1: the nearer of the two changes at x = 1/2.
    mesh = display_mesh(
        square(10, lambda x: np.where(x[:, 0] < 0.5, x[:, 0] + 0.01, x[:, 0] - 1.01), arms=([1, 0], 1.01))
    )
    assert len(mesh.points) == mesh.original


def test_a_zero_on_another_sheet_is_no_crossing(square):
    # The distance is measured along a tangent, so it vanishes on all of x = 0.5, the boundary is elsewhere.
    mesh = display_mesh(square(10, lambda x: x[:, 0] - 0.5, elsewhere=([0, 1], 3)))
    assert len(mesh.points) == mesh.original
    mesh = display_mesh(square(10, lambda x: x[:, 0] - 0.47, elsewhere=([0, 1], 3)))
    assert len(mesh.points) == mesh.original


def test_triangles_segments_and_points_are_cut_together(mixture):
    solution = mixture()
    mesh = display_mesh(solution)
    assert mesh.cells.shape[1] == 3
    assert mesh.original == len(solution.surface.points)
    np.testing.assert_array_equal(mesh.points[: mesh.original], solution.surface.points)
    for cells in (mesh.triangles, mesh.segments, mesh.dots[:, None]):
        assert np.ptp(mesh.values[cells], axis=1).max() == 0
        np.testing.assert_array_equal(mesh.values[cells[:, 0], 0], np.sign(mesh.points[cells][:, :, 0].mean(1) - 0.37))
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    assert (np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2).sum() == pytest.approx(1)
    assert len(mesh.segments) == 7
    ends = mesh.points[mesh.segments]
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(1)
    assert len(mesh.dots) == 200


def test_points_have_the_normals_of_the_plane_around_them_and_segments_have_none(mixture):
    mesh = display_mesh(mixture())
    np.testing.assert_allclose(np.abs(mesh.normals[mesh.dots]), np.tile([0, 0, 1], (200, 1)), atol=1e-12)
    np.testing.assert_allclose(mesh.normals[mesh.triangles.ravel(), 2], 1)
    assert not mesh.normals[mesh.segments].any()


def cloud(points, **abilities):
    """A solution on a cloud of points, whose value is the first coordinate."""
    source = SimpleNamespace(closest_point=lambda x: SimpleNamespace(points=x), **abilities)
    source.mesh = lambda spacing: (points, np.arange(len(points))[:, None])
    scene = SimpleNamespace(surface=source, boundaries=())
    return SimpleNamespace(scene=scene, spacing=0.1, channels=1, evaluate=lambda points, side=None: points[:, 0])


def test_the_normals_of_a_cloud_are_its_own_where_it_has_them():
    points = np.random.default_rng(0).uniform(size=(50, 3))
    mesh = display_mesh(cloud(points, normals=lambda feet: feet.points))
    np.testing.assert_allclose(mesh.normals, points / np.linalg.norm(points, axis=1, keepdims=True))
    np.testing.assert_array_equal(mesh.values[:, 0], points[:, 0])


@pytest.mark.parametrize("points", [np.eye(3)[:2], np.linspace(0, 1, 20)[:, None] * [1.0, 2.0, 0.5]])
def test_points_that_span_no_plane_have_no_normal(points):
    assert not display_mesh(cloud(points)).normals.any()


@pytest.mark.parametrize("longest", [0.5, 0.05])
def test_every_sort_of_cell_is_refined_by_itself(mixture, longest):
    solution = mixture()
    object.__setattr__(solution, "boundaries", {})
    object.__setattr__(solution, "value", lambda points, signs: points[:, :1])
    before = display_mesh(solution)
    object.__setattr__(solution, "spacing", longest / 2)  # edges are up to two spacings long
    mesh = display_mesh(solution)
    np.testing.assert_array_equal(mesh.dots, before.dots)
    ends = mesh.points[mesh.segments]
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max() <= longest
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(1)
    assert len(mesh.triangles) > len(before.triangles) or longest == 0.5


def test_turning_the_triangles_corners_changes_nothing(square):
    solution = square(6, line=([1, 0.3], 0.61))
    before = areas(display_mesh(solution))
    solution.surface.cells[:] = np.roll(solution.surface.cells, 1, axis=1)
    np.testing.assert_allclose(np.sort(areas(display_mesh(solution))).sum(), before.sum())
    assert spread(display_mesh(solution)) == 0


@pytest.mark.parametrize("longest", [0.5, 0.3, 0.17, 0.11])
def test_long_edges_are_halved_until_none_is_left(square, longest):
    random = np.random.default_rng(4).uniform(size=(6, 2))
    points = np.concatenate([[[0, 0], [1, 0], [1, 1], [0, 1]], 0.1 + 0.8 * random])
    cells = Delaunay(points).simplices.astype(np.int64)
    coarse = square(2)
    object.__setattr__(coarse, "surface", type(coarse.surface)(points, cells))
    object.__setattr__(coarse, "spacing", longest / 2)
    mesh = display_mesh(coarse)
    finer, pieces = mesh.points, mesh.triangles
    ends = finer[np.stack([pieces, np.roll(pieces, 1, axis=1)], axis=-1)]
    assert np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=-1).max() <= longest
    np.testing.assert_array_equal(finer[:10], points)
    of_piece = areas(SimpleNamespace(points=finer, cells=pieces))
    assert of_piece.min() > 0
    assert of_piece.sum() == pytest.approx(1)
    # Neighbours share all middles: every edge but those of the rim belongs to two triangles.
    counts = np.unique(np.sort(pieces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0, return_counts=True)[1]
    assert (counts == 1).sum() == 4 * round(2 ** np.ceil(np.log2(1 / longest)))


def test_a_mesh_coarser_than_the_grid_is_refined_and_its_vertices_come_first(torus):
    coarse = torus(0.3)
    object.__setattr__(coarse, "spacing", 0.05)
    mesh = display_mesh(coarse)
    assert mesh.original == len(coarse.surface.points) < len(mesh.points) / 5
    np.testing.assert_array_equal(mesh.points[: mesh.original], coarse.surface.points)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1)


def test_a_surface_without_a_mesh_is_refused_with_a_remedy(square):
    solution = square(2)
    object.__setattr__(solution, "surface", object())
    with pytest.raises(InputError, match=r"has no method mesh\(spacing\)"):
        display_mesh(solution)
