"""What starts light stays light: nothing is imported before it is needed."""

import json
import subprocess
import sys
from functools import cache
from importlib.metadata import entry_points

import pytest

LIBRARIES = {"scipy", "numba", "trimesh", "pyvista", "vtk", "vtkmodules", "matplotlib", "skfem", "open3d"}
PLUGINS = {point.value.partition(":")[0].partition(".")[0] for point in entry_points(group="cpmkit.kinds")} - {"cpmkit"}
COMMAND = """
from click.testing import CliRunner
from cpmkit.cli import main
assert CliRunner().invoke(main, {}).exit_code == 0
"""


@cache
def imported_by(statement):
    """Return the top-level modules that a fresh interpreter holds after ``statement``."""
    code = (
        f"{statement}\nimport json, sys\nprint(json.dumps(sorted({{name.partition('.')[0] for name in sys.modules}})))"
    )
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return set(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.parametrize(
    "statement",
    [
        "import cpmkit",
        "import cpmkit.cli",
        "import cpmkit.plugin",
        "import cpmkit.saving.saved_solutions, cpmkit.view, cpmkit.solution.display_mesh, cpmkit.commands.doctor",
        COMMAND.format(["--help"]),
        COMMAND.format(["solve", "--help"]),
        COMMAND.format(["plugins"]),
        COMMAND.format(["plugins", "--json"]),
    ],
)
def test_nothing_heavy_and_no_plugin_is_imported(statement):
    assert imported_by(statement) & (LIBRARIES | PLUGINS) == set()


@pytest.mark.parametrize(
    "statement", ["import cpmkit", "import cpmkit.plugin", COMMAND.format(["--help"]), COMMAND.format(["plugins"])]
)
def test_not_even_numpy_is_imported(statement):
    assert "numpy" not in imported_by(statement)


def test_a_kind_imports_its_own_plugin_and_no_other():
    assert {"cpmkit_analytic", "cpmkit_mesh"} <= PLUGINS
    modules = imported_by("import cpmkit; cpmkit.source('analytic.torus')")
    assert modules & PLUGINS == {"cpmkit_analytic"}
    assert modules & LIBRARIES == set()


def test_the_module_for_plugins_is_imported_when_it_is_named():
    imported_by("import sys, cpmkit; assert 'cpmkit.plugin' not in sys.modules; cpmkit.plugin.hookimpl")


def test_kernels_are_imported_where_a_scene_is_discretised():
    assert "numba" not in imported_by("import cpmkit.solving")


def test_a_mesh_is_made_without_what_a_solution_needs():
    mesh = "cpmkit.source('mesh.triangles', vertices=[[0, 0, 0], [1, 0, 0], [0, 1, 0.0]], faces=[[0, 1, 2]])"
    imported_by(f"import sys, cpmkit; {mesh}; assert not {{'cpmkit.facade', 'cpmkit.scene.scene'}} & set(sys.modules)")


def test_every_public_name_exists():
    import cpmkit

    for name in cpmkit.__all__:
        assert getattr(cpmkit, name) is not None
