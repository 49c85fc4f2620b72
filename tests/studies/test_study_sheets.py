"""On real meshes, sheets that are told apart bring the method near to finite elements, and the table says how near."""

import json
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import cpmkit as ck
from cpmkit.cli import main
from cpmkit.errors import InputError, SceneError
from cpmkit.studies.records import append_record, group_into_series, read_records
from cpmkit.studies.reference_values import compute_reference
from cpmkit.studies.report import write_report
from cpmkit.studies.run_one import measure_run, run_study
from cpmkit.studies.studyfile import load_study
from cpmkit.studies.tables import run_sentence

ROOT = Path(__file__).parents[2]
STUDIES = ROOT / "examples" / "studies"
MESHES = {
    # the file, and the title in the table
    "fish": ("fish.obj", "Fish"),
    "koala": ("koala.obj", "Koala"),
    "nefertiti": ("nefertiti-lowres.obj", "Nefertiti"),
    "spot": ("spot.obj", "Spot"),
    "mountain": ("mountain.obj", "Mountain (open)"),
}
#: At the coarsest spacing, the rms difference less its mean that is accepted, in percent, and how much worse sheets
#: that mix are at least.
BOUNDS = {"fish": (2.0, 4.0), "spot": (1.0, 4.0), "koala": (3.0, 2.0), "nefertiti": (2.2, 0.9), "mountain": (6.0, 0.9)}
#: Always: the ratio of sheets to the plain method on a thin plate, below, and that the tables hold what was asked.
SLOW = tuple(BOUNDS)
#: What was asked of the table at some spacings: the rms difference less its mean, in percent.
ASKED = {
    ("Fish", 0.0156): 2.0,
    ("Nefertiti", 0.0031): 1.0,
    ("Koala", 0.0029): 0.4,
    ("Spot", 0.0033): 0.7,
}
#: Where sheets are known to be behind the plain method by more than a tenth at the grid's own position, and how far.
#: Rms over several positions they are not: 2.04 beside 2.06 over six, and 1.20 beside 1.40 over four.
BEHIND = {("Koala", 0.0091): 1.45, ("Nefertiti", 0.0056): 1.2}
COLUMNS = (("rms mean kept", "rms_error"), ("rms mean removed", "rms_without_mean"), ("largest", "error"))

PLATE = """
title = "Thin plate"

[surface]
kind = "mesh.triangles"
file = "plate.off"

[problem]
kind = "screened"
f = "1 + 4*x*y + 3*z"
c = 1.0

[exact]
reference = "fem"
points = "vertices"

[sweep]
spacings = [0.2, 0.15]
methods = ["cpm", "plain"]

[solver]
tolerance = 1e-9
"""


def table():
    """Return the rows of the table in the documentation, by title and spacing: cells by the head of their column."""
    lines = (ROOT / "benchmarks" / "tables" / "sheets.md").read_text(encoding="utf-8").splitlines()
    head, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {(row[0], float(row[1])): dict(zip(head[2:], row[2:], strict=True)) for row in rows}


def measured(name, which=0):
    """Return the entries at one spacing of a mesh's study: with sheets, and without them."""
    study = load_study(STUDIES / f"sheets-{name}.toml")
    lower, upper = study.scene.surface.bounds
    assert np.allclose(lower, 0, atol=1e-8)
    assert (upper - lower).max() == pytest.approx(1, abs=1e-8)
    measure = compute_reference(study)
    runs = [run for run in study.sweep.runs() if run.spacing == study.sweep.spacings[which]]
    return [series.entries[0] for series in group_into_series([measure_run(study, run, measure) for run in runs])]


def check_row(name, parted, mixed):
    row = table()[MESHES[name][1], parted.spacing]
    assert row["unknowns"] == f"{parted.unknowns:,.0f}"
    assert row["twins"] == f"{parted.twins / parted.unknowns:.1%}"
    for label, entry in (("with sheets", parted), ("without sheets", mixed)):
        for column, quantity in COLUMNS:
            assert float(row[f"{column}, {label}"]) == pytest.approx(entry.percent(quantity), rel=0.02, abs=0.006)


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in BOUNDS])
def test_sheets_bring_the_method_near_to_finite_elements_and_the_first_rows_are_printed_again(name, real_mesh):
    real_mesh(MESHES[name][0])
    entries = measured(name)
    separated, mixed = (entry.percent("rms_without_mean") for entry in entries)
    bound, worse = BOUNDS[name]
    assert separated <= bound
    assert mixed >= worse * separated
    check_row(name, *entries)


@pytest.mark.slow
@pytest.mark.parametrize("name", MESHES)
def test_the_second_rows_of_the_table_are_printed_again(name, real_mesh):
    real_mesh(MESHES[name][0])
    check_row(name, *measured(name, 1))


