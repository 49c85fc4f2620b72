"""Geodesic distance: accuracy, signs, bounds, symmetry, barriers, paths, several origins, several representations."""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.applications import geodesic_distance
from cpmkit.errors import InputError
from cpmkit.preparing import Prepared

SPHERE = ck.source("analytic.sphere")
EQUATOR = ck.source("analytic.circle", normal=[0, 0, 1])


def _directions(count: int, seed: int = 0) -> np.ndarray:
    found = np.random.default_rng(seed).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


POINTS = _directions(3000)


@cache
def _sphere(spacing: float) -> Prepared:
    return ck.prepare(ck.Scene(SPHERE, ck.Poisson(0.0)), spacing, form="galerkin")


def _share(found: np.ndarray, exact: np.ndarray) -> float:
    """Return the rms of the error over the mean distance."""
    return float(np.sqrt(np.mean((found - exact) ** 2)) / exact.mean())


@pytest.mark.parametrize(
    ("spacings", "bound"),
    [((0.4, 0.28, 0.2), 7e-3), pytest.param((0.4, 0.2, 0.1), 1e-3, marks=pytest.mark.slow)],
    ids=["coarse", "asked"],
)
@pytest.mark.parametrize("method", ["heat", "transport"])
def test_points_of_a_sphere_to_a_thousandth(method: str, spacings: tuple[float, ...], bound: float) -> None:
    """The asked .1 percent at .1, and an order of 1.5 between any two of three spacings."""
    errors = []
    for spacing in spacings:
        squares = []
        for origin in _directions(4, seed=1)[:2]:
            distance = geodesic_distance(_sphere(spacing), origin, method=method).evaluate(POINTS)
            squares.append(_share(distance, np.arccos(np.clip(POINTS @ origin, -1, 1))) ** 2)
        errors.append(np.sqrt(np.mean(squares)))
    assert errors[-1] < bound
    for k in (0, 1):
        assert np.log(errors[k] / errors[k + 1]) / np.log(spacings[k] / spacings[k + 1]) > 1.5


def test_a_circle_of_a_sphere_from_both_sides() -> None:
    exact = np.abs(np.arcsin(np.clip(POINTS[:, 2], -1, 1)))
    for method in ("heat", "transport"):
        distance = geodesic_distance(_sphere(0.2), EQUATOR, method=method).evaluate(POINTS)
        assert _share(distance, exact) < 1.5e-2
        assert distance.min() >= 0


def test_a_torus_from_its_outer_equator() -> None:
    torus = ck.source("analytic.torus", major=1.0, minor=0.4)
    outer = ck.source("analytic.circle", radius=1.4, normal=[0, 0, 1])
    rng = np.random.default_rng(0)
    around, along = rng.uniform(-np.pi, np.pi, 3000), rng.uniform(-np.pi, np.pi, 3000)
    ring = 1 + 0.4 * np.cos(around)
    points = np.stack([ring * np.cos(along), ring * np.sin(along), 0.4 * np.sin(around)], axis=1)
    distance = geodesic_distance(torus, outer, spacing=0.2, method="heat")
    assert _share(distance.evaluate(points), 0.4 * np.abs(around)) < 4e-2


def test_distances_are_symmetric_and_no_shorter_than_straight() -> None:
    torus = ck.source("analytic.torus", major=1.0, minor=0.4)
    prepared = ck.prepare(ck.Scene(torus, ck.Poisson(0.0)), 0.2, form="galerkin")
    places = torus.closest_point(np.random.default_rng(3).normal(size=(3, 3))).points
    table = np.array([geodesic_distance(prepared, one).evaluate(places) for one in places])
    straight = np.linalg.norm(places[:, None] - places, axis=2)
    assert np.abs(table - table.T).max() < 0.02
    assert (table - straight).min() > -0.01
    assert np.abs(np.diag(table)).max() < 1e-12


def test_of_several_origins_the_nearest_counts() -> None:
    poles = np.array([[0.0, 0, 1], [0, 0, -1]])
    distance = geodesic_distance(_sphere(0.2), [poles, EQUATOR])
    latitude = np.abs(np.arcsin(np.clip(POINTS[:, 2], -1, 1)))
    assert _share(distance.evaluate(POINTS), np.minimum(latitude, np.pi / 2 - latitude)) < 2e-2


