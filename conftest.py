"""What all tests share: real meshes where they are to be had, and no downloads."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable
from pathlib import Path

import pytest

os.environ.setdefault("CPMKIT_FETCH", "0")
if "PYTEST_XDIST_WORKER" in os.environ:  # one process a core: threads would only get in each other's way
    for name in ("CPMKIT_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def pytest_collection_finish() -> None:
    """Keep the collector of garbage from what was collected of tests: each run of a study would go through it all."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def real_mesh() -> Callable[[str], Path]:
    """Return a finder of real meshes by file name.

    The test is skipped where the mesh is not found, and fails where CPMKIT_DATA is set and lacks it.
    """
    from cpmkit.errors import InputError
    from cpmkit.files.data_files import find_file

    def find(name: str) -> Path:
        try:
            return find_file(name)
        except InputError as error:
            if os.environ.get("CPMKIT_DATA"):
                raise
            pytest.skip(str(error))

    return find
