"""The command that measures distances: what it writes, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from cpmkit import cli

SCENE = """
[surface]
kind = "analytic.sphere"

[[boundary]]
name = "equator"
kind = "analytic.circle"
normal = [0, 0, 1]
both = { neumann = 0 }

[problem]
kind = "laplace"

[discretization]
spacing = 0.4

[output]
folder = "out"
files = ["solution.npz"]
"""


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE)
    return tmp_path


def _written(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    with np.load(folder / "out" / "solution.npz") as arrays:
        return np.clip(arrays["points"], -1, 1), arrays["values"].reshape(len(arrays["points"]))


def _run(*arguments: str) -> Result:
    return CliRunner().invoke(cli.main, ["distance", "scene.toml", *arguments])


def test_from_a_boundary_with_a_path(scene: Path) -> None:
    found = _run("--from", "equator", "--path-from", "0,0.1,1", "--method", "heat")
    assert found.exit_code == 0, found.output
    path = np.loadtxt(scene / "out" / "path-1.csv", delimiter=",")
    assert abs(np.linalg.norm(np.diff(path, axis=0), axis=1).sum() - (np.pi / 2 - np.arctan(0.1))) < 0.05
    points, values = _written(scene)
    assert np.abs(values - np.abs(np.arcsin(points[:, 2]))).mean() < 0.02


def test_from_vertices_of_a_mesh_and_points(scene: Path) -> None:
    Path("mesh.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n")
    Path("scene.toml").write_text(
        "[surface]\nkind = 'mesh.triangles'\nfile = 'mesh.obj'\n[problem]\nkind = 'laplace'\n"
        "[output]\nfolder = 'out'\nfiles = ['solution.npz']\n"
    )
    found = _run("--from", "0", "--from", "1,1,0", "--method", "heat", "--spacing", "0.1")
    assert found.exit_code == 0, found.output
    points, values = _written(scene)
    exact = np.minimum(np.linalg.norm(points, axis=1), np.linalg.norm(points - [1, 1, 0], axis=1))
    assert np.abs(values - exact).mean() < 0.02


def test_signed_and_at_another_spacing(scene: Path) -> None:
    found = _run("--from", "equator", "--signed", "--method", "heat", "--spacing", "0.3")
    assert found.exit_code == 0, found.output
    points, values = _written(scene)
    assert np.abs(values - np.arcsin(points[:, 2])).mean() < 0.01


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--from", "0,1"), "3 numbers"),
        (("--from", "pole"), "a name or a vertex number"),
        (("--from", "7"), "vertices"),  # the sphere has none
        (("--from", "equator", "--signed", "--path-from", "0,0,1"), "leave out"),
        (("--from", "0,0,1"), "1 of 2 pieces of the surface have no origin"),  # the equator is a barrier
    ],
)
def test_refusals_leave_nothing_behind(scene: Path, arguments: tuple[str, ...], words: str) -> None:
    found = _run(*arguments)
    assert found.exit_code == 1
    assert words in " ".join(found.output.split())
    assert not (scene / "out").exists()
