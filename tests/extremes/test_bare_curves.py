"""Curves known by closest points alone, drawn at random: at most one percent is wrong, and none in silence."""

from __future__ import annotations

import pytest
from extremes.bare_curves import KINDS, ORIGINS, case
from extremes.curve_verdicts import geometry_verdict, verdicts

import cpmkit as ck

#: Sixty, over all kinds and origins.
FEW = [([*KINDS][i % len(KINDS)], 10 + i // len(KINDS), i % len(ORIGINS)) for i in range(60)]
#: With the solution, on three lattices each.
WITH_SOLUTION = [("eight", 3), ("wedge", 4), ("T", 5), ("cube frame", 6)]
#: More than six hundred, with the solution: every kind, three origins each.
MANY_SEEDS = range(900, 906)


@pytest.mark.parametrize(("kind", "seed", "origin"), FEW)
def test_sixty_traces(kind, seed, origin):
    verdict = geometry_verdict(case(kind, seed), origin)
    assert verdict.wrong == ""


@pytest.mark.parametrize(("kind", "seed"), WITH_SOLUTION)
def test_solutions_on_three_lattices(kind, seed):
    assert [verdict.wrong for verdict in verdicts(case(kind, seed))] == ["", "", ""]


@pytest.mark.parametrize(("kind", "seed", "origin"), [("star", 902, 1), ("cube frame", 902, 1), ("tripod", 903, 2)])
def test_where_the_first_lattice_fails_another_serves(kind, seed, origin, monkeypatch):
    verdict = geometry_verdict(case(kind, seed), origin)
    assert (verdict.wrong, verdict.warnings) == ("", ())
    monkeypatch.setattr("cpmkit.meshing.contouring.contoured_curves.LATTICES", ((0.5, 0.1723),))
    assert geometry_verdict(case(kind, seed), origin).warnings


@pytest.mark.slow
@pytest.mark.parametrize("seed", MANY_SEEDS)
def test_six_hundred_traces_and_solutions(seed):
    found = [verdict for kind in KINDS for verdict in verdicts(case(kind, seed))]
    wrong = [verdict for verdict in found if verdict.wrong]
    assert len(wrong) <= 0.01 * len(found), wrong
    assert not any(verdict.is_silent for verdict in wrong), wrong


@pytest.mark.parametrize("spacing", [0.2, 1 / 13, 1 / 15, 0.04])
def test_a_square_with_sides_in_knot_planes_is_covered_once(spacing):
    square = case("square", 0).curve
    scene = ck.Scene(square, ck.ScreenedPoisson(1.0))
    sampled = ck.discretize(scene, spacing, form="galerkin").sampled
    assert sampled.samples.weights.sum() == pytest.approx(4.0, rel=1e-9)
