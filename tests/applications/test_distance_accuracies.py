"""Distances to an accuracy or in a time in place of a spacing, and how large their errors are told to be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.accuracy import adaptive_run
from cpmkit.applications import geodesic_distance, signed_distance

SPHERE = ck.source("analytic.sphere")
POINTS = np.random.default_rng(0).normal(size=(2000, 3))
POINTS /= np.linalg.norm(POINTS, axis=1, keepdims=True)
EXACT = np.arccos(np.clip(POINTS[:, 2], -1, 1))


def test_a_tolerance_is_reached_and_reported() -> None:
    distance = geodesic_distance(SPHERE, [0, 0, 1], tolerance=2e-2, method="heat")
    trade, estimate = distance.solution.solve_history, distance.error
    assert trade is not None
    assert trade.status == "reached"
    assert len(trade.steps) > 1
    assert distance.solution.spacing == trade.steps[-1].spacing
    error = np.sqrt(np.mean((distance.evaluate(POINTS) - EXACT) ** 2)) / np.pi
    assert error < estimate.of("rms") < 2e-2


@pytest.fixture
def clock_of_unknowns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a solve take a millisecond an unknown, whatever else the machine does, and nothing beside take time."""

    def timed(purpose: Any, spacing: float, step: float, unknowns: int, _: float, *more: Any) -> Any:
        return Timed(purpose, spacing, step, unknowns, 1e-3 * unknowns, *more)

    Timed = adaptive_run.TimedSolve
    monkeypatch.setattr(adaptive_run, "TimedSolve", timed)
    monkeypatch.setattr(
        adaptive_run.AdaptiveRun, "elapsed", property(lambda self: sum(one.seconds for one in self.solves))
    )


@pytest.mark.usefixtures("clock_of_unknowns")
def test_seconds_are_kept() -> None:
    distance = geodesic_distance(SPHERE, [0, 0, 1], seconds=4.0, method="heat")
    trade = distance.solution.solve_history
    assert trade is not None
    assert trade.status == "within"
    assert len(trade.steps) > 2
    assert 2.0 < trade.seconds < 6.0


def test_all_parts_of_a_distance_are_those_of_the_solution_that_a_missed_target_leaves(monkeypatch: Any) -> None:
    """The solution with the smallest estimated error need not be the last one that was made."""

    def first_of_two(recipe: Any, *_: Any, **__: Any) -> Any:
        first, _ = recipe(0.1, None), recipe(0.2, None)
        return first

    monkeypatch.setattr(ck, "solve_by", first_of_two)
    pair = ck.source("union", members=[ck.source("analytic.circle", center=[x, 0]) for x in (0, 4)])
    with pytest.warns(ck.CpmkitWarning, match="1 of 2 pieces"):
        distance = geodesic_distance(pair, [[1, 0]], tolerance=1e-9, method="heat")
    assert len(distance.pieces.of_unknown) == distance.solution.discretized.size
    assert np.isinf(distance.evaluate([[-1, 0], [3, 0]])).tolist() == [False, True]


@pytest.mark.parametrize("spacing", [0.24, 0.16])
def test_the_error_of_a_distance_is_no_smaller_than_it_is_and_not_much_larger(spacing: float) -> None:
    distance = geodesic_distance(SPHERE, [0, 0, 1], spacing=spacing, method="heat")
    error = np.sqrt(np.mean((distance.solution.evaluate(POINTS) - EXACT) ** 2)) / np.pi
    assert error < distance.error.of("rms") < 10 * error
    assert distance.error is distance.error


def test_of_a_signed_distance_and_of_a_prepared_scene() -> None:
    equator = ck.source("analytic.circle", normal=[0, 0, 1])
    prepared = ck.prepare(ck.Scene(SPHERE, ck.Poisson(0.0)), 0.24, form="galerkin")
    distance = signed_distance(prepared, equator, method="heat")
    error = np.abs(distance.evaluate(POINTS) - np.arcsin(POINTS[:, 2])).max()
    assert error < distance.error.bound[0] < 20 * error


@pytest.mark.parametrize(("given", "words"), [({}, "spacing"), ({"spacing": 0.3, "tolerance": 1e-2}, "tolerance")])
def test_one_of_spacing_and_accuracy_is_needed(given: dict[str, float], words: str) -> None:
    with pytest.raises(ck.InputError, match=words):
        geodesic_distance(SPHERE, [0, 0, 1], **given)


@pytest.mark.filterwarnings("ignore::cpmkit.CpmkitWarning")
def test_a_tolerance_holds_on_the_pieces_that_have_an_origin() -> None:
    pieces = ck.source("union", members=[SPHERE, ck.source("analytic.sphere", center=[6, 0, 0])])
    distance = geodesic_distance(pieces, [0, 0, 1], tolerance=2e-2, method="heat")
    found = distance.evaluate([[1, 0, 0], [6, 0, 1]])
    assert abs(found[0] - np.pi / 2) < 2e-2 * np.pi
    assert np.isinf(found[1])


def test_a_recipe_needs_something_to_reach() -> None:
    scene = ck.Scene(SPHERE, ck.Poisson(0.0))
    with pytest.raises(ck.InputError, match="needs a tolerance"):
        ck.solve_by(lambda spacing, origin: ck.solve(scene, spacing, origin=origin), scene)
