"""A mesh file is read as it is written, or refused in a sentence that does not repeat what is in it."""

import os
import signal
import struct

import numpy as np
import pytest
import trimesh
from cpmkit_mesh import read_mesh

from cpmkit.errors import InputError

VERTICES = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n"
FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
PLY = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
PLY += "element face {}\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n"


def written(folder, name, content):
    file = folder / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return file


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.obj", VERTICES + "f 0 1 2\n", "line 5 names vertex 0, and OBJ counts vertices from 1"),
        ("a.obj", VERTICES + "f 1 2 3\nf 2 3", "line 6 holds a face of 2 corners"),
        ("a.obj", VERTICES + "f 1 2 3\nf 2 3 4.0", "line 6 holds something else than numbers of vertices"),
        ("a.obj", VERTICES + "f 1 2 99999999999999999999\n", "line 5 holds something else than numbers of vertices"),
        ("a.obj", VERTICES + "f 1 2 5\n", "line 5 names vertex 5, and there are 4"),
        ("a.obj", VERTICES + "f 1 2 -5\n", "line 5 names vertex -5, and there are 4"),
        ("a.obj", VERTICES + "v 1 1\nf 1 2 3\n", "line 5 holds no vertex of three coordinates"),
        ("a.obj", VERTICES + "v 1 1 1 0.5\nf 1 2 3\n", "line 5 holds no vertex of three coordinates"),
        ("a.obj", VERTICES + "v 1 1 1_0\nf 1 2 3\n", "line 5 holds something else than numbers"),
        ("a.obj", VERTICES + "surf 0 1 0 1 1 2\nf 1 2 3\n", "line 5 begins with a free-form surface"),
        ("a.obj", VERTICES + "call other.obj\nf 1 2 3\n", "line 5 begins with a call of another file"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n3 0 1 2\n", "says 3 vertices and 1 faces, and has 3 lines for them"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "line 6 says 3 corners and has 2"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "line 6 names vertex 3"),
        ("a.off", "OFF\n3 -1 0\n", "does not say how many vertices and faces"),
        ("a.stl", "solid a\n" + FACET, "its last line is no endsolid: it is cut off"),
        ("a.stl", "solid a\n" + FACET + FACET[19:] + "endsolid\n", "line 9 begins otherwise than with facet"),
        ("a.stl", "solid a\n" + FACET[:-9] + "endsolid\n", "its last triangle, which begins in line 2, is cut off"),
        ("a.stl", "solid a\n" + FACET.replace("1 0 0", "1 0") + "endsolid\n", "line 5 holds no vertex"),
        ("a.stl", "solid a\n" + FACET.replace("1 0 0", "1 0 x") + "endsolid\n", "line 5 holds something else"),
        ("a.stl", bytes(80) + struct.pack("<I", 3) + bytes(100), "it says 3 triangles, and is as long as one of 2"),
        ("a.ply", PLY.format(1)[:150], "its header has no end_header"),
        ("a.ply", PLY.format(2) + "3 0 1 2\n", "it says that it has 2 rows of 'face', and ends before"),
        ("a.ply", PLY.format(1) + "3 0 1 2\n3 0 1 2\n", "it goes on after the last row"),
        ("a.ply", PLY.format(1) + "2 0 1\n", "face 1 has 2 corners, three are needed"),
        ("a.ply", PLY.format(1) + "3 0 1 3\n", "face 1 names a vertex that is not one of 0 to 2"),
        ("a.ply", PLY.format(1) + "3 0 1 1.5\n", "face 1 names a vertex that is not one of 0 to 2"),
        ("a.ply", PLY.format(10**12) + "3 0 1 2\n", "and ends before: it is cut off or damaged"),
        ("a.ply", PLY.format(1).replace("face 1", "face one"), "line 7 of its header is damaged"),
    ],
)
def test_damaged_files_are_refused_with_the_place(tmp_path, name, content, message):
    with pytest.raises(InputError, match=message) as error:
        read_mesh(written(tmp_path, name, content))
    assert str(error.value).endswith(".")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off"])
def test_what_is_in_a_file_that_is_no_mesh_is_not_repeated(tmp_path, suffix):
    heads = {"obj": "v ", "ply": PLY.format(1), "stl": "solid a\n", "off": "OFF\n3 1 0\n"}
    for head in ("", heads[suffix]):
        with pytest.raises(InputError) as error:
            read_mesh(written(tmp_path, f"a.{suffix}", head + "root:x:0:password=hunter2\n" * 3))
        assert "hunter" not in str(error.value)


