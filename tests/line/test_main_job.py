"""The README's main job ends with files and a picture, whether or not a renderer answers."""

import contextlib
import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from cpmkit.cli import main

SCENE = Path(__file__).parents[2] / "examples" / "01-first-curves.toml"


def run(folder, *arguments):
    with contextlib.chdir(folder):
        return CliRunner().invoke(main, arguments)


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    """Run the main job."""
    folder = tmp_path_factory.mktemp("job")
    done = run(folder, "solve", str(SCENE), "--spacing", "0.15", "--look", "width=400")
    return folder, done


def test_it_ends_well_and_names_what_it_wrote(job):
    folder, done = job
    assert done.exit_code == 0, done.output
    for name in ("solution.vtp", "summary.json", "picture.png"):
        assert (folder / "first-curves" / name).stat().st_size > 1000
        assert f"first-curves/{name}" in done.stdout


def test_the_summary_says_what_the_picture_shows(job):
    folder, done = job
    summary = json.loads((folder / "first-curves" / "summary.json").read_text())
    assert summary["picture"]["camera"] in done.stdout
    assert summary["report"]["converged"]
    assert len(summary["scene"]["boundaries"]) == 5
    assert summary["discretization"]["channels"] == 3


def test_the_file_for_paraview_holds_sharp_colours(job):
    pyvista = pytest.importorskip("pyvista")
    folder, _ = job
    mesh = pyvista.read(folder / "first-curves" / "solution.vtp")
    colours = mesh.point_data["rgb"]
    assert colours.shape == (mesh.n_points, 3)
    assert mesh.point_data["u"].shape == (mesh.n_points, 3)
    for side in ([250, 199, 64], [41, 51, 120]):  # left and right of the first circle
        assert (abs(colours.astype(int) - side).max(axis=1) <= 6).any()


def test_explain_says_what_it_will_be_before_it_is_built(tmp_path):
    done = run(tmp_path, "explain", str(SCENE), "--json")
    told = json.loads(done.stdout)
    assert done.exit_code == 0
    assert told["unknowns"] == pytest.approx(60_324, rel=0.1)
    assert not list(tmp_path.iterdir())
