"""Formulas with kinks give level sets with creases and corners; feet there are as exact as elsewhere."""

import numpy as np
import pytest

import cpmkit as ck

BOX = [[-1.2] * 3, [1.2] * 3]
BALLS = "x**2 + y**2 + (z + 0.5)**2", "x**2 + y**2 + (z - 0.5)**2"


def cube_distance(x, half=0.8):
    """Distances (n,) of points (n, d) from the surface of a cube, in the plane a square."""
    beyond = np.abs(x) - half
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
    return np.where((beyond < 0).all(axis=1), -beyond.max(axis=1), outside)


def octahedron_distance(x):
    """Distances (n,) of points (n, 3) outside |x| + |y| + |z| = 1, by projection on the simplex of absolute values."""
    a = np.abs(x)
    falling = -np.sort(-a, axis=1)
    shares = (np.cumsum(falling, axis=1) - 1) / [1, 2, 3]
    count = (falling > shares).sum(axis=1)
    return np.linalg.norm(a - np.maximum(a - shares[np.arange(len(a)), count - 1][:, None], 0), axis=1)


@pytest.mark.parametrize(
    "phi", [f"{BALLS[0]} + {BALLS[1]} + abs({BALLS[0]} - ({BALLS[1]})) - 2", f"maximum({BALLS[0]}, {BALLS[1]}) - 1"]
)
def test_a_lens_has_the_feet_of_two_caps(phi):
    lens = ck.source("levelset.expression", phi=phi, bounds=BOX)
    caps = [ck.source("analytic.cap", center=[0, 0, -s / 2], axis=[0, 0, s], height=0.5) for s in (1, -1)]
    exact = ck.source("union", members=caps)
    rng = np.random.default_rng(0)
    x = exact.closest_point(rng.normal(size=(8000, 3))).points + rng.uniform(-0.15, 0.15, (8000, 3))
    feet = lens.closest_point(x)
    np.testing.assert_allclose(feet.distance, exact.closest_point(x).distance, atol=1e-12)
    assert exact.closest_point(feet.points).distance.max() < 1e-12
    assert feet.doubtful.mean() < 1e-3


@pytest.mark.parametrize(
    "phi",
    ["maximum(maximum(abs(x), abs(y)), abs(z)) - 0.8", "-minimum(0.64 - x**2, minimum(0.64 - y**2, 0.64 - z**2))"],
)
def test_a_cube_by_maxima_has_faces_edges_and_corners(phi):
    x = np.random.default_rng(1).uniform(-1.2, 1.2, (8000, 3))
    x = x[cube_distance(x) < 0.15]
    feet = ck.source("levelset.expression", phi=phi, bounds=BOX).closest_point(x)
    np.testing.assert_allclose(feet.distance, cube_distance(x), atol=1e-12)
    assert feet.doubtful.mean() < 3e-3


def test_a_square_in_the_plane_has_corners():
    square = ck.source("levelset.expression", phi="maximum(abs(x), abs(y)) - 0.8", bounds=[[-1.2] * 2, [1.2] * 2])
    x = np.random.default_rng(1).uniform(-1.2, 1.2, (4000, 2))
    feet = square.closest_point(x)
    np.testing.assert_allclose(feet.distance, cube_distance(x), atol=1e-12)
    assert not feet.doubtful.any()


def test_creases_meet_at_the_corners_of_an_octahedron():
    x = np.random.default_rng(2).uniform(-1.2, 1.2, (8000, 3))
    x = x[np.abs(x).sum(axis=1) > 1]
    solid = ck.source("levelset.expression", phi="abs(x) + abs(y) + abs(z) - 1", bounds=BOX)
    np.testing.assert_allclose(solid.closest_point(x).distance, octahedron_distance(x), atol=1e-12)


def test_the_edge_of_a_trimmed_surface_has_corners():
    plate = ck.source("levelset.expression", phi="z", bounds=BOX, trim="maximum(abs(x), abs(y)) - 0.8")
    x = np.random.default_rng(1).uniform(-1.1, 1.1, (8000, 3)) * [1, 1, 0.2]
    beyond = np.maximum(np.abs(x[:, :2]) - 0.8, 0)
    feet = plate.closest_point(x)
    np.testing.assert_allclose(feet.distance, np.hypot(np.linalg.norm(beyond, axis=1), x[:, 2]), atol=1e-12)
    np.testing.assert_array_equal(feet.edge == 0, beyond.any(axis=1))


def test_a_crease_that_is_cut_off_ends_at_the_edge():
    wedge = ck.source("levelset.expression", phi="z - abs(x)", bounds=BOX, trim="x**2 + y**2 - 0.25")
    x = np.random.default_rng(4).uniform(-0.3, 0.3, (4000, 3)) * [0.1, 1, -1] - [0, 0, 0.35]
    feet = wedge.closest_point(x)  # below the crease
    np.testing.assert_allclose(feet.distance, np.linalg.norm(x[:, ::2], axis=1), atol=1e-12)
    np.testing.assert_allclose(feet.points, x * [0, 1, 0], atol=1e-12)


def test_a_kink_of_the_formula_that_does_not_turn_the_surface_makes_no_crease():
    smooth = ck.source("levelset.expression", phi="abs(x)**3 + y**2 + z**2 - 1", bounds=BOX)
    assert len(smooth.surface.layers) == 1
