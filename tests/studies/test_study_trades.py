"""Studies ask for errors and times; their reports say which run buys which error for what."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

import cpmkit as ck
from cpmkit.cli import main
from cpmkit.errors import SceneError
from cpmkit.studies.records import group_into_series, read_records
from cpmkit.studies.reference_values import refine_surface_mesh, solve_on_refined_mesh
from cpmkit.studies.report import write_report
from cpmkit.studies.run_one import memory_entries, run_study
from cpmkit.studies.studyfile import load_study
from cpmkit.studies.sweep import Run, Sweep
from cpmkit.studies.tables import Attempt, attempts, cheapest_by_decade, pareto_front

TEXT = """
[surface]
kind = "analytic.circle"
[problem]
kind = "screened"
f = "2*x"
[exact]
u = "x"
points = 300
[sweep]
spacings = [0.2, 0.1]
tolerances = [1e-2, 1e-3]
methods = ["galerkin", "collocation"]
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "line.toml"
    path.write_text(TEXT)
    return path


def test_tolerances_and_seconds_are_runs_beside_spacings():
    sweep = Sweep({}, [0.2, 0.1], tolerances=[1e-2, 1e-3], seconds=[1], methods=["galerkin", "fem"])
    runs = sweep.runs()
    assert [run.target for run in runs if run.method == "galerkin"] == [
        {}, {}, {"tolerance": 1e-2}, {"tolerance": 1e-3}, {"seconds": 1.0},
    ]  # fmt: skip
    assert [run.spacing for run in runs if run.method == "fem"] == [0.2, 0.1]
    cheap = [run for run in sweep.runs(cheap=True) if run.method == "galerkin"]
    assert [(run.spacing, run.target) for run in cheap] == [
        (0.2, {}), (None, {"tolerance": 1e-2}), (None, {"seconds": 1.0}),
    ]  # fmt: skip
    assert all(Run.from_record({**run.as_dict(), "spacing": run.spacing or 0.07}) == run for run in runs)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "needs a list of spacings, tolerances or seconds"),
        ({"tolerances": []}, "tolerances of .sweep. must be a list with at least one entry"),
        ({"tolerances": [2.0]}, "each entry of tolerances of .sweep. is an error as a share"),
        ({"seconds": [-1]}, "each entry of seconds of .sweep."),
        ({"tolerances": [0.1], "methods": ["fem"]}, "'fem' of .sweep. goes with spacings alone"),
        ({"tolerances": [0.1], "cheap": [0.1]}, "'cheap' of .sweep. goes with spacings alone"),
        ({"tolerances": [0.1], "spacings": [0.1], "step_per_spacing": 0.5}, "step_per_spacing of .sweep. ties"),
    ],
)
def test_targets_that_are_not_accepted_are_refused(given, message):
    with pytest.raises(SceneError, match=message):
        Sweep({}, **given)


@pytest.mark.parametrize("key", ["tolerance", "seconds"])
def test_targets_stand_in_the_sweep(file, key):
    file.write_text(TEXT + f"[discretization]\n{key} = 0.5\n")
    with pytest.raises(SceneError, match=f"a study's {key} stands in {key.removesuffix('s')}"):
        load_study(file)


