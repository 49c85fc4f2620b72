"""Feet are the nearest points of the whole image: also where it crosses, bends sharply, or is glued with a twist."""

from __future__ import annotations

import numpy as np
import pytest
from cpmkit_parametric import curve, helix, klein, moebius, revolution, surface, torus_knot
from cpmkit_parametric.cases import conformance_cases

import cpmkit as ck

TURN = [0, "2*pi"]
CASES = [case for case in conformance_cases() if case.name != "far from zero"]


def around(source, n, reach, seed=7):
    """Points up to ``reach`` from a source's mesh, in every direction."""
    rng = np.random.default_rng(seed)
    vertices = source.mesh(0.02 * np.linalg.norm(np.ptp(source.bounds, axis=0)))[0]
    direction = rng.normal(size=(n, source.dim))
    direction *= reach * rng.uniform(0, 1, (n, 1)) / np.linalg.norm(direction, axis=1, keepdims=True)
    return vertices[rng.integers(0, len(vertices), n)] + direction


@pytest.mark.parametrize("case", CASES, ids=str)
def test_no_sample_is_nearer_than_the_foot_and_the_nearest_is_hardly_farther(case):
    from scipy.spatial import cKDTree

    source, rng = case.make(), np.random.default_rng(5)
    lower, upper = source.bounds
    size = np.linalg.norm(upper - lower)
    x = 0.5 * (lower + upper) + size * rng.uniform(-0.7, 0.7, (1000, source.dim))
    feet = source.closest_point(x)
    nearest = cKDTree(case.samples(rng, 100_000)).query(x)[0]
    assert (feet.distance <= nearest + 1e-12 * size).all()
    assert (nearest - feet.distance).max() < 5e-3 * size
    assert feet.doubtful.mean() < 1e-3


TWINS = {
    "circle": (
        curve(x=["2*cos(t)", "2*sin(t)"], range=TURN, periodic=True),
        ck.source("analytic.circle", radius=2.0),
        0.9,
    ),
    "circle from a callable": (
        curve(x=lambda t: np.stack([np.cos(t), np.sin(t), 0 * t], axis=1), range=[0, 2 * np.pi], periodic=True),
        ck.source("analytic.circle", normal=[0, 0, 1]),
        0.4,
    ),
    "arc": (
        curve(x=["cos(t)", "sin(t)"], range=[0.7, 5.9]),
        ck.source("analytic.arc", start=0.7, end=5.9),
        0.4,
    ),
    "torus": (
        revolution(profile=["2+0.5*cos(t)", "0.5*sin(t)"], range=TURN, periodic=True),
        ck.source("analytic.torus", major=2.0, minor=0.5),
        0.25,
    ),
    "sphere": (
        revolution(profile=["cos(t)", "sin(t)"], range=["-pi/2", "pi/2"]),
        ck.source("analytic.sphere"),
        0.5,
    ),
    "cap": (
        revolution(profile=["cos(t)", "sin(t)"], range=["arcsin(0.3)", "pi/2"]),
        ck.source("analytic.cap", height=0.3),
        0.5,
    ),
    "cylinder": (
        surface(x=["cos(u)", "sin(u)", "v"], u=TURN, v=[-1, 1], periodic_u=True),
        ck.source("analytic.cylinder", radius=1.0, length=2.0),
        0.5,
    ),
}


@pytest.mark.parametrize("name", TWINS)
def test_feet_in_the_tube_agree_with_closed_forms(name):
    made, exact, reach = TWINS[name]
    x = around(exact, 4000, reach)
    found, wanted = made.closest_point(x), exact.closest_point(x)
    size = np.linalg.norm(np.ptp(exact.bounds, axis=0))
    # differences of a callable are good to about 1e-13 of the range's features
    assert np.linalg.norm(found.points - wanted.points, axis=1).max() < 1e-12 * size
    assert np.abs(found.distance - wanted.distance).max() < 1e-12 * size
    inside = (found.edge >= 0) == (wanted.edge >= 0)
    assert inside.mean() > 0.999
    assert not found.doubtful.any()


@pytest.mark.parametrize(
    ("x", "range", "periodic"),
    [
        (["sin(t)", "sin(2*t)/2"], TURN, True),
        (["t", "sqrt(t**2 + 1e-6)"], [-1, 1], False),
        (["t", "abs(t)"], [-1, 1], False),
        (["cos(t) + cos(9*t)/3", "sin(t) - sin(9*t)/3"], TURN, True),
    ],
    ids=["figure eight", "bend of radius 1e-3", "corner", "rosette with loops"],
)
def test_crossing_and_sharply_curved_curves_give_the_global_closest_point(x, range, periodic):
    source = curve(x=x, range=range, periodic=periodic)
    lower, upper = source.bounds
    queries = np.random.default_rng(3).uniform(lower - 0.3, upper + 0.3, (1000, 2))
    dense = source.mesh(1e-4)[0]
    from scipy.spatial import cKDTree

    nearest = cKDTree(dense).query(queries)[0]
    distance = source.closest_point(queries).distance
    assert (distance <= nearest + 1e-12).all()
    # a sample lies within 5e-5 of the foot: along the curve at any distance, else by its square
    assert (nearest - distance).max() < 1e-4
    assert np.median(nearest - distance) < 2.5e-8


