"""Diffusion curves: colours from both sides, along curves and from files; nothing brighter than what is held."""

from __future__ import annotations

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.applications import ColouredSurface, diffusion_curves
from cpmkit.applications.colouring import ArcLengthShare, colour_data
from cpmkit.errors import InputError, SceneError

SPHERE = ck.source("analytic.sphere")
EQUATOR = ck.source("analytic.circle", normal=[0, 0, 1])
ARC = ck.source("analytic.arc", center=[0, 0, 0], normal=[0, 1, 0], radius=1.0, start=-0.9, end=-0.3)
RNG = np.random.default_rng(3)
POINTS = RNG.normal(size=(4000, 3))
POINTS /= np.linalg.norm(POINTS, axis=1, keepdims=True)


@pytest.mark.parametrize("curve", [EQUATOR, ck.source("analytic.circle", center=[0, 0, 0.6], radius=0.8)])
def test_shares_of_a_closed_curve_grow_with_its_angle(curve):
    angle = RNG.uniform(0, 2 * np.pi, 200)
    along = ArcLengthShare(curve)
    start = along(np.array([[1.0, 0, curve.bounds[0, 2]]]))
    found = (along(np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)) - start) % 1
    np.testing.assert_allclose(
        np.minimum(found, 1 - found) % 1, np.minimum(angle, 2 * np.pi - angle) / (2 * np.pi), atol=1e-5
    )


def test_shares_of_a_polyline_are_of_its_arc_length_from_its_first_point():
    corners = np.array([[0.3, 0.0], [0.8, 0.0], [0.8, 0.2], [0.3, 0.2]])
    closed = ArcLengthShare(ck.source("mesh.polyline", points=corners, closed=True))
    np.testing.assert_allclose(
        closed(np.array([[0.45, 0], [0.8, 0.1], [0.3, 0.1]])), [0.15 / 1.4, 0.6 / 1.4, 1.3 / 1.4], atol=1e-6
    )
    opened = ArcLengthShare(ck.source("mesh.polyline", points=corners))
    np.testing.assert_allclose(opened(np.array([[0.3, 0.0], [0.8, 0.1], [0.3, 0.2]])), [0, 0.5, 1], atol=1e-6)


def test_colours_along_a_curve_are_the_same_from_arrays_names_and_files(tmp_path):
    ramp = np.array([[1.0, 0, 0], [0, 1, 0], [1, 0, 0]])
    np.savetxt(tmp_path / "ramp.csv", ramp, delimiter=",")
    np.save(tmp_path / "stops.npy", np.column_stack([[0, 0.5, 1], ramp]))
    angle = np.linspace(0.2, 6, 20)
    on = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    green = 1 - np.abs(1 - 2 * ArcLengthShare(EQUATOR)(on))
    for given in (ramp, str(tmp_path / "ramp.csv"), tmp_path / "stops.npy", ["red", "lime", "#f00"]):
        data = colour_data(given, ArcLengthShare(EQUATOR), "the colour")
        np.testing.assert_allclose(data(on), np.stack([1 - green, green, 0 * green], axis=1), atol=1e-12)


def test_colours_are_met_on_both_sides():
    data = {"left": ["red", "lime", "red"], "right": "#0000ff"}
    found = diffusion_curves(SPHERE, [(EQUATOR, data)], spacing=0.2)
    assert isinstance(found, ColouredSurface)
    angle = np.linspace(0, 6, 20)
    on = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    exact = colour_data(data["left"], ArcLengthShare(EQUATOR), "left")(on)
    np.testing.assert_allclose(found.evaluate(on, "left"), exact, atol=0.06)  # the ramp has kinks
    np.testing.assert_allclose(found.evaluate(on, "right"), [[0, 0, 1.0]] * 20, atol=1e-6)


