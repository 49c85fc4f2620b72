"""Records of the trade's benchmark: what is printed, and what is found again in a file."""

import json
import sys
from pathlib import Path

import pytest

BENCHMARKS = str(Path(__file__).parents[2] / "benchmarks")


@pytest.fixture
def records(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    yield __import__("trade_records")
    sys.modules.pop("trade_records")


def test_runs_are_found_again_and_printed(records, tmp_path):
    to_an_error = records.TradeRun("slit", 0, 1e-3, "max", None, "1 GiB", "reached", 8e-4, 5e-4, True, 2.0, 4e7, 5e7)
    in_a_time = records.TradeRun("slit", 0, None, "rms", 3.0, "1 GiB", "within", 8e-5, 5e-5, True, 2.0, 4e7, 5e7)
    refused = records.TradeRun("cube", 0, 1e-3, "max", None, "1 GiB")
    runs = [to_an_error, refused, in_a_time]
    for run in runs:
        records.append(tmp_path / "runs.jsonl", run)
    assert records.read(tmp_path / "runs.jsonl") == runs
    printed = json.loads(records.printed(runs))
    assert list(printed) == ["problems"]
    assert [(one["name"], len(one["runs"])) for one in printed["problems"]] == [("slit", 2), ("cube", 1)]
    keys = "asked_tolerance norm estimate true_error status asked_seconds seconds predicted_bytes bytes"
    for problem in printed["problems"]:
        for run in problem["runs"]:
            assert list(run) == [*keys.split(), "cost_over_last_solve"]
            assert (run["asked_tolerance"] is None) != (run["asked_seconds"] is None)
    assert printed["problems"][1]["runs"][0]["status"] == "failed"
    with pytest.raises(ValueError, match="JSON"):
        records.printed([records.TradeRun("slit", 0, 1e-3, "max", None, "1 GiB", estimate=float("nan"))])


def test_what_holds_is_counted(records):
    run = lambda true, slow=False, **more: records.TradeRun(  # noqa: E731
        "slit", 0, 1e-3, "rms", None, "1 GiB", "reached", 9e-4, true, slow, 2.0, 4e7, 5e7, 1000, 1.5, **more
    )
    rows = "\n".join(records.table([run(5e-4), run(2e-3), run(1.2e-3, slow=True)]))
    assert "below the tolerance | 1 of 3 |" in rows
    assert "effectivity in [.5, 3] | 67% of 3 |" in rows
    assert "accepted without the flag | 1 |" in rows