def test_where_a_curve_crosses_itself_its_branch_is_doubtful_and_the_foot_is_not():
    eight = curve(x=["sin(t)", "sin(2*t)/2"], range=TURN, periodic=True)
    feet = eight.closest_point([[0, 0], [0.3, 0.3]])
    assert feet.doubtful.tolist() == [True, False]
    assert feet.distance[0] == pytest.approx(0.0, abs=1e-15)


def test_moebius_feet_on_both_sides_of_the_gluing_line_are_one_foot():
    strip, rng = moebius(), np.random.default_rng(1)
    v = rng.uniform(-0.3, 0.3, 200)
    height = rng.uniform(-0.2, 0.2, 200)
    x = np.stack([1 + v, np.zeros(200), height], axis=1)
    eps = 1e-9 * np.array([0, 1.0, 0])
    before, at, after = (strip.closest_point(x + k * eps) for k in (-1, 0, 1))
    for feet in (before, after):
        assert np.linalg.norm(feet.points - at.points, axis=1).max() < 5e-9
        assert np.abs(feet.distance - at.distance).max() < 5e-9
    # (u + 2 pi, v) is (u, -v): the same point of the strip has one pair of parameters
    seam = strip.closest_point(np.stack([1 + v, np.zeros(200), np.zeros(200)], axis=1))
    assert seam.distance.max() < 1e-15
    u, w = seam.local.T
    unrolled = np.where(u > np.pi, -w, w)
    assert unrolled == pytest.approx(v, abs=1e-12)
    turn = np.stack([np.full(9, 1e-3), np.linspace(-0.3, 0.3, 9)], axis=1)
    for sign in (-1, 1):
        su, sv = sign * turn[:, 0], turn[:, 1]
        ring = 1 + sv * np.cos(su / 2)
        points = np.stack([ring * np.cos(su), ring * np.sin(su), sv * np.sin(su / 2)], axis=1)
        local = strip.closest_point(points).local
        expected = np.stack([su % (2 * np.pi), sign * sv], axis=1)
        assert local == pytest.approx(expected, abs=1e-11)


def test_klein_sheets_meet_on_the_circle_where_it_crosses_itself():
    angle = np.linspace(0, 6, 7)
    circle = 2.0 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    feet = klein().closest_point(circle)
    assert feet.distance.max() < 1e-12
    assert feet.doubtful.all()
    assert (feet.edge == -1).all()


@pytest.mark.parametrize(
    ("source", "x", "edge"),
    [
        (helix(turns=1.0, pitch=2.0), [[1, -0.5, -0.1], [1, 0, 0], [-1, 0, 1], [1, 0.1, 2.1]], [0, 0, -1, 1]),
        (torus_knot(), [[4, 0, 0], [9, 9, 9]], [-1, -1]),
        # of the two rims, the wider is 0
        (
            revolution(profile=["t", "t"], range=[1, 2]),
            [[3, 0, 3], [0, 0, 0], [1.5, 0, 1.5], [0.5, 0, 0.5]],
            [0, 1, -1, 1],
        ),
        (revolution(profile=["t", "-t"], range=[1, 2]), [[3, 0, -3], [0.5, 0, -0.5]], [0, 1]),
        # the twisted strip has one rim, and a pole is none
        (moebius(), [[1.6, 0, 0], [0.5, 0, 0], [-1, 0, 0.6], [-1, 0, -0.6], [1.1, 0, 0]], [0, 0, 0, 0, -1]),
        (revolution(profile=["cos(t)", "sin(t)"], range=[0, "pi/2"]), [[0, 0, 2], [1, 0, -1]], [-1, 0]),
        (
            surface(x=["u", "v", "0*u"], u=[0, 2], v=[0, 1]),
            [[-1, 0.5, 0], [3, 0.5, 0], [1, -1, 0], [1, 2, 0], [3, 3, 3], [1, 0.5, 2]],
            [0, 0, 0, 0, 0, -1],
        ),
    ],
    ids=["helix", "knot", "cone", "cone downwards", "moebius", "hemisphere", "rectangle"],
)
def test_feet_on_a_bound_have_the_number_of_the_end_or_loop(source, x, edge):
    feet = source.closest_point(np.array(x, dtype=float))
    assert feet.edge.tolist() == edge
    assert source.closest_point(feet.points).edge.tolist() == edge


def test_local_holds_the_parameters_as_the_user_counts_them():
    made = curve(x=["t", "t**2", "0*t"], range=[-1, 3])
    feet = made.closest_point([[0.5, 0.25, 1.0], [9, 81, 0]])
    assert feet.local[:, 0] == pytest.approx([0.5, 3.0], abs=1e-12)
    made = surface(x=["u", "v", "u*v"], u=[-1, 1], v=[2, 4])
    assert made.closest_point([[0.5, 3, 1.5]]).local == pytest.approx(np.array([[0.5, 3.0]]), abs=1e-12)


def test_a_helix_at_1e9_answers_as_the_helix_at_the_origin_seen_from_there():
    offset = np.array([1e9, -1e9, 5e8])
    x = around(helix(), 200, 0.5)
    here, there = helix().closest_point(x), helix(translation=offset).translate(-offset).closest_point(x)
    assert np.array_equal(here.points, there.points)
