"""A distribution that is no part of the project installs from its wheel, works in scenes, and keeps the laws."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cpmkit.testing import LAWS

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "cpmkit-neural"
TUTORIAL = ROOT / "docs" / "tutorial" / "write-a-plugin.md"
CLI = ("-c", "from cpmkit.cli import main; main()")
SCENE = """
[surface]
kind = "neural.field"
file = "cube.npz"
resolution = 32

[[boundary]]
name = "waist"
kind = "cut.plane"
point = [0, 0, 0.2]
normal = [0, 0.2, 1]
resolution = 32
left = { dirichlet = 1.0 }
right = { dirichlet = 0.0 }

[problem]
kind = "laplace"

[discretization]
spacing = 0.24
estimate = false

[output]
folder = "cube"
files = ["summary.json", "solution.npz"]
picture = { file = "picture.png", width = 200 }
"""


def run(folder, site, *arguments):
    """Return what Python prints that sees the distributions in ``site`` beside the installed ones."""
    path = os.pathsep.join([*([str(site)] if site else []), *filter(None, [os.environ.get("PYTHONPATH")])])
    # one thread multiplies the network's small matrices sooner than several that wait for each other;
    # what other distributions hang into pytest is no part of this
    environment = {**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Build the wheel from a copy of the folder and install it, and nothing else, into a fresh folder."""
    work = tmp_path_factory.mktemp("neural")
    copy = shutil.copytree(EXAMPLE, work / "source", ignore=shutil.ignore_patterns("__pycache__", ".*", "dist"))
    run(copy, None, "-m", "hatchling", "build", "-t", "wheel", "-d", str(work / "wheels"))
    (wheel,) = (work / "wheels").glob("*.whl")
    pip = ("-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", "--no-index", "--target")
    run(work, None, *pip, str(work / "site"), str(wheel))
    return work / "site"


def test_the_wheel_holds_the_package_with_its_types_and_weights_and_no_more(site):
    folder = EXAMPLE / "cpmkit_neural"
    files = {file.name for file in (site / "cpmkit_neural").iterdir()} - {"__pycache__"}
    assert files == {file.name for file in folder.iterdir()} - {"__pycache__"}
    assert {"py.typed", "spot.npz"} <= files
    others = {entry.name for entry in site.iterdir()} - {"cpmkit_neural"}
    assert all(name.startswith("cpmkit_neural-") for name in others)


def test_its_kind_is_listed_beside_the_others(site, tmp_path):
    listed = [line.split() for line in run(tmp_path, site, *CLI, "plugins").splitlines()]
    assert ["neural.field", "cpmkit-neural", "0.1.0"] in listed
    assert "cpmkit-analytic" in {distribution for _, distribution, _ in listed}


def test_a_scene_that_names_its_kind_solves_and_writes_a_picture(site, tmp_path):
    """With a network of one layer, written by hand: of the cow's closest points a solve takes a minute."""
    layers = {"weight0": np.eye(3), "bias0": np.full(3, np.pi / 2), "weight1": -np.ones((3, 1)), "bias1": [2.0]}
    np.savez(tmp_path / "cube.npz", bounds=[[-3.0] * 3, [3.0] * 3], **layers)
    (tmp_path / "cube.toml").write_text(SCENE)
    run(tmp_path, site, *CLI, "solve", "cube.toml", "--quiet")
    assert json.loads((tmp_path / "cube" / "summary.json").read_text())["report"]["converged"]
    assert (tmp_path / "cube" / "picture.png").stat().st_size > 2_000
    mesh = np.load(tmp_path / "cube" / "solution.npz")
    beyond = mesh["points"] @ [0, 0.2, 1] - 0.2
    away = np.abs(beyond) > 0.01  # vertices at the cut carry the value of either side
    # harmonic on each side of the cut and constant on it: one behind, nought before
    assert 0.2 < (beyond > 0).mean() < 0.8
    np.testing.assert_allclose(mesh["values"][away, 0], beyond[away] > 0, atol=1e-4)


@pytest.mark.slow
def test_its_own_scene_solves_at_a_coarse_spacing(site, tmp_path):
    run(tmp_path, site, *CLI, "solve", str(EXAMPLE / "neural.toml"), "--spacing", "0.06", "--quiet")
    assert (tmp_path / "neural" / "picture.png").stat().st_size > 50_000


def own_tests(site, folder, *chosen):
    """Return what pytest prints of the distribution's own tests, run against the installed wheel."""
    shutil.copytree(EXAMPLE / "tests", folder / "tests", ignore=shutil.ignore_patterns("__pycache__", ".*"))
    where = run(folder, site, "-c", "import cpmkit_neural; print(cpmkit_neural.__file__)")
    assert Path(where.strip()).is_relative_to(site)
    output = run(folder, site, "-m", "pytest", "-rA", "-p", "no:cacheprovider", "tests", *chosen)
    assert "failed" not in output
    assert "skipped" not in output
    return output


def laws_kept(told):
    return len(re.findall(r"^PASSED .*test_laws\.py", told, re.MULTILINE))


def test_its_own_tests_pass_against_the_installed_wheel_with_the_laws_on_one_of_its_surfaces(site, tmp_path):
    assert laws_kept(own_tests(site, tmp_path, "-k", "not Spot")) == len(LAWS)


@pytest.mark.slow
def test_all_its_own_tests_pass_against_the_installed_wheel(site, tmp_path):
    assert laws_kept(own_tests(site, tmp_path)) == 2 * len(LAWS)


def test_the_tutorial_reads_every_file_aloud():
    text = TUTORIAL.read_text(encoding="utf-8")
    read = re.findall(r"^```\{literalinclude\} \.\./\.\./examples/cpmkit-neural/(\S+)", text, re.MULTILINE)
    package = [f"cpmkit_neural/{file.name}" for file in (EXAMPLE / "cpmkit_neural").glob("[a-z]*.py")]
    assert {*package, "pyproject.toml", "neural.toml", "tests/test_laws.py"} - set(read) == set()
    assert not re.search(r"^```(python|toml)", text, re.MULTILINE), "a listing that is typed twice may lag"


@pytest.mark.slow  # the file is part of the package, and so are its weights: the numbers change with neither
def test_the_readme_says_how_far_the_network_is_from_the_mesh(site, tmp_path, real_mesh):
    measure = f"""
import numpy as np, cpmkit as ck
from cpmkit_neural.cases import spot
cow, mesh = spot(), ck.source("mesh.triangles", file={str(real_mesh("spot.obj"))!r})
vertices, _ = ck.read_mesh({str(real_mesh("spot.obj"))!r})
there, back = mesh.closest_point(cow.mesh(0.02)[0]).distance, cow.closest_point(np.asarray(vertices)).distance
print(f"{{there.mean():.4f}} {{there.max():.3f}} {{back.mean():.4f}} {{back.max():.3f}}")
"""
    told = run(tmp_path, site, "-c", measure).split()
    claimed = re.findall(r"\b0\.0\d+\b", (EXAMPLE / "README.md").read_text().partition("## The cow")[2])
    assert claimed[:4] == told
