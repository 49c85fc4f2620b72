"""A curve that winds more often than its cells resolve is refused: it would be another curve, without a word."""

from __future__ import annotations

import numpy as np
import pytest
from counted_calls import counted_calls

import cpmkit as ck


@pytest.mark.parametrize(
    ("kind", "keys"),
    [
        ("helix", {"turns": 3000}),
        ("helix", {"turns": 30_000}),
        ("helix", {"turns": 1e9}),
        ("torus_knot", {"a": 1000, "b": 999}),
        ("curve", {"x": ["cos(1e9*t)", "sin(1e9*t)"], "range": [0, 1]}),
        ("surface", {"x": ["u", "v", "0.1*sin(3e4*u)"], "u": [0, 1], "v": [0, 1]}),
    ],
)
def test_more_windings_than_cells(kind, keys):
    with pytest.raises(ck.InputError, match="winds or bends more often than"):
        ck.source(f"parametric.{kind}", **keys)


def test_knots_have_a_thousand_windings_at_most():
    """They are refused before a cell of them is made."""

    def knot():
        with pytest.raises(ck.InputError, match="a must be a whole number from 1 to 1000, got 100000"):
            ck.source("parametric.torus_knot", a=100_000, b=99_999)

    assert counted_calls(knot) < 5_000


@pytest.mark.parametrize(
    ("kind", "keys"),
    [("helix", {"turns": 300}), ("planar_curve", {"a": 300, "b": 299}), ("torus_knot", {"a": 50, "b": 49})],
)
def test_feet_on_many_windings_are_the_nearest_of_dense_samples(kind, keys):
    made = ck.source(f"parametric.{kind}", **keys)
    samples = made.map.value(np.linspace(0, 1, 400_001)[:, None])
    x = np.random.default_rng(0).uniform(made.bounds[0], made.bounds[1], (20, made.dim))
    nearest = np.array([np.linalg.norm(samples - point, axis=1).min() for point in x])
    step = np.linalg.norm(np.diff(samples, axis=0), axis=1).max()
    assert np.all(np.abs(made.closest_point(x).distance - nearest) < step)
