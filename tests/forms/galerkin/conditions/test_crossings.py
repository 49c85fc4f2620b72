"""Boundaries that cross or end with different values are told, with the place, and others are not."""

import numpy as np
import pytest

import cpmkit as ck

SPHERE = ck.source("analytic.sphere")


def great_circle(name, normal, **sides):
    return ck.Boundary(name, ck.source("analytic.circle", normal=normal), **sides)


def arc(**sides):
    t = np.linspace(-0.8, 0.8, 60)
    points = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    return ck.Boundary("arc", ck.source("mesh.polyline", points=points), **sides)


def warnings_of(problem, *boundaries):
    return ck.solve(ck.Scene(SPHERE, problem, list(boundaries)), 0.25, form="galerkin").warnings


def test_circles_that_cross_with_different_values():
    one = great_circle("one", [0, 0, 1], both=ck.Dirichlet(1.0))
    (sentence,) = warnings_of(ck.Laplace(), one, great_circle("other", [1, 0, 0], both=ck.Dirichlet(3.0)))
    assert "'one' and 'other' cross with different values" in sentence
    assert "near (0, " in sentence
    assert "difference, 2," in sentence
    assert not warnings_of(ck.Laplace(), one, great_circle("other", [1, 0, 0], both=ck.Dirichlet(1.0)))
    assert not warnings_of(ck.Laplace(), one, great_circle("other", [1, 0, 0], both=ck.Neumann(0.0)))


def test_values_that_are_equal_at_the_crossings_alone():
    one = great_circle("one", [0, 0, 1], both=ck.Dirichlet(lambda x: x[:, 0]))
    assert not warnings_of(ck.Laplace(), one, great_circle("other", [1, 0, 0], both=ck.Dirichlet(lambda x: x[:, 2])))


def test_a_third_pair_is_counted():
    circles = [great_circle(f"{k}", np.eye(3)[k], both=ck.Dirichlet(float(k))) for k in range(3)]
    (sentence,) = warnings_of(ck.Laplace(), *circles)
    assert "and 2 more pairs" in sentence


def test_an_arc_that_ends_with_different_values():
    (sentence,) = warnings_of(ck.ScreenedPoisson(0.0), arc(left=ck.Dirichlet(1.0), right=ck.Dirichlet(-1.0)))
    assert "'arc' ends near" in sentence
    assert "and at its other end with different values" in sentence
    assert not warnings_of(ck.ScreenedPoisson(0.0), arc(both=ck.Dirichlet(1.0)))
    assert not warnings_of(ck.ScreenedPoisson(0.0), arc(left=ck.Dirichlet(1.0), right=ck.Neumann(0.0)))
    ends = [np.array([np.cos(t), np.sin(t), 0.0]) for t in (-0.8, 0.8)]

    def opening(x):
        return np.prod([np.linalg.norm(x - end, axis=1) for end in ends], axis=0)

    assert not warnings_of(ck.ScreenedPoisson(0.0), arc(left=ck.Dirichlet(opening), right=ck.Dirichlet(0.0)))


@pytest.mark.parametrize("same", [True, False])
def test_one_circle_drawn_twice(same):
    both = [
        great_circle(name, [0, 0, 1], both=ck.Dirichlet(1.0 if same else value))
        for name, value in (("a", 1.0), ("b", 2.0))
    ]
    if same:
        (sentence,) = warnings_of(ck.ScreenedPoisson(0.0), *both)
        assert "'a' and 'b' lie at the same place and hold the same" in sentence
    else:
        with pytest.raises(ck.SceneError, match="'a' and 'b' lie at the same place, and their conditions"):
            warnings_of(ck.ScreenedPoisson(0.0), *both)


def test_values_that_change_in_time_at_ends_and_crossings():
    def warm(x, t):
        return 1 + t + x[:, 1]

    problem = ck.Heat(1.0, until=0.2, step=0.1)
    other = great_circle("other", [0, 1, 0], both=ck.Dirichlet(lambda x, t: 1 + t))
    assert not warnings_of(problem, arc(both=ck.Dirichlet(warm)), other)
    sentences = warnings_of(problem, arc(left=ck.Dirichlet(warm), right=ck.Dirichlet(0.0)))
    assert any("'arc' ends near" in sentence for sentence in sentences)