def test_a_record_has_the_target_and_the_result(file, tmp_path):
    study = load_study(file)
    outcome = run_study(study, tmp_path)
    assert (outcome.made, outcome.failed) == (8, 0)
    target = [one for one in read_records(outcome.file) if one["asked_tolerance"] is not None]
    assert {one["asked_tolerance"] for one in target} == {1e-2, 1e-3}
    for one in target:
        assert one["status"] == "reached"
        assert one["estimate"] < one["asked_tolerance"]
        assert one["rms_error"] / (2 * one["half_range"]) < one["asked_tolerance"]
        assert one["spacing"] > 0
        assert {"pilot"} <= set(one["seconds"]) <= {"pilot", "companion", "answer", "correction"}
        assert one["bytes_are"] in ("measured", "predicted")
    assert run_study(study, tmp_path).made == 0  # found again by what was asked for, not by the spacing that was found
    every = group_into_series(read_records(outcome.file))
    assert [one.target for one in every] == ["", "", "tolerance", "tolerance"]
    assert [entry.target for entry in every[-1].entries] == [1e-2, 1e-3]
    itself = replace(every[0].entries[0], rms_error=1e-17)
    same = replace(every[0], reference="fem", entries=[itself, every[0].entries[1]])
    assert [one.setting for one in attempts([same])] == ["spacing 0.1"]  # the first is the reference itself
    said = CliRunner().invoke(main, ["study", "report", str(tmp_path)])
    assert said.exit_code == 0, said.output
    assert f"\n**{load_study(file).title}**\n\n| rms error below, of the range |" in said.output
    assert "| unbeaten in | rms error, of the range |" in said.output
    assert "## What it cost, with errors in the unit of u" in (tmp_path / "report.md").read_text()
    assert (tmp_path / "trade.png").stat().st_size > 10_000


def test_a_study_of_tolerances_alone_has_a_report(file, tmp_path):
    file.write_text(TEXT.replace("spacings = [0.2, 0.1]", "origins = 2").replace("1e-2, 1e-3", "1e-2"))
    outcome = run_study(load_study(file), tmp_path)
    first, second = [one for one in read_records(outcome.file) if one["method"] == "galerkin"]
    assert first["max_error"] != second["max_error"]  # on lattices at other places
    report = write_report(tmp_path)
    assert [one.name for one in report.files] == ["report.md", "trade.png"]


def made(error, seconds, mebibytes=1.0):
    return Attempt("a", f"{error}", error, seconds, mebibytes)


def test_no_other_beats_the_front_in_both():
    rng = np.random.default_rng(0)
    every = [made(*pair) for pair in 10 ** rng.uniform(-3, 0, (60, 2))]
    kept = pareto_front(every, "seconds")
    for one in every:
        beaten = any(other.error < one.error and other.seconds < one.seconds for other in every)
        assert beaten != (one in kept)
    assert pareto_front([made(1.0, np.nan)], "seconds") == []


def test_the_cheapest_below_each_decade_wins():
    every = [made(0.02, 1.0), made(0.008, 2.0), made(0.009, 3.0), made(0.0002, 9.0)]
    won = cheapest_by_decade(every, "seconds")
    assert {power: one.seconds for power, one in won.items()} == {-1: 1.0, -2: 2.0, -3: 9.0}


def test_bytes_are_predicted_where_they_are_not_measured():
    solution = ck.solve(ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(1.0)), 0.1)
    assert memory_entries(solution, 5) == {"bytes": 5, "bytes_are": "measured"}
    predicted = memory_entries(solution, None)
    assert predicted["bytes_are"] == "predicted"
    assert predicted["bytes"] > 1000 * solution.discretized.size
    other = SimpleNamespace(discretized=SimpleNamespace(options=None), scene=solution.scene)
    assert memory_entries(other, None) == {"bytes": None, "bytes_are": None}


def test_a_refined_mesh_is_finer_and_the_error_on_it_falls_at_second_order():
    """Against the finest: the mesh stays as flat as it is."""
    pytest.importorskip("cpmkit_fem")
    vertices, faces = ck.source("analytic.sphere").mesh(0.8)
    sphere = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="smooth")
    points, cells = refine_surface_mesh(sphere).mesh(0.1)
    edges = np.linalg.norm(points[cells] - points[np.roll(cells, 1, axis=1)], axis=2)
    assert edges.max() <= 0.1 + 1e-12
    assert np.array_equal(points[: len(vertices)], vertices)
    scene = ck.Scene(sphere, ck.ScreenedPoisson(lambda x: 3 * x[:, 2]))
    solutions = [solve_on_refined_mesh(scene, spacing).evaluate(vertices) for spacing in (0.4, 0.2, 0.1, 0.05)]
    errors = [np.sqrt(np.mean((one - solutions[-1]) ** 2)) for one in solutions[:-1]]
    assert np.log2(errors[0] / errors[1]) > 1.6
    assert np.log2(errors[1] / errors[2]) > 1.6
