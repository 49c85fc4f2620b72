"""A smooth mesh answers for the surface that it samples: its feet follow interpolated normals, without jumps."""

import numpy as np
import pytest
from cpmkit_mesh import triangles
from cpmkit_mesh.conformance import largest_turning_angle


def around_unit_sphere(count, reach=0.2):
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return direction * rng.uniform(1 - reach, 1 + reach, (count, 1)), direction


def smooth_and_faceted(mesh):
    return [triangles(vertices=mesh[0], faces=mesh[1], closest=closest) for closest in ("smooth", "faceted")]


def rms(vectors):
    return np.sqrt((vectors**2).sum(axis=1).mean())


def phong(mesh, x, rounds=60):
    """Project the query along the normal at its foot, take the nearest point of that, and again."""
    feet = mesh.closest_point(x)
    for _ in range(rounds):
        normals = mesh.normals(feet)
        height = np.einsum("nk,nk->n", x - feet.points, normals)
        feet = mesh.closest_point(x - height[:, None] * normals)
    return feet


def test_feet_on_a_closed_sphere_are_of_second_order_and_those_of_facets_of_first(sphere):
    x, direction = around_unit_sphere(4000)
    meshes = [smooth_and_faceted(sphere(level)) for level in (2, 3, 4, 5)]
    errors = np.array([[rms(mesh.closest_point(x).points - direction) for mesh in pair] for pair in meshes])
    order = np.log2(errors[:-1] / errors[1:])
    assert order[:, 0].min() > 1.9
    assert order[-1, 1] < 1.2
    assert (errors[:, 0] < errors[:, 1] / [1.1, 1.4, 2, 4]).all()


def test_feet_at_an_open_edge_are_of_second_order_too(cap):
    x, direction = around_unit_sphere(4000)
    x, direction = x[np.abs(direction[:, 2]) < 0.5], direction[np.abs(direction[:, 2]) < 0.5]
    exact = np.where(direction[:, 2:] > 0, direction, x * [1, 1, 0])
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    errors = []
    for level in (2, 3, 4, 5):
        feet = smooth_and_faceted(cap(level))[0].closest_point(x)
        assert not feet.doubtful.any()
        errors.append(rms(feet.points - exact))
        on_rim = feet.edge == 0
        assert (on_rim == (direction[:, 2] < 0)).mean() > 0.97
        np.testing.assert_allclose(feet.points[on_rim, 2], 0, atol=1e-15)
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > 1.9


def test_the_walk_ends_where_repeated_projection_converges(sphere):
    points, faces = sphere(3)
    smooth, faceted = smooth_and_faceted((points * [1.0, 0.8, 0.6], faces))
    x = around_unit_sphere(4000)[0] * [1.0, 0.8, 0.6]
    feet = smooth.closest_point(x)
    apart = np.linalg.norm(feet.points - phong(faceted, x).points, axis=1)
    assert np.quantile(apart, 0.99) < 1e-10
    assert not feet.doubtful.any()


def test_the_walk_agrees_with_repeated_projection_on_a_real_mesh(real_mesh):
    file = real_mesh("spot.obj")
    smooth, faceted = (triangles(file=file, closest=closest) for closest in ("smooth", "faceted"))
    rng = np.random.default_rng(2)
    x = rng.permutation(smooth.vertices)[:4000] + rng.uniform(-0.01, 0.01, (4000, 3))
    feet = smooth.closest_point(x)
    apart = np.linalg.norm(feet.points - phong(faceted, x).points, axis=1)
    assert np.mean(apart < 1e-9) > 0.97
    assert feet.doubtful.mean() < 1e-3


@pytest.mark.parametrize("shape", ["sphere", "cap"])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_a_foot_is_its_own_foot(request, shape, scale):
    points, faces = request.getfixturevalue(shape)(3)
    mesh = triangles(vertices=points * scale, faces=faces)
    once = mesh.closest_point(around_unit_sphere(4000)[0] * scale)
    twice = mesh.closest_point(once.points)
    np.testing.assert_allclose(twice.points, once.points, atol=1e-13 * scale)
    assert twice.distance.max() < 1e-13 * scale
    np.testing.assert_array_equal(twice.edge, once.edge)


