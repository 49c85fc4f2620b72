"""A polyline answers with its nearest segment, its ends, its direction of travel and its own data."""

import numpy as np
import pytest
from cpmkit_mesh import polyline

from cpmkit import ClosestPointSource
from cpmkit.errors import InputError
from cpmkit.plugin import HasMesh, HasNormals, HasTangents, HasTranslation, HasValues

SQUARE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])


def brute_force(x, points):
    a, b = points[:-1], points[1:]
    t = np.einsum("nmk,mk->nm", x[:, None] - a, b - a) / np.einsum("mk,mk->m", b - a, b - a)
    feet = a + np.clip(t, 0, 1)[..., None] * (b - a)
    distance = np.linalg.norm(x[:, None] - feet, axis=2)
    return feet[np.arange(len(x)), distance.argmin(axis=1)], distance.min(axis=1)


def ragged(dim, count=200):
    """Return a random walk whose steps differ a thousandfold."""
    rng = np.random.default_rng(1)
    return np.cumsum(rng.normal(size=(count, dim)) * 10 ** rng.uniform(-3, 0, (count, 1)), axis=0)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (1e-6, 0.0), (1e6, 0.0), (1.0, 1e3)])
def test_the_nearest_segment_is_found(dim, scale, offset):
    points = ragged(dim) * scale + offset
    x = np.random.default_rng(2).uniform(-10, 10, (1000, dim)) * scale + offset
    feet, (exact, distance) = polyline(points=points).closest_point(x), brute_force(x, points)
    size = max(scale, offset / 100)
    np.testing.assert_allclose(feet.points, exact, atol=1e-11 * size)
    np.testing.assert_allclose(feet.distance, distance, rtol=1e-13, atol=1e-12 * size)
    along = points[feet.element] + feet.local * (points[feet.element + 1] - points[feet.element])
    np.testing.assert_allclose(along, feet.points, atol=1e-12 * size)


def test_ends_of_an_open_polyline_are_its_edge():
    line = polyline(points=[[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 1, 0]])
    x = np.array([[-1.0, 0.5, 0], [0, 0, 0], [0.5, 1, 0], [2, -1, 0], [3, 1, 0], [4, 2, 1]])
    np.testing.assert_array_equal(line.closest_point(x).edge, [0, 0, -1, -1, 1, 1])


@pytest.mark.parametrize(
    ("points", "closed", "vertices", "answer"),
    [
        (SQUARE, None, 4, True),
        (SQUARE, True, 4, True),
        (SQUARE, False, 5, False),
        (SQUARE + [[0], [0], [0], [0], [3e-16]], None, 4, True),  # as of cos(2 pi)
        (SQUARE[:-1], None, 4, False),
        (SQUARE[:-1], True, 4, True),
        (SQUARE[[0, 0, 1, 2, 2, 2, 3, 4]], None, 4, True),
    ],
)
def test_a_polyline_is_closed_on_request_or_where_it_returns(points, closed, vertices, answer):
    line = polyline(points=points, closed=closed)
    assert line.closed is answer
    assert line.mesh(1.0)[0].shape == (vertices, 2)
    assert line.mesh(1.0)[1].shape == (vertices if answer else vertices - 1, 2)
    feet = line.closest_point(np.array([[-0.5, 0.5], [-0.1, -0.1]]))
    fourth_side = answer or len(points) == 5
    np.testing.assert_allclose(feet.distance[0], 0.5 if fourth_side else np.sqrt(0.5))
    assert (feet.edge >= 0).any() == (not answer)


@pytest.mark.parametrize("closed", [True, False])
def test_tangents_travel_along_and_bisect_at_vertices(closed):
    line = polyline(points=SQUARE, closed=closed)
    half = np.sqrt(0.5)
    feet = line.closest_point(np.array([[0.5, -0.2], [0.5, 1.2], [1.3, -0.3], [1 + 1e-12, 1 + 1e-12], [-0.3, -0.3]]))
    start = [half, -half] if closed else [1, 0] if feet.local[4, 0] == 0 else [0, -1]
    np.testing.assert_allclose(line.tangents(feet), [[1, 0], [-1, 0], [half, half], [-half, half], start], atol=1e-12)


def test_the_tangent_is_defined_where_a_polyline_turns_back():
    line = polyline(points=[[0.0, 0], [1, 0], [0, 0], [0, 1]])
    tangents = line.tangents(line.closest_point(np.array([[2.0, 0], [1.0, 0.1]])))
    np.testing.assert_allclose(tangents, [[1, 0], [1, 0]], atol=1e-15)


def test_values_belong_to_the_points_that_were_given():
    points = ragged(3, 50)[np.repeat(np.arange(50), np.arange(50) % 3 + 1)]
    line = polyline(points=points)
    assert line.value_count == len(points)
    feet = line.closest_point(np.random.default_rng(3).normal(size=(300, 3)))
    np.testing.assert_allclose(line.interpolate(points, feet), feet.points, atol=1e-13)
    np.testing.assert_allclose(line.interpolate(points[:, 1], feet), feet.points[:, 1], atol=1e-13)
    with pytest.raises(InputError, match=f"each of the {len(points)} points, got shape"):
        line.interpolate(points[1:], feet)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_polyline_is_a_source_with_tangents_values_a_mesh_and_translation(dim):
    line = polyline(points=ragged(dim))
    for contract in (ClosestPointSource, HasTangents, HasValues, HasMesh, HasTranslation):
        assert isinstance(line, contract)
    assert not isinstance(line, HasNormals)
    assert (line.dim, line.manifold_dim, line.exact) == (dim, 1, True)
    offset = np.arange(1.0, dim + 1)
    moved = line.translate(offset)
    x = np.random.default_rng(4).normal(size=(100, dim))
    np.testing.assert_allclose(
        moved.closest_point(x + offset).points, line.closest_point(x).points + offset, atol=1e-13
    )
    np.testing.assert_allclose(moved.bounds, line.bounds + offset)


def test_a_polyline_reads_numpy_files(tmp_path):
    np.save(tmp_path / "curve.npy", ragged(3).astype(np.float32))
    np.testing.assert_array_equal(polyline(file=tmp_path / "curve.npy").vertices, ragged(3).astype(np.float32))
    (tmp_path / "text.npy").write_text("0 0 0\n")
    with pytest.raises(InputError, match=r"'text.npy' is not a .npy file"):
        polyline(file=tmp_path / "text.npy")
    np.save(tmp_path / "flat.npy", np.zeros(3))
    with pytest.raises(InputError, match="shape"):
        polyline(file=tmp_path / "flat.npy")


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({}, "got neither"),
        ({"points": SQUARE, "file": "a.npy"}, "got both"),
        ({"file": "nowhere.npy"}, "no file 'nowhere.npy'"),
        ({"points": SQUARE[:1]}, "at least 2 points, got 1"),
        ({"points": np.ones((3, 2))}, "2 points that differ, got 3 times the same"),
        ({"points": [[0, 0], [np.nan, 1]]}, "must be finite: 1 of 2"),
        ({"points": np.zeros((3, 4))}, r"shape \(n, 2\) or \(n, 3\), got \(3, 4\)"),
        ({"points": [1.0, 2.0]}, r"shape \(n, 2\) or \(n, 3\)"),
        ({"points": [[0, 0], [1, 1, 1]]}, "rows of equal length"),
        ({"points": [["a", "b"]]}, "array of numbers"),
    ],
)
def test_wrong_input_is_answered_in_one_sentence(keys, message):
    with pytest.raises(InputError, match=message):
        polyline(**keys)
