"""Benchmarks whose tables are of the closest point method take its form by name, whatever form a solve takes first."""

import sys
from pathlib import Path

import pytest
from model_problems import octahedron

import cpmkit as ck

BENCHMARKS = str(Path(__file__).parents[2] / "benchmarks")
NAMES = ("unfolding", "balance", "normals")


@pytest.fixture
def benchmarks(monkeypatch):
    """Return the modules, with a small sphere in the place of every mesh."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    made = {name: __import__(name) for name in NAMES}
    monkeypatch.setattr(made["unfolding"], "mesh", lambda name: octahedron(2))
    monkeypatch.setattr(made["balance"], "DEGREES", (1,))
    yield made
    for name in NAMES:
        sys.modules.pop(name)


def test_differences_without_balance_and_with_tilted_normals_are_of_the_collocation_form(benchmarks):
    scene, options, measure = benchmarks["unfolding"].solution_off("spot")
    off = measure(ck.solve(scene, 0.5, sheets=True, **options))
    assert ck.solve(scene, 0.5, **options).discretized.form == "collocation"
    without, balanced = benchmarks["balance"].differences("spot", 0.5, 1)[0]
    assert without == pytest.approx(off, rel=1e-9)
    assert balanced < without
    assert benchmarks["normals"].differences("spot", 0.5, 1)[1] == pytest.approx([off], rel=1e-9)
