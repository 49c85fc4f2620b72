"""Conditions on one sheet of a surface hold there and nowhere else, however near the other sheets are."""

from functools import partial

import numpy as np
import pytest
from model_problems import max_error, order_of

import cpmkit as ck

KINDS = ("dirichlet", "neumann", "robin", "transmission")


class Spiral:
    """The radius grows by ``gap`` in each turn, from one; position, angle and travelled length along it."""

    def __init__(self, gap, turns):
        self.rate, self.end = gap / (2 * np.pi), 2 * np.pi * turns
        self.x = [f"(1 + {self.rate!r}*u)*cos(u)", f"(1 + {self.rate!r}*u)*sin(u)"]
        self.length = self.travelled(self.end)

    def at(self, angle):
        radius = 1 + self.rate * np.asarray(angle)
        return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)

    def angle(self, x):
        """Unwrapped: the radius tells the turn only, for points a little off the curve."""
        direction = np.arctan2(x[:, 1], x[:, 0])
        turn = ((np.hypot(x[:, 0], x[:, 1]) - 1) / self.rate - direction) / (2 * np.pi)
        return direction + 2 * np.pi * np.round(turn)

    def travelled(self, angle):
        def primitive(r):
            return (r * np.hypot(r, self.rate) + self.rate**2 * np.arcsinh(r / self.rate)) / (2 * self.rate)

        return primitive(1 + self.rate * np.asarray(angle)) - primitive(1.0)


def conditions(kind, left, right, slope_left, slope_right):
    """Data of functions of points on a boundary: values, and slopes out of each side."""
    if kind == "dirichlet":
        return {"left": ck.Dirichlet(left), "right": ck.Dirichlet(right)}
    if kind == "neumann":
        return {"left": ck.Neumann(slope_left), "right": ck.Neumann(slope_right)}
    if kind == "robin":
        return {
            "left": ck.Robin(1.0, 2.0, lambda x: slope_left(x) + 2 * left(x)),
            "right": ck.Robin(1.0, 2.0, lambda x: slope_right(x) + 2 * right(x)),
        }
    jump, flux = (lambda x: left(x) - right(x)), (lambda x: slope_left(x) + slope_right(x))
    return {"across": ck.Transmission(jump=jump, flux=flux)}


def cut_spiral(kind, gap):
    """-u'' + u = f on two turns of a spiral, cut at three points, of which two are opposite each other.

    u is cos k s plus 3, -6, 9, -12 on the four pieces.
    """
    spiral = Spiral(gap, turns=2)
    cuts = np.array([0.7, 3.0, 0.7 + 2 * np.pi])
    at, constants, k = spiral.travelled(cuts), np.array([3.0, -6.0, 9.0, -12.0]), 4 * np.pi / spiral.length

    def u(x, amplitude=1.0):
        s = spiral.travelled(spiral.angle(x))
        return amplitude * np.cos(k * s) + constants[np.searchsorted(at, s)]

    def near(value):
        return lambda x: np.full(len(x), value)

    boundaries = []
    for number, (angle, s) in enumerate(zip(cuts, at, strict=True)):
        value, slope = np.cos(k * s), -k * np.sin(k * s)
        sides = (near(value + constants[number]), near(value + constants[number + 1]), near(slope), near(-slope))
        point = ck.source("analytic.point", at=spiral.at(angle))
        boundaries.append(ck.Boundary(f"cut {number}", point, **conditions(kind, *sides)))
    curve = ck.source("parametric.curve", x=[one.replace("u", "t") for one in spiral.x], range=[0, spiral.end])
    angles = np.linspace(0, spiral.end, 1000)
    points = spiral.at(angles[np.abs(angles[:, None] - cuts).min(axis=1) > 1e-3])
    f = partial(u, amplitude=1 + k * k)
    return ck.Scene(curve, ck.ScreenedPoisson(f, c=1.0), boundaries), points, u(points)


