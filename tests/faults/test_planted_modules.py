"""What lies in the working directory is never run: whoever unpacks a folder of scenes and draws one is safe."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

RAN = "CODE_RAN"


@pytest.fixture
def planted(tmp_path, monkeypatch):
    """Make a working directory whose modules leave a file behind when they are imported."""
    for name in ("numpy", "json", "pyvista", "click", "cpmkit", "sitecustomize", "scipy"):
        (tmp_path / f"{name}.py").write_text(f"open({RAN!r}, 'w').close()\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_command_runs_nothing_that_lies_there(planted):
    command = Path(sys.executable).with_name("cpmkit")
    if not command.exists():
        pytest.skip("the command is not installed beside the interpreter")
    done = subprocess.run([command, "plugins"], capture_output=True, text=True, check=False)
    assert (done.returncode, Path(RAN).exists()) == (0, False), done.stderr


def test_numba_keeps_compiled_code_in_no_folder_that_a_file_there_names(tmp_path):
    pytest.importorskip("numba")
    pytest.importorskip("yaml")
    (tmp_path / ".numba_config.yaml").write_text("cache_dir: planted\n")
    code = (
        "from cpmkit.runtime.compilation import compiled, inlined\n"
        "inlined(lambda x: x)\n"
        "compiled(lambda x: x)\n"
        "from numba import config\n"
        "print(repr(config.CACHE_DIR))"
    )
    kept = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    command = [sys.executable, "-P", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=kept, check=False)
    assert done.stdout == "''\n", done.stderr
