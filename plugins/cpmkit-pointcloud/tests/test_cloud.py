"""What a cloud says of itself: sheets, sides, data, doubts, and how far its distance can be trusted."""

import numpy as np
import pytest
from cpmkit_pointcloud import points
from cpmkit_pointcloud.conformance import ellipse_samples, sphere_samples, torus_samples
from model_problems import order_of

import cpmkit as ck
from cpmkit.errors import InputError
from cpmkit.plugin import HasNormals

BALL = sphere_samples(2000)


def unit(x):
    return x / np.linalg.norm(x, axis=1, keepdims=True)


def test_mixed_sheets_are_doubtful_and_normals_tell_them_apart():
    sheets = np.concatenate([BALL, 0.9 * BALL])
    x = 1.01 * sphere_samples(500)
    mixed = points(points=sheets)
    assert mixed.thick == len(sheets)
    assert mixed.closest_point(x).doubtful.all()
    apart = points(points=sheets, normals=np.concatenate([BALL, -BALL]))
    assert apart.thick == 0
    feet = apart.closest_point(x)
    assert not feet.doubtful.any()
    np.testing.assert_allclose(np.linalg.norm(feet.points, axis=1), 1.0, atol=1e-5)


@pytest.mark.parametrize("flip", [1.0, -1.0])
@pytest.mark.parametrize("cloud", [BALL, ellipse_samples(100) / [1.0, 0.6]], ids=["sphere", "circle"])
def test_normals_are_the_fitted_surfaces_on_the_side_of_the_given_ones(cloud, flip):
    source = points(points=cloud, normals=flip * 7.0 * (cloud + 0.1))
    feet = source.closest_point(1.02 * cloud[::7])
    np.testing.assert_allclose(source.normals(feet), flip * feet.points, atol=1e-3)
    assert not isinstance(points(points=cloud), HasNormals)


