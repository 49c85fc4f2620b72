"""A mesh that is moved is searched as one that was made there, with what the first one made."""

import pickle
from importlib import import_module

import numpy as np
import pytest
from cpmkit_mesh import box_tree
from trimesh.creation import icosphere

import cpmkit as ck

BALL = icosphere(subdivisions=3)
QUERIES = np.random.default_rng(0).uniform(-1.3, 1.3, (3000, 3))


def ball(closest, offset=0.0):
    return ck.source("mesh.triangles", vertices=BALL.vertices + offset, faces=BALL.faces, closest=closest)


@pytest.mark.parametrize("offset", [[0.3, -0.1, 0.2], [1e3, 0, -7.0], [1e6, 1e6, 1e6]])
def test_feet_are_those_of_a_mesh_made_there(offset):
    offset = np.array(offset)
    moved, made = ball("faceted").translate(offset), ball("faceted", offset)
    got, want = (one.closest_point(QUERIES + offset) for one in (moved, made))
    np.testing.assert_allclose(got.distance, want.distance, atol=1e-15 * np.abs(offset).max() + 1e-14)
    np.testing.assert_allclose(got.points, want.points, atol=1e-15 * np.abs(offset).max() + 1e-14)
    back = moved.translate(-offset).closest_point(QUERIES)
    np.testing.assert_allclose(back.points + offset, want.points, atol=1e-14 * np.abs(offset).max() + 1e-14)


def test_smooth_feet_near_the_mesh_too():
    offset, queries = np.array([0.3, -0.1, 0.2]), BALL.vertices[:200] * 1.05 + 0.01
    moved = ball("smooth").translate(offset).closest_point(queries + offset)
    np.testing.assert_allclose(moved.points, ball("smooth", offset).closest_point(queries + offset).points, atol=1e-13)


def test_one_tree_is_built_however_often_a_mesh_is_moved(monkeypatch):
    built = []
    counted = lambda corners: built.append(1) or box_tree.build_tree(corners)  # noqa: E731
    monkeypatch.setattr(import_module("cpmkit_mesh.triangles"), "build_tree", counted)
    mesh = ball("smooth")
    for offset in np.eye(3):
        moved = mesh.translate(offset).translate(-0.5 * offset)
        moved.closest_point(QUERIES[:10])
        assert moved.advice(0.1) == mesh.advice(0.1)
    assert built == [1]
    scene = ck.Scene(mesh, ck.ScreenedPoisson("x"))
    solutions = [ck.solve(scene, 0.4, origin=[shift, 0.0, 0.0]) for shift in (0.0, 0.1)]
    assert built == [1]
    again = pickle.loads(pickle.dumps(solutions[1]))
    np.testing.assert_array_equal(again.evaluate(BALL.vertices), solutions[1].evaluate(BALL.vertices))
