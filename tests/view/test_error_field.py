"""The estimated error is a field like the solution: drawn, and saved beside it."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import cpmkit as ck
from cpmkit.cli import main
from cpmkit.commands.options import as_shown
from cpmkit.errors import InputError, SceneError
from cpmkit.scenefile.look import Look
from cpmkit.scenefile.output_request import OutputRequest, PictureRequest
from cpmkit.view.pictures import shown_values

SCENE = """
[surface]
kind = "analytic.sphere"
[problem]
kind = "screened"
f = "x*y"
[discretization]
spacing = 0.2
[output]
folder = "out"
files = ["summary.json", "ball.npz"]
"""


@pytest.fixture(scope="module")
def jumping():
    ball = ck.source("analytic.sphere")
    ring = ck.source("analytic.circle", normal=[0, 0, 1])
    cut = ck.Boundary("ring", ring, left=ck.Dirichlet(lambda x: 1 + x[:, 0]), right=ck.Dirichlet(0))
    return ck.solve(ck.Scene(ball, ck.ScreenedPoisson(lambda x: x[:, 2]), [cut]), 0.2, estimate=True)


def test_the_error_on_a_mesh_is_that_of_its_points_and_of_their_own_sides(jumping):
    mesh = jumping.display_mesh()
    found = jumping.error.on_mesh(mesh)
    off = ~mesh.sides.any(axis=1)
    assert np.allclose(found[off, 0], jumping.error_at(mesh.points[off]))
    assert (~off).sum() > 20
    assert found.max() < 0.2  # across the jump, which is of one, left minus right would be as large
    assert found.max() > 0


def test_files_hold_the_error_where_it_was_estimated(jumping, tmp_path):
    jumping.save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as arrays:
        assert np.array_equal(arrays["error"], jumping.error.on_mesh(jumping.display_mesh()))
    assert ck.load(tmp_path / "a.npz", jumping.scene).values.shape == jumping.values.shape
    bare = ck.solve(jumping.scene, 0.2)
    bare.save(tmp_path / "b.npz")
    with np.load(tmp_path / "b.npz") as arrays:
        assert "error" not in arrays


def test_paraview_shows_the_error_beside_the_solution(jumping, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    jumping.save(tmp_path / "a.vtp")
    data = pyvista.read(tmp_path / "a.vtp")
    assert np.allclose(data.point_data["error"], jumping.error.on_mesh(jumping.display_mesh())[:, 0])


def test_a_picture_shows_the_error(jumping, tmp_path):
    pytest.importorskip("matplotlib")
    mesh = jumping.display_mesh()
    values, bar = shown_values(jumping, mesh, Look(field="error"))
    assert bar.ends[1] == values.max() == jumping.error.on_mesh(mesh).max()
    assert jumping.picture(tmp_path / "error.png", width=300, field="error").file.is_file()
    with pytest.raises(InputError, match="field of a picture must be 'solution' or 'error', got 'grad'"):
        jumping.picture(tmp_path / "error.png", field="grad")


def test_a_scene_file_asks_for_a_picture_of_the_error(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ball.toml").write_text(SCENE + 'picture = { field = "error", width = 200 }\n')
    done = CliRunner().invoke(main, ["solve", "ball.toml"])
    assert done.exit_code == 0, done.output
    assert "error      error about" in done.output  # it took less than a second, and is estimated for the picture
    with np.load(tmp_path / "out" / "ball.npz") as arrays:
        assert arrays["error"].max() > 0
    refused = CliRunner().invoke(main, ["solve", "ball.toml", "--no-estimate"])
    assert refused.exit_code == 1
    assert "--no-estimate leaves it out" in refused.output
    shown = CliRunner().invoke(main, ["solve", "ball.toml", "--field", "solution", "--no-estimate"])
    assert shown.exit_code == 0, shown.output
    (tmp_path / "ball.toml").write_text(SCENE)
    for said in (["--field", "error"], ["--look", "cmap=magma"]):
        refused = CliRunner().invoke(main, ["solve", "ball.toml", *said])
        assert refused.exit_code == 1
        assert "the scene asks for none" in refused.output


def test_the_command_line_says_how_the_picture_looks():
    output = OutputRequest(Path("out"), (), PictureRequest(file="ball.png", cmap="gray", edges=True))
    look = ["cmap=magma", "clim=[0, 2]", "isolines=3", "title=two words", "up=y"]
    drawn = as_shown(output, None, look, None).picture
    assert (drawn.file, drawn.edges) == ("ball.png", True)
    assert (drawn.cmap, drawn.clim, drawn.isolines, drawn.title, drawn.up) == ("magma", (0.0, 2.0), 3, "two words", "y")
    for wrong, told in (("cmpa=magma", "'cmap'"), ("clim=[2, 0]", "the lower first"), ("magma", "KEY=VALUE")):
        with pytest.raises(InputError, match=told):
            as_shown(output, None, [wrong], None)


@pytest.mark.parametrize("given", [{"field": "grad"}, {"field": "error", "frames": True}])
def test_what_a_picture_cannot_show_is_refused(given):
    with pytest.raises(SceneError, match="field"):
        PictureRequest(**given)
