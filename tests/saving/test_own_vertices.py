"""Values at the vertices of a mesh as it was given, in its order, whatever was welded, mended or is in no face."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.errors import InputError, MissingDependencyError

SUFFIXES = (".vtp", ".vtu", ".ply", ".obj", ".csv", ".npz")


def soup():
    """Return an octahedron, split twice, in which each triangle has vertices of its own, and three vertices more."""
    corners = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
    triangles = corners[faces]
    for _ in range(2):
        a, b, c = (triangles[:, k] for k in range(3))
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(part, axis=1) for part in parts])
    triangles /= np.linalg.norm(triangles, axis=2, keepdims=True)
    vertices = np.concatenate([[[9.0, 9.0, 9.0], [np.nan, 0, 0]], triangles.reshape(-1, 3), [[0, 0, 1.0]]])
    faces = 2 + np.arange(3 * len(triangles)).reshape(-1, 3)
    return vertices, np.concatenate([faces, faces[:1]])[::-1].copy()


@pytest.fixture(scope="module")
def welded():
    vertices, faces = soup()
    surface = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    return ck.solve(ck.Scene(surface, ck.ScreenedPoisson(lambda x: 3 * x[:, 2])), 0.25), vertices, faces


def test_there_is_a_value_a_vertex_in_their_order(welded):
    solution, vertices, _ = welded
    values = solution.at_vertices()
    assert values.shape == (len(vertices),)
    assert np.isnan(values[:2]).all()  # far from the surface, and nowhere
    assert np.array_equal(values[2:], solution.evaluate(vertices[2:]))
    assert np.abs(values[2:] - vertices[2:, 2]).max() < 0.1  # -Lap z + z = 3 z on the sphere
    assert values[-1] == solution.evaluate([[0, 0, 1.0]])[0]  # in no face, but on the surface


def test_every_vertex_that_is_kept_has_a_number_of_its_place(welded):
    solution, vertices, _ = welded
    surface = solution.scene.surface
    assert len(surface.vertices) < len(vertices) / 3
    np.testing.assert_array_equal(vertices[surface.given_vertices], surface.vertices)


def test_moved_meshes_and_several_channels():
    vertices, faces = soup()
    mesh = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    surface = ck.source("moved", of=mesh, scale=2.0, translation=[1.0, 0.0, 0.0])
    f = [lambda x: x[:, 0], 1.0]
    solution = ck.solve(ck.Scene(surface, ck.ScreenedPoisson(f)), 0.5)
    values = solution.at_vertices()
    assert values.shape == (len(vertices), 2)
    assert np.array_equal(values[2:], solution.evaluate(2 * vertices[2:] + [1.0, 0, 0]))


def test_sides_are_chosen_at_vertices_on_a_cut(welded):
    solution, vertices, _ = welded
    ring = ck.source("analytic.circle", normal=[0, 0, 1])
    cut = ck.Boundary("ring", ring, left=ck.Dirichlet(1.0), right=ck.Dirichlet(-1.0))
    surface = ck.source("moved", of=solution.scene.surface)
    split = ck.solve(ck.Scene(surface, ck.ScreenedPoisson(0.0), [cut]), 0.25)
    on = 2 + np.flatnonzero(np.abs(vertices[2:, 2]) < 1e-12)
    assert len(on) > 10
    assert split.at_vertices("left")[on].mean() == pytest.approx(1, abs=0.05)
    assert split.at_vertices("right")[on].mean() == pytest.approx(-1, abs=0.05)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_file_holds_the_own_vertices_faces_and_values(welded, tmp_path, suffix):
    solution, vertices, faces = welded
    path = tmp_path / f"own{suffix}"
    solution.save(path, vertices="own")
    values = solution.at_vertices()
    points, triangles, found = READERS[suffix](path)
    np.testing.assert_array_equal(points, vertices)
    if triangles is not None:
        np.testing.assert_array_equal(triangles, faces)
    if found is not None:
        np.testing.assert_array_equal(found, values)


def by_pyvista(path):
    pyvista = pytest.importorskip("pyvista")
    data = pyvista.read(path)
    cells = data.regular_faces if path.suffix == ".vtp" else data.cells.reshape(-1, 4)[:, 1:]
    return data.points, cells, data.point_data["u"]


def by_meshio(path):
    data = pytest.importorskip("meshio").read(path)
    return data.points, data.cells_dict["triangle"], data.point_data["u"]


def of_obj(path):
    lines = [line.split() for line in path.read_text().splitlines()]
    points = np.array([line[1:] for line in lines if line[0] == "v"], dtype=float)
    assert points[:, 3:].min() >= 0
    assert points[:, 3:].max() <= 1
    return points[:, :3], np.array([line[1:] for line in lines if line[0] == "f"], dtype=int) - 1, None


def of_csv(path):
    with path.open() as file:
        assert file.readline() == "x,y,z,u\n"
        table = np.loadtxt(file, delimiter=",")
    return table[:, :3], None, table[:, 3]


def of_npz(path):
    with np.load(path) as arrays:
        return arrays["points"], arrays["cells"], arrays["values"][:, 0]


READERS = {
    ".vtp": by_pyvista,
    ".vtu": by_pyvista,
    ".ply": by_meshio,
    ".obj": of_obj,
    ".csv": of_csv,
    ".npz": of_npz,
}


@pytest.mark.parametrize("suffix", [suffix for suffix in SUFFIXES if suffix != ".npz"])
def test_the_mesh_of_the_pictures_is_written_alike(torus, tmp_path, suffix):
    solution = torus(0.3, channels=1)
    solution_file = tmp_path / f"display{suffix}"
    from cpmkit.saving.saved_solutions import save

    save(solution, solution_file)
    points, triangles, values = READERS[suffix](solution_file)
    mesh = solution.display_mesh()
    np.testing.assert_array_equal(points, mesh.points)
    if triangles is not None:
        np.testing.assert_array_equal(triangles, mesh.triangles)
    if values is not None:
        np.testing.assert_array_equal(values, mesh.values[:, 0])


def test_polylines_and_clouds_have_their_points(tmp_path):
    t = np.linspace(0, 2 * np.pi, 41)
    points = np.column_stack([np.cos(t), np.sin(t)])[[0, 0, *range(1, 41)]]  # one twice, and the first again at the end
    line = ck.source("mesh.polyline", points=points)
    solution = ck.solve(ck.Scene(line, ck.ScreenedPoisson(lambda x: x[:, 0])), 0.1)
    values = solution.at_vertices()
    np.testing.assert_allclose(values, solution.evaluate(points), rtol=1e-14)
    np.testing.assert_allclose(values[[1, -1]], values[0], rtol=1e-14)  # the closing foot lies on another segment
    solution.save(tmp_path / "line.csv", vertices="own")
    assert len((tmp_path / "line.csv").read_text().splitlines()) == 43
    cloud = ck.source("pointcloud.points", points=points)
    on_cloud = ck.solve(ck.Scene(cloud, ck.ScreenedPoisson(lambda x: x[:, 0])), 0.1).at_vertices()
    assert np.abs(on_cloud - values).max() < 0.01


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
def test_solids_have_the_vertices_of_their_boundary(tmp_path, form):
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3), [[9.0, 9.0, 9.0]]])
    skin = ck.source("mesh.triangles", vertices=corners, faces=[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    solid = ck.source("moved", of=ck.source("solid", of=skin), translation=[1.0, 0.0, 0.0])
    scene = ck.Scene(solid, ck.ScreenedPoisson(lambda x: x[:, 0]), edge=ck.Dirichlet(lambda x: x[:, 0]))
    solution = ck.solve(scene, 0.1, form=form)
    np.testing.assert_allclose(solution.at_vertices(), [1, 2, 1, 1, np.nan], atol=0.01)
    solution.save(tmp_path / "solid.csv", vertices="own")
    assert len((tmp_path / "solid.csv").read_text().splitlines()) == 6


def test_a_surface_that_was_made_from_no_vertices_is_refused(tmp_path):
    solution = ck.solve(ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(1.0)), 0.3)
    for ask in (solution.at_vertices, lambda: solution.save(tmp_path / "u.csv", vertices="own")):
        with pytest.raises(InputError, match=r"was not made from vertices of yours; solution\.evaluate\(points\)"):
            ask()
    with pytest.raises(InputError, match="vertices must be 'display' or 'own', got 'mine'"):
        solution.save(tmp_path / "u.csv", vertices="mine")
    assert not list(tmp_path.iterdir())


def test_other_libraries_get_the_mesh_with_its_values(welded):
    solution, _, faces = welded
    values, mesh = solution.at_vertices(), solution.display_mesh()
    pytest.importorskip("pyvista")
    assert np.array_equal(solution.to_pyvista().point_data["u"], mesh.values[:, 0])
    pytest.importorskip("trimesh")
    made = solution.to_trimesh("own")
    assert np.array_equal(made.faces, faces)
    np.testing.assert_array_equal(made.vertex_attributes["u"], values)
    pytest.importorskip("meshio")
    np.testing.assert_array_equal(solution.to_meshio("own").point_data["u"], values)
    assert np.array_equal(solution.to_meshio().cells_dict["triangle"], mesh.triangles)


def test_what_is_not_installed_is_one_sentence(welded, monkeypatch):
    solution, _, _ = welded

    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr("cpmkit.saving.mesh_files.import_module", missing)
    for name in ("trimesh", "meshio", "polyscope"):
        with pytest.raises(MissingDependencyError, match=f"^{name} is not installed; `pip install {name}` adds it.$"):
            getattr(solution, f"to_{name}")()
