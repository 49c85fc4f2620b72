"""Curves known by closest points alone are traced with the right ends and crossings, and lengths of order four."""

from __future__ import annotations

from math import hypot, pi, sqrt

import numpy as np
import pytest
from meshing.contouring.measures import length, pieces
from scipy.special import ellipe

import cpmkit as ck
from cpmkit.errors import ResolutionError
from cpmkit.mesh.subdivision import split_at_knot_planes
from cpmkit.meshing.contouring.contoured_curves import contour_curve
from cpmkit.meshing.curved_from_points import curve_cells_by_closest_points
from cpmkit.plugin import localize

ROUND = {"range": [0, 2 * pi], "periodic": True}
TREFOIL = ["(2 + cos(3*t))*cos(2*t)/2", "(2 + cos(3*t))*sin(2*t)/2", "sin(3*t)/2"]
TREFOIL_LENGTH = 15.9493003332  # the trapezoidal rule on 4,096 points, exact to rounding
EIGHT_LENGTH = 6.0972234701
CURVES = {
    "circle": ({"kind": "analytic.circle", "center": [0, 0]}, 2 * pi, 0),
    "circle in space": ({"kind": "analytic.circle", "normal": [1, 2, 3]}, 2 * pi, 0),
    "ellipse": ({"kind": "parametric.curve", "x": ["2*cos(t)", "sin(t)"], **ROUND}, 8 * ellipe(0.75), 0),
    "open arc": ({"kind": "analytic.arc", "start": 0.7, "end": 5.9}, 5.2, 2),
    "trefoil": ({"kind": "parametric.curve", "x": TREFOIL, **ROUND}, TREFOIL_LENGTH, 0),
    "helix": ({"kind": "parametric.helix"}, 4 * pi * sqrt(1 + 1 / (4 * pi**2)), 2),
}


def followed(source, spacing, origin=None):
    centre = np.asarray(source.bounds).mean(axis=0)
    seen = localize(source, centre if origin is None else centre + origin)
    mesh, defects = contour_curve(seen, spacing)
    return curve_cells_by_closest_points(mesh, seen), defects


def degrees(mesh):
    """Return how many vertices there are of each number of segments."""
    return np.bincount(np.bincount(mesh.cells.ravel()))[1:].tolist()


@pytest.mark.parametrize("name", CURVES)
def test_lengths_are_of_order_four_and_ends_are_met(name):
    keys, exact, ends = CURVES[name]
    source = ck.source(**keys)
    errors = []
    for spacing in (0.2, 0.1, 0.05):
        mesh, defects = followed(source, spacing)
        count = degrees(mesh)
        assert (pieces(mesh.cells), count[0], len(count)) == (1, ends, 2)
        assert defects.count == 0
        errors.append(abs(length(mesh) / exact - 1))
    assert errors[1] < 1e-6 if mesh.dim == 2 else 1e-5
    assert np.log2(errors[0] / errors[2]) / 2 > 3.5


def test_segments_of_a_trace_are_split_to_lie_in_one_cell_each():
    source = ck.source("analytic.arc", start=0.7, end=5.9)
    local = localize(source, np.asarray(source.bounds).mean(axis=0))
    mesh, _ = contour_curve(local, 0.1)
    ends = split_at_knot_planes(mesh, 0.1, local).vertices[split_at_knot_planes(mesh, 0.1, local).cells] / 0.1
    assert degrees(mesh)[0] == 2
    assert np.abs(ends - np.rint(ends.mean(axis=1))[:, None]).max() < 0.5 + 1e-9


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_anywhere_on_the_lattice_and_of_any_size(seed, scale):
    origin = np.random.default_rng(seed).uniform(0, 0.1, 3) * scale
    mesh, defects = followed(ck.source("analytic.circle", normal=[1, 2, 3], scale=scale), 0.1 * scale, origin)
    assert (pieces(mesh.cells), degrees(mesh)[0], defects.count) == (1, 0, 0)
    assert length(mesh) == pytest.approx(2 * pi * scale, rel=1e-6)


@pytest.mark.parametrize("spacing", [0.2, 0.1, 0.05])
def test_a_curve_that_crosses_itself_is_one_star(spacing):
    eight = ck.source("parametric.curve", x=["sin(t)", "sin(2*t)/2"], **ROUND)
    mesh, _ = followed(eight, spacing)
    count = degrees(mesh)
    assert (pieces(mesh.cells), count[0], count[3]) == (1, 0, 1)
    assert length(mesh) == pytest.approx(EIGHT_LENGTH, rel=0.04 * spacing**2)


@pytest.mark.parametrize("seed", range(8))
def test_a_cross_of_two_segments_has_four_ends_and_one_star(seed):
    cross = ck.source(
        "union",
        members=[
            ck.source("analytic.segment", start=[-1, -0.3], end=[1, 0.4]),
            ck.source("analytic.segment", start=[-0.2, -1], end=[0.3, 1]),
        ],
    )
    mesh, _ = followed(cross, 0.1, np.random.default_rng(seed).uniform(0, 0.1, 2))
    count = degrees(mesh)
    assert (pieces(mesh.cells), count[0], count[3]) == (1, 4, 1)
    assert length(mesh) == pytest.approx(hypot(2, 0.7) + hypot(0.5, 2), rel=1e-9)


def test_a_segment_through_corners_of_cells():
    mesh, defects = followed(ck.source("analytic.segment", start=[0, 0, 0], end=[1, 1, 1]), 0.1)
    assert (degrees(mesh)[0], len(degrees(mesh)), defects.count) == (2, 2, 0)
    assert length(mesh) == pytest.approx(sqrt(3), rel=1e-12)


@pytest.mark.parametrize("spacing", [0.1, 0.2, 0.3, 0.45])
def test_a_step_between_parallel_lines_is_traced(spacing):
    """The tangents at the ends of a chord over the step are parallel and meet nowhere."""
    step = ck.source("mesh.polyline", points=[[-1, 0], [0, 0], [0, 0.1], [1, 0.1]])
    mesh, _ = contour_curve(localize(step, np.zeros(2)), spacing)
    steps = np.diff(mesh.vertices[mesh.cells], axis=1)[:, 0]
    assert np.linalg.norm(steps, axis=1).sum() == pytest.approx(2.1, abs=0.11)


def test_a_curve_inside_one_cell_is_refused():
    with pytest.raises(ResolutionError, match="lies in one cell"):
        followed(ck.source("analytic.circle", center=[0, 0], radius=0.01), 0.1)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("spacing", [0.2, 0.1, 0.05])
def test_a_junction_of_arcs_is_met(spacing, seed):
    keys = {"start": 0.0, "end": pi / 2, "x_axis": [0, 0, 1]}
    normals = [[-np.sin(turn), np.cos(turn), 0.0] for turn in (0.3, 2.4, 4.0)]
    source = ck.source("union", members=[ck.source("analytic.arc", normal=normal, **keys) for normal in normals])
    shift = np.random.default_rng(seed).uniform(0, spacing, 3)
    mesh, _ = followed(source, spacing, shift)
    assert degrees(mesh)[0::2] == [3, 1]
    junction = mesh.vertices[np.argmax(np.bincount(mesh.cells.ravel(), minlength=len(mesh.vertices)))]
    pole = [0, 0, 1] - np.mean(source.bounds, axis=0) - shift
    assert np.linalg.norm(junction - pole) < 1e-6 * spacing
