"""Study files and records, changed at random: each is run and reported, or answered in a sentence."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from fuzzing import answered, corpus, long, short
from hypothesis import given
from hypothesis import strategies as st

from cpmkit.errors import CpmkitError
from cpmkit.studies.report import error_tables, write_report
from cpmkit.studies.run_one import run_study
from cpmkit.studies.studyfile import load_study

TEXT = """
title = "A cut circle"

[surface]
kind = "analytic.circle"

[[boundary]]
name = "cut"
kind = "analytic.point"
at = [0.6, 0.8]
both = { dirichlet = "x + y" }

[problem]
kind = "screened"
f = "2*(x + y)"

[exact]
u = "x + y"
points = 20

[sweep]
spacings = [0.25, 0.2]
cheap = [0.25]
degrees = [3]
orders = [2]
origins = 1
methods = ["cpm"]
"""
#: Runs of a study that is made, and no more: the bounds of a study are far above.
FEW = 4
WORDS = [
    "",
    "x",
    "vertices",
    "fem",
    "cpm",
    "plain",
    "ball",
    "unfolded",
    "balanced",
    "nothing",
    "$x^",
    "a\nb",
    "\x1b[2J",
]
NUMBERS = st.integers(-3, 6) | st.sampled_from([10**10, 10**20, 0.2, 1e-300, 1e300]) | st.floats(width=32)
VALUES = st.recursive(
    NUMBERS | st.booleans() | st.sampled_from(WORDS),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from("abc"), inner, max_size=2),
    max_leaves=4,
)
#: What a study adds to a scene, and what it leaves out of one.
TABLES = ("title", "exact", "sweep", "discretization", "let")


def as_toml(value: Any) -> str:
    """Return a value as TOML writes it in one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {as_toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(as_toml, value))}]"
    return json.dumps(value).replace("Infinity", "inf").replace("NaN", "nan")


def run(path: Path) -> None:
    """Load a study, make it if it has few runs, and report it."""
    study = answered(lambda: load_study(path))
    if isinstance(study, CpmkitError) or len(study.sweep.runs()) > FEW:
        return
    made = answered(lambda: run_study(study, path.with_suffix("")))
    again = answered(lambda: run_study(study, path.with_suffix("")))
    if not isinstance(made, CpmkitError):
        assert again.made == 0
    report(path.with_suffix(""))


def report(folder: Path) -> None:
    """Write a report and its table."""
    answered(lambda: error_tables([write_report(folder)]))


def change_study(data: st.DataObject, folder: Path) -> None:
    """Replace, add or leave out a table or a key of one."""
    tables = tomllib.loads(TEXT)
    for _ in range(data.draw(st.integers(1, 2))):
        name = data.draw(st.sampled_from(TABLES))
        table = tables.get(name)
        if isinstance(table, dict) and table and data.draw(st.integers(0, 4)):
            key = data.draw(st.sampled_from([*table, "points", "reference", "step_per_spacing", "origin"]))
            table[key] = data.draw(VALUES)
            if not data.draw(st.integers(0, 4)):
                del table[key]
        else:
            tables[name] = data.draw(VALUES)
    (folder / "study.toml").write_text(
        "".join(f"{json.dumps(key)} = {as_toml(value)}\n" for key, value in tables.items())
    )
    run(folder / "study.toml")


PLAIN = {
    "study": "cut", "title": "A cut circle", "content": "c", "method": "cpm", "spacing": 0.2, "degree": 3, "order": 2,
    "origin": None, "reference": None, "max_error": 0.1, "rms_error": 0.05, "rms_without_mean": 0.04, "half_range": 1.0,
    "unknowns": 100, "iterations": 7, "cpu_seconds": 1.0, "twins": 0, "imbalances": [{"shift": [0.1]}], "warnings": [],
}  # fmt: skip


def change_records(data: st.DataObject, folder: Path) -> None:
    """Write a few records in which some values are others, and perhaps a line that is none."""
    lines = []
    for spacing in (0.2, 0.1, 0.05):
        record = PLAIN | {"spacing": spacing}
        for key in data.draw(st.lists(st.sampled_from([*PLAIN, "error"]), max_size=2)):
            record[key] = data.draw(VALUES | st.none() | st.just(10**400))
            if not data.draw(st.integers(0, 4)):
                del record[key]
        lines.append(json.dumps(record).encode())
    if not data.draw(st.integers(0, 4)):
        lines.append(data.draw(st.binary(max_size=20)))
    (folder / "records.jsonl").write_bytes(b"\n".join([*lines, b""]))
    report(folder)


@pytest.mark.parametrize("change", [change_study, change_records])
@short
@given(data=st.data())
def test_studies_and_records_are_answered(change, data, tmp_path):
    clear(tmp_path)
    change(data, tmp_path)


@pytest.mark.parametrize("change", [change_study, change_records])
@long
@given(data=st.data())
def test_many_studies_and_records_are_answered(change, data, tmp_path):
    clear(tmp_path)
    change(data, tmp_path)


def clear(folder: Path) -> None:
    """Leave nothing of the example before."""
    for file in [*folder.glob("*/*"), *folder.glob("*.*")]:
        file.unlink()


@pytest.mark.parametrize("file", corpus(".study.toml", ".records.jsonl"), ids=lambda file: file.name)
def test_what_broke_once_is_answered(file, tmp_path):
    if file.name.endswith(".toml"):
        (tmp_path / "study.toml").write_bytes(file.read_bytes())
        run(tmp_path / "study.toml")
    else:
        (tmp_path / "records.jsonl").write_bytes(file.read_bytes())
        report(tmp_path)
