"""What the tests in tests/fuzz share: a short session, a long one, and the one law, an answer or a CpmkitError."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from cpmkit.errors import CpmkitError

CORPUS = Path(__file__).with_name("fuzz") / "corpus"
_NO_CHECKS = (HealthCheck.too_slow, HealthCheck.function_scoped_fixture, HealthCheck.data_too_large)

#: Runs always: a few examples, the same in every run.
short = settings(max_examples=25, derandomize=True, deadline=None, database=None, suppress_health_check=_NO_CHECKS)


def long(test: Callable[..., Any]) -> Callable[..., Any]:
    """Mark a session of many random examples: ``pytest -m fuzz tests/fuzz``, so many as ``FUZZ_EXAMPLES`` says."""
    count = int(os.environ.get("FUZZ_EXAMPLES", "5000"))
    many = settings(max_examples=count, deadline=None, suppress_health_check=_NO_CHECKS)
    return pytest.mark.slow(pytest.mark.fuzz(many(test)))


def corpus(*suffixes: str) -> list[Path]:
    """Return the files of tests/fuzz/corpus that end in one of ``suffixes``, in the order of their names."""
    return sorted(file for file in CORPUS.iterdir() if file.name.endswith(suffixes))


def answered(call: Callable[[], Any]) -> Any:
    """Return what ``call`` answers, or the CpmkitError that it raises; any other exception is a failure."""
    try:
        return call()
    except CpmkitError as error:
        text = str(error)
        assert text.endswith("."), text
        assert len(text) < 2000, text
        return error
