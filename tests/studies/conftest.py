"""What tests of studies share."""

from __future__ import annotations

import gc

import pytest


@pytest.fixture(autouse=True)
def loaded_things_are_kept() -> None:
    """Keep the collector of garbage from what tests before have loaded: each run of a study would go through it."""
    gc.collect()
    gc.freeze()
