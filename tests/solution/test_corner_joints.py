"""Points along a polyline: one curve round its corners, however sharp, with the arc lengths of the polyline."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.solution.boundary_points import join_at_corners

PLATE = ck.source(
    "mesh.triangles",
    vertices=[[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]],
    faces=[[0, 1, 2], [0, 2, 3]],
    closest="faceted",
)
SQUARE = [[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]]
TEETH = [[-0.6, 0.5, 0], [-0.3, -0.5, 0], [0, 0.5, 0], [0.3, -0.5, 0], [0.6, 0.5, 0]]


@pytest.mark.parametrize(("corners", "closed"), [(SQUARE, True), (SQUARE, False), (SQUARE[:3], False), (TEETH, False)])
def test_a_polyline_is_one_curve_with_its_arc_length(corners, closed):
    along = ck.boundary_points(ck.source("mesh.polyline", points=corners, closed=closed), PLATE, 0.1)
    path = np.array(corners + corners[:1] if closed else corners, dtype=float)
    knots = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))]
    assert along.closed == (closed,)
    np.testing.assert_allclose(along.lengths, [knots[-1]], rtol=1e-12)
    begin = 0.0
    if closed:  # anywhere
        first = np.argmin([np.abs(along.points[0] - _on(path, knots, s)).max() for s in np.linspace(0, 4, 4001)])
        begin = 4 * first / 4000 - along.arc_length[0]
    expected = np.array([_on(path, knots, (s + begin) % knots[-1]) for s in along.arc_length])
    share = np.linalg.norm(along.points - expected, axis=1) / along.weights
    assert share.max() < 0.2  # of Gauss' points, which lie off the middles of what they stand for


def _on(path, knots, s):
    return np.array([np.interp(s, knots, axis) for axis in path.T])


def test_two_curves_that_cross_at_their_corners_go_straight_on():
    first = ck.source("mesh.polyline", points=[[-0.6, 0.5, 0], [0, 0, 0], [-0.6, -0.5, 0]])
    second = ck.source("mesh.polyline", points=[[0.6, 0.5, 0], [0, 0, 0], [0.6, -0.5, 0]])
    along = ck.boundary_points(ck.source("union", members=[first, second]), PLATE, 0.1)
    assert along.closed == (False, False)
    np.testing.assert_allclose(along.lengths, 2 * np.hypot(0.6, 0.5))


def test_where_three_ends_meet_nothing_is_joined():
    points, tangents = np.array([[-0.5, 0], [0, 0.5], [0.0, -0.5]]), np.array([[1, 0], [0, 1], [0, -1]])
    runs, closed = join_at_corners([np.array([k]) for k in range(3)], [False] * 3, points, tangents, np.ones(3))
    assert (len(runs), closed) == (3, (False,) * 3)
    runs, _ = join_at_corners([np.array([0]), np.array([1])], [False] * 2, points, tangents, np.ones(3))
    assert [run.tolist() for run in runs] == [[0, 1]]


def test_ends_are_joined_the_way_the_curves_run_and_nothing_else():
    points = np.array([[0.5, 0], [1.5, 0], [2, 0.5], [2, 1.5], [2.5, 5]])
    tangents, weights = np.array([[1, 0], [1, 0], [0, 1], [0, 1], [1, 0]]), np.ones(5)
    runs, one = [np.array([2, 3]), np.array([4]), np.array([0, 1])], [False, True, False]
    joined, closed = join_at_corners(runs, one, points, tangents, weights)
    assert [run.tolist() for run in joined] == [[4], [0, 1, 2, 3]]
    assert closed == (True, False)
    against, _ = join_at_corners(runs, one, points, tangents * [[1], [1], [-1], [-1], [1]], weights)
    assert sorted(map(len, against)) == [1, 2, 2]
