"""Sheets that are too near to each other to be parted are told, however near they are."""

import numpy as np
import pytest
from layouts import lay_out
from model_problems import rotation

import cpmkit as ck
from cpmkit.forms.collocation.diagnosis.survey import find_unresolved


def close(surface, spacing=0.1):
    found = find_unresolved(lay_out(ck.Scene(surface, ck.ScreenedPoisson(1.0)), spacing))
    return [one for one in found if one.kind == "sheets"]


def segments(gap, slope):
    return ck.source(
        "union",
        members=[ck.source("analytic.segment", start=[0, y], end=[1, y + slope]) for y in (0.0, gap)],
    )


@pytest.mark.parametrize("slope", [0.0, 0.4])
@pytest.mark.parametrize("gap", [0.03, 0.02, 0.01, 0.001])
def test_two_parallel_segments(gap, slope):
    (told,) = close(segments(gap, slope))
    assert told.worst == pytest.approx(gap / np.hypot(1, slope), rel=0.01)
    assert told.share > 0.9


def discs(gap, turned):
    """Two discs of triangles, one above the other."""
    angle = np.arange(24) * 2 * np.pi / 24
    rings = [r * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) for r in (0.25, 0.5, 0.75, 1.0)]
    vertices = np.concatenate([[[0.0, 0.0, 0.0]], *rings])
    around = np.arange(24)
    beside = (around + 1) % 24
    faces = [np.stack([0 * around, 1 + around, 1 + beside], axis=1)]
    for k in range(3):
        a, b = 1 + 24 * k + around, 1 + 24 * k + beside
        faces += [np.stack([a, a + 24, b + 24], axis=1), np.stack([a, b + 24, b], axis=1)]
    lower = np.concatenate(faces)
    both = np.concatenate([vertices, vertices + [0, 0, gap]]) @ (rotation().T if turned else np.eye(3))
    return ck.source("mesh.triangles", vertices=both, faces=np.concatenate([lower, lower + len(vertices)]))


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("gap", [0.1, 0.04])
def test_two_discs_of_triangles(gap, turned):
    (told,) = close(discs(gap, turned), 0.2)
    assert told.worst == pytest.approx(gap, rel=0.05)


def test_members_that_touch_end_to_end_are_one_sheet():
    halves = [ck.source("analytic.arc", start=k * np.pi, end=(k + 1) * np.pi) for k in (0, 1)]
    assert not close(ck.source("union", members=halves), 0.2)
