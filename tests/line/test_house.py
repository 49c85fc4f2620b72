"""The house is built as it says: rooms import what is below them, and plugins import the facade alone."""

import ast
import os
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import cpmkit.plugin

ROOT = Path(__file__).parents[2]
PLUGINS = sorted(ROOT.glob("plugins/*/cpmkit_*"))
EXAMPLE = ROOT / "examples" / "cpmkit-neural" / "cpmkit_neural"
NAMES = {name: module for names in cpmkit.plugin.USES.values() for name, module in names.items()}
#: Modules whose names an author is held to, used by the plugins of the repository or not.
CONTRACTS = {
    "conditions",
    "contract",
    "data",
    "equations",
    "errors",
    "laws",
    "operators",
    "residuals",
    "solve_report",
    "testing",
}
LINT = "from importlinter.cli import lint_imports_command; lint_imports_command(['--no-cache'])"


def imports(file):
    """Yield the module and the names of each ``from module import names`` of a file, wherever it stands."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            yield node.module, {one.name for one in node.names}
        if isinstance(node, ast.Import):
            yield from ((one.name, set()) for one in node.names)


@pytest.fixture
def house(tmp_path):
    """Copy the packages and the contracts: what is planted there stays there."""
    for package in (ROOT / "cpmkit", *PLUGINS):
        shutil.copytree(package, tmp_path / package.name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def linted(house):
    """Return the exit status of import-linter in a copy, and what it says."""
    environment = {**os.environ, "PYTHONPATH": str(house), "NO_COLOR": "1"}
    done = subprocess.run(
        [sys.executable, "-c", LINT], cwd=house, env=environment, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stdout + done.stderr


def test_all_contracts_are_kept(house):
    status, message = linted(house)
    assert status == 0, message
    assert "0 broken" in message


#: A file, what is planted in it, the contract that this breaks, and the import that is told of it.
PLANTED = [
    (
        "cpmkit/grid/band.py",
        "from cpmkit.solving import solve",
        "A room knows the rooms below it alone",
        "cpmkit.grid.band -> cpmkit.solving",
    ),
    (
        "cpmkit_mesh/box_tree.py",
        "from cpmkit.types import Floats",
        "A plugin imports the facade alone",
        "cpmkit_mesh.box_tree -> cpmkit.types",
    ),
    (
        "cpmkit_levelset/search.py",
        "import cpmkit as ck",
        "A plugin imports the facade alone",
        "cpmkit_levelset.search -> cpmkit",
    ),
    (
        "cpmkit_fem/pins.py",
        "def late():\n    import cpmkit.scene.scene",
        "A plugin imports the facade alone",
        "cpmkit_fem.pins -> cpmkit.scene.scene",
    ),
    ("cpmkit_fem/pins.py", "import cpmkit_mesh", "No plugin knows another", "cpmkit_fem.pins -> cpmkit_mesh"),
]


def test_planted_imports_break_the_contracts_that_forbid_them(house):
    for file, planted, *_ in PLANTED:
        with (house / file).open("a", encoding="utf-8") as opened:
            opened.write(f"\n{planted}\n")
    status, message = linted(house)
    assert status == 1, message
    for _, _, contract, found in PLANTED:
        assert f"{contract} BROKEN" in message
        assert f"{found} (l." in message


@pytest.mark.parametrize("package", [*PLUGINS, EXAMPLE], ids=lambda package: package.name)
def test_plugins_import_names_of_the_facade_even_for_their_types(package):
    """import-linter looks past imports for type checkers, and knows nothing of what an example installs."""
    for file in package.rglob("*.py"):
        for module, names in imports(file):
            if module.partition(".")[0] == "cpmkit":
                assert module == "cpmkit.plugin", file
                assert names <= set(NAMES), file


def test_the_facade_offers_what_type_checkers_see_each_name_for_one_use():
    own = {"typing", "__future__", "cpmkit.runtime.deprecation"}
    seen = [(module, names) for module, names in imports(ROOT / "cpmkit" / "plugin.py") if module not in own]
    assert {name: module for module, names in seen for name in names} == NAMES
    assert len(NAMES) == len(seen) == sum(map(len, cpmkit.plugin.USES.values()))
    assert all(cpmkit.plugin.USES)  # a comment behind each condition


@pytest.mark.parametrize("name", NAMES)
def test_each_name_of_the_facade_is_that_of_its_module(name):
    assert getattr(cpmkit.plugin, name) is getattr(import_module(NAMES[name]), name)


def test_each_name_of_the_facade_serves_a_plugin_or_is_a_part_of_its_contract():
    """A facade grows by itself: what nobody imports goes, but for the contracts that authors are held to."""
    used = {
        name
        for package in [*PLUGINS, EXAMPLE]
        for file in package.rglob("*.py")
        for _, names in imports(file)
        for name in names
    }
    contracts = {name for name, module in NAMES.items() if module.split(".")[-1] in CONTRACTS}
    assert set(NAMES) - used - contracts == set()


def test_an_unknown_name_is_refused_by_naming_the_page():
    with pytest.raises(AttributeError, match=r"no attribute 'prepare'; .*plugin-api\.md"):
        cpmkit.plugin.prepare  # noqa: B018
