"""What all tests share: real meshes where they are to be had, and no downloads."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Callable, Generator
from pathlib import Path

import pytest

os.environ.setdefault("CPMKIT_FETCH", "0")
if "PYTEST_XDIST_WORKER" in os.environ:  # one process a core: threads would only get in each other's way
    for name in ("CPMKIT_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Where nothing is compiled yet, compile what most tests call before there are workers, each part once."""
    if "PYTEST_XDIST_WORKER" in os.environ or not session.config.getoption("numprocesses", None):
        return
    import cpmkit

    if any(Path(cpmkit.__file__).parent.rglob("*.nbi")):
        return
    script = str(Path(__file__).parent / "tests" / "compile_kernels.py")
    for one in [subprocess.Popen([sys.executable, "-P", script, part]) for part in ("galerkin", "others")]:
        one.wait()  # what fails here fails where it is tested


#: Members of parametrised tests that are slow, one a line.
RARE = Path(__file__).parent / "tests" / "rare_members.txt"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the rare members of parametrised tests as slow.

    Raises
    ------
    pytest.UsageError
        If one is listed that its file does not have, or all members of a test are.
    """
    rare = {line for line in RARE.read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")}
    for item in items:
        if item.nodeid in rare:
            item.add_marker(pytest.mark.slow)
    if any("::" in argument for argument in config.args):
        return  # of a file a part was collected
    kept = {item.nodeid.partition("[")[0] for item in items if item.nodeid not in rare}
    files = {item.nodeid.partition("::")[0] for item in items}
    there = {item.nodeid for item in items}
    for name in rare:
        if name.partition("::")[0] in files and (name not in there or name.partition("[")[0] not in kept):
            raise pytest.UsageError(f"{RARE.name} lists {name}, which is no test or has no sibling that always runs.")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect tests without the collector of garbage, which would go through all that was collected again and again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


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
    from cpmkit.files.whole_files import find_file

    def find(name: str) -> Path:
        try:
            return find_file(name)
        except InputError as error:
            if os.environ.get("CPMKIT_DATA"):
                raise
            pytest.skip(str(error))

    return find
