"""The two forms beside each other, on fifteen problems whose tables are in the documentation.

Run ``python benchmarks/forms.py``; it needs ``pip install . ./plugins/*`` and, for the last five problems,
``CPMKIT_DATA`` set to a folder with fish.obj, koala.obj, nefertiti-lowres.obj, spot.obj and mountain.obj; those whose
mesh is missing are left out. It prints the table of tables/forms-problems.md: root mean squares of the error over
the points of the study and over four positions of the grid, of meshes two, in percent of the solution's range (of
meshes: differences from linear finite elements), what share of it the Galerkin form leaves, and what both cost. The
forms take turns; a run of each, at a coarser spacing, comes before, so that compiling is no cost of either.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.errors import CpmkitError
from cpmkit.studies.records import Record
from cpmkit.studies.reference_values import compute_reference
from cpmkit.studies.run_one import measure_run
from cpmkit.studies.studyfile import Study, load_study
from cpmkit.studies.tables import table_row, table_rule

STUDIES = Path(__file__).parents[1] / "examples" / "studies"
#: The study of each problem, and one of the spacings at which the documentation has it.
PROBLEMS = {
    "panel-a-circle-jump": 0.05,
    "interior-neumann-circle": 0.05,
    "interior-robin-circle": 0.05,
    "panel-d-dziuk-neumann-closed": 0.1,
    "panel-e-dziuk-neumann-open": 0.1,
    "compare-closed-curve": 0.1,
    "compare-open-curve": 0.1,
    "closed-dziuk": 0.1,
    "interior-fluxes-sphere": 0.1,
    "forms-torus": 0.1,
    "sheets-fish": 0.0156,
    "sheets-koala": 0.0167,
    "sheets-nefertiti": 0.0177,
    "sheets-spot": 0.0193,
    "sheets-mountain": 0.0170,
}
METHODS = ("cpm", "galerkin")
#: Positions of the grid, and those of meshes.
ORIGINS, MESH_ORIGINS = 4, 2
#: Of the runs that come before, in spacings.
COARSER = 1.7


def compared(study: Study, spacing: float, origins: int) -> dict[str, list[Record]]:
    """Return the records of both methods at every position of the grid."""
    truth = compute_reference(study)
    first = replace(study.sweep, lists={}, spacings=[COARSER * spacing], cheap=None, methods=METHODS, origins=1)
    sweep = replace(first, spacings=[spacing], origins=origins)
    for run in first.runs():
        measure_run(study, run, truth)
    runs = sorted(sweep.runs(), key=lambda run: run.origin or 0)
    records = [measure_run(study, run, truth) for run in runs]
    return {method: [one for one in records if one["method"] == method] for method in METHODS}


def rms(records: Sequence[Record], name: str) -> float:
    """Return the root mean square of an error over positions, in percent of the range of the solution."""
    return 50 * float(np.sqrt(np.mean([(one[name] / one["half_range"]) ** 2 for one in records])))


def mean(records: Sequence[Record], name: str) -> float:
    """Return the mean of a cost over positions."""
    return float(np.mean([one[name] for one in records]))


def cells(title: str, spacing: float, made: dict[str, list[Record]]) -> Iterator[str]:
    """Yield the cells of a problem's row: both forms of each quantity beside each other."""
    collocation, galerkin = (made[method] for method in METHODS)
    yield from (title, f"{spacing:g}")
    for name in ("rms_error", "max_error"):
        pair = rms(collocation, name), rms(galerkin, name)
        yield from (f"{pair[0]:.2g}", f"{pair[1]:.2g}", f"{pair[1] / pair[0]:.3f}")
    for name, form in (("unknowns", ",.0f"), ("closest_point_queries", ",.0f"), ("cpu_seconds", ".2f")):
        yield from (format(mean(records, name), form) for records in (collocation, galerkin))


def problems() -> Iterator[tuple[Study, float]]:
    """Yield the studies whose files are there, and their spacings."""
    for name, spacing in PROBLEMS.items():
        try:
            study = load_study(STUDIES / f"{name}.toml")
            study.scene  # noqa: B018 - its mesh is looked for now
        except CpmkitError as error:
            print(f"{name} is left out: {error}", file=sys.stderr)
            continue
        yield study, spacing


def main(origins: int = ORIGINS, names: Sequence[str] = tuple(PROBLEMS)) -> dict[str, Any]:
    """Print the table, and return the share of the error that the Galerkin form leaves, by problem."""
    both = ("collocation", "Galerkin")
    heads = [f"{head}, {form}" for head in ("rms error %", "largest %") for form in (*both, "share left")]
    heads += [f"{head}, {form}" for head in ("unknowns", "queries", "CPU seconds") for form in both]
    print(table_row(["problem", "spacing", *heads]), table_rule(1, 1 + len(heads)), sep="\n", flush=True)
    shares = {}
    for study, spacing in problems():
        if study.name in names:
            made = compared(study, spacing, origins if study.exact.reference is None else min(origins, MESH_ORIGINS))
            failed = [one["error"] for records in made.values() for one in records if "error" in one]
            if failed:
                print(table_row([study.title, f"{spacing:g}", failed[0], *[""] * (len(heads) - 1)]), flush=True)
                continue
            shares[study.name] = rms(made["galerkin"], "rms_error") / rms(made["cpm"], "rms_error")
            print(table_row(list(cells(study.title, spacing, made))), flush=True)
    return shares


if __name__ == "__main__":
    main()
