"""Estimates of errors on smooth shapes, ends of boundaries and close curves included: near the truth."""

from __future__ import annotations

import numpy as np
import pytest
from extremes.exact_problems import exact_problems

PROBLEMS = {problem.name: problem for problem in exact_problems()}
#: Of each group a cheap one or two.
FEW = (
    "circle, a slow wave",
    "flat ellipse, a fast wave",
    "arc, materials",
    "helix, no reaction",
    "arc, points",
    "cylinder, a fast wave",
    "cap, a slow wave",
    "plate, a curve with values",
    "sphere, a curve with fluxes",
    "cylinder, close curves",
    "slit, flux, 0.2",
    "slit, value, 0.11",
)
#: The share of problems whose estimates are between LEAST and MOST of the truth; no estimate without a warning is below
#: LOWEST, and no answer is said to keep a tolerance and is above BEYOND times it.
SHARE, LEAST, MOST, LOWEST, BEYOND = 0.85, 0.5, 3.0, 0.4, 1.1


def ratios(problem):
    """Return the estimates over the errors in both norms, and whether there is a warning."""
    solution = problem.solve()
    estimate = solution.error
    rms, largest = problem.errors(solution)
    return estimate.of("rms") / rms, estimate.of("max") / largest, bool(estimate.slow or solution.warnings)


def kept(problem, tolerance):
    """Return whether an answer that is said to keep a tolerance is within BEYOND of it."""
    answer = problem.solve(tolerance=tolerance)
    return answer.solve_history.status != "reached" or problem.errors(answer)[0] <= BEYOND * tolerance


@pytest.mark.parametrize("name", FEW)
def test_estimates_of_a_few(name):
    rms, largest, _ = ratios(PROBLEMS[name])
    assert LOWEST < rms < 4
    assert LOWEST < largest < MOST


@pytest.mark.parametrize("name", [*FEW[::3], "arc, points", "slit, flux, 0.2"])
def test_tolerances_of_a_few(name):
    assert kept(PROBLEMS[name], 1e-3)


def test_what_may_fall_slowly_keeps_a_tolerance():
    problem, tolerance = PROBLEMS["slit, value, 0.2"], 1.6e-3
    answer = problem.solve(tolerance=tolerance)
    assert answer.solve_history.status == "reached"
    assert answer.error.slow
    assert problem.errors(answer)[0] <= tolerance


@pytest.mark.slow
def test_estimates_of_more_than_eighty():
    found = [ratios(problem) for problem in PROBLEMS.values()]
    assert len(found) >= 80
    for norm in (0, 1):
        inside = [LEAST <= one[norm] <= MOST for one in found]
        assert np.mean(inside) >= SHARE
    assert all(warned or min(rms, largest) >= LOWEST for rms, largest, warned in found)


@pytest.mark.slow
def test_tolerances_of_more_than_eighty():
    assert [name for name, problem in PROBLEMS.items() if not kept(problem, 1e-3)] == []
