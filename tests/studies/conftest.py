"""What tests of studies share."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

BENCHMARKS = str(Path(__file__).parents[2] / "benchmarks")


@pytest.fixture(autouse=True)
def loaded_things_are_kept() -> None:
    """Keep the collector of garbage from what tests before have loaded: each run of a study would go through it."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def quick_rows(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], list[dict[str, str]]]]:
    """Return a function that measures the quick rows of a benchmark, given by its name: cells by column."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    before = set(sys.modules)

    def measure(name: str) -> list[dict[str, str]]:
        module = __import__(name)
        return [dict(zip(module.HEAD, cells, strict=True)) for cells in module.rows(True)]

    yield measure
    for name in set(sys.modules) - before:
        if (getattr(sys.modules[name], "__file__", None) or "").startswith(BENCHMARKS):
            sys.modules.pop(name)