@pytest.mark.parametrize("shape", ["sphere", "cap"])
def test_feet_stay_within_the_turning_angle_of_the_nearest_points(request, shape):
    smooth, faceted = smooth_and_faceted(request.getfixturevalue(shape)(3))
    x = around_unit_sphere(4000)[0]
    feet, nearest = smooth.closest_point(x), faceted.closest_point(x)
    np.testing.assert_array_equal(feet.distance, nearest.distance)
    away = np.linalg.norm(feet.points - nearest.points, axis=1)
    assert (away <= largest_turning_angle(smooth) * nearest.distance + 1e-14).all()


def test_feet_do_not_jump_where_the_nearest_triangle_changes(sphere):
    """Crossing the fan above a vertex, the nearest point stands still and then leaps; the smooth foot moves on."""
    smooth, faceted = smooth_and_faceted(sphere(3))
    t = np.linspace(0, 1, 4001)
    path = 1.15 * np.stack([np.cos(t), np.sin(t) * 0.8, np.sin(t) * 0.6], axis=1)
    step = np.linalg.norm(np.diff(path, axis=0), axis=1)
    speed = [
        np.linalg.norm(np.diff(mesh.closest_point(path).points, axis=0), axis=1) / step for mesh in (smooth, faceted)
    ]
    assert 0.8 < speed[0].min() < speed[0].max() < 0.95
    assert speed[1].min() < 0.01


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
def test_degenerate_queries_get_a_point_of_the_mesh(sphere, closest):
    points, faces = sphere(2)
    mesh = triangles(vertices=points, faces=faces, closest=closest)
    feet = mesh.closest_point(np.concatenate([np.zeros((1, 3)), 1e3 * points, 1e-9 * points, 0.5 * points]))
    assert np.isfinite(feet.points).all()
    assert mesh.closest_point(feet.points).distance.max() < 1e-14


def test_smooth_answers_do_not_depend_on_threads_or_batches(monkeypatch, cap):
    mesh = smooth_and_faceted(cap(3))[0]
    x = np.random.default_rng(4).uniform(-1.5, 1.5, (20_000, 3))
    monkeypatch.setenv("CPMKIT_THREADS", "2")
    whole = mesh.closest_point(x)
    monkeypatch.setenv("CPMKIT_THREADS", "1")
    parts = [mesh.closest_point(part) for part in np.array_split(x, 7)]
    for name in ("points", "distance", "edge", "element", "local", "doubtful"):
        np.testing.assert_array_equal(getattr(whole, name), np.concatenate([getattr(part, name) for part in parts]))


def test_rough_meshes_give_finite_feet_on_the_mesh_and_doubt_where_they_fall_back():
    """Random triangles: folds, spikes, non-manifold edges, disagreeing winding."""
    rng = np.random.default_rng(5)
    points, faces = rng.normal(size=(30, 3)), rng.integers(0, 30, (80, 3))
    smooth, faceted = smooth_and_faceted((points, faces))
    x = rng.normal(size=(5000, 3))
    feet = smooth.closest_point(x)
    assert np.isfinite(feet.points).all()
    assert faceted.closest_point(feet.points).distance.max() < 1e-13
    assert feet.doubtful.any()
    nearest = faceted.closest_point(x)
    np.testing.assert_array_equal(feet.points[feet.doubtful], nearest.points[feet.doubtful])
    assert (np.linalg.norm(x - feet.points, axis=1) <= 2 * nearest.distance * (1 + 1e-12)).all()
    np.testing.assert_allclose(np.linalg.norm(smooth.normals_at_corners, axis=2), 1, atol=1e-12)


def test_a_flat_sheet_with_a_corner_has_square_corners():
    """Beyond the corner of a square its foot is the corner, beside a side the foot lies straight across."""
    i, j = np.divmod(np.arange(25), 5)
    points = np.stack([i / 4, j / 4, 0 * i], axis=1)
    corner = (np.arange(4)[:, None] * 5 + np.arange(4)).ravel()
    faces = np.concatenate([corner[:, None] + [0, 5, 6], corner[:, None] + [0, 6, 1]])
    mesh = triangles(vertices=points, faces=faces)
    x = np.random.default_rng(6).uniform(-0.5, 1.5, (2000, 3)) * [1, 1, 0.2]
    feet = mesh.closest_point(x)
    np.testing.assert_allclose(feet.points, np.clip(x, 0, 1) * [1, 1, 0], atol=1e-14)
    outside = ((x[:, :2] < 0) | (x[:, :2] > 1)).any(axis=1)
    np.testing.assert_array_equal(feet.edge, np.where(outside, 0, -1))
