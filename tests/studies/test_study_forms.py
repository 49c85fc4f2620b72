"""Two forms at equal spacings: Galerkin's leaves a fraction of the error, and the documentation's rows come again."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cpmkit.cli import main
from cpmkit.studies.records import append_record, group_into_series, read_records
from cpmkit.studies.run_one import run_study
from cpmkit.studies.studyfile import load_study

ROOT = Path(__file__).parents[2]
STUDIES = ROOT / "examples" / "studies"
#: At the first spacing of the table, the share of the largest and of the rms error that the Galerkin form may leave.
SHARES = {
    "circle": (0.25, 0.15),
    "helix": (0.1, 0.1),
    "sphere": (0.3, 0.15),
    "sphere-level-set": (0.3, 0.15),
    "hemisphere": (0.3, 0.15),
    "torus": (0.15, 0.15),
    "two-sides": (0.3, 0.15),
}


def table(name):
    """Return the rows of a table in the documentation, as cells by the head of their column."""
    lines = (ROOT / "benchmarks" / "tables" / name).read_text(encoding="utf-8").splitlines()
    head, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [dict(zip(head, row, strict=True)) for row in rows]


def check_row(title, one, entry):
    (row,) = [
        row
        for row in table("forms.md")
        if (row["problem"], row[""], row["spacing"]) == (title, one.label, f"{entry.spacing:g}")
    ]
    assert float(row["greatest error"]) == pytest.approx(entry.error, rel=0.05)
    assert float(row["rms error"]) == pytest.approx(entry.rms_error, rel=0.05)
    for head, quantity in (("unknowns", entry.unknowns), ("queries", entry.queries)):
        assert int(row[head].replace(",", "")) == pytest.approx(quantity, rel=0.02)


def measured(name, folder):
    """Return the title and both series at the coarsest spacing."""
    study = load_study(STUDIES / f"forms-{name}.toml")
    assert study.sweep.origins >= 4
    outcome = run_study(study, folder, spacings=[study.sweep.spacings[0]])
    assert outcome.failed == 0
    collocation, galerkin = group_into_series(read_records(outcome.file))
    assert (collocation.method, galerkin.method) == ("cpm", "galerkin")
    return study.title, collocation, galerkin


#: The sphere again, by another kind; and a torus, whose second mark is that of the sphere.
SLOW = ("sphere-level-set", "torus")


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in SHARES])
def test_the_galerkin_form_leaves_a_fraction_of_the_error_and_the_first_rows_are_printed_again(name, tmp_path):
    title, collocation, galerkin = measured(name, tmp_path)
    before, after = collocation.entries[0], galerkin.entries[0]
    largest, rms = SHARES[name]
    assert after.error < largest * before.error
    assert after.rms_error < rms * before.rms_error
    assert after.unknowns < before.unknowns
    check_row(title, collocation, before)
    check_row(title, galerkin, after)


@pytest.mark.slow
def test_the_rows_of_a_real_mesh_are_printed_again(real_mesh, tmp_path):
    real_mesh("spot.obj")
    title, *series = measured("spot", tmp_path)
    for one in series:
        check_row(title, one, one.entries[0])
    assert series[1].entries[0].percent("rms_error") < 0.26  # of half the range


def test_the_galerkin_form_converges_on_an_open_curve_in_space(tmp_path):
    study = load_study(STUDIES / "forms-helix.toml")
    sweep = replace(study.sweep, methods=["galerkin"], origins=1, spacings=[0.2, 0.14, 0.1, 0.07])
    (one,) = group_into_series(read_records(run_study(replace(study, sweep=sweep), tmp_path).file))
    rms = [entry.rms_error for entry in one.entries]
    assert np.polyfit(np.log(one.spacings), np.log(rms), 1)[0] > 2.7


def test_one_table_shows_what_several_studies_cost(tmp_path):
    for name, title in (("first", "First"), ("second", "Second")):
        study = load_study(STUDIES / "forms-circle.toml")
        sweep = replace(study.sweep, origins=1)
        made = run_study(replace(study, sweep=sweep, title=title), tmp_path / name, spacings=[0.2])
        assert made.made == 2
    (record,) = [one for one in read_records(made.file) if one["method"] == "cpm"]
    append_record(made.file, {**record, "method": "fem", "closest_point_queries": None})
    written = tmp_path / "costs.md"
    folders = [str(tmp_path / name) for name in ("first", "second")]
    done = CliRunner().invoke(main, ["study", "report", *folders, "--costs", str(written)])
    assert done.exit_code == 0, done.output
    head, _, *rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in written.read_text().splitlines()]
    assert head[:4] == ["problem", "", "spacing", "greatest error"]
    assert [row[:2] for row in rows] == [
        ["First", "closest point method"],
        ["First", "Galerkin form"],
        ["Second", "closest point method"],
        ["Second", "Galerkin form"],
        ["Second", "finite elements"],
    ]
    assert rows[0][head.index("queries")] == f"{record['closest_point_queries']:,}"
    assert rows[-1][head.index("queries")] == ""
    assert f"written    {written}" in done.output


def test_the_table_of_problems_shows_half_the_error_at_most():
    rows = table("forms-problems.md")
    assert len(rows) == 15
    shares = [float(row["rms error %, share left"]) for row in rows]
    assert max(shares) <= 0.5
    assert all(int(row["unknowns, Galerkin"].replace(",", "")) > 0 for row in rows)
