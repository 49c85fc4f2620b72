"""Meshes and clouds of other libraries are surfaces of scenes as they are."""

from types import SimpleNamespace

import numpy as np
import pytest

import cpmkit as ck

SPHERE = ck.source("analytic.sphere")
VERTICES, FACES = SPHERE.mesh(0.3)
QUERIES = np.array([[0.0, 0.0, 2.0], [1.0, 1.0, 0.5], [-0.3, 0.2, 0.1]])


class Tensor:
    def __init__(self, array):
        self.array = array

    def numpy(self):
        return self.array


def trimesh_mesh():
    return pytest.importorskip("trimesh").Trimesh(VERTICES, FACES, process=False)


def pyvista_mesh():
    flat = np.concatenate([np.full((len(FACES), 1), 3), FACES], axis=1)
    return pytest.importorskip("pyvista").PolyData(VERTICES, flat.ravel())


def meshio_mesh():
    return pytest.importorskip("meshio").Mesh(VERTICES, [("triangle", FACES)])


MESHES = {
    "vertices and faces": lambda: (VERTICES, FACES),
    "lists": lambda: [VERTICES.tolist(), FACES.tolist()],
    "trimesh": trimesh_mesh,
    "pyvista": pyvista_mesh,
    "meshio": meshio_mesh,
    "as open3d has it": lambda: SimpleNamespace(vertices=VERTICES, triangles=FACES),
    "as tensors of open3d": lambda: SimpleNamespace(
        vertex=SimpleNamespace(positions=Tensor(VERTICES)), triangle=SimpleNamespace(indices=Tensor(FACES))
    ),
}
CLOUDS = {
    "trimesh": lambda: pytest.importorskip("trimesh").PointCloud(VERTICES),
    "pyvista": lambda: pytest.importorskip("pyvista").PolyData(VERTICES),
    "as open3d has it": lambda: SimpleNamespace(points=VERTICES, normals=np.zeros((0, 3))),
    "with normals": lambda: SimpleNamespace(points=VERTICES, normals=VERTICES),
}


@pytest.mark.parametrize("make", [pytest.param(make, id=name) for name, make in MESHES.items()])
def test_a_mesh_is_the_source_of_its_triangles(make):
    own = ck.source("mesh.triangles", vertices=VERTICES, faces=FACES)
    given = ck.Scene(make(), ck.ScreenedPoisson("x*y")).surface
    np.testing.assert_allclose(given.closest_point(QUERIES).points, own.closest_point(QUERIES).points, atol=1e-6)


@pytest.mark.parametrize("make", [pytest.param(make, id=name) for name, make in CLOUDS.items()])
def test_points_alone_are_a_cloud(make):
    given = ck.Scene(make(), ck.ScreenedPoisson("x*y")).surface
    assert "PointCloud" in type(given).__name__
    assert np.abs(np.linalg.norm(given.closest_point(QUERIES).points, axis=1) - 1).max() < 0.01


def test_what_is_no_surface_is_refused():
    pyvista = pytest.importorskip("pyvista")
    for wrong, told in (
        (pyvista.Line(), "PolyData with lines"),
        (3.0, "closest_point"),
        ((VERTICES, VERTICES), "faces"),
    ):
        with pytest.raises(ck.CpmkitError, match=told):
            ck.Scene(wrong, ck.ScreenedPoisson("x*y"))
