"""Path data, transforms and flattening: what commands draw, in closed form, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from cpmkit_svg.flattening import TOLERANCE_SHARE, flatten_cubics
from cpmkit_svg.path_data import subpaths
from cpmkit_svg.transforms import compose_maps, parse_transform

import cpmkit as ck
from cpmkit.errors import InputError


def drawn(text: str) -> np.ndarray:
    (one,) = subpaths(text, "d")
    return flatten_cubics(one.cubics)


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("M1 2 L3 4 5 6", "M 1,2 l 2 2 2 2"),
        ("M1 2 3 4", "m1 2 2 2"),
        ("M0 0 H3 V-1 Z", "M0,0h3v-1z"),
        ("M0 0 C0 1 1 1 1 0 S 2 -1 2 0", "M0 0 c0 1 1 1 1 0 C 1 -1 2 -1 2 0"),
        ("M0 0 Q1 2 2 0 T 4 0", "M0 0 q1 2 2 0 q 1 -2 2 0"),
        ("M0 0 T 4 0", "M0 0 Q 0 0 4 0"),
        ("M0 0 S 1 1 4 0", "M0 0 C 0 0 1 1 4 0"),
        ("M1-2.5.5e1-1", "M 1 -2.5 L 5 -1"),
        ("M0 0a1 1 0 012 0", "M0 0 A 1 1 0 0 1 2 0"),
        ("M0 0 A 0 1 0 0 1 2 0", "M0 0 L 2 0"),
        ("M0 0 A 0.1 0.1 0 0 1 2 0", "M0 0 A 1 1 0 0 1 2 0"),
        ("M0 0 Q 1 2 3 1", "M0 0 C 0.6666666666666666 1.3333333333333333 1.6666666666666665 1.6666666666666665 3 1"),
    ],
)
def test_commands_say_the_same_in_two_ways(text, same):
    np.testing.assert_allclose(drawn(text), drawn(same), atol=1e-12)


@pytest.mark.parametrize("large", [0, 1])
@pytest.mark.parametrize("sweep", [0, 1])
def test_arcs_lie_on_their_ellipse_and_turn_the_way_that_is_given(large, sweep):
    """Of the two ellipses and four arcs through two points; y is downwards, so a sweep is clockwise as one sees it."""
    rx, ry, turn = 3.0, 1.5, np.radians(25)
    points = drawn(f"M 1 0 A {rx} {ry} 25 {large} {sweep} 2.5 1")
    np.testing.assert_allclose(points[[0, -1]], [[1, 0], [2.5, 1]], atol=1e-12)
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) / [[rx], [ry]]
    unit = points @ axes.T
    system = np.column_stack([2 * unit, np.ones(len(unit))])
    centre = np.linalg.lstsq(system, (unit**2).sum(axis=1), rcond=None)[0][:2]
    np.testing.assert_allclose(np.linalg.norm(unit - centre, axis=1), 1.0, atol=1e-5)
    angle = np.unwrap(np.arctan2(*(unit - centre).T[::-1]))
    assert (np.diff(angle) > 0).all() == bool(sweep)
    assert (abs(angle[-1] - angle[0]) > np.pi) == bool(large)


def test_points_along_a_cubic_leave_it_by_less_than_is_said():
    cubic = np.array([[[0.0, 0.0], [3.0, 4.0], [-2.0, 4.0], [1.0, 0.0]]])
    points, t = flatten_cubics(cubic), np.linspace(0, 1, 5001)
    s = 1 - t
    fine = np.stack([s**3, 3 * s * s * t, 3 * s * t * t, t**3], axis=1) @ cubic[0]
    off = ck.source("mesh.polyline", points=points).closest_point(fine).distance.max()
    assert off < TOLERANCE_SHARE * np.ptp(cubic.reshape(-1, 2), axis=0).max()
    assert len(flatten_cubics(np.linspace([[0.0, 0.0]], [[1.0, 1.0]], 4).reshape(1, 4, 2))) == 2


def test_subpaths_are_separated_by_moves_and_closings():
    found = subpaths("M0 0 L1 0 Z L 0 2 M 5 5 L 6 6 M 7 7", "d")
    assert [(len(one.cubics), one.closed) for one in found] == [(2, True), (1, False), (1, False)]
    np.testing.assert_array_equal(found[1].cubics[0, [0, -1]], [[0, 0], [0, 2]])


@pytest.mark.parametrize(
    ("text", "matrix"),
    [
        ("", [[1, 0, 0], [0, 1, 0]]),
        ("translate(3)", [[1, 0, 3], [0, 1, 0]]),
        ("translate(3 4), scale(2)", [[2, 0, 3], [0, 2, 4]]),
        ("rotate(90, 1, 1)", [[0, -1, 2], [1, 0, 0]]),
        ("matrix(1 2 3 4 5 6)", [[1, 3, 5], [2, 4, 6]]),
        ("skewX(45)scale(1,-1)", [[1, -1, 0], [0, -1, 0]]),
        ("skewY(45)", [[1, 0, 0], [1, 1, 0]]),
    ],
)
def test_transforms(text, matrix):
    found = parse_transform(text, "g")
    np.testing.assert_allclose(found, matrix, atol=1e-12)
    np.testing.assert_allclose(
        compose_maps(found, parse_transform("scale(2)", "g")), parse_transform(f"{text} scale(2)", "g")
    )


@pytest.mark.parametrize("text", ["turn(3)", "scale(1 2 3)", "scale(a)", "scale(1", "rotate(1 2)"])
def test_wrong_transforms_are_refused(text):
    with pytest.raises(InputError, match="transform of g"):
        parse_transform(text, "g")


@pytest.mark.parametrize("sweep", [0, 1])
def test_arcs_of_any_radius(sweep):
    """A radius far below the chord is scaled up to a half circle; far above it the shorter arc is a line."""
    for radius in (0.3, 1e-5, 1e-300):
        half = drawn(f"M -1 0 A {radius} {radius} 0 0 {sweep} 1 0")
        np.testing.assert_allclose(np.linalg.norm(half, axis=1), 1, atol=3e-5)
    for radius in (1e7, 1e9, 1e30):
        assert np.abs(drawn(f"M -1 0 A {radius} {radius} 0 0 {sweep} 1 0")[:, 1]).max() < 1e-7
    for radii in ("1e-300 1", "2 1e-12", "1e-5 1e30"):
        np.testing.assert_allclose(drawn(f"M -1 0 A {radii} 0 0 {sweep} 1 0")[:, 1], 0)
    gap = drawn(f"M 50 0 A 50 50 0 1 {sweep} 50 {1e-6 * (1 if sweep == 0 else -1)}")  # all of a circle but a millionth
    np.testing.assert_allclose(np.linalg.norm(gap, axis=1), 50, atol=2e-3)
    assert np.ptp(gap[:, 0]) == pytest.approx(100, abs=2e-3)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("L 1 1", 2),
        ("M 0 0 L 1", 10),
        ("M 0 0 X 1 1", 8),
        ("M 0 0 Z 3", 9),
        ("M 0 0 A 1 1 0 2 0 3 3", 15),
        ("M 0 0 ,;", 8),
    ],
)
def test_damaged_path_data_are_refused_with_the_place(text, place):
    with pytest.raises(InputError, match=rf"d: .* was expected at character {place}, got"):
        subpaths(text, "d")
