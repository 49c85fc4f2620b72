"""What a user of meshes writes: values at the own vertices, both sides of a cut, a film, a sheet of modes, a page."""

from pathlib import Path

import numpy as np
import pytest

import cpmkit as ck


def test_a_two_sided_cut_both_values_to_a_ply_of_the_own_vertices(real_mesh, tmp_path):
    meshio = pytest.importorskip("meshio")
    belly = Path(__file__).parents[2] / "examples" / "curves" / "spot-belly.npy"
    vertices, faces = ck.read_mesh(real_mesh("spot.obj"))
    spot = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    ring = ck.source("mesh.polyline", file=belly)
    cut = ck.Boundary("belly", ring, left=ck.Dirichlet(1.0), right=ck.Dirichlet(-1.0))
    solution = ck.solve(ck.Scene(spot, ck.Laplace(), [cut]), spacing=0.15)

    mesh = solution.to_meshio("own")
    mesh.point_data = {"left": solution.at_vertices("left"), "right": solution.at_vertices("right")}
    mesh.write(tmp_path / "both.ply", binary=True)

    read = meshio.read(tmp_path / "both.ply")
    assert np.array_equal(read.cells_dict["triangle"], faces)
    assert np.abs(read.points - vertices).max() == 0
    assert np.array_equal(read.point_data["left"], solution.at_vertices("left"))
    near = np.abs(np.abs(read.point_data["left"]) - 1) < 1e-2
    assert near.mean() > 0.95  # each part takes the value of its side


def test_heat_on_spot_as_a_film(real_mesh, tmp_path):
    spot = ck.source("mesh.triangles", file=real_mesh("spot.obj"))
    heat = ck.Heat(lambda x: np.exp(-20 * ((x - [0, 0.9, -0.6]) ** 2).sum(axis=1)), until=0.1, step=0.02, frames=2)
    solution = ck.solve(ck.Scene(spot, heat), spacing=0.2)
    solution.animate(tmp_path / "heat.gif", fps=6, up="y", width=160)
    assert (tmp_path / "heat.gif").stat().st_size > 5000


def test_six_modes_as_a_sheet_and_a_page(tmp_path):
    modes = ck.solve(ck.Scene(ck.source("analytic.torus"), ck.Eigen(count=6)), spacing=0.3)
    drawn = modes.picture(tmp_path / "modes.png", title="Six modes of a torus", width=300)
    modes.save(tmp_path / "modes.html", cmap="PuOr")
    assert drawn.file.stat().st_size > 5000
    assert (tmp_path / "modes.html").read_text().count("\\u03bb = ") == 6
    assert "z up" in drawn.camera
