"""Where a stencil crosses several boundaries: its own first, else the one nearest to it; each node is replaced once."""

import numpy as np
import pytest

from cpmkit.forms.collocation.selection import Centres, visible_ghosts
from cpmkit.forms.collocation.side_view import SideView

LEFT, RIGHT = np.array([[1.0, 0.0, 0.0]]), np.array([[-1.0, 0.0, 0.0]])


def seen_from_the_left(distance):
    """How one boundary sees a single stencil on its left, so far away."""
    one, none = np.zeros(1), np.zeros((1, 2))
    return SideView(np.array([0]), none, one.astype(bool), np.array([distance]), one + 1, none, LEFT)


def chosen(distances, own, directors):
    """The boundary and ghost that a stencil reads in its one node, which has a ghost of each boundary."""
    centres = Centres([seen_from_the_left(distance) for distance in distances], np.array([own]))
    label, number = visible_ghosts(centres, np.array([[0]]), [np.array([0])] * len(distances), directors)
    return label[0, 0], number[0, 0]


@pytest.mark.parametrize("own", [0, 1, 2])
@pytest.mark.parametrize("distances", [(0.3, 0.2, 0.1), (0.1, 0.2, 0.3)])
def test_the_own_boundary_comes_first(own, distances):
    assert chosen(distances, own, [RIGHT, RIGHT, RIGHT]) == (own, 0)


@pytest.mark.parametrize(("distances", "nearest"), [((0.3, 0.2, 0.1), 2), ((0.1, 0.2, 0.3), 0), ((0.2, 0.1, 0.3), 1)])
def test_of_others_the_nearest_comes_first(distances, nearest):
    assert chosen(distances, -1, [RIGHT, RIGHT, RIGHT]) == (nearest, 0)


def test_what_is_not_crossed_is_not_read():
    assert chosen((0.1, 0.2), 0, [LEFT, RIGHT]) == (1, 0)
    assert chosen((0.1, 0.2), 0, [LEFT, LEFT]) == (-1, -1)