def test_no_colour_leaves_the_range_of_its_own_side():
    """The maximum principle, farther than three spacings from the tips of an open curve."""
    spacing = 0.1
    north = np.array([[0.9, 0.2, 0.1], [0.5, 0.4, 0.1], [0.9, 0.2, 0.1]])
    sides = {"left": north, "right": [0.2, 0.9, 0.6]}
    arc = {"left": [0.7, 0.3, 0.3], "right": [0.6, 0.25, 0.5]}
    found = diffusion_curves(SPHERE, [(EQUATOR, sides), (ARC, arc)], spacing=spacing).solution.evaluate(POINTS)
    below = POINTS[:, 2] < 0
    assert np.abs(found[below] - sides["right"]).max() < 1e-2
    imposed = np.array([*north, *arc.values()])
    tips = ARC.mesh(0.1)[0][[0, -1]]
    away = np.linalg.norm(POINTS[:, None] - tips, axis=2).min(axis=1) > 3 * spacing
    above = found[~below & away]
    assert (above > imposed.min(axis=0) - 1e-2).all()
    assert (above < imposed.max(axis=0) + 1e-2).all()
    assert np.ptp(above, axis=0).min() > 0.1


def test_colours_at_a_tip_are_clipped_to_those_imposed():
    """Where two sides meet, what is solved for swings beyond both; a flux that is not zero may do so rightly."""
    arc = {"left": ["#402040", "#c04040", "#402040"], "right": lambda points: 0 * points + [0.5, 0.25, 0.75]}
    found = diffusion_curves(SPHERE, [(ARC, arc)], spacing=0.2)
    np.testing.assert_allclose(found.ends, [[64 / 255, 32 / 255, 64 / 255], [192 / 255, 64 / 255, 0.75]])
    raw, mesh = found.solution.evaluate(POINTS), found.drawable().display_mesh()
    assert (raw < found.ends[0]).any() or (raw > found.ends[1]).any()
    for colours in (found.evaluate(POINTS), mesh.values):
        assert (colours >= found.ends[0]).all()
        assert (colours <= found.ends[1]).all()
    lamp = ck.source("analytic.arc", center=[0, 0, 0], normal=[1, 0, 0], radius=1.0, start=0.3, end=0.9)
    scene = ck.Scene(SPHERE, ck.Laplace(), [ck.Boundary("lamp", lamp, both=ck.Neumann(0.1))])
    lit = diffusion_curves(scene, [(ARC, arc)], spacing=0.3)
    np.testing.assert_array_equal(lit.ends, [[0, 0, 0], [1, 1, 1]])
    wall = ck.Scene(SPHERE, ck.Laplace(), [ck.Boundary("wall", lamp, both=ck.Neumann([0.0, 0.0, 0.0]))])
    np.testing.assert_allclose(diffusion_curves(wall, [(ARC, arc)], spacing=0.3).ends, found.ends, atol=1e-12)


def test_a_side_without_a_colour_lets_nothing_pass_and_a_scene_holds_besides():
    collar = ck.source("analytic.circle", normal=[0, 0, 1], center=[0, 0, 0.6], radius=0.8)
    wall = ck.Boundary("wall", EQUATOR, both=ck.Neumann())
    scene = ck.Scene(SPHERE, ck.Laplace(), [wall])
    pin = ck.source("analytic.circle", normal=[0, 0, 1], center=[0, 0, -0.6], radius=0.8)
    curves = {"collar": (collar, {"left": "navy", "right": None}), "low": (pin, "white")}
    with pytest.raises(
        SceneError, match="touches no side of a curve that has a colour"
    ):  # between collar and wall nothing holds a colour
        diffusion_curves(scene, {"collar": curves["collar"]}, spacing=0.2)
    found = diffusion_curves(SPHERE, curves, spacing=0.2).evaluate([[0, 0, 1.0], [0.96, 0, 0.28]])
    np.testing.assert_allclose(found, [[0, 0, 128 / 255], [1, 1, 1]], atol=1e-6)


