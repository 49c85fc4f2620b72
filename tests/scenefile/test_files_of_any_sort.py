"""Whatever stands where a file is due, one sentence answers; and what is in a file of another sort is not repeated."""

import os
import signal
import struct

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.files.whole_files import find_file

FORMS = pytest.mark.parametrize("form", ["collocation", "galerkin"])
READERS = [
    ("mesh.polyline", {}),
    ("points", {}),
    ("pointcloud.points", {}),
    ("levelset.grid", {"spacing": 1.0}),
]


def npy(header, data=b""):
    text = header.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


DAMAGED = {
    "claims.npy": npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 3), }"),
    "short.npy": npy("{'descr': '<f8', 'fortran_order': False, 'shape': (9, 3), }", bytes(50)),
    "header.npy": npy("{'descr': '<f8', 'fortran_order': False, 'shape': (9, "),
    "indented.npy": npy("\n  {'descr'\n :: 3"),
    "negative.npy": npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-9, -3), }"),
    "objects.npy": npy("{'descr': '|O', 'fortran_order': False, 'shape': (1, 3), }", b"cos\nsystem\n"),
    "words.npy": npy("{'descr': '<U5', 'fortran_order': False, 'shape': (0, 3), }"),
    "empty.npy": b"",
    "text.npy": b"root:x:0:password=hunter2\n",
}


@pytest.mark.parametrize("name", DAMAGED)
@pytest.mark.parametrize(("kind", "keys"), READERS)
def test_an_array_file_that_is_none_is_refused(tmp_path, kind, keys, name):
    (tmp_path / name).write_bytes(DAMAGED[name])
    with pytest.raises(ck.InputError, match=name) as error:
        ck.source(kind, file=tmp_path / name, **keys)
    text = str(error.value)
    assert text.endswith(".")
    assert "hunter2" not in text
    assert "allow_pickle" not in text


@pytest.mark.parametrize("name", DAMAGED)
def test_a_file_of_vertex_data_that_is_none_is_refused(tmp_path, name):
    (tmp_path / name).write_bytes(DAMAGED[name])
    (tmp_path / "scene.toml").write_text(f"""
[surface]
kind = "analytic.sphere"
[[boundary]]
kind = "points"
at = [[0, 0, 1.0], [1, 0, 0]]
both = {{ dirichlet = {{ values = "{name}" }} }}
[problem]
kind = "laplace"
""")
    with pytest.raises(ck.InputError, match=name):
        ck.load_scene(tmp_path / "scene.toml")


@pytest.mark.parametrize("suffix", ["xyz", "csv", "txt", "ply"])
def test_a_cloud_that_is_none_is_not_repeated(tmp_path, suffix):
    (tmp_path / f"a.{suffix}").write_text("1 2 3\nroot:x:0:password=hunter2\n")
    with pytest.raises(ck.InputError, match="does not parse as") as error:
        ck.source("pointcloud.points", file=tmp_path / f"a.{suffix}")
    assert "hunter2" not in str(error.value)


def test_a_cloud_in_a_ply_file_opens_no_picture(tmp_path):
    """A named pipe that nobody writes to: whoever opens it waits for ever, here ten seconds."""
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.alarm(10)
    os.mkfifo(tmp_path / "pipe.png")
    head = "ply\nformat ascii 1.0\ncomment TextureFile pipe.png\nelement vertex 3\n"
    head += "property float x\nproperty float y\nproperty float z\nend_header\n"
    (tmp_path / "a.ply").write_text(head + "0 0 0\n1 0 0\n0 1 0\n")
    assert ck.source("pointcloud.points", file=tmp_path / "a.ply", method="nearest").value_count == 3
    signal.alarm(0)


@pytest.mark.parametrize("file", [3, True, ["a"], None, 2.5, "a" * 300, "a\0b", "", "a/" * 3000])
@pytest.mark.parametrize(("kind", "keys"), [*READERS, ("mesh.triangles", {})])
def test_what_is_no_path_is_refused(kind, keys, file):
    with pytest.raises(ck.InputError) as error:
        ck.source(kind, file=file, **keys)
    assert str(error.value).endswith(".")
    assert len(str(error.value)) < 800
    with pytest.raises(ck.InputError, match="file"):
        find_file(file)


