"""Curves of which closest points alone are known are traced: round corners, through crossings, to their ends."""

import numpy as np
import pytest
from cut_meshes import check_sound, cut, icosphere, moebius_band, plate, polyline, torus, tube, zones_and_tips

import cpmkit as ck
from cpmkit.plugin import Mesh

PLATE = plate(30)
TURN = 2 * np.pi * np.arange(200) / 200
NONE = np.zeros(200)


class ClosestPointsAlone:
    """A source without any ability."""

    manifold_dim = 1
    exact = True

    def __init__(self, of):
        self.of, self.dim, self.bounds = of, of.dim, of.bounds

    def closest_point(self, x):
        return self.of.closest_point(x)


def line(*points, closed=False):
    return polyline([[*point, 0.0] for point in points], closed)


def around(*coordinates, closed=True):
    return polyline(np.stack(coordinates, axis=1), closed)


def circle(x, y, radius):
    return ck.source("analytic.circle", center=[x, y, 0.0], radius=radius)


def together(*members):
    return ck.source("union", members=list(members))


SPIRAL = around(0.1 * np.cos(6 * TURN), 0.1 * np.sin(6 * TURN), 0.1 + TURN / 9, closed=False)
KNOT = 1 + 0.4 * np.cos(3 * TURN)
CASES = {
    "line": (line((0.2, 0.23), (0.8, 0.77)), (1, 2)),
    "circle": (circle(0.5, 0.5, 0.3), (2, 0)),
    "square": (line((0.21, 0.2), (0.8, 0.21), (0.78, 0.8), (0.2, 0.79), closed=True), (2, 0)),
    "triangle": (line((0.21, 0.2), (0.8, 0.21), (0.5, 0.8), closed=True), (2, 0)),
    "acute corner": (line((0.2, 0.5), (0.8, 0.58), (0.8, 0.42), closed=True), (2, 0)),
    "V": (line((0.2, 0.5), (0.8, 0.58), (0.2, 0.7)), (1, 2)),
    "eight": (around(0.5 + 0.3 * np.sin(TURN), 0.5 + 0.15 * np.sin(2 * TURN), NONE), (3, 0)),
    "X": (together(line((0.2, 0.23), (0.8, 0.77)), line((0.2, 0.8), (0.83, 0.2))), (1, 4)),
    "T": (together(line((0.2, 0.53), (0.8, 0.53)), line((0.5, 0.53), (0.51, 0.9))), (1, 3)),
    "Y": (together(*[line((0.5, 0.5), end) for end in [(0.8, 0.53), (0.31, 0.9), (0.3, 0.1)]]), (1, 3)),
    "two circles": (together(circle(0.3, 0.5, 0.15), circle(0.7, 0.5, 0.15)), (3, 0)),
    "two circles that cross": (together(circle(0.4, 0.5, 0.2), circle(0.6, 0.5, 0.2)), (4, 0)),
    "over both rims": (line((-0.3, 0.4), (1.5, 0.53)), (2, 0)),
    "over four rims": (circle(0.5, 0.5, 0.55), (5, 0)),
}


@pytest.mark.parametrize("name", CASES)
def test_zones_and_tips_of(name):
    source, expected = CASES[name]
    after = cut(PLATE, ClosestPointsAlone(source), spacing=0.05).mesh
    assert zones_and_tips(after) == expected
    check_sound(PLATE, after)


@pytest.mark.parametrize(
    ("make", "source", "expected"),
    [
        (lambda: icosphere(4), ck.source("analytic.circle", center=[0, 0, 0.6], radius=0.8), (2, 0)),
        (
            lambda: tube(0.1),
            around(0.1 * np.cos(6 * TURN), 0.1 * np.sin(6 * TURN), 0.1 + TURN / 9, closed=False),
            (1, 2),
        ),
        (torus, around(KNOT * np.cos(2 * TURN), KNOT * np.sin(2 * TURN), 0.4 * np.sin(3 * TURN)), (1, 0)),
        (moebius_band, around(np.cos(TURN), np.sin(TURN), NONE), (1, 0)),
    ],
    ids=["circle on a sphere", "spiral on a limb", "knot on a torus", "core of a Moebius band"],
)
def test_curves_in_space(make, source, expected):
    mesh = make()
    after = cut(mesh, ClosestPointsAlone(source)).mesh
    assert zones_and_tips(after) == expected
    check_sound(mesh, after)


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_the_unit_of_length_does_not_matter(unit):
    mesh = Mesh.of(unit * PLATE.vertices, PLATE.cells)
    source = ck.source("moved", of=CASES["square"][0], scale=unit)
    assert zones_and_tips(cut(mesh, ClosestPointsAlone(source), spacing=0.05 * unit).mesh) == (2, 0)


def test_random_triangles():
    rng = np.random.default_rng(3)
    for _ in range(8):
        angle = rng.uniform(0, 2 * np.pi) + np.array([0, 2, 4]) + rng.uniform(-0.4, 0.4, 3)
        corners = 0.5 + rng.uniform(0.25, 0.4, 3)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        after = cut(PLATE, ClosestPointsAlone(line(*corners.tolist(), closed=True)), spacing=0.05).mesh
        assert zones_and_tips(after) == (2, 0)
        places = after.vertices[after.cut][:, 0, :2]
        gaps = np.linalg.norm(places[:, None] - corners, axis=2).min(axis=0)
        assert gaps.max() < 0.1 / 30
