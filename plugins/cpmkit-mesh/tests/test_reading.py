"""Every format gives the same closed surface that was written, however it split the corners."""

import numpy as np
import pytest
import trimesh
from cpmkit_mesh import read_mesh, triangles
from cpmkit_mesh.mesh_files import group_equal_rows

from cpmkit.errors import InputError

FORMATS = ["obj", "ply", "stl", "off"]


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("closest", ["smooth", "faceted"])
def test_a_troublesome_mesh_survives_the_file(tmp_path, troublesome, suffix, closest):
    soup, cells = troublesome
    file = tmp_path / f"troublesome.{suffix.upper()}"
    trimesh.Trimesh(soup, cells, process=False).export(file, file_type=suffix)
    written, read = triangles(vertices=soup, faces=cells, closest=closest), triangles(file=file, closest=closest)
    assert len(read.vertices) == len(written.vertices) == 145 + 66
    assert len(read.faces) == len(cells)
    assert set(read.adjacency.loop) == {0}
    x = np.random.default_rng(1).uniform(written.bounds[0] - 20, written.bounds[1] + 20, (2000, 3))
    one, other = written.closest_point(x), read.closest_point(x)
    np.testing.assert_allclose(one.points, other.points, atol=1e-4)
    np.testing.assert_array_equal(one.edge, other.edge)
    assert {-1, 0} == set(one.edge)


@pytest.mark.parametrize("suffix", ["obj", "off", "ply"])
def test_polygons_are_cut_into_triangles(tmp_path, suffix):
    corners = ["0 0 0", "2 0 0", "2 1 0", "0 1 0", "1 2 0"]
    obj = [f"v {c}" for c in corners] + ["o house", "f 1 2 3 4", "usemtl roof", "f 4 3 5"]
    off = ["OFF", "5 2 0", *corners, "4 0 1 2 3", "3 3 2 4"]
    kinds = [f"property float {axis}" for axis in "xyz"]
    head = ["ply", "format ascii 1.0", "element vertex 5", *kinds, "element face 2"]
    ply = [*head, "property list uchar int vertex_indices", "end_header", *corners, "4 0 1 2 3", "3 3 2 4"]
    file = tmp_path / f"house.{suffix}"
    file.write_text("\n".join({"obj": obj, "off": off, "ply": ply}[suffix]) + "\n")
    vertices, faces = read_mesh(file)
    assert vertices.shape == (5, 3)
    assert faces.shape == (3, 3)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    np.testing.assert_allclose(np.cross(b - a, c - a)[:, 2].sum() / 2, 3.0)
    assert len(triangles(file=file).adjacency.boundary) == 5


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("mesh.xyz", "", "accepted are .obj, .ply, .stl, .off"),
        ("mesh.obj", "nothing of the kind\n", "line 1 begins with no word of the format"),
        ("mesh.obj", "# nothing\n", "holds 0 vertices and 0 faces"),
        ("mesh.stl", "nothing of the kind\n", "mesh.stl"),
        ("mesh.ply", "nothing of the kind\n", "does not parse as PLY"),
        ("mesh.off", "nothing of the kind\n", "does not parse as OFF"),
        ("mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "does not parse as OBJ"),
        ("mesh.obj", "v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", "must be finite: 1 of 3"),
        ("mesh.obj", "v 0 0 0\nv 1 0 0\n", "holds 2 vertices and 0 faces"),
    ],
)
def test_files_that_hold_no_surface_are_named(tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / name)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"There is no file '.*missing\.obj'"):
        read_mesh(tmp_path / "missing.obj")
    with pytest.raises(InputError, match="There is no file"):
        read_mesh(tmp_path)


def test_welding_keeps_the_order_and_joins_only_equal_points():
    points = np.array([[2.0, 0, 0], [1, 0, 0], [2, 0, 0], [-0.0, 0, 0], [1, 0, 1e-16], [0.0, 0, 0]])
    first, place = group_equal_rows(points)
    np.testing.assert_array_equal(first, [0, 1, 3, 4])
    np.testing.assert_array_equal(place, [0, 1, 0, 2, 3, 2])


@pytest.mark.parametrize(
    ("name", "vertices", "faces", "loops"),
    [("spot.obj", 11533, 23062, 0), ("nefertiti-lowres.obj", 35002, 70000, 0), ("mountain.obj", 25600, 50562, 1)],
)
def test_real_meshes_read_as_they_are_stored(real_mesh, name, vertices, faces, loops):
    points, cells = read_mesh(real_mesh(name))
    assert (len(points), len(cells)) == (vertices, faces)
    mesh = triangles(vertices=points, faces=cells)
    assert mesh.adjacency.consistent
    assert len(set(mesh.adjacency.loop)) == loops