@pytest.mark.parametrize("folder", ["x" * 5000, "a/" * 3000])
def test_a_folder_of_data_that_cannot_be_named(monkeypatch, folder):
    monkeypatch.setenv("CPMKIT_DATA", folder)
    with pytest.raises(ck.InputError, match=r"no file 'a\.npy'; looked in") as error:
        find_file("a.npy")
    assert len(str(error.value)) < 800


def test_a_folder_of_data_that_may_not_be_searched(monkeypatch, tmp_path):
    """Simulated, for the administrator may search all."""
    import pathlib

    def refused(self):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setenv("CPMKIT_DATA", str(tmp_path))
    monkeypatch.setattr(pathlib.Path, "is_file", refused)
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(ck.InputError, match=r"\(which may not be searched\)"):
        find_file("a.npy")


def sphere(radius):
    return ck.source("analytic.sphere", radius=radius)


CORNERS = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [-1, -1, -1]])


@pytest.mark.parametrize("size", [1e308, 1e150, 1e-150, 5e-324])
@pytest.mark.parametrize(
    "make",
    [
        lambda size: ck.source("analytic.sphere", radius=size),
        lambda size: ck.source("analytic.torus", major=2 * size if size < 1 else size, minor=size),
        lambda size: ck.source("analytic.cylinder", length=size),
        lambda size: ck.source("analytic.sphere", scale=size),
        lambda size: ck.source("points", at=size * CORNERS),
        lambda size: ck.source("pointcloud.points", points=size * CORNERS),
        lambda size: ck.source("mesh.polyline", points=size * CORNERS),
        lambda size: ck.source("mesh.triangles", vertices=size * CORNERS, faces=[[0, 1, 2]]),
    ],
)
def test_sizes_whose_squares_are_no_numbers_are_refused(make, size):
    with pytest.raises(ck.InputError, match="unit of length"):
        make(size)


def test_positions_whose_squares_are_no_numbers_are_refused():
    with pytest.raises(ck.InputError, match=r"upper must lie within 1e\+50 of zero, got 1e\+300"):
        ck.source("analytic.box", lower=[0, 0], upper=[1, 1e300])
    with pytest.raises(ck.InputError, match="center must lie within"):
        ck.source("analytic.sphere", center=[0, 0, 1e300])


@pytest.mark.parametrize("value", [[0, [0, 0], 0], [-1, ["x"]], "abc", 3, np.zeros((3, 2)), None])
def test_positions_that_are_none_are_refused(value):
    for keys in ({"kind": "analytic.box", "lower": value, "upper": [1, 1]}, {"kind": "analytic.point", "at": value}):
        with pytest.raises(ck.InputError, match="must be"):
            ck.source(**keys)


@pytest.mark.parametrize("call", [ck.solve, ck.explain])
@FORMS
@pytest.mark.parametrize("spacing", [5e-324, 1e-300, 1e-13])
def test_a_spacing_too_small_to_number_the_nodes_is_refused(call, spacing, form):
    with pytest.raises(ck.CpmkitError, match="spacing"):
        call(ck.Scene(sphere(1.0), ck.ScreenedPoisson(1.0)), spacing, form=form)


@pytest.mark.parametrize("far", [1.5e20, 1e12, 1e30])
@pytest.mark.parametrize("call", [ck.solve, ck.explain])
@FORMS
def test_one_vertex_far_away_is_refused_before_anything_is_allocated(call, far, form):
    corners = np.concatenate([CORNERS, [[0, 0, -far]]])
    mesh = ck.source("mesh.triangles", vertices=corners, faces=[[0, 1, 2], [0, 1, 4]])
    with pytest.raises(ck.ResolutionError, match=r"spacing=0\.25"):
        call(ck.Scene(mesh, ck.ScreenedPoisson(1.0)), 0.25, form=form)


@pytest.mark.parametrize("value", [1e150, -1e308])
def test_data_whose_squares_are_no_numbers_are_refused(value):
    with pytest.raises(ck.InputError, match=r"must be at most 1e\+100 in size"):
        ck.solve(ck.Scene(sphere(1.0), ck.ScreenedPoisson(value)), 0.4)


def test_a_source_with_bounds_that_are_none_is_named():
    class Endless:
        dim, manifold_dim, exact = 3, 2, True
        bounds = np.array([[-1, -1, -1], [1, 1, np.inf]])

        def closest_point(self, x):
            return sphere(1.0).closest_point(x)

    with pytest.raises(ck.CpmkitError, match="bounds"):
        ck.solve(ck.Scene(Endless(), ck.ScreenedPoisson(1.0)), 0.3)
