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


def unstructured_grid():
    return pyvista_mesh().cast_to_unstructured_grid()


MESHES = {
    "vertices and faces": lambda: (VERTICES, FACES),
    "lists": lambda: [VERTICES.tolist(), FACES.tolist()],
    "trimesh": trimesh_mesh,
    "pyvista": pyvista_mesh,
    "unstructured grid of pyvista": unstructured_grid,
    "meshio": meshio_mesh,
    "as scikit-fem has it": lambda: SimpleNamespace(p=VERTICES.T, t=FACES.T),
    "as LaPy has it": lambda: SimpleNamespace(v=VERTICES, t=FACES),
    "as psbody has it": lambda: SimpleNamespace(v=VERTICES, f=FACES),
    "as libigl names it": lambda: SimpleNamespace(V=VERTICES, F=FACES),
    "as nilearn has it": lambda: SimpleNamespace(coordinates=VERTICES, faces=FACES),
    "as SciPy has it": lambda: SimpleNamespace(points=VERTICES, simplices=FACES),
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


#: A square of four quads beside two triangles, its points counted along x first.
MIXED_POINTS = np.array([[x, y, 0.0] for y in (0, 1, 2) for x in (0, 1, 2)] + [[3.0, 1, 0]])
QUADS = np.array([[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]])
TRIANGLES = np.array([[2, 9, 5], [5, 9, 8]])


def mixed_meshio():
    meshio = pytest.importorskip("meshio")
    blocks = [("line", np.array([[0, 1]])), ("triangle", TRIANGLES), ("quad", QUADS)]
    return meshio.Mesh(MIXED_POINTS, blocks)


def mixed_grid():
    pyvista = pytest.importorskip("pyvista")
    flat = [[4, *QUADS[0]], [3, *TRIANGLES[0]], [4, *QUADS[1][[0, 1, 3, 2]]], [3, *TRIANGLES[1]], [4, *QUADS[2]]]
    flat = np.concatenate([*flat, [4, *QUADS[3]], [2, 0, 1]])
    return pyvista.UnstructuredGrid(flat, [9, 5, 8, 7, 7, 9, 3], MIXED_POINTS)


@pytest.mark.parametrize("make", [mixed_meshio, mixed_grid])
def test_all_faces_of_a_mesh_are_read_whatever_their_number_of_corners(make):
    surface = ck.Scene(make(), ck.ScreenedPoisson("x*y")).surface
    vertices, cells = surface.mesh(1.0)
    a, b, c = (vertices[cells[:, k]] for k in range(3))
    parts = 0.5 * np.cross(b - a, c - a)[:, 2]
    np.testing.assert_allclose(np.sort(parts), np.full(10, 0.5))
    assert np.array_equal(surface.given_mesh[0], MIXED_POINTS)


@pytest.mark.parametrize("kind", ["StructuredGrid", "RectilinearGrid", "ImageData"])
def test_a_grid_of_two_dimensions_is_the_surface_of_its_quads(kind):
    pyvista = pytest.importorskip("pyvista")
    x, y = np.linspace(0, 3, 4), np.linspace(0, 2, 3)
    grid = {
        "StructuredGrid": lambda: pyvista.StructuredGrid(*np.meshgrid(x, y, [0.5], indexing="ij")),
        "RectilinearGrid": lambda: pyvista.RectilinearGrid(x, y, [0.5]),
        "ImageData": lambda: pyvista.ImageData(dimensions=(4, 3, 1), origin=(0, 0, 0.5)),
    }[kind]()
    surface = ck.Scene(grid, ck.ScreenedPoisson("x*y")).surface
    vertices, cells = surface.mesh(1.0)
    a, b, c = (vertices[cells[:, k]] for k in range(3))
    parts = 0.5 * np.cross(b - a, c - a)
    np.testing.assert_allclose(parts, np.tile([0, 0, 0.5], (12, 1)), atol=1e-12)
    assert np.array_equal(surface.given_mesh[0], grid.points)


def test_what_is_no_surface_is_refused():
    pyvista, meshio = pytest.importorskip("pyvista"), pytest.importorskip("meshio")
    tetrahedron = np.arange(4)[None]
    for wrong, message in (
        (pyvista.Line(), "PolyData with lines"),
        (3.0, r"closest_point\), or of a mesh its arrays, the pair .*, got float"),
        ((VERTICES, VERTICES), "faces"),
        (meshio.Mesh(VERTICES, [("triangle", FACES), ("tetra", tetrahedron)]), "cells of the kinds tetra; accepted"),
        (meshio.Mesh(VERTICES, [("triangle6", [range(6)])]), "cells of the kinds triangle6; accepted are triangles"),
        (meshio.Mesh(VERTICES, [("line", [[0, 1]])]), "a mesh with no faces; accepted are triangles"),
        (pyvista.ImageData(dimensions=(3, 3, 3)).cast_to_unstructured_grid(), "of the kinds number 11 of VTK"),
        (pyvista.ImageData(dimensions=(3, 3, 3)), "of the kinds number 11 of VTK"),
        (SimpleNamespace(p=VERTICES.T, t=tetrahedron.T), r"with cells of shape \(1, 4\), and triangles"),
        (SimpleNamespace(v=VERTICES, t=tetrahedron), r"with cells of shape \(1, 4\), and triangles"),
    ):
        with pytest.raises(ck.CpmkitError, match=message):
            ck.Scene(wrong, ck.ScreenedPoisson("x*y"))
