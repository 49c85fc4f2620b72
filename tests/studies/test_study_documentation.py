"""What the documentation says about study files holds, and names every key."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from click.testing import CliRunner
from measure_docs import block_texts

from cpmkit.cli import main
from cpmkit.studies.records import group_into_series, read_records
from cpmkit.studies.reference_values import compute_reference
from cpmkit.studies.run_one import measure_run, run_study
from cpmkit.studies.studyfile import load_study

ROOT = Path(__file__).parents[2]
STUDIES = ROOT / "examples" / "studies"
DOCS = ROOT / "docs"


def test_the_study_in_the_documentation_converges(tmp_path):
    file = tmp_path / "torus.toml"
    file.write_text(block_texts(DOCS / "how-to" / "run-a-study.md", "toml")[0])
    study = load_study(file)
    coarse = replace(study, sweep=replace(study.sweep, spacings=[0.28, 0.2, 0.14]))
    outcome = run_study(coarse, tmp_path)
    first, second = group_into_series(read_records(outcome.file))
    assert second.fitted_order > 1.7
    assert all(np.array(second.errors) < first.errors)


def test_python_in_the_documentation(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    exec("\n".join(block_texts(DOCS / "how-to" / "run-a-study.md", "python")), names)
    assert abs(names["report"].series[0].fitted_order - 2) < 0.2


def test_every_key_of_a_study_is_documented(tmp_path):
    text = (DOCS / "reference" / "study-keys.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([^`\n]+)`", text))
    tables = json.loads(CliRunner().invoke(main, ["schema", "study"]).output)["properties"]
    keys = {key for table in ("exact", "sweep") for key in tables[table]["properties"]}
    assert len(keys) > 10
    assert {"title", *keys} - named == set()
    assert {f"[{table}]" for table in tables if table not in ("title", "boundary")} - named == set()
    study = load_study(STUDIES / "panel-a-circle-jump.toml")
    record = measure_run(study, study.sweep.runs()[0], compute_reference(study))
    assert {*record, "error"} - named == set()
