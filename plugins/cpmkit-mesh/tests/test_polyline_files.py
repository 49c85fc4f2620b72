"""Polylines are read from rows of numbers and from the line of an OBJ file."""

import numpy as np
import pytest
from cpmkit_mesh import polyline

from cpmkit.errors import InputError

BEND = np.array([[0.0, 0.0, 0.25], [1.0, 0.5, 0.0], [2.0, 0.0, -1e-3]])
VERTICES = "".join(f"v {x} {y} {z}\n" for x, y, z in BEND)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", "# drawn by hand\n0,0,0.25\n1, 0.5, 0\n\n2,0,-1e-3\n"),
        ("a.txt", "0 0 0.25\n1 0.5 0\n2 0 -1e-3"),
        ("a.obj", f"o curve\n{VERTICES}l 1 2 3\n"),
        ("a.OBJ", f"{VERTICES}l 1 2\nl 2 -1\n"),
    ],
)
def test_a_file_is_read_as_its_points(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    read = polyline(file=tmp_path / name)
    np.testing.assert_array_equal(read.vertices, BEND)
    assert len(read.segments) == 2


def test_a_line_that_returns_is_closed_and_rows_of_two_are_in_the_plane(tmp_path):
    (tmp_path / "a.obj").write_text(f"{VERTICES}l 2 3 1 2\n")
    ring = polyline(file=tmp_path / "a.obj")
    assert ring.segments[-1].tolist() == [2, 0]
    np.testing.assert_array_equal(ring.vertices, BEND[[1, 2, 0]])
    (tmp_path / "a.csv").write_text("0,0\n1,2\n")
    assert polyline(file=tmp_path / "a.csv").dim == 2


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "", "'a.csv' is no polyline: it holds no point"),
        ("a.csv", "x,y,z\n0,0,0\n", "line 1 holds something else than numbers"),
        ("a.csv", "0,0,0\n1,1\n", "line 2 holds 2 numbers, and the first point has 3"),
        ("a.csv", "0,0,0,0\n1,1,1,1\n", "must have shape"),
        ("a.obj", VERTICES, "holds no line, which begins with l"),
        ("a.obj", f"{VERTICES}l 1 2\nl 3 1\n", "line 5 begins a second line"),
        ("a.obj", f"{VERTICES}l 1 4\n", "names vertex 4, and there are 3"),
        ("a.obj", "v 0 0\nl 1 1\n", "line 1 holds no vertex of three coordinates"),
        ("nowhere.csv", None, "no file"),
    ],
)
def test_what_is_no_polyline_is_refused(tmp_path, name, text, message):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message):
        polyline(file=tmp_path / name)