@pytest.mark.parametrize("key", ASKED)
def test_the_table_has_the_errors_that_were_required(key):
    assert float(table()[key]["rms mean removed, with sheets"]) <= ASKED[key]


def test_the_plain_method_is_nowhere_far_ahead_in_the_table():
    rows = table()
    assert len(rows) == 20
    assert {title for title, _ in rows} == {title for _, title in MESHES.values()}
    for key, row in rows.items():
        separated, mixed = (float(row[f"rms mean removed, {label}"]) for label in ("with sheets", "without sheets"))
        assert separated <= BEHIND.get(key, 1.1) * mixed


@pytest.mark.parametrize("name", MESHES)
def test_the_cheap_spacings_are_the_two_coarsest(name):
    study = tomllib.loads((STUDIES / f"sheets-{name}.toml").read_text(encoding="utf-8"))
    assert (study["title"], study["surface"]["of"]["file"]) == (MESHES[name][1], MESHES[name][0])
    assert study["sweep"]["cheap"] == study["sweep"]["spacings"][:2]


@pytest.fixture
def file(tmp_path):
    """Return the file of a study on an ellipsoid that is thinner than its band."""
    return write_plate(tmp_path)


def write_plate(folder):
    from trimesh.creation import icosphere

    sphere = icosphere(subdivisions=3)
    points = sphere.vertices * [1.0, 1.0, 0.15]
    lines = ["OFF", f"{len(points)} {len(sphere.faces)} 0"]
    lines += [" ".join(map(str, point)) for point in points.tolist()]
    lines += ["3 " + " ".join(map(str, face)) for face in sphere.faces.tolist()]
    (folder / "plate.off").write_text("\n".join(lines) + "\n")
    path = folder / "plate.toml"
    path.write_text(PLATE)
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Run the study twice; return its folder, what came out and with what the reference was solved."""
    folder, solved = tmp_path_factory.mktemp("plate"), []
    study = load_study(write_plate(folder))

    def counted(scene, **options):
        solved.append(options)
        return ck.solve(scene, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cpmkit.studies.reference_values.solve", counted)
        outcomes = [run_study(study, folder / "plate", spacings=[0.2]) for _ in range(2)]
    return folder / "plate", outcomes, solved


@pytest.fixture
def folder(made, tmp_path):
    """Return a copy of the folder in which the study was run."""
    return shutil.copytree(made[0], tmp_path / "plate")


def test_a_record_says_how_far_a_method_is_from_the_reference(made, folder):
    study = load_study(made[0].parent / "plate.toml")
    points = study.scene.surface.mesh(1.0)[0]
    reference = ck.solve(study.scene, backend="fem", solver_tolerance=1e-9).evaluate(points)
    records = read_records(folder / "records.jsonl")
    assert [record["method"] for record in records] == ["cpm", "plain"]
    for record in records:
        solution = ck.solve(study.scene, 0.2, sheets=record["method"] == "cpm", solver_tolerance=1e-9)
        difference = solution.evaluate(points) - reference
        assert record["reference"] == "fem"
        assert record["rms_error"] == pytest.approx(np.sqrt(np.mean(difference**2)), rel=1e-6)
        assert record["rms_without_mean"] == pytest.approx(np.std(difference), rel=1e-6)
        assert record["half_range"] == pytest.approx(np.ptp(reference) / 2, rel=1e-9)
        assert record["imbalances"] == [json.loads(json.dumps(one.as_dict())) for one in solution.imbalances]
        assert len(record["imbalances"]) == 1
    assert records[0]["twins"] > 100
    assert records[1]["twins"] == 0
    assert records[0]["unknowns"] - records[0]["twins"] == records[1]["unknowns"]
    assert records[1]["rms_without_mean"] > 2 * records[0]["rms_without_mean"]


def test_the_reference_is_solved_once_and_not_for_runs_that_are_recorded(made):
    _, (first, second), solved = made
    assert (first.made, first.skipped, second.made, second.skipped) == (2, 0, 0, 2)
    assert solved == [{"backend": "fem", "solver_tolerance": 1e-9}]


def test_a_report_shows_both_methods_in_percent_of_the_half_range(folder):
    report = write_report(folder)
    text = report.files[0].read_text()
    with_sheets, without = report.series
    assert [with_sheets.label, without.label] == ["with sheets", "without sheets"]
    percent = 100 * without.entries[0].rms_error / without.entries[0].half_range
    (row,) = [line for line in text.splitlines() if line.startswith("| Thin plate | 0.2 |")]
    assert [cell.strip() for cell in row.strip("|").split("|")][5] == f"{percent:.2f}"
    assert "Differences from the solution of the back end 'fem', whose own error is not known" in text
    assert [file.name for file in report.files] == ["report.md", "convergence.png", "work.png", "trade.png"]
    assert all(file.stat().st_size > 1000 for file in report.files)


def test_several_studies_share_one_table(folder, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    for record in read_records(folder / "records.jsonl"):
        changed = {"study": "other", "title": "Other", "spacing": 0.4, "max_error": 2 * record["half_range"]}
        append_record(other / "records.jsonl", {**record, **changed})
    written = tmp_path / "table.md"
    done = CliRunner().invoke(main, ["study", "report", str(folder), str(other), "--table", str(written)])
    assert done.exit_code == 0, done.output
    lines = written.read_text().splitlines()
    assert done.stdout.startswith(written.read_text())
    assert [line.split("|")[1:3] for line in lines[2:]] == [[" Thin plate ", " 0.2 "], [" Other ", " 0.4 "]]
    assert lines[3].split("|")[9:11] == [" 200.00 ", " 200.00 "]
    assert all(line.count("|") == lines[0].count("|") for line in lines)


def test_one_method_that_fails_leaves_its_cells_empty(folder, tmp_path):
    (tmp_path / "half").mkdir()
    first, second = read_records(folder / "records.jsonl")
    append_record(tmp_path / "half" / "records.jsonl", first)
    kept = ("study", "title", "content", "reference", "method", "degree", "order", "origin")
    append_record(
        tmp_path / "half" / "records.jsonl",
        {**{key: second[key] for key in kept}, "spacing": 0.15, "error": "ConvergenceError: it did not."},
    )
    append_record(tmp_path / "half" / "records.jsonl", second)
    append_record(tmp_path / "half" / "records.jsonl", {**first, "spacing": 0.15})
    report = write_report(tmp_path / "half")
    (row,) = [line for line in report.files[0].read_text().splitlines() if line.startswith("| Thin plate | 0.15 |")]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert all(cells[4::2])
    assert not any(cells[5::2])
    assert report.failed == 1


def test_one_spacing_can_be_selected(made, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = made[0].parent / "plate.toml"
    assert {record["spacing"] for record in read_records(folder / "records.jsonl")} == {0.2}
    done = CliRunner().invoke(main, ["study", "run", str(file), "--spacing", "0.2"])
    assert done.exit_code == 0, done.output
    assert "runs       0 made, 0 with errors, 2 recorded before" in done.stdout
    with pytest.raises(InputError, match=r"the study has no spacing 0.3; it has 0.2, 0.15\."):
        run_study(load_study(file), folder, spacings=[0.3])


def test_a_run_is_reported_in_percent_of_the_half_range(folder):
    first, _ = read_records(folder / "records.jsonl")
    percent = 100 * first["rms_error"] / first["half_range"]
    assert run_sentence(first).startswith(
        f"cpm, degree 3, order 2, spacing 0.2: rms difference {percent:.2f} % of half the"
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('reference = "fem"', "", "takes either u, a formula, or reference, .*; got neither"),
        ('reference = "fem"', 'reference = "fem"\nu = "x"', "takes either u, a formula, or reference, .*; got both"),
        ('reference = "fem"', "reference = 3", "reference of .exact. must be text, got 3"),
        (
            'points = "vertices"',
            'points = "corners"',
            "whole number above zero, or 'vertices' of a mesh, got 'corners'",
        ),
        (
            "[sweep]",
            "[discretization]\nsheets = false\n[sweep]",
            "sheets stands in methods of .sweep., as 'cpm' or 'plain'",
        ),
    ],
)
def test_a_wrong_study_file_is_answered_in_one_sentence(file, old, new, message):
    file.write_text(PLATE.replace(old, new))
    with pytest.raises(SceneError, match=message) as caught:
        load_study(file)
    assert str(caught.value).startswith("plate.toml: ")


def test_a_scene_that_cannot_be_compared_is_answered_in_one_sentence(file):
    sphere = PLATE.replace('kind = "mesh.triangles"\nfile = "plate.off"', 'kind = "analytic.sphere"')
    file.write_text(sphere)
    with pytest.raises(SceneError, match=r"points = 'vertices' of .exact. needs a surface that is a mesh"):
        compute_reference(load_study(file))
    file.write_text(PLATE.replace('f = "1 + 4*x*y + 3*z"', 'f = ["x", "y"]'))
    with pytest.raises(SceneError, match="compares one channel, and the scene has 2"):
        compute_reference(load_study(file))


def test_records_belong_to_one_reference(file):
    before = load_study(file)
    file.write_text(PLATE.replace('reference = "fem"', 'reference = "other"'))
    assert load_study(file).content != before.content
    file.write_text(PLATE.replace('points = "vertices"', "points = 100"))
    assert load_study(file).content != before.content
    assert replace(before, title="another").content == before.content
