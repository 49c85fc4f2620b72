"""Feet are nearest points: no dense sample is nearer, also where many are equally near, and edges are named."""

from __future__ import annotations

import numpy as np
import pytest
from cpmkit_analytic import arc, cap, circle, cylinder, point, segment, sphere, torus
from cpmkit_analytic.cases import conformance_cases

CASES = [case for case in conformance_cases() if case.name != "far from zero"]


def lengths(vectors: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vectors, axis=-1)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_foot_is_as_near_as_the_nearest_of_many_samples(case):
    source, rng = case.make(), np.random.default_rng(7)
    lower, upper = source.bounds
    size = max(lengths(upper - lower), 1e-3)
    x = rng.uniform(lower - 0.4 * size, upper + 0.4 * size, (120, source.dim))
    samples = case.samples(rng, 20_000)
    nearest = lengths(x[:, None] - samples).min(axis=1)
    distance = source.closest_point(x).distance
    assert (distance <= nearest + 1e-12 * size).all()
    # A sample lies within about 0.05 size of every foot, so the nearest is farther by little.
    assert (nearest <= distance + 0.05 * size).all()
    # Samples lie farther apart in a solid than on a surface.
    assert np.median(nearest - distance) < (2e-3 if source.manifold_dim < 3 else 6e-3) * size


@pytest.mark.parametrize(
    ("source", "x", "distance"),
    [
        (circle(radius=2.0), [0, 0], 2.0),
        (circle(radius=2.0, normal=[0, 0, 1]), [0, 0, 1.5], 2.5),
        (sphere(radius=3.0), [0, 0, 0], 3.0),
        (sphere(radius=3.0), [0, 1e-170, 0], 3.0),
        (sphere(radius=3.0), [5e-324, 0, 0], 3.0),
        (torus(major=2.0, minor=0.5), [0, 0, 0], 1.5),
        (torus(major=2.0, minor=0.5), [0, 0, 1.5], 2.0),
        (torus(major=2.0, minor=0.5), [0, 2.0, 0], 0.5),
        (cylinder(radius=2.0, length=2.0), [0, 0, 0.3], 2.0),
        (cylinder(radius=2.0, length=2.0), [0, 0, 2.5], 2.5),
        (cap(radius=2.0, height=0.0), [0, 0, 0], 2.0),
        (cap(radius=5.0, height=3.0), [0, 0, -1.0], np.hypot(4.0, 4.0)),
        (arc(start=2.0, end=4.0), [0, 0], 1.0),
        (arc(start=0.0, end=np.pi), [0, -1.0], np.sqrt(2.0)),
        (segment(start=[0, 0], end=[1, 0]), [0.5, 0], 0.0),
        (point(at=[1.0, 2.0]), [1.0, 2.0], 0.0),
    ],
    ids=lambda value: type(value.shape).__name__ if hasattr(value, "shape") else None,
)
def test_a_query_with_many_closest_points_gets_one_of_them_and_always_the_same(source, x, distance):
    x = np.array([x, x], dtype=float)
    feet = source.closest_point(x)
    assert feet.distance == pytest.approx(distance, rel=1e-15)
    assert lengths(x - feet.points) == pytest.approx(distance, rel=1e-15)
    assert source.closest_point(feet.points).distance == pytest.approx(0.0, abs=1e-15)
    assert np.array_equal(feet.points[0], feet.points[1])


@pytest.mark.parametrize(
    ("source", "x", "edge"),
    [
        (segment(start=[0, 0], end=[1, 0]), [[-1, 1], [0, 0], [0.3, 1], [1, 0], [2, 5]], [0, 0, -1, 1, 1]),
        (arc(start=0.0, end=np.pi / 2), [[2, -0.1], [1, 1], [-0.1, 2], [-1, -1.1], [-1.1, -1]], [0, -1, 1, 0, 1]),
        (arc(start=3.0, end=-3.0), [[-1, 0], [1, 0.1], [1, -0.1]], [-1, 0, 1]),
        (arc(start=0.5, end=0.1), [[1, 0], [np.cos(0.2), np.sin(0.2)], [np.cos(0.4), np.sin(0.4)]], [-1, 1, 0]),
        (cap(height=0.5), [[0, 0, 3], [1, 0, 0], [0, 0, -1], [0, 0, 0]], [-1, 0, 0, -1]),
        (cap(height=-0.5), [[1, 0, 0], [1, 0, -0.5], [1, 0, -2]], [-1, -1, 0]),
        (cylinder(), [[0.1, 0, -2], [3, 0, -1], [3, 0, 0.99], [0, 2, 1.5]], [0, 0, -1, 1]),
        (sphere(), [[0, 0, 3]], [-1]),
        (point(at=[0, 0]), [[1, 2]], [-1]),
    ],
)
def test_a_foot_that_a_query_beyond_the_rim_is_pulled_back_to_has_the_number_of_the_rim(source, x, edge):
    assert source.closest_point(x).edge.tolist() == edge


def test_local_is_the_share_of_a_segment_and_the_angle_on_a_circle_and_arc():
    assert segment(start=[1, 1], end=[1, 5]).closest_point([[0, 2], [0, 9]]).local[:, 0] == pytest.approx([0.25, 1.0])
    assert circle().closest_point([[0, 3], [0, -3]]).local[:, 0] == pytest.approx([np.pi / 2, -np.pi / 2])
    feet = arc(start=-1.0, end=4.0).closest_point([[-1, 1e-3], [-1, -1e-3], [np.cos(5), np.sin(5)]])
    assert feet.local[:, 0] == pytest.approx(
        [np.pi - 1e-3, np.pi + 1e-3, 4.0 if 2 * np.pi - 6 > 5 - 4 else -1.0], abs=1e-8
    )


def test_the_ends_of_a_segment_and_an_arc_are_where_the_keys_put_them():
    made = segment(start=[0.1, 0.2, 0.3], end=[4.0, -5.0, 6.0])
    assert made.closest_point([[-9.0, 9, -9], [9, -9, 9]]).points == pytest.approx(
        np.array([[0.1, 0.2, 0.3], [4.0, -5.0, 6.0]]), rel=1e-15
    )
    made = arc(center=[1, 2, 3], radius=2.0, normal=[0, 1, 0], x_axis=[0, 0, 5], start=0.0, end=np.pi / 2)
    x = made.mesh(0.1)[0][[0, -1]]
    assert x == pytest.approx(np.array([[1, 2, 5.0], [3, 2, 3]]), rel=1e-15)