@pytest.mark.parametrize(
    ("curves", "words"),
    [
        ([EQUATOR], "must be a pair"),
        ([(EQUATOR, {"left": "red"})], "as left and right, with None"),
        ([(EQUATOR, {"left": None, "right": None})], "no side of a curve has a colour"),
        ([], "no side of a curve"),
        ([(EQUATOR, "navvy")], "did you mean 'navy'"),
        ([(EQUATOR, [255, 0, 0])], "from 0 to 1, got 255"),
        ([(EQUATOR, [[0.0, 0.1]])], r"got shape \(1, 2\)"),
        ([(EQUATOR, [[0.5, 0, 0, 0], [0.1, 1, 1, 1]])], "do not go back"),
        ([(EQUATOR, ["red", 3])], "entry 1 of the colour of curve 0"),
        ([(EQUATOR, "colours.npy")], "colours.npy"),
        ([(EQUATOR, {"left": lambda points: points[:, 0], "right": "red"})], r"shape \(\d+, 3\)"),
    ],
)
def test_wrong_input_is_answered_in_one_sentence(curves, words):
    with pytest.raises(InputError, match=words):
        diffusion_curves(SPHERE, curves, spacing=0.3)


def test_a_damaged_list_of_colours_is_refused(tmp_path):
    (tmp_path / "colours.csv").write_text("red,green,blue\n0,0,1\n")
    with pytest.raises(InputError, match=r"colours\.csv' must hold lines of three numbers"):
        diffusion_curves(SPHERE, [(EQUATOR, tmp_path / "colours.csv")], spacing=0.3)


@pytest.mark.slow
def test_the_square_of_the_paper_keeps_to_its_colours():
    """The curve crosses itself at (-0.5, 0) in a loop 0.013 long, whose right side lies inside the large loop."""
    from matplotlib.path import Path

    spacing = 0.01
    angle = np.linspace(0, 2 * np.pi, 20001)
    size = (np.cos(angle) * (3.5 + np.sin(3 * angle) + np.sin(4 * angle)) + 3.5) / 7
    curve = np.stack([size * np.cos(angle) - 0.5, size * np.sin(angle)], axis=1)

    def left(x):
        return np.stack([0.9 * (0.5 - 0.5 * x), 0.8 * (0.5 + 0.5 * x), 0 * x + 0.1], axis=1)

    def right(x):
        return left(x)[:, [2, 1, 0]]

    source = ck.source("parametric.planar_curve", translation=[0, 0.5])
    box = ck.source("analytic.box", lower=[-1, -1], upper=[1, 1])
    sides = {"left": lambda points: left(points[:, 0]), "right": lambda points: right(points[:, 0])}
    points = RNG.uniform(-0.99, 0.99, (20000, 2))
    near = RNG.uniform(0, 2 * np.pi, 5000), spacing * RNG.uniform(3, 4, 5000)
    ring = np.stack([near[1] * np.cos(near[0]) - 0.5, near[1] * np.sin(near[0])], axis=1)
    points = np.concatenate([points, ring])
    found = diffusion_curves(box, [(source, sides)], spacing=spacing).evaluate(points)
    away = np.linalg.norm(points - [-0.5, 0], axis=1) > 3 * spacing
    large = size >= 0
    inside = Path(curve[large]).contains_points(points)
    outer = right(curve[large, 0])
    inner = np.concatenate([left(curve[large, 0]), right(curve[~large, 0])])
    for part, imposed in ((~inside, outer), (inside, inner)):
        seen = found[part & away]
        assert (seen > imposed.min(axis=0) - 1e-2).all()
        assert (seen < imposed.max(axis=0) + 1e-2).all()
    # beyond the loop its blue falls as that of a slit's end: by 2 / pi arctan(sqrt(length / distance))
    blue = found[inside & (np.linalg.norm(points - [-0.5, 0], axis=1) > 0.2), 2]
    assert (blue < 0.1 + 0.57 * 2 / np.pi * np.arctan(np.sqrt(0.03 / 0.2))).all()
