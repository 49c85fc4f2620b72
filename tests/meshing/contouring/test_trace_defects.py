"""Defects of a trace are found, and warnings name their place and size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bare import Bare

import cpmkit as ck
from cpmkit.meshing.contouring.contoured_curves import trace_defects
from cpmkit.meshing.contouring.curve_graph import CurveGraph

#: The x axis from 0 to 3, in spacings of one.
LINE = np.stack([np.arange(4.0), np.zeros(4)], axis=1)
POINTS = np.stack([np.linspace(0, 3, 13), np.zeros(13)], axis=1)


def trace(vertices, segments, ends=(0, 3)):
    segments = np.array(segments)
    midpoints = vertices[segments].mean(axis=1)
    return CurveGraph(vertices, segments, midpoints, np.array(ends))


WHOLE = trace(LINE, [[0, 1], [1, 2], [2, 3]])


def test_a_whole_trace_breaks_none():
    assert trace_defects(WHOLE, POINTS, 1.0).count == 0


def test_points_without_a_segment_are_missed_by_their_distance():
    defects = trace_defects(WHOLE, np.concatenate([POINTS, [[3.0, 0.003], [3.0, 0.001], [3.0, 2.0]]]), 1.0)
    assert defects.missed.tolist() == [[3.0, 0.003], [3.0, 2.0]]
    assert defects.missed_distances == pytest.approx([0.003, 2.0])


def test_a_segment_along_two_others_is_double():
    defects = trace_defects(trace(LINE, [[0, 1], [1, 2], [2, 3], [1, 3]]), POINTS, 1.0)
    assert sorted(defects.covered_twice[:, 0]) == [1.5, 2.0, 2.5]


def test_strands_at_an_angle_are_not_double():
    wedge = np.array([[0, 0], [0.1, 0.0], [0.1 * np.cos(0.26), 0.1 * np.sin(0.26)]])
    assert len(trace_defects(trace(wedge, [[0, 1], [0, 2]], (1, 2)), wedge, 1.0).covered_twice) == 0


def test_ends_that_the_curve_does_not_have_are_gaps():
    assert trace_defects(replace(WHOLE, ends=np.array([3])), POINTS, 1.0).gaps.tolist() == [[0.0, 0.0]]


@pytest.mark.parametrize(
    ("members", "sentence"),
    [
        ([{"radius": 1.0}, {"radius": 0.01, "center": [3, 0]}], r"A piece of the curve near \(3.*was left out"),
        ([{"radius": 1.0}, {"radius": 1.001}], r"A piece of the curve near .* from the rest, .* was left out"),
    ],
)
def test_a_defect_on_every_lattice_is_warned_of_with_its_place(members, sentence):
    circles = [ck.source("analytic.circle", **{"center": [0, 0], **keys}) for keys in members]
    scene = ck.Scene(Bare(ck.source("union", members=circles)), ck.ScreenedPoisson(1.0))
    with pytest.warns(ck.CpmkitWarning, match=sentence):
        ck.solve(scene, spacing=0.2, form="galerkin")
