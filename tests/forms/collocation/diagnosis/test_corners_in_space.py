"""Corners of curves in space: warned of as those in the plane are, and in the estimate; smooth curves have none."""

import numpy as np
import pytest

import cpmkit as ck


def zigzag(turn, rise):
    i = np.arange(7)
    return np.stack([np.cos(turn * i), np.sin(turn * i), rise * i], axis=1)


@pytest.mark.parametrize("turn", [0.9, 0.4])
@pytest.mark.parametrize("spacing", [0.1, 0.05, 0.025])
def test_a_polyline_in_space_is_warned_of_at_every_spacing(turn, spacing):
    """u is linear along it: 3 to 17 percent off at any spacing, of which .08 were estimated at most."""
    points = zigzag(turn, 0.2)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0.1, length[-1] - 0.1, 150)
    places = np.stack([np.interp(at, length, points[:, axis]) for axis in range(3)], axis=1)
    edge = {0: ck.Dirichlet(0.0), 1: ck.Dirichlet(1.0)}
    scene = ck.Scene(ck.source("mesh.polyline", points=points), ck.Laplace(), edge=edge)
    solution = ck.solve(scene, spacing, form="collocation")
    assert any("has creases" in text and "hardly lessens" in text for text in solution.warnings)
    assert "creases or corners" in solution.error.slow
    error = np.abs(solution.evaluate(places) - at / length[-1]).max()
    assert 0.4 < solution.error.error[0] / error < 4


@pytest.mark.parametrize(
    ("kind", "keys"),
    [
        ("parametric.torus_knot", {"a": 2, "b": 3}),
        ("analytic.circle", {"normal": [0, 0.3, 1]}),
        ("analytic.segment", {"start": [0, 0, 0], "end": [1, 2, 0.5]}),
    ],
)
def test_smooth_curves_have_none(kind, keys):
    solution = ck.solve(ck.Scene(ck.source(kind, **keys), ck.ScreenedPoisson(1.0)), 0.15, form="collocation")
    assert not any("creases" in text for text in solution.warnings)
    assert not solution.discretized.slow
