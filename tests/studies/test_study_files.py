"""The paper's convergence studies load, and their cheap variants show the orders that the paper claims."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cpmkit.studies.records import group_into_series, read_records
from cpmkit.studies.run_one import run_study
from cpmkit.studies.studyfile import load_study

ROOT = Path(__file__).parents[2]
STUDIES = ROOT / "examples" / "studies"
#: Of solutions that are known; the others are compared with a reference.
FILES = sorted(file for file in STUDIES.glob("*.toml") if not file.stem.startswith(("sheets", "forms-spot")))
PANELS = [file.stem for file in FILES if file.stem.startswith("panel")]
INTERIOR = [file.stem for file in FILES if file.stem.startswith("interior")]
#: At the finest cheap spacing, the greatest error of second order that is accepted.
BOUNDS = {
    "panel-a-circle-jump": 7.5e-4,
    "panel-b-sphere-heat-dirichlet": 4e-4,
    "panel-c-sphere-heat-neumann": 2.5e-4,
    "panel-d-dziuk-neumann-closed": 2.2e-3,
    "panel-e-dziuk-neumann-open": 2e-3,
    "interior-neumann-circle": 4e-4,
    "interior-robin-circle": 1.7e-4,
    "interior-fluxes-sphere": 5e-3,
}


#: Where the cheap variant takes long it is slow; these run always, the bounds at 0.1.
COARSE = (0.2, 0.14, 0.1)
COARSE_BOUNDS = {
    "panel-b-sphere-heat-dirichlet": 2e-3,
    "panel-c-sphere-heat-neumann": 1.1e-3,
}
#: Panel (b) at coarse spacings is also the problem of degrees 2 and 3, in the comparisons.
SLOW_AT_COARSE = ("panel-b-sphere-heat-dirichlet",)
#: In the plane a study has sixteen positions of the grid; at four of them the orders show too.
FEW_POSITIONS = ("panel-a-circle-jump", "interior-neumann-circle")
#: The problem of panel (d) runs always as that of degrees 2 and 3, in the comparisons; panel (e) differs from it by
#: the curve's ends, which the level set's own tests have, and a Robin condition on a circle from a flux by a term.
SLOW = {
    "interior-fluxes-sphere",
    "interior-robin-circle",
    "panel-d-dziuk-neumann-closed",
    "panel-e-dziuk-neumann-open",
    *COARSE_BOUNDS,
    *FEW_POSITIONS,
}


def orders(name, folder, **changes):
    """Return the fitted orders of the cheap variant by order of the conditions, and the series."""
    study = load_study(STUDIES / f"{name}.toml")
    outcome = run_study(replace(study, sweep=replace(study.sweep, **changes)), folder, cheap=True)
    assert outcome.failed == 0
    series = {
        (one.method, *(one.options.get(name) for name in ("degree", "order"))): one
        for one in group_into_series(read_records(outcome.file))
    }
    return {key: one.fitted_order for key, one in series.items()}, series


def test_there_is_a_study_for_each_figure_of_the_paper():
    assert len(PANELS) == 5
    others = {
        "degrees-heat",
        "degrees-poisson",
        "compare-closed-curve",
        "compare-open-curve",
        "compare-point",
    }
    assert others <= {file.stem for file in FILES}


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_studies_load_and_their_solutions_hold_on_their_boundaries(file):
    study = load_study(file)
    assert len(study.sweep.spacings) >= len({run.spacing for run in study.sweep.runs(cheap=True)}) >= 3
    for boundary in study.scene.boundaries:
        condition = boundary.condition("right")
        if condition.kind == "dirichlet" and callable(condition.value):
            points = boundary.source.closest_point(
                np.random.default_rng(0).uniform(-1, 1, (50, boundary.source.dim))
            ).points
            time = {"t": 0.07} if study.solution.takes_time else {}
            assert np.allclose(condition.value(points, **time), study.solution(points, **time), atol=1e-12)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in PANELS + INTERIOR]
)
def test_studies_show_first_and_second_order(name, tmp_path):
    fitted, series = orders(name, tmp_path, lists={"order": [1, 2]})
    assert fitted["cpm", 3, 2] >= 1.8
    assert 0.85 <= fitted["cpm", 3, 1] <= 1.3
    assert series["cpm", 3, 2].errors[-1] <= BOUNDS[name]
    assert all(np.array(series["cpm", 3, 2].errors) < series["cpm", 3, 1].errors)
    printed = in_documentation(name)
    for one in series.values():
        assert [printed[one.label][f"{h:g}"] for h in one.spacings] == pytest.approx(one.errors, rel=0.03)


@pytest.mark.parametrize("name", FEW_POSITIONS)
def test_few_positions_of_the_grid_show_first_and_second_order(name, tmp_path):
    fitted, series = orders(name, tmp_path, lists={"order": [1, 2]}, origins=4)
    second, first = series["cpm", 3, 2], series["cpm", 3, 1]
    assert fitted["cpm", 3, 2] >= 1.8
    assert 0.85 <= fitted["cpm", 3, 1] <= 1.3
    assert second.errors[-1] <= BOUNDS[name]
    assert all(np.array(second.errors) < first.errors)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW_AT_COARSE)) for name in COARSE_BOUNDS]
)
def test_coarse_spacings_show_first_and_second_order(name, tmp_path):
    fitted, series = orders(name, tmp_path, cheap=list(COARSE))
    second, first = series["cpm", 3, 2], series["cpm", 3, 1]
    assert fitted["cpm", 3, 2] >= 1.8
    assert 0.85 <= fitted["cpm", 3, 1] <= 1.3
    assert second.errors[-1] <= COARSE_BOUNDS[name]
    assert all(np.array(second.errors) < first.errors)
    printed = in_documentation(name)
    for one in (second, first):
        known = {f"{h:g}": error for h, error in zip(one.spacings, one.errors, strict=True)}
        shared = known.keys() & printed[one.label].keys()
        assert len(shared) >= 2
        assert all(printed[one.label][h] == pytest.approx(known[h], rel=0.03) for h in shared)


def in_documentation(name):
    """Return the table of a study in the documentation: errors by label and spacing."""
    lines = (ROOT / "benchmarks" / "tables" / f"study-{name}.md").read_text(encoding="utf-8").splitlines()
    (_, *spacings, _), _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {row[0]: {h: float(cell) for h, cell in zip(spacings, row[1:-1], strict=True) if cell} for row in rows}