def test_lists_of_origins_hold_points_and_vertex_numbers() -> None:
    square = _walled_square().surface
    table = geodesic_distance(square, [[0.0, 0, 0], [2, 2, 0]], spacing=0.2, method="heat").evaluate([[1, 0.5, 0]])
    for origins in ([[[0, 0, 0]], [[2, 2, 0]]], [[[0, 0, 0]], 1680], (np.zeros(3), np.array([[2.0, 2, 0]]))):
        distance = geodesic_distance(square, origins, spacing=0.2, method="heat")
        np.testing.assert_allclose(distance.evaluate([[1, 0.5, 0]]), table, rtol=1e-9)
    with pytest.raises(ck.InputError, match="finite points"):
        geodesic_distance(square, [[[0, 0, 0]], [[0, 0]]], spacing=0.2)


def _walled_square() -> ck.Scene:
    x = np.linspace(0, 2, 41)
    vertices = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((41, 41))], axis=-1).reshape(-1, 3)
    at = np.arange(41 * 41).reshape(41, 41)
    a, b, c, d = (one.ravel() for one in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    square = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")
    wall = ck.source("mesh.polyline", points=[[1.013, -0.0, 0], [1.013, 1.5, 0]])
    return ck.Scene(square, ck.Poisson(0.0), [ck.Boundary("wall", wall, both=ck.Neumann(0.0))])


def test_barriers_are_gone_round() -> None:
    start, end, corner = np.array([0.5, 0.5, 0]), np.array([1.5, 0.5, 0]), np.array([1.013, 1.5, 0])
    exact = np.linalg.norm(start - corner) + np.linalg.norm(corner - end)
    distance = geodesic_distance(_walled_square(), start, spacing=0.1)
    assert abs(distance.evaluate(end[None])[0] / exact - 1) < 0.02
    path = distance.path(end)[0]
    assert abs(np.linalg.norm(np.diff(path, axis=0), axis=1).sum() / exact - 1) < 0.07
    assert np.linalg.norm(path - corner, axis=1).min() < 0.1


def test_a_path_is_as_long_as_the_distance_and_lies_on_the_surface() -> None:
    distance = geodesic_distance(_sphere(0.2), [[0, 0.6, 0.8]], method="heat")
    for path, start in zip(distance.path(POINTS[:4]), POINTS[:4], strict=True):
        exact = np.arccos(start @ [0, 0.6, 0.8])
        assert abs(np.linalg.norm(np.diff(path, axis=0), axis=1).sum() - exact) < 5e-3
        assert np.abs(np.linalg.norm(path, axis=1) - 1).max() < 1e-9
        np.testing.assert_allclose(path[[0, -1]], [start, [0, 0.6, 0.8]], atol=1e-9)


def test_representations_of_one_sphere_agree() -> None:
    ball = ck.source("levelset.expression", phi="x*x + y*y + z*z - 1", bounds=[[-1.2] * 3, [1.2] * 3])
    exact = np.arccos(np.clip(POINTS[:, 0], -1, 1))
    for surface in (ball, SPHERE):
        distance = geodesic_distance(surface, [[1, 0, 0]], spacing=0.3, method="heat")
        assert _share(distance.evaluate(POINTS), exact) < 1.5e-2


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"origins": []}, "finite points"),
        ({"origins": np.zeros((0, 3))}, "needs origins"),
        ({"origins": [[0, 1]]}, "finite points"),
        ({"origins": [1, 0, 0], "method": "fast"}, "method must be"),
        ({"origins": [1, 0, 0], "rounds": 0}, "rounds"),
    ],
)
def test_bad_input_is_reported(given: dict[str, Any], words: str) -> None:
    origins = given.pop("origins")
    with pytest.raises(ck.InputError, match=words):
        geodesic_distance(SPHERE, origins, spacing=0.3, **given)


@pytest.mark.parametrize("condition", [ck.Dirichlet(0.0), ck.Neumann(3.0)])
def test_a_boundary_with_data_is_no_barrier(condition: Any) -> None:
    scene = ck.Scene(SPHERE, ck.Laplace(), [ck.Boundary("equator", EQUATOR, both=condition)])
    with pytest.raises(ck.InputError, match="barriers"):
        geodesic_distance(scene, [0, 0, 1], spacing=0.3)


