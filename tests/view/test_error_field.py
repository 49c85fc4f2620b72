"""The estimated error is a field like the solution: drawn, and saved beside it."""

import numpy as np
import pytest
from click.testing import CliRunner

import cpmkit as ck
from cpmkit.cli import main
from cpmkit.errors import InputError, SceneError
from cpmkit.saving.results import check_request
from cpmkit.scenefile.look import OutputRequest, PictureRequest

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
    error = jumping.error.on_mesh(jumping.display_mesh())
    low, high = float(error.min()), float(error.max())
    drawn = [tmp_path / "error.png", tmp_path / "same.png", tmp_path / "other.png"]
    for file, options in zip(drawn, ({}, {"clim": (low, high)}, {"clim": (low, 2 * high)}), strict=True):
        assert jumping.picture(file, width=300, field="error", **options).file.is_file()
    assert drawn[0].read_bytes() == drawn[1].read_bytes() != drawn[2].read_bytes()
    with pytest.raises(InputError, match="field of a picture must be 'solution' or 'error', got 'grad'"):
        jumping.picture(tmp_path / "error.png", field="grad")


def test_a_scene_file_asks_for_a_picture_of_the_error(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ball.toml").write_text(SCENE + 'picture = { field = "error", width = 200 }\n')
    done = CliRunner().invoke(main, ["solve", "ball.toml"])
    assert done.exit_code == 0, done.output
    assert (
        "error      largest error about" in done.output
    )  # it took less than a second, and is estimated for the picture
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


def test_the_command_line_says_how_the_picture_looks(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ball.toml").write_text(SCENE + 'picture = { file = "ball.png", cmap = "gray", edges = true }\n')
    look = {"cmap": "magma", "clim": [0, 2], "isolines": 3, "title": "two words", "up": "y"}
    said = [word for key, value in look.items() for word in ("--look", f"{key}={value}")]
    done = CliRunner().invoke(main, ["solve", "ball.toml", *said])
    assert done.exit_code == 0, done.output
    loaded = ck.load_scene("ball.toml")
    solution = ck.solve(loaded.scene, loaded.spacing)
    solution.picture("same.png", edges=True, **look)
    assert (tmp_path / "out" / "ball.png").read_bytes() == (tmp_path / "same.png").read_bytes()
    for wrong, message in (("cmpa=magma", "'cmap'"), ("clim=[2, 0]", "the lower first"), ("magma", "KEY=VALUE")):
        refused = CliRunner().invoke(main, ["solve", "ball.toml", "--look", wrong])
        assert refused.exit_code == 1
        assert message in refused.output


def test_a_film_beside_a_picture_of_the_error_is_refused_before_anything_is_solved(tmp_path):
    request = OutputRequest(tmp_path, ("film.gif",), PictureRequest(field="error"))
    with pytest.raises(InputError, match=r"'film\.gif' shows frames"):
        check_request(request, ck.source("analytic.sphere"), tmp_path)


@pytest.mark.parametrize("given", [{"field": "grad"}, {"field": "error", "frames": True}])
def test_fields_that_a_picture_cannot_show_are_refused(given):
    with pytest.raises(SceneError, match="field"):
        PictureRequest(**given)
