"""A benchmark whose table is of the closest point method takes its form by name, whatever form a solve takes first."""

import sys
from pathlib import Path

import pytest
from model_problems import octahedron

import cpmkit as ck

BENCHMARKS = str(Path(__file__).parents[2] / "benchmarks")


@pytest.fixture
def normals(monkeypatch):
    """Return the module, with a small sphere in the place of every mesh."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    made = __import__("normals")
    monkeypatch.setattr(made, "mesh", lambda name: octahedron(2))
    yield made
    sys.modules.pop("normals")


def test_differences_with_tilted_normals_are_of_the_collocation_form(normals):
    scene, options, measure = normals.solution_off("spot")
    assert ck.solve(scene, 0.5, **options).discretized.form == "collocation"
    off = measure(ck.solve(scene, 0.5, sheets=True, **options))
    assert normals.differences("spot", 0.5, 1)[1] == pytest.approx([off], rel=1e-9)
