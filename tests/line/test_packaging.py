"""The core and its plugins install by the README's two commands, and agree on one version."""

import re
import tomllib
from pathlib import Path

import pytest

import cpmkit

ROOT = Path(__file__).parents[2]
PLUGINS = sorted(path for path in (ROOT / "plugins").iterdir() if path.name not in ("__pycache__", ".pytest_cache"))


def project(folder):
    return tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.mark.parametrize("folder", PLUGINS, ids=lambda folder: folder.name)
def test_plugins_are_installable_folders(folder):
    assert folder.is_dir(), "`pip install ./plugins/*` fails on a plain file"
    settings = project(folder)
    assert settings["name"] == folder.name
    assert settings["requires-python"] == project(ROOT)["requires-python"]
    assert settings["license"] == project(ROOT)["license"]
    assert settings["entry-points"]["cpmkit.kinds"]
    assert (folder / settings["name"].replace("-", "_") / "py.typed").is_file()


@pytest.mark.parametrize("folder", PLUGINS, ids=lambda folder: folder.name)
def test_plugins_have_a_readme_and_tests(folder):
    assert len((folder / "README.md").read_text(encoding="utf-8")) > 200
    assert list(folder.glob("tests/test_*.py"))


def test_all_versions_are_equal():
    assert [project(folder)["version"] for folder in [ROOT, *PLUGINS]] == [cpmkit.__version__] * (1 + len(PLUGINS))
    assert f"\n## {cpmkit.__version__} - " in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("folder", PLUGINS, ids=lambda folder: folder.name)
def test_plugins_accept_this_core_and_not_the_next_minor_version(folder):
    major, minor, _ = (int(part) for part in cpmkit.__version__.split("."))
    wanted = f"cpmkit>={major}.{minor},<{major}.{minor + 1}"
    assert wanted in project(folder)["dependencies"]


def test_the_citation_names_this_version_and_the_article():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    fields = dict(re.findall(r"^([a-z-]+): *(.*)$", text, re.MULTILINE))
    assert {"cff-version", "message", "title", "authors", "preferred-citation"} <= set(fields)
    assert fields["version"] == cpmkit.__version__
    assert fields["license"] == project(ROOT)["license"]
    article = text.partition("\npreferred-citation:\n")[2]
    assert re.findall(r"family-names: (\w+)", article) == ["King", "Su", "Aanjaneya", "Ruuth", "Batty"]
    assert "2305.04711" in article


def test_the_readme_opens_with_the_two_commands():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    fences = re.findall(r"^```(\w*)\n(.*?)^```", readme, re.MULTILINE | re.DOTALL)
    environment = "python3 -m venv .venv && .venv/bin/pip install"
    assert fences[:2] == [
        ("sh", f"{environment} '.[view]' ./plugins/* && .venv/bin/cpmkit solve examples/01-first-curves.toml\n"),
        ("sh", f"{environment} '.[test]' ./plugins/* && .venv/bin/pytest\n"),
    ]
    extras = project(ROOT)["optional-dependencies"]
    assert {"view", "test"} <= set(extras)
    assert any(re.match(r"cpmkit\[.*\bview\b.*\]$", wanted) for wanted in extras["test"])


def test_every_plugin_is_in_the_list_that_windows_needs():
    text = (ROOT / "docs" / "how-to" / "install.md").read_text(encoding="utf-8")
    command = next(line for line in text.splitlines() if line.startswith(r".venv\Scripts\pip install"))
    assert [f"./plugins/{folder.name}" for folder in PLUGINS] == command.split()[3:]


def test_pictures_in_the_repository_are_small():
    for picture in (ROOT / "docs" / "images").iterdir():
        assert picture.stat().st_size < 300_000, picture.name  # in full colours, which a palette of 256 falsifies


def test_every_plugin_is_an_extra_of_the_core_and_all_of_them_are_one():
    from cpmkit.runtime.messages import PLUGIN_FAMILIES

    extras, (major, minor, _) = project(ROOT)["optional-dependencies"], cpmkit.__version__.split(".")
    assert [f"cpmkit-{family}" for family in PLUGIN_FAMILIES] == [folder.name for folder in PLUGINS]
    for family in PLUGIN_FAMILIES:
        assert extras[family] == [f"cpmkit-{family}>={major}.{minor},<{major}.{int(minor) + 1}"]
    (everything,) = extras["all"]
    assert re.fullmatch(r"cpmkit\[(.*)\]", everything)[1].split(",") == [*PLUGIN_FAMILIES, "view", "data"]


@pytest.mark.parametrize("folder", [ROOT, *PLUGINS], ids=lambda folder: folder.name)
def test_every_distribution_has_what_an_index_shows(folder):
    settings = project(folder)
    assert settings["license-files"] == ["LICENSE"]
    assert (folder / "LICENSE").read_text(encoding="utf-8") == (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert settings["urls"] == project(ROOT)["urls"]
    assert settings["classifiers"] == project(ROOT)["classifiers"]
    assert settings.get("readme", "README.md") == "README.md"
    assert settings["authors"] == project(ROOT)["authors"]


@pytest.mark.parametrize("folder", [ROOT, *PLUGINS], ids=lambda folder: folder.name)
def test_no_readme_sends_a_reader_of_the_index_nowhere(folder):
    """Links there lead to addresses, or keep their words alone."""
    text = (folder / "README.md").read_text(encoding="utf-8")
    hook = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"].get("metadata", {})
    for change in hook.get("hooks", {}).get("fancy-pypi-readme", {}).get("substitutions", []):
        text = re.sub(change["pattern"], change["replacement"], text)
    assert len(text) > 200
    assert re.findall(r"\]\((?!https?://)[^)]*\)", text) == []