@pytest.mark.parametrize("method", ["heat", "transport"])
def test_distances_are_infinite_on_pieces_without_an_origin(method: str) -> None:
    pieces = ck.source("union", members=[SPHERE, ck.source("analytic.sphere", center=[6, 0, 0], radius=2.0)])
    with pytest.warns(ck.CpmkitWarning, match="1 of 2 pieces of the Union have no origin: distances are infinite"):
        distance = geodesic_distance(pieces, [[0, 0, 1]], spacing=0.4, method=method)
    assert any("1 of 2 pieces" in text for text in distance.solution.warnings)
    found = distance.evaluate([[0, 0, 1], [1, 0, 0], [0, 0, -1], [6, 0, 2], [8, 0, 0]])
    np.testing.assert_array_equal(np.isinf(found), [False, False, False, True, True])
    np.testing.assert_allclose(found[:3], [0, np.pi / 2, np.pi], atol=0.15)
    with pytest.raises(ck.ResolutionError, match=r"no path leads from \(8, 0, 0\) to an origin"):
        distance.path([8, 0, 0])


@pytest.mark.parametrize("method", ["heat", "transport"])
def test_each_piece_is_measured_from_its_own_origins(method: str) -> None:
    pieces = ck.source("union", members=[SPHERE, ck.source("analytic.sphere", center=[6, 0, 0], radius=2.0)])
    distance = geodesic_distance(pieces, [[0, 0, 1], [6, 0, 2]], spacing=0.4, method=method)
    found = distance.evaluate([[0, 0, 1], [1, 0, 0], [0, 0, -1], [6, 0, 2], [8, 0, 0], [6, 0, -2]])
    np.testing.assert_allclose(found, np.array([0, 1, 2, 0, 2, 4]) * np.pi / 2, atol=0.15)


def test_distances_are_infinite_behind_a_barrier() -> None:
    scene = ck.Scene(SPHERE, ck.Laplace(), [ck.Boundary("equator", EQUATOR, both=ck.Neumann(0.0))])
    with pytest.warns(ck.CpmkitWarning, match="1 of 2 pieces"):
        distance = geodesic_distance(scene, [0, 0, 1], spacing=0.3, method="heat")
    assert np.isinf(distance.evaluate([[0, 0, -1], [0.6, 0, 0.8], [0.6, 0, -0.8]])).tolist() == [True, False, True]


def test_the_distance_at_vertices_is_that_of_evaluate_in_their_order_and_is_saved(tmp_path):
    import trimesh

    ball = trimesh.creation.icosphere(3)
    distance = geodesic_distance(ball, [0], spacing=0.2)
    found = distance.at_vertices()
    assert found[0] == 0.0
    np.testing.assert_allclose(found, distance.evaluate(ball.vertices))
    assert np.abs(found - np.arccos(np.clip(ball.vertices @ ball.vertices[0], -1, 1))).max() < 0.05
    distance.save(tmp_path / "own.ply", vertices="own")
    saved = trimesh.load(tmp_path / "own.ply", process=False)
    np.testing.assert_array_equal(saved.metadata["_ply_raw"]["vertex"]["data"]["u"].ravel(), found)
    np.testing.assert_array_equal(saved.faces, ball.faces)
    distance.save(tmp_path / "smooth.npz", vertices="display")
    assert np.load(tmp_path / "smooth.npz")["values"].min() > 0.01  # the solution is smooth at the origin
    with pytest.raises(InputError, match="was not made from vertices"):
        geodesic_distance(_sphere(0.4), [0, 0, 1], method="heat").save(tmp_path / "own.ply", vertices="own")


@pytest.mark.parametrize("origins", [[0, 0, 2], [[[0, 0, 2]], EQUATOR]])
def test_an_origin_far_from_the_surface_is_refused(origins):
    with pytest.raises(InputError, match=r"an origin is 1 away from the surface, more than 3 spacings, 0\.9; move it"):
        geodesic_distance(SPHERE, origins, spacing=0.3)
    assert geodesic_distance(SPHERE, [0, 0, 1.5], spacing=0.3, method="heat").evaluate([[0, 0, 1]]) == 0


def test_each_warning_of_a_distance_is_issued_once_and_stays_with_it():
    pieces = ck.source("union", members=[SPHERE, ck.source("analytic.sphere", center=[4, 0, 0], radius=0.2)])
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        distance = geodesic_distance(pieces, [0, 0, 1], spacing=0.3)
    said = [str(warning.message) for warning in issued]
    assert len(said) == len(set(said)) > 1
    assert set(distance.warnings) <= set(said)
    assert any("1 of 2 pieces" in sentence for sentence in distance.warnings)
    assert all(warning.filename == __file__ for warning in issued)
