"""The degree of splines is chosen by a record, and only where that says something."""

from pathlib import Path

import numpy as np
import pytest
from model_problems import sphere_points

import cpmkit as ck
from cpmkit.accuracy.spacing_search import CUBIC_ERROR

TABLE = Path(__file__).parents[2] / "benchmarks" / "tables" / "knobs.md"
SPHERE = ck.source("analytic.sphere")
AT = sphere_points()


def f(x):
    return 7 * x[:, 0] * x[:, 1]


def test_cubic_splines_are_chosen_below_the_error_of_equal_cost():
    """For each surface log(seconds) is a line over log(error) through the two finest solves of each degree."""
    cells = [[cell.strip() for cell in line.strip("|\n").split("|")] for line in TABLE.read_text().splitlines()[2:]]
    rows = [row for row in cells if row[3] == "as they are" and row[2] in ("2", "3")]
    assert len(rows) == 12
    equal = []
    for surface in {row[0] for row in rows}:
        lines = []
        for degree in ("2", "3"):
            chosen = sorted(
                (row for row in rows if (row[0], row[2]) == (surface, degree)), key=lambda row: float(row[1])
            )
            error, seconds = np.log([[float(row[9]), float(row[8])] for row in chosen[:2]]).T
            lines.append(np.polyfit(error, seconds, 1))
        (slope, height), (cubic_slope, cubic_height) = lines
        equal.append((cubic_height - height) / (slope - cubic_slope))
    assert pytest.approx(np.exp(np.mean(equal)), rel=0.02) == CUBIC_ERROR


def test_cubic_splines_reach_small_errors(monkeypatch):
    monkeypatch.setattr("cpmkit.accuracy.spacing_search.CUBIC_ERROR", 2e-3)  # a size that is solved quickly
    solution = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(f)), tolerance=1e-3)
    off = (solution.evaluate(AT) - AT[:, 0] * AT[:, 1]) / np.ptp(AT[:, 0] * AT[:, 1])
    trade = solution.solve_history
    assert solution.discretization()["degree"] == 3
    assert "degree 3 was chosen" in trade.chosen
    assert trade.chosen in str(trade)
    assert trade.status == "reached"
    assert np.sqrt(np.mean(off**2)) < 1e-3
    assert 0.4 < trade.error / np.sqrt(np.mean(off**2)) < 6
    assert all(one.discretized.options.own.degree == 3 for one in solution.error.coarse_solutions)


@pytest.mark.parametrize("options", [{"tolerance": 5e-3}, {"tolerance": 1e-3, "degree": 2}, {"memory": "20 MB"}])
def test_nothing_is_chosen_elsewhere(options, monkeypatch):
    monkeypatch.setattr("cpmkit.accuracy.spacing_search.CUBIC_ERROR", 2e-3)
    solution = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(f)), **options)
    assert solution.discretization()["degree"] == 2
    assert not solution.solve_history.chosen
