"""What is saved can be read back by others, on both sides of a boundary, and is never half a file."""

import json

import numpy as np
import pytest

from cpmkit.errors import InputError, MissingDependencyError
from cpmkit.plugin import written_whole
from cpmkit.saving.saved_solutions import check_file, save, write_summary
from cpmkit.solution.display_mesh import display_mesh

pyvista = pytest.importorskip("pyvista")


def test_vtp_holds_the_cut_mesh_with_values_and_colours(torus, tmp_path):
    solution = torus(0.2)
    save(solution, tmp_path / "torus.vtp")
    read, mesh = pyvista.read(tmp_path / "torus.vtp"), display_mesh(solution)
    np.testing.assert_allclose(read.points, mesh.points, rtol=1e-6)
    np.testing.assert_array_equal(read.regular_faces, mesh.cells)
    np.testing.assert_array_equal(read.point_data["u"], mesh.values)
    np.testing.assert_allclose(read.point_data["rgb"], 255 * np.clip(mesh.values, 0, 1), atol=0.5)
    assert read.point_data["rgb"].dtype == np.uint8


def test_one_channel_is_saved_as_one_number_a_vertex(torus, tmp_path):
    save(torus(0.3, channels=1), str(tmp_path / "torus.vtp"))
    read = pyvista.read(tmp_path / "torus.vtp")
    assert read.point_data["u"].shape == (read.n_points,)
    assert "rgb" not in read.point_data


def test_a_curve_in_the_plane_is_saved_as_lines(square, tmp_path):
    solution = square(3)
    object.__setattr__(solution.surface, "cells", np.array([[0, 1], [1, 2], [2, 3]]))
    save(solution, tmp_path / "curve.vtp")
    assert pyvista.read(tmp_path / "curve.vtp").n_lines == 3


def test_a_mixture_is_saved_as_triangles_lines_and_points(mixture, tmp_path):
    solution = mixture()
    save(solution, tmp_path / "mixture.vtp")
    read, mesh = pyvista.read(tmp_path / "mixture.vtp"), display_mesh(solution)
    np.testing.assert_array_equal(read.verts.reshape(-1, 2)[:, 1], mesh.dots)
    np.testing.assert_array_equal(read.lines.reshape(-1, 3)[:, 1:], mesh.segments)
    np.testing.assert_array_equal(read.faces.reshape(-1, 4)[:, 1:], mesh.triangles)
    np.testing.assert_array_equal(read.point_data["u"], mesh.values[:, 0])
    save(solution, tmp_path / "mixture.npz")
    with np.load(tmp_path / "mixture.npz") as arrays:
        np.testing.assert_array_equal(arrays["cells"], mesh.cells)
    save(solution, tmp_path / "mixture.ply")
    header = (tmp_path / "mixture.ply").read_bytes()[:400]
    assert f"element vertex {len(mesh.points)}".encode() in header
    assert f"element face {len(mesh.triangles)}".encode() in header


@pytest.mark.parametrize("suffix", [".vtp", ".ply"])
def test_a_cloud_is_saved_as_points(mixture, tmp_path, suffix):
    solution = mixture(channels=3)
    object.__setattr__(solution.surface, "cells", np.arange(50)[:, None])
    save(solution, tmp_path / f"cloud{suffix}")
    read = pyvista.read(tmp_path / f"cloud{suffix}")
    np.testing.assert_allclose(read.points[:50], solution.surface.points[:50], atol=1e-7)
    assert (read.n_lines, len(read.faces)) == (0, 0)


@pytest.mark.parametrize("channels", [1, 3])
def test_ply_holds_a_colour_a_vertex(torus, tmp_path, channels):
    solution = torus(0.3, channels)
    save(solution, tmp_path / "torus.ply")
    header = (tmp_path / "torus.ply").read_bytes()[:400]
    assert b"property uchar red" in header
    assert f"element vertex {len(display_mesh(solution).points)}".encode() in header


def test_npz_holds_the_mesh_and_what_a_solution_is_rebuilt_from(torus, tmp_path):
    solution = torus(0.3)
    save(solution, tmp_path / "torus.npz")
    with np.load(tmp_path / "torus.npz") as read:
        np.testing.assert_array_equal(read["values"], display_mesh(solution).values)
        assert read["original"] == len(solution.surface.points)
        np.testing.assert_array_equal(read["lattice_unknowns"], solution.arrays()["unknowns"])


def test_npz_does_without_a_mesh(square, tmp_path):
    solution = square(2)
    object.__setattr__(solution, "surface", object())
    save(solution, tmp_path / "raw.npz")
    with np.load(tmp_path / "raw.npz") as read:
        assert set(read) == {"lattice_origin", "lattice_unknowns", "format", "summary"}


def test_json_is_the_summary(square, tmp_path):
    save(square(2), tmp_path / "summary.json")
    assert json.loads((tmp_path / "summary.json").read_text()) == square(2).summary()


def test_an_unknown_suffix_is_answered_with_the_accepted_ones(square, tmp_path):
    with pytest.raises(InputError, match=r"'u\.xyz'; accepted are \.vtp, \.vtu, \.ply, \.obj, \.csv, \.npz, \.json"):
        save(square(2), tmp_path / "u.xyz")


def test_a_surface_without_a_mesh_is_refused_before_anything_is_solved():
    with pytest.raises(InputError, match="has no method mesh"):
        check_file("u.vtp", object())


def test_without_pyvista_the_extra_is_named(square, monkeypatch):
    monkeypatch.setattr("cpmkit.saving.saved_solutions.find_spec", lambda name: None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'cpmkit\[view\]'"):
        check_file("u.vtp", square(2).surface)


@pytest.mark.parametrize("file", ["film.gif", "page.html"])
def test_without_matplotlib_films_and_pages_are_refused_before_anything_is_solved(file, square, monkeypatch):
    monkeypatch.setattr("cpmkit.view.pictures.find_spec", lambda name: None)
    with pytest.raises(MissingDependencyError, match="need matplotlib"):
        check_file(file, square(2).surface)


def test_what_fails_half_way_leaves_the_earlier_file_and_no_other(tmp_path):
    def fail(path):
        with written_whole(path) as unfinished:
            unfinished.write_text("half")
            raise ZeroDivisionError

    path = tmp_path / "u.txt"
    path.write_text("earlier")
    with pytest.raises(ZeroDivisionError):
        fail(path)
    assert [found.name for found in tmp_path.iterdir()] == ["u.txt"]
    assert path.read_text() == "earlier"


def test_a_folder_that_is_not_there_is_one_sentence(tmp_path):
    with pytest.raises(InputError, match=r"summary\.json cannot be written: No such file or directory\.$"):
        write_summary({}, tmp_path / "absent" / "summary.json")
