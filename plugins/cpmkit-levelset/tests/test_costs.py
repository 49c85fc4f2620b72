"""What feet cost is counted: evaluations of the formula, each of which takes as long for one point as for a hundred."""

import numpy as np
import pytest
from cpmkit_levelset.descent import minimize_distance
from cpmkit_levelset.formulas import FormulaField

import cpmkit as ck

FLAT = {"phi": "x*x + y*y + 100*z*z - 1", "bounds": [[-1.2, -1.2, -0.3], [1.2, 1.2, 0.3]]}
BALL = {"phi": "x*x + y*y + z*z - 1", "bounds": [[-1.2] * 3, [1.2] * 3]}


@pytest.fixture
def counted(monkeypatch):
    """The numbers of points of all evaluations of formulas."""
    sizes = []

    def counting(plain):
        def evaluate(field, p):
            sizes.append(len(p))
            return plain(field, p)

        return evaluate

    for name in ("value", "gradient", "jet"):
        monkeypatch.setattr(FormulaField, name, counting(getattr(FormulaField, name)))
    return sizes


def near_the_middle():
    """Points in a flat ellipsoid, half of them within 1e-9 of its middle plane: two feet are nearly as near."""
    p = np.random.default_rng(2).uniform(-0.95, 0.95, (200, 3)) * [0.7, 0.7, 0.1]
    p[::2, 2] *= 1e-8
    return p


def near_the_rim():
    """Points where the ellipsoid bends more than its samples can tell, so that many descents are asked for."""
    return np.random.default_rng(0).normal(size=(200, 3)) * 0.02 + [0.95, 0, 0]


@pytest.mark.parametrize(
    ("keys", "x", "evaluations", "a_query"),
    [
        pytest.param(FLAT, near_the_middle(), 100, 20, id="two feet"),
        pytest.param(FLAT, near_the_rim(), 220, 250, id="many descents"),
        pytest.param(BALL, near_the_middle() + [0, 0, 0.2], 8, 7, id="one descent"),
    ],
)
def test_few_queries_take_few_evaluations(keys, x, evaluations, a_query, counted):
    surface = ck.source("levelset.expression", **keys)
    counted.clear()
    surface.closest_point(x)
    assert len(counted) <= evaluations
    assert sum(counted) <= a_query * len(x)


@pytest.mark.parametrize("height", [0.0, 1e-14, -1e-9])
def test_a_ridge_between_two_basins_is_left_in_few_steps(height, counted):
    """From the rim of the ellipsoid the distance falls on both sides, by forces that vanish with the height."""
    surface, r = ck.source("levelset.expression", **FLAT), 0.9
    x = np.array([[r, 0.0, height]])
    counted.clear()
    foot, converged = minimize_distance(surface.surface.layers[0].zero_set, x, np.array([[1.0, 0.0, 0.0]]), 0.05)
    assert len(counted) <= 45
    assert converged.all()
    across = r / (1 - 0.01)
    assert abs(foot[0, 0] - across) <= 1e-7
    assert abs(foot[0, 2]) == pytest.approx(0.1 * np.sqrt(1 - across**2), abs=1e-7)
    assert height * foot[0, 2] >= 0