@pytest.mark.parametrize("make", [sphere_samples, lambda count: ellipse_samples(count // 4)], ids=["sphere", "ellipse"])
def test_data_are_read_at_second_order_between_the_samples(make):
    errors = []
    for count in (250, 1000, 4000):
        cloud = make(count)
        source, values = points(points=cloud), np.stack([cloud[:, 0] ** 2, np.full(len(cloud), 2.0)], axis=1)
        feet = source.closest_point(np.ascontiguousarray(1.01 * cloud[:-1] + 0.003))
        read = source.interpolate(values, feet)
        np.testing.assert_allclose(read[:, 1], 2.0, atol=1e-12)
        errors.append(np.abs(read[:, 0] - feet.points[:, 0] ** 2).max())
    assert order_of([2, 1, 0.5], errors) >= 1.8 if make is sphere_samples else order_of([4, 1, 0.25], errors) >= 1.8


def test_data_keep_the_rows_of_the_users_points():
    source = points(points=np.concatenate([BALL[:5], BALL]))
    feet = source.closest_point(BALL[:1])
    assert feet.element == 0
    with pytest.raises(InputError, match="one row for each of the 2005 points"):
        source.interpolate(np.zeros(2000), feet)


def test_nearest_reads_the_samples_own_data():
    source = points(points=BALL, method="nearest")
    feet = source.closest_point(1.3 * BALL[::3])
    np.testing.assert_array_equal(feet.element, np.arange(0, 2000, 3))
    np.testing.assert_array_equal(source.interpolate(np.arange(2000.0), feet), feet.element)
    np.testing.assert_allclose(feet.distance, 0.3, atol=1e-12)


def test_distance_is_the_feets_own_up_to_the_trusted_one_and_a_lower_bound_beyond():
    source = points(points=BALL)
    assert 0.4 < source.trusted_distance < 0.6
    near = source.closest_point(np.ascontiguousarray(0.7 * BALL))
    np.testing.assert_allclose(near.distance, np.linalg.norm(0.7 * BALL - near.points, axis=1), atol=1e-14)
    far = source.closest_point(np.ascontiguousarray(3.0 * BALL))
    assert (far.distance < 2.0 - 0.5 * source.gap).all()
    assert (far.distance >= 2.0 - 1.1 * source.gap).all()


@pytest.mark.parametrize(
    "cloud",
    [
        sphere_samples(4000)[:2000],
        BALL[BALL[:, 0] < 0.9],
        torus_samples(4000)[torus_samples(4000)[:, 0] > 0.0],
        ellipse_samples(200)[:101],
    ],
    ids=["half", "hole", "random", "curve"],
)
def test_an_open_cloud_must_be_said_to_be_open(cloud):
    with pytest.raises(InputError, match=r"The cloud is open: at \d+ of \d+ samples .* set closed=False"):
        points(points=cloud)
    assert points(points=cloud, closed=False).open_samples[0] > 0


@pytest.mark.parametrize("seed", range(4))
def test_a_closed_cloud_is_not_taken_for_an_open_one_by_its_random_gaps(seed):
    cloud = unit(np.random.default_rng(seed).normal(size=(3000, 3)))
    hole = np.linalg.norm(cloud - cloud[0], axis=1) < 4 / np.sqrt(len(cloud))
    for kept in (cloud, cloud[~hole], torus_samples(2000, seed)):
        assert points(points=kept).open_samples[0] == 0


@pytest.mark.parametrize("count", [1000, 4000])
def test_an_open_cloud_ends_in_a_rim_one_sample_distance_outside(count):
    apart = np.sqrt(4 * np.pi / (2 * count))
    source = points(points=sphere_samples(2 * count)[:count], closed=False)
    x = 1.03 * sphere_samples(2000)
    feet = source.closest_point(x)
    rim, z = feet.edge == 0, feet.points[:, 2]
    assert not feet.doubtful[x[:, 2] > -0.9].any()
    assert not rim[x[:, 2] > 0.0].any()
    assert rim[x[:, 2] < -2 * apart].all()
    assert (z[rim] < -0.5 * apart).all()
    assert (z[rim] > -1.5 * apart).all()
    near = rim & (x[:, 2] > -0.5)
    slide = np.linalg.norm(unit(feet.points[near, :2]) - unit(x[near, :2]), axis=1)
    assert slide.max() < 0.1
    again = source.closest_point(feet.points)
    np.testing.assert_allclose(again.points, feet.points, atol=1e-12)
    np.testing.assert_array_equal(again.edge, feet.edge)


def test_distance_to_an_open_cloud_is_never_above_the_true_one():
    source = points(points=BALL[BALL[:, 2] > 0.0], closed=False)
    x = np.random.default_rng(0).uniform(-1.5, 1.5, (1000, 3))
    feet = source.closest_point(x)
    nearest = np.linalg.norm(x[:, None] - feet.points, axis=2).min(axis=1)
    assert (feet.distance <= nearest + 1e-12).all()


def test_an_open_curve_ends_near_its_last_samples():
    source = points(points=ellipse_samples(200)[:101], closed=False)
    feet = source.closest_point(np.array([[1.05, -0.2], [-1.05, -0.2], [0.1, 0.7]]))
    np.testing.assert_array_equal(feet.edge, [0, 0, -1])
    assert (np.abs(feet.points[:2, 1]) < 3 * 0.6 * np.pi / 100).all()
    assert not feet.doubtful.any()


def test_what_may_spoil_a_solution_is_said_in_sentences():
    assert points(points=BALL).advice(0.1).warnings == ()
    sheets = np.concatenate([BALL, 0.9 * BALL, BALL[:100]])
    repeated, thick = points(points=sheets).advice(0.1).warnings
    assert "100 of 4100 points of the cloud lie where an earlier one lies" in repeated
    assert "The neighbours of 4000 of 4000 samples of the cloud lie on no smooth surface" in thick
    assert "where there is noise neighbours=60, and fewer if that raises this count" in thick
    assert ck.explain(ck.Scene(points(points=sheets), ck.ScreenedPoisson(1.0)), 0.3).warnings == (repeated, thick)
    t = np.linspace(0.0, 1.0, 200)[:, None]
    (lowered_degree_count,) = (
        points(points=np.concatenate([t * [1, 0, 0], BALL + [5.0, 0, 0]]), closed=False).advice(0.1).warnings
    )
    assert "samples of the cloud the neighbours determine no patch of degree 2" in lowered_degree_count


@pytest.mark.parametrize("options", [{}, {"normals": BALL}, {"method": "nearest"}])
def test_a_cloud_is_drawn_by_some_of_its_points(options):
    source = points(points=BALL, **options)
    (few, cells), (all_of_them, _) = source.mesh(0.4), source.mesh(1e-3)
    assert len(all_of_them) == len(BALL)
    np.testing.assert_array_equal(cells[:, 0], np.arange(len(few)))
    apart = np.linalg.norm(BALL[:, None] - few, axis=2).min(axis=1)
    assert apart.max() < 0.2 * np.sqrt(3)
    assert len(few) < 1.6 * 4 * np.pi / 0.2**2
    np.testing.assert_allclose(np.linalg.norm(few, axis=1), 1.0, atol=1e-5)


def test_patches_that_the_neighbours_do_not_determine_are_of_lower_degree_and_counted():
    t = np.linspace(0.0, 1.0, 200)
    line = np.stack([t, np.zeros(200), np.zeros(200)], axis=1)
    source = points(points=np.concatenate([line, sphere_samples(500) + [5.0, 0, 0]]), closed=False)
    assert 190 <= source.lowered_degree_count <= 200
    feet = source.closest_point(np.array([[0.5, 0.0, 0.01]]))
    assert np.isfinite(feet.points).all()
    assert points(points=torus_samples(500)).lowered_degree_count == 0


def test_a_cloud_of_few_points_is_a_plane():
    source = points(points=[[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], closed=False)
    feet = source.closest_point(np.array([[0.5, 0.5, 0.3]]))
    np.testing.assert_allclose(feet.points, [[0.5, 0.5, 0.0]], atol=1e-12)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({}, "either points or a file, got neither"),
        ({"points": BALL, "file": "a.ply"}, "got both"),
        ({"points": BALL, "method": "best"}, "method must be 'mls' or 'nearest', got 'best'"),
        ({"points": BALL, "degree": 5}, "degree must be 1, 2, 3 or 4, got 5"),
        ({"points": BALL, "degree": 2.0}, r"degree must be 1, 2, 3 or 4, got 2\.0"),
        ({"points": BALL, "degree": [2]}, r"degree must be 1, 2, 3 or 4, got \[2\]"),
        ({"points": BALL, "neighbours": 5}, "at least 6 for degree 2, got 5"),
        ({"points": BALL, "neighbours": 20.5}, "a whole number"),
        ({"points": BALL[:, :1]}, r"shape \(n, 2\) or \(n, 3\)"),
        ({"points": BALL[:0]}, "n > 0"),
        ({"points": [["a", "b"]]}, "array of numbers"),
        ({"points": [[0.0, 1.0], [2.0]]}, "rows of equal length"),
        ({"points": [[0.0, np.nan], [2.0, 1.0]]}, "points must be finite: 1 of 2"),
        ({"points": np.zeros((30, 3))}, "at least 4 points that differ, got 1"),
        ({"points": BALL, "normals": BALL[1:]}, "normals must have the shape of the points"),
        ({"points": BALL, "normals": np.vstack([-BALL[:1], BALL[1:]])}, "at 1 points, .* the opposite normal"),
        ({"points": BALL, "normals": 0 * BALL}, "normals must not be zero: 2000 of 2000"),
    ],
)
def test_bad_keys_are_answered_with_what_is_accepted(keys, message):
    with pytest.raises(InputError, match=message):
        points(**keys)


def test_the_uneven_vertices_of_a_real_mesh_are_searched_to_an_end(real_mesh):
    """On some of them a search left the reach of all patches, and looked for a way back for ever."""
    vertices, _ = ck.read_mesh(real_mesh("koala.obj"))
    cloud = points(points=vertices)
    queries = np.ascontiguousarray(vertices[::50] + 0.1)
    feet = cloud.closest_point(queries)
    assert (feet.distance <= 0.1 * np.sqrt(3) + 1e-9).all()
    assert any("the surface ends" in sentence for sentence in cloud.advice(0.1).warnings)
