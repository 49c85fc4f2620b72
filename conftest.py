"""What all tests share: real meshes where they are to be had, and no downloads."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

os.environ.setdefault("CPMKIT_FETCH", "0")
if "PYTEST_XDIST_WORKER" in os.environ:  # one process a core: threads would only get in each other's way
    for name in ("CPMKIT_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")

#: One module that compiles most kernels, and some that need none of them: of two processes that run side by side, one
#: compiles while the other has work, and reads the kernels from disk afterwards.
FIRST_MODULES = (
    "tests/forms/galerkin/test_the_form.py",
    "tests/forms/collocation/conservation/test_null_spaces.py",
    "tests/forms/collocation/boundary/test_several_curves.py",
    "tests/forms/collocation/conservation/test_flux_balance.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put tests of the first modules first; the others keep their order."""
    place = {module: number for number, module in enumerate(FIRST_MODULES)}
    items.sort(key=lambda item: place.get(item.nodeid.partition("::")[0], len(place)))


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
