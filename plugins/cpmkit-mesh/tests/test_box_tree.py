"""The tree finds the nearest point of every triangle soup, to the last digits and for any number of threads."""

import numpy as np
import pytest
from cpmkit_mesh.box_tree import build_tree, find_nearest

from cpmkit.plugin import run_parcels, thread_count


def on_segment(q, edge):
    square = np.einsum("mk,mk->m", edge, edge)
    t = np.einsum("nmk,mk->nm", q, edge) / np.where(square > 0, square, 1.0)
    return np.linalg.norm(q - np.clip(t, 0, 1)[..., None] * edge, axis=2)


def brute_force(x, corners):
    """Return the distance to the nearest triangle: to its edges, or to its plane where the foot is inside.

    In extended precision: the plane of a sliver is known less well than the tree knows the distance.
    """
    x, corners = x.astype(np.longdouble), corners.astype(np.longdouble)
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    q = x[:, None] - a
    distance = np.minimum(on_segment(q, b - a), on_segment(q, c - a))
    distance = np.minimum(distance, on_segment(x[:, None] - b, c - b))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    normal = np.divide(normal, length[:, None], out=np.zeros_like(normal), where=length[:, None] > 0)
    inside = length > 0
    for start, end in ((a, b), (b, c), (c, a)):
        side = np.einsum("nmk,mk->nm", x[:, None] - start, np.cross(normal, end - start))
        inside = inside & (side >= 0)
    height = np.abs(np.einsum("nmk,mk->nm", q, normal))
    return np.where(inside, np.minimum(distance, height), distance).min(axis=1).astype(float)


def soup(rng, count):
    """Return triangles of very different sizes and shapes, slivers among them."""
    centre = rng.uniform(-1, 1, (count, 1, 3))
    corners = centre + rng.normal(size=(count, 3, 3)) * 10.0 ** rng.uniform(-3, -0.5, (count, 1, 1))
    thin = rng.random(count) < 0.2
    share = rng.uniform(0, 1, (thin.sum(), 1))
    flat = (1 - share) * corners[thin, 0] + share * corners[thin, 1]
    height = 10.0 ** rng.uniform(-6, -1, (thin.sum(), 1))
    corners[thin, 2] = flat + height * (corners[thin, 2] - flat)
    return corners


extended = pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="no extended precision to compare with")


@extended
@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (1e-6, 0.0), (1e6, 0.0), (1.0, 1e3)])
def test_distances_equal_those_of_all_triangles(scale, offset):
    rng = np.random.default_rng(1)
    corners = soup(rng, 600) * scale + offset
    x = np.concatenate([rng.uniform(-1.5, 1.5, (400, 3)), rng.uniform(-30, 30, (100, 3))]) * scale + offset
    x = np.concatenate([x, corners.reshape(-1, 3)[:100], corners.mean(axis=1)[:100]])
    nearest_points = find_nearest(build_tree(corners), x)
    size = max(scale, offset / 100)
    np.testing.assert_allclose(nearest_points.distance, brute_force(x, corners), rtol=1e-12, atol=1e-12 * size)


def test_a_record_is_consistent_with_itself():
    rng = np.random.default_rng(2)
    corners, x = soup(rng, 500), rng.uniform(-1.5, 1.5, (2000, 3))
    tree = build_tree(corners)
    nearest_points = find_nearest(tree, x)
    local = np.column_stack([1 - nearest_points.local.sum(axis=1), nearest_points.local])
    assert local.min() >= -1e-15
    np.testing.assert_allclose(
        np.einsum("nc,nck->nk", local, corners[tree.order[nearest_points.slot]]), nearest_points.point, atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.norm(x - nearest_points.point, axis=1), nearest_points.distance, rtol=1e-15)


@pytest.mark.parametrize(
    "corners",
    [
        [[[0, 0, 0], [0, 0, 0], [0, 0, 0]]],
        [[[0, 0, 0], [1, 0, 0], [1, 0, 0]]],
        [[[0, 0, 0], [1, 0, 0], [0, 0, 0]]],
        [[[0, 0, 0], [0, 0, 0], [1, 0, 0]]],
        [[[0, 0, 0], [1, 0, 0], [0.3, 0, 0]], [[0, 0, 0], [2, 0, 0], [3, 0, 0]]],
        [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]] * 40,
    ],
)
def test_degenerate_triangles_count_as_the_segments_and_points_that_they_are(corners):
    corners = np.array(corners, dtype=float)
    x = np.random.default_rng(3).uniform(-2, 4, (500, 3))
    np.testing.assert_allclose(find_nearest(build_tree(corners), x).distance, brute_force(x, corners), rtol=1e-13)


@pytest.mark.parametrize("height", [1e-16, 1e-13, 1e-10, 1e-7])
def test_slivers_lie_within_their_height_of_their_longest_edge(height):
    rng = np.random.default_rng(6)
    corners = rng.normal(size=(200, 3, 3))
    share = rng.uniform(0, 1, (200, 1))
    corners[:, 2] = (1 - share) * corners[:, 0] + share * corners[:, 1] + height * corners[:, 2]
    for k in range(3):  # whichever corner comes first
        x = np.concatenate([rng.uniform(-3, 3, (300, 3)), corners.mean(axis=1)])
        distance = find_nearest(build_tree(np.roll(corners, k, axis=1)), x).distance
        edges = find_nearest(build_tree(corners[:, [0, 1, 1]]), x).distance
        np.testing.assert_allclose(distance, edges, atol=4 * height + 1e-15)
        assert distance[300:].max() < 4e-15


def test_sizes_that_grow_geometrically_do_not_overflow_the_stack():
    corners = 2.0 ** -np.arange(900)[:, None, None] * np.array([[[1.0, 0, 0], [1, 1, 0], [1, 0, 1]]])
    x = np.random.default_rng(4).uniform(0, 1, (200, 3))
    np.testing.assert_allclose(find_nearest(build_tree(corners), x).distance, brute_force(x, corners), rtol=1e-12)


def test_answers_do_not_depend_on_the_number_of_threads(monkeypatch, sphere):
    points, faces = sphere(3)
    tree, x = build_tree(points[faces]), np.random.default_rng(5).uniform(-1, 1, (20_000, 3))
    answers = []
    for threads in ("1", "2", "3"):
        monkeypatch.setenv("CPMKIT_THREADS", threads)
        answers.append(find_nearest(tree, x))
    for other in answers[1:]:
        np.testing.assert_array_equal(other.slot, answers[0].slot)
        np.testing.assert_array_equal(other.point, answers[0].point)


def test_parcels_cover_the_range_once_and_hand_on_errors(monkeypatch):
    monkeypatch.setenv("CPMKIT_THREADS", "2")
    seen = np.zeros(10_001, dtype=int)

    def count(start, stop):
        seen[start:stop] += 1

    run_parcels(count, len(seen))
    assert (seen == 1).all()
    with pytest.raises(ZeroDivisionError):
        run_parcels(lambda start, stop: 1 // start, 10_000)


@pytest.mark.parametrize("target", ["0", "two", "-1", "1.5"])
def test_a_wrong_number_of_threads_is_named(monkeypatch, target):
    monkeypatch.setenv("CPMKIT_THREADS", target)
    with pytest.raises(ValueError, match=f"CPMKIT_THREADS must be a whole number above zero, got '{target}'"):
        thread_count()