@pytest.mark.parametrize(
    ("kind", "gap"),
    [
        ("dirichlet", 1.5),
        *[pytest.param(kind, gap, marks=pytest.mark.slow) for kind in KINDS for gap in (1.5, 2, 3)],
    ],
)
def test_cuts_of_a_spiral(kind, gap):
    """The turns draw nearer with the spacing; the error is that of a curve by itself, of second order."""
    for h in (0.07, 0.05, 0.035):
        assert max_error(*cut_spiral(kind, gap * h), h, form="collocation") <= 1e-3 * (h / 0.05) ** 2


def test_plain_closest_points_mix_the_turns_of_a_cut_spiral():
    for h in (0.07, 0.05):
        assert max_error(*cut_spiral("dirichlet", 2 * h), h, sheets=False) > 5


def rolled_sheet(kind, curve, gap, turns=1.2, height=0.5):
    """-Lap u + u = f on a sheet rolled up to a spiral, u a product of cosines that jumps by 10 across a curve.

    The curve runs along the axis, on one turn, or winds up with the sheet through all turns and grows by 0.03 each
    radian: its nearest part is then often on a neighbouring turn.
    """
    spiral = Spiral(gap, turns)
    k, m = 4 * np.pi / spiral.length, np.pi / height
    surface = ck.source("parametric.surface", x=[*spiral.x, "v"], u=[0, spiral.end], v=[0, height])
    if curve == "axis":
        foot = spiral.at(0.9)
        line = ck.source("analytic.segment", start=[*foot, 0.0], end=[*foot, height])
    else:
        winding = [one.replace("u", "t") for one in spiral.x]
        line = ck.source("parametric.curve", x=[*winding, "0.15 + 0.03*t"], range=[0, spiral.end])

    def to_left(x):
        """The unit vector to the left in arc length and height."""
        if curve == "axis":
            return -1.0, 0.0
        rise = 0.03 / np.hypot(1 + spiral.rate * spiral.angle(x), spiral.rate)
        return -rise / np.hypot(1, rise), 1 / np.hypot(1, rise)

    def side(x):
        angle = spiral.angle(x)
        return 0.9 - angle if curve == "axis" else x[:, 2] - 0.15 - 0.03 * angle

    def smooth(x):
        return np.cos(k * spiral.travelled(spiral.angle(x))) * np.cos(m * x[:, 2])

    def slope(x, sign):
        s, z = k * spiral.travelled(spiral.angle(x)), m * x[:, 2]
        along, up = to_left(x)
        return sign * (-k * np.sin(s) * np.cos(z) * along - m * np.cos(s) * np.sin(z) * up)

    def u(x, amplitude=1.0):
        return amplitude * smooth(x) + np.where(side(x) > 0, 5.0, -5.0)

    data = (lambda x: smooth(x) + 5, lambda x: smooth(x) - 5, partial(slope, sign=-1.0), partial(slope, sign=1.0))
    boundary = ck.Boundary("line", line, **conditions(kind, *data))
    angle, z = (one.ravel() for one in np.meshgrid(np.linspace(0, spiral.end, 300), np.linspace(0, height, 40)))
    points = np.concatenate([spiral.at(angle), z[:, None]], axis=1)
    points = points[np.abs(side(points)) > 1e-3]
    f = partial(u, amplitude=1 + k * k + m * m)
    return ck.Scene(surface, ck.ScreenedPoisson(f, c=1.0), [boundary]), points, u(points)


@pytest.mark.slow
def test_a_curve_on_one_turn_of_a_rolled_sheet():
    """The jump is 10: that is the error where the next turn shares it."""
    h = 0.1
    problem = rolled_sheet("dirichlet", "axis", 2 * h)
    assert max_error(*problem, h, form="collocation") <= 0.05
    assert max_error(*problem, h, sheets=False) > 5


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_curves_on_one_turn_of_a_rolled_sheet(kind):
    spacings = (0.1, 0.07, 0.05)
    errors = [max_error(*rolled_sheet(kind, "axis", 2 * h), h) for h in spacings]
    assert order_of(spacings, errors) >= 1.6


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_curve_that_winds_up_with_a_rolled_sheet(kind):
    """As exact as where the turns are ten spacings apart, so that nothing is shared."""
    for h in (0.1, 0.05):
        alone = max_error(*rolled_sheet(kind, "winding", 10 * h), h)
        assert max_error(*rolled_sheet(kind, "winding", 2 * h), h) <= 1.2 * alone
