"""Every format gives the cloud that was written, and what cannot be read is answered with what can."""

import builtins
import sys

import numpy as np
import pytest
import trimesh
from cpmkit_pointcloud import points, read_points
from cpmkit_pointcloud.conformance import sphere_samples

from cpmkit.errors import InputError, MissingDependencyError

CLOUD = sphere_samples(50).astype(np.float32).astype(float)


def written(folder, name, cloud=CLOUD):
    file = folder / name
    if name.endswith(".npy"):
        np.save(file, cloud)
    elif name.lower().endswith(".ply"):
        trimesh.PointCloud(cloud).export(file, file_type="ply")
    else:
        np.savetxt(file, cloud, delimiter="," if name.endswith(".csv") else " ")
    return file


@pytest.mark.parametrize("name", ["a.ply", "a.PLY", "a.xyz", "a.txt", "a.csv", "a.npy"])
def test_a_cloud_survives_the_file(tmp_path, name):
    np.testing.assert_allclose(read_points(written(tmp_path, name)), CLOUD, rtol=1e-6)
    source = points(file=str(written(tmp_path, name)), method="nearest")
    assert source.value_count == 50


def test_further_columns_of_text_are_left_and_two_columns_are_the_plane(tmp_path):
    coloured = np.hstack([CLOUD, CLOUD])
    np.testing.assert_allclose(read_points(written(tmp_path, "a.xyz", coloured)), CLOUD)
    assert points(file=written(tmp_path, "b.csv", CLOUD[:, :2]), method="nearest").dim == 2


def test_normals_come_from_a_file_too(tmp_path):
    source = points(points=CLOUD, normals=written(tmp_path, "n.npy"))
    feet = source.closest_point(CLOUD)
    assert (np.einsum("ij,ij->i", source.normals(feet), CLOUD) > 0.9).all()


def test_the_vertices_of_a_mesh_are_a_cloud(tmp_path):
    file = tmp_path / "box.ply"
    trimesh.creation.box().export(file)
    assert read_points(file).shape == (8, 3)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.obj", "", "accepted are .ply, .xyz, .txt, .csv, .npy, .pcd"),
        ("a.ply", "nothing of the kind\n", "does not parse as PLY"),
        ("a.npy", "nothing of the kind\n", "is not a .npy file with an array of points"),
        ("a.xyz", "1 2 3\nnothing\n", "does not parse as XYZ"),
        ("a.csv", "1,2,3\n1,2\n", "does not parse as CSV"),
        ("a.txt", "1 2 3\n1 2 nan\n", "points must be finite: 1 of 2"),
    ],
)
def test_files_that_hold_no_cloud_are_named(tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=message):
        points(file=tmp_path / name)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"There is no file '.*missing\.ply'"):
        points(file=tmp_path / "missing.ply")


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (ModuleNotFoundError("No module named 'open3d'"), "pip install open3d, or save the cloud as PLY"),
        (ImportError("libusb-1.0.so.0: cannot open shared object file"), "apt-get install libusb-1.0-0"),
        (OSError("libGL.so.1: cannot open shared object file"), "cannot load: libGL.so.1"),
    ],
)
def test_what_open3d_lacks_is_named(tmp_path, monkeypatch, error, message):
    """PCD files are the only thing that needs Open3D."""
    file, plain = tmp_path / "a.pcd", builtins.__import__
    file.write_text("VERSION .7\n")

    def broken(name, *rest, **more):
        if name == "open3d":
            raise error
        return plain(name, *rest, **more)

    monkeypatch.delitem(sys.modules, "open3d", raising=False)
    monkeypatch.setattr(builtins, "__import__", broken)
    with pytest.raises(MissingDependencyError, match=message):
        points(file=file)