def test_a_byte_order_mark_is_no_part_of_the_first_line(tmp_path):
    mark = b"\xef\xbb\xbf"
    plain = read_mesh(written(tmp_path, "a.obj", VERTICES + "f 1 2 3\nf 2 4 3\n"))
    marked = read_mesh(written(tmp_path, "b.obj", mark + VERTICES.encode() + b"f 1 2 3\nf 2 4 3\n"))
    np.testing.assert_array_equal(plain[0], marked[0])
    np.testing.assert_array_equal(plain[1], marked[1])


def test_all_ways_to_write_a_face_in_obj(tmp_path):
    text = "\tv 0 0 0 1.0\r\nv 1 0 0 .5 .5 .5\r\nv 0 1 0 # last\r\nmtllib nowhere.mtl\r\nvt 0 0\r\n"
    text += "f 1/1 2/1 3/1\r\nf -3//1 -2//1 -1//1\r\nf 1 \\\r\n 2 3\r\nv 9 9 9\r\nf 1/1/1 2/1/1 4/1/1\r\n"
    vertices, faces = read_mesh(written(tmp_path, "a.obj", text))
    np.testing.assert_array_equal(vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 9, 9]])
    np.testing.assert_array_equal(faces, [[0, 1, 2], [0, 1, 2], [0, 1, 2], [0, 1, 3]])


@pytest.mark.parametrize("order", ["little", "big"])
def test_triangles_and_polygons_in_one_binary_ply(tmp_path, order):
    sign = {"little": "<", "big": ">"}[order]
    points = [[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [1, 2, 0]]
    head = f"ply\nformat binary_{order}_endian 1.0\nelement vertex 5\nproperty double x\nproperty double y\n"
    head += "property double z\nproperty uchar red\nelement face 2\nproperty list uchar int vertex_index\n"
    head += "property list uchar float texcoord\nelement edge 1\nproperty int vertex1\nend_header\n"
    body = b"".join(struct.pack(sign + "dddB", *point, 7) for point in points)
    body += struct.pack(sign + "BiiiiB", 4, 0, 1, 2, 3, 0) + struct.pack(sign + "BiiiBff", 3, 3, 2, 4, 2, 0.5, 0.5)
    vertices, faces = read_mesh(written(tmp_path, "a.ply", head.encode() + body + struct.pack(sign + "i", 3)))
    np.testing.assert_array_equal(vertices, points)
    np.testing.assert_array_equal(faces, [[0, 1, 2], [0, 2, 3], [3, 2, 4]])


def test_polygons_that_are_not_convex_do_not_fold_over(tmp_path):
    arrow = "OFF\n4 1 0\n0 0 0\n2 -1 0\n1 0 0\n2 1 0\n4 1 2 3 0\n"
    vertices, faces = read_mesh(written(tmp_path, "a.off", arrow))
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    np.testing.assert_allclose(np.cross(b - a, c - a)[:, 2], [1, 1])


def test_off_may_stand_beside_the_number_of_vertices(tmp_path):
    vertices, faces = read_mesh(written(tmp_path, "a.off", "OFF3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"))
    assert (vertices.shape, faces.tolist()) == ((3, 3), [[0, 1, 2]])


@pytest.fixture
def ten_seconds():
    """Fail, not wait for ever."""
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.alarm(10)
    yield
    signal.alarm(0)


@pytest.mark.usefixtures("ten_seconds")
@pytest.mark.parametrize("suffix", ["obj", "ply"])
def test_files_that_a_mesh_names_are_not_opened(tmp_path, suffix):
    """A named pipe that nobody writes to: whoever opens it waits for ever."""
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd pipe.png\n")
    obj = f"mtllib a.mtl\nmtllib pipe.png\n{VERTICES}vt 0 0\nusemtl a\nf 1/1 2/1 3/1\n"
    ply = PLY.format(1).replace("1.0\n", "1.0\ncomment TextureFile pipe.png\n") + "3 0 1 2\n"
    assert len(read_mesh(written(tmp_path, f"a.{suffix}", {"obj": obj, "ply": ply}[suffix]))[1]) == 1


@pytest.mark.parametrize("name", ["spot.obj", "koala.obj", "nefertiti-lowres.obj"])
def test_real_meshes_are_read_as_another_library_reads_them(real_mesh, name):
    vertices, faces = read_mesh(real_mesh(name))
    other = trimesh.load_mesh(real_mesh(name), process=False, maintain_order=True, skip_materials=True)
    np.testing.assert_array_equal(vertices[faces], other.vertices[other.faces])
