"""What a singular function is, by its own: slopes, sides, where it ends."""

import numpy as np
import pytest
from plane_zones import FRAME, slit, solved

from cpmkit.forms.galerkin.enrichment.singular_functions import SingularFunction

#: Frequency and phase of the functions of a tip, by whether a value is given on the left and on the right.
WAVES = {
    (False, False): [(0.5, 0.0)],
    (True, True): [(0.5, 0.5 * np.pi)],
    (True, False): [(-0.25, 0.25 * np.pi), (-0.75, 0.75 * np.pi)],
    (False, True): [(0.25, 0.25 * np.pi), (0.75, 0.75 * np.pi)],
}


@pytest.fixture(scope="module")
def disc():
    scene, _ = slit("flux")
    (function,) = solved(scene, 0.2, tips="singular").discretized.sampled.singular
    return function.disc


def around(disc, r, t):
    """Points at a distance and an angle from straight on, and a cell of the disc on the side of each."""
    points = disc.origin + r[:, None] * (np.cos(t)[:, None] * disc.heading + np.sin(t)[:, None] * disc.leftward)
    behind = np.where(np.cos(t) > 0, 0, np.where(np.sin(t) > 0, 1, -1))
    cells = {side: disc.cells[disc.sides == side][0] for side in (-1, 0, 1)}
    return points, np.array([cells[side] for side in behind.tolist()])


def test_the_axes(disc):
    np.testing.assert_allclose(FRAME[:2] @ disc.heading, [1, 0], atol=1e-9)
    assert abs(disc.curvature) < 1e-6
    assert 0.8 < disc.radius < 1


@pytest.mark.parametrize("given", WAVES)
def test_slopes_are_those_of_the_values(disc, given):
    generator = np.random.default_rng(0)
    r, t = generator.uniform(0.05, 0.85, 50), generator.uniform(-3, 3, 50)
    points, cells = around(disc, r, t)
    for wave in WAVES[given]:
        function = SingularFunction(disc, *wave)
        rows, slopes = function.slopes(points, cells)
        assert len(rows) == len(points)
        for axis in (disc.heading, disc.leftward):
            apart = [function.values(points + step * axis, cells)[1] for step in (1e-6, -1e-6)]
            np.testing.assert_allclose(slopes @ axis, (apart[0] - apart[1]) / 2e-6, atol=1e-7)


@pytest.mark.parametrize("given", WAVES)
def test_sides(disc, given):
    """On the sides that hold values the functions vanish, on the others their slope across does."""
    r = np.linspace(0.1, 0.8, 8)
    for side, holds in zip((1, -1), given, strict=True):
        points, cells = around(disc, r, np.full(8, side * (np.pi - 1e-12)))
        for wave in WAVES[given]:
            function = SingularFunction(disc, *wave)
            read = function.values(points, cells)[1] if holds else function.slopes(points, cells)[1] @ disc.leftward
            np.testing.assert_allclose(read, 0, atol=1e-9)


def test_a_point_past_the_boundary_is_read_from_its_cell(disc):
    """A sample may lie a rounding across the boundary that its triangle ends at."""
    function = SingularFunction(disc, 0.5, 0.0)
    for side in (1, -1):
        point = disc.origin - 0.3 * disc.heading - side * 1e-7 * disc.leftward
        cell = disc.cells[disc.sides == side][:1]
        rows, value = function.values(point[None], cell)
        assert len(rows) == 1
        assert value[0] * side > 0.1


def test_outside_there_is_nothing(disc):
    far = disc.origin + 1.01 * disc.radius * disc.heading
    assert not len(SingularFunction(disc, 0.5, 0.0).values(far[None], disc.cells[:1])[0])
    assert not len(SingularFunction(disc, 0.5, 0.0).values(disc.origin[None], np.array([-1]))[0])
