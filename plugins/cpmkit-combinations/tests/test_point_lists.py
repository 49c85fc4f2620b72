"""A list of points is a source: its feet are the nearest points, and each can carry a value."""

import numpy as np
import pytest
from cpmkit_combinations.points import points

import cpmkit as ck
from cpmkit.errors import InputError


@pytest.mark.parametrize("dim", [2, 3])
def test_feet_are_the_nearest_points(dim):
    rng = np.random.default_rng(0)
    at, x = rng.normal(size=(40, dim)), rng.normal(size=(300, dim))
    feet = points(at=at).closest_point(x)
    nearest = np.linalg.norm(x[:, None] - at, axis=2).argmin(axis=1)
    assert (feet.element == nearest).all()
    assert (feet.points == at[nearest]).all()
    assert (feet.edge == -1).all()


def test_each_point_carries_a_value():
    pins = points(at=np.eye(3))
    feet = pins.closest_point(np.array([[0.0, 0.9, 0.2], [0.9, 0.1, 0.0]]))
    assert pins.interpolate(np.array([[1.0, 2], [3, 4], [5, 6]]), feet).tolist() == [[3, 4], [1, 2]]


def test_points_are_read_from_a_file(tmp_path):
    np.save(tmp_path / "pins.npy", np.eye(3))
    assert (points(file=tmp_path / "pins.npy").mesh(0.1)[0] == np.eye(3)).all()


def test_points_far_away_are_moved_without_rounding():
    far = points(at=1e9 + np.eye(3))
    near = far.translate(np.full(3, -1e9))
    assert (near.closest_point(np.zeros((1, 3))).distance == 1.0).all()


@pytest.mark.parametrize("form", ["collocation", "galerkin"])
def test_dirichlet_points_hold_their_value(form):
    sphere, ends = ck.source("analytic.sphere"), np.array([[0.6, 0.0, 0.8], [0.0, 0.8, -0.6], [-1.0, 0.0, 0.0]])
    pins = ck.Boundary("pins", points(at=ends), both=ck.Dirichlet(lambda p: p[:, 0] + 2.0))
    solution = ck.solve(ck.Scene(sphere, ck.ScreenedPoisson(lambda p: 3 * p[:, 0] + 2.0), [pins]), 0.1, form=form)
    assert np.abs(solution.evaluate(ends) - ends[:, 0] - 2.0).max() < 5e-3


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({}, "takes either at or a file, got neither"),
        ({"at": [[0, 0]], "file": "x.npy"}, "got both"),
        ({"at": []}, "at must be points of shape"),
        ({"at": [[1, 2, 3, 4]]}, r"got the shape \(1, 4\)"),
        ({"at": [[1, np.nan]]}, "at must be finite"),
        ({"at": "here"}, "at must be points, n times 2 or 3 numbers"),
        ({"file": "nowhere.npy"}, "There is no file"),
    ],
)
def test_what_is_not_a_list_of_points_is_refused(keys, message):
    with pytest.raises(InputError, match=message):
        points(**keys)
