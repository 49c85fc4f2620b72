"""The doctor reports what is there, says what to do about what is not, and imports no plugin for it."""

import json
import warnings
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError

import pytest

from cpmkit.cli import main
from cpmkit.commands.doctor import diagnose
from cpmkit.errors import CpmkitWarning

runner = pytest.importorskip("click.testing").CliRunner()


def test_what_is_installed_is_reported(monkeypatch):
    monkeypatch.setenv("CPMKIT_DATA", "/somewhere")
    found = diagnose()
    assert found.versions["numpy"]
    assert found.kinds["analytic.circle"].startswith("cpmkit-analytic ")
    assert found.processors >= 1
    assert found.memory.endswith(" GiB")
    assert found.variables["CPMKIT_DATA"] == "/somewhere"
    assert found.scene is None
    for said in ("numpy", "analytic.circle", "/somewhere"):
        assert said in str(found)
    assert json.loads(json.dumps(asdict(found)))["versions"] == found.versions


def test_what_is_absent_is_said_with_the_way_to_add_it(monkeypatch):
    monkeypatch.setattr("cpmkit.commands.doctor.DISTRIBUTIONS", ("matplotlib", "pyvista", "imageio", "cpmkit-no-such"))
    monkeypatch.setattr("cpmkit.solution.summary.version", _absent)
    monkeypatch.setattr("cpmkit.commands.doctor.installed_kinds", list)
    found = diagnose()
    assert found.versions["pyvista"] is None
    assert "not installed" in str(found)
    assert any("pip install 'cpmkit[view]'" in sentence for sentence in found.advice)
    assert any("pip install 'cpmkit[all]'" in sentence for sentence in found.advice)


def _absent(name):
    raise PackageNotFoundError(name)


def test_a_scene_that_does_not_load_is_reported_and_exits_with_1(tmp_path):
    (tmp_path / "scene.toml").write_text("[surface\n")
    result = runner.invoke(main, ["doctor", str(tmp_path / "scene.toml")])
    assert result.exit_code == 1
    assert "is not TOML" in result.stdout


def test_json_is_the_diagnosis():
    result = runner.invoke(main, ["doctor", "--json"])
    assert result.exit_code == 0
    assert json.loads(result.stdout)["versions"]["numpy"]


def test_what_a_scene_warns_of_is_among_the_advice(tmp_path, monkeypatch):
    def load_scene(path):
        warnings.warn("A triangle is dropped.", CpmkitWarning, stacklevel=1)

    monkeypatch.setattr("cpmkit.scenefile.scene_files.load_scene", load_scene)
    assert diagnose(tmp_path / "scene.toml").advice[0] == "A triangle is dropped."
