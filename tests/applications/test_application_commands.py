"""The commands that make applications of scene files: what they write, what they tell, and what they refuse."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from cpmkit import cli

SPHERE = """
[surface]
kind = "analytic.sphere"

[discretization]
spacing = 0.4

[output]
folder = "out"
files = ["solution.npz", "summary.json"]
"""
VECTORS = """
[[direction]]
kind = "analytic.circle"
normal = [0, 0, 1]
along = "tangent"
"""
MAP = """
[target]
kind = "analytic.sphere"

[[landmark]]
kind = "analytic.circle"
normal = [0, 0, 1]
to = ["-y", "x", "z"]
"""
PAINT = """
[[curve]]
name = "equator"
kind = "analytic.circle"
normal = [0, 0, 1]
left = ["red", "lime", "red"]
right = { formula = ["x**2", "0", "y**2"] }
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _run(command: str, text: str, *arguments: str) -> Result:
    Path("scene.toml").write_text(text)
    return CliRunner().invoke(cli.main, [command, "scene.toml", *arguments])


def _written(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    with np.load(folder / "out" / "solution.npz") as arrays:
        return arrays["points"], arrays["values"]


def test_vectors_run_east_everywhere_and_turn_round_both_poles(folder: Path) -> None:
    found = _run("vectors", VECTORS + SPHERE, "--json")
    assert found.exit_code == 0, found.output
    points, values = _written(folder)
    away = np.abs(points[:, 2]) < 0.8
    points, values = points[away], values[away]
    east = np.stack([-points[:, 1], points[:, 0], 0 * points[:, 0]], axis=1)
    cosine = np.einsum("nd,nd->n", values, east) / np.linalg.norm(values, axis=1) / np.linalg.norm(east, axis=1)
    assert cosine.min() > 0.999
    told = json.loads(found.stdout)
    assert sorted(round(abs(one["place"][2])) for one in told["singularities"]) == [1, 1]
    assert {one["index"] for one in told["singularities"]} == {1}
    assert json.loads((folder / "out" / "summary.json").read_text())["files"] == told["files"]


def test_vectors_at_points_and_on_two_sides(folder: Path) -> None:
    more = """
[[direction]]
at = [[0, 0, 1], [0, 0, -1]]
vector = [1, 0, 0]

[[direction]]
kind = "analytic.circle"
normal = [0, 0, 1]
left = ["-y", "x", "0"]
right = "backwards"

[vectors]
transport = "paper"
"""
    found = _run("vectors", more + SPHERE)
    assert found.exit_code == 0, found.output
    assert "indices    +2 in all" in found.output
    points, values = _written(folder)
    turning = values[:, 1] * points[:, 0] - values[:, 0] * points[:, 1]
    beside = np.abs(points[:, 2]) < 0.3
    assert (np.sign(turning) == np.sign(points[:, 2]))[beside & (np.abs(points[:, 2]) > 0.05)].all()


def test_a_map_that_turns_the_equator_turns_the_sphere(folder: Path) -> None:
    found = _run("map", MAP + SPHERE, "--quiet")
    assert found.exit_code == 0, found.output
    assert found.stdout == ""
    points, values = _written(folder)
    assert np.abs(values - np.stack([-points[:, 1], points[:, 0], points[:, 2]], axis=1)).max() < 0.05


def test_a_map_reports_energy_and_degree_and_starts_where_its_file_says(folder: Path) -> None:
    own = '\n[map]\ninitial = ["x", "y", "-z"]\nrest = 1e-3\ntexture = "z"\n'
    found = _run("map", MAP.split("[[")[0] + own + SPHERE)
    assert found.exit_code == 0, found.output
    assert "degree     -1" in found.output
    assert "at rest" in found.output
    assert "energy     12.5" in found.output


def test_paint_holds_the_colours_of_both_sides(folder: Path) -> None:
    found = _run("paint", PAINT + SPHERE, "--no-estimate")
    assert found.exit_code == 0, found.output
    points, values = _written(folder)
    north, south = points[:, 2] > 0.05, points[:, 2] < -0.05
    assert np.abs(values[north, 2]).max() < 1e-6  # red and green alone
    assert np.abs(values[north].sum(axis=1) - 1).max() < 1e-6
    assert np.abs(values[south][:, [0, 2]].sum(axis=1) - 1).max() < 0.01
    assert np.abs(values[south, 1]).max() < 1e-6


def test_paint_takes_a_tolerance_in_place_of_the_spacing(folder: Path) -> None:
    found = _run("paint", PAINT + SPHERE, "--tolerance", "0.05", "--seconds", "20")
    assert found.exit_code == 0, found.output
    assert "history    " in found.output


def test_pictures_and_pages_show_what_is_made(folder: Path) -> None:
    drawn = 'files = ["page.html"]\npicture = { file = "picture.png", width = 200 }'
    scene = SPHERE.replace('files = ["solution.npz", "summary.json"]', drawn)
    assert _run("vectors", VECTORS + scene, "--look", "width=160").exit_code == 0
    assert (folder / "out" / "page.html").stat().st_size > 1000
    from matplotlib.image import imread

    picture = imread(folder / "out" / "picture.png")[..., :3]
    assert picture.shape[1] == 160
    blue = (picture[..., 2] - picture[..., 0] > 0.15).mean()  # of arrows on ivory
    assert 0.002 < blue < 0.05


@pytest.mark.parametrize(
    ("command", "text", "words"),
    [
        ("vectors", "", "needs directions"),
        ("vectors", "[[direction]]\nat = [0, 0, 1]\n", "needs a vector"),
        ("vectors", "[[direction]]\nat = [0, 0]\nvector = [1, 0, 0]\n", "at of [[direction]] 1 must have shape (n, 3)"),
        ("vectors", "[[direction]]\nat = [0, 0, 1]\nvector = [[1, 0, 0], [0, 1, 0]]\n", "1 points and 2 vectors"),
        ("vectors", VECTORS + '[vectors]\ntransprot = "paper"\n', "did you mean 'transport'"),
        ("vectors", VECTORS + '[vectors]\ntransport = "own"\n', "parallel or paper"),
        ("vectors", VECTORS.replace("along", "left"), "or with left and right"),
        ("vectors", VECTORS + '[problem]\nkind = "laplace"\n', "has its own equation"),
        ("vectors", PAINT, "unknown key 'curve'"),
        ("map", "", "needs the table [target]"),
        ("map", MAP.replace('to = ["-y", "x", "z"]', ""), "needs to"),
        ("map", MAP.replace('"z"]', '"t"]'), "must not depend on t"),
        ("map", MAP + "[map]\nmost_steps = 0\n", "most_steps"),
        ("paint", "", "no side of a curve has a colour"),
        ("paint", PAINT.replace("right", "both"), "needs both, or left and right"),
        ("paint", PAINT.replace('"lime"', '"limy"'), "limy"),
        ("paint", PAINT.replace("formula", "formulas"), "must be a colour"),
        ("solve", PAINT, "`cpmkit paint` makes"),
    ],
)
def test_refusals_leave_nothing_behind(folder: Path, command: str, text: str, words: str) -> None:
    found = _run(command, text + SPHERE)
    assert found.exit_code == 1, found.output
    assert words in " ".join(found.output.split())
    assert "scene.toml" in found.output or command != "solve"
    assert not (folder / "out").exists()


@pytest.mark.parametrize("key", ["tolerance = 0.01", "seconds = 5.0", "estimate = true"])
@pytest.mark.parametrize(("command", "text"), [("vectors", VECTORS), ("map", MAP)])
def test_what_takes_a_spacing_takes_no_accuracy(folder: Path, command: str, text: str, key: str) -> None:
    found = _run(command, text + SPHERE.replace("spacing = 0.4", key))
    assert found.exit_code == 1
    assert f"takes a spacing and estimates no error; leave out {key.split()[0]}" in " ".join(found.output.split())


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ('files = ["film.gif"]', "makes none"),
        ('picture = { file = "a.png", field = "error" }', "no estimate of the error"),
        ('picture = { file = "a.png", vectors = true }', "draws in its own way"),
    ],
)
def test_output_that_a_field_has_not(folder: Path, target: str, words: str) -> None:
    found = _run("vectors", VECTORS + SPHERE.replace('files = ["solution.npz", "summary.json"]', target))
    assert found.exit_code == 1
    assert words in " ".join(found.output.split())
