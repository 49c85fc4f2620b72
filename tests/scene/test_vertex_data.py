"""Data of one row a vertex act as the function that they sample, to the error of interpolating it."""

import numpy as np
import pytest
from model_problems import order_of, sphere_points

import cpmkit as ck

RADIUS = np.sqrt(0.91)


def u(x):
    return x[:, 0] * x[:, 1] + x[:, 2]


def polyline(count):
    angle = 2 * np.pi * np.arange(count) / count
    ring = np.stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), np.full(count, 0.3)], axis=1)
    return ck.source("mesh.polyline", points=ring, closed=True), ring


def icosphere(halvings):
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=halvings)
    vertices = np.array(mesh.vertices)
    return ck.source("mesh.triangles", vertices=vertices, faces=np.array(mesh.faces)), vertices


@pytest.mark.parametrize("condition", ["dirichlet", "robin"])
def test_data_at_the_points_of_a_polyline_are_of_second_order(condition):
    """Grid and polyline are refined together; the polyline snaps to the sphere."""
    spacings, counts, errors = [0.4, 0.2, 0.1], [16, 32, 64], []
    for h, count in zip(spacings, counts, strict=True):
        source, ring = polyline(count)
        exact = u(ring)
        gradient = np.stack([ring[:, 1], ring[:, 0], np.ones(count)], axis=1)
        slope = np.sum(gradient * ([0, 0, 1.0] - 0.3 * ring), axis=1) / RADIUS  # to the left, which is up
        made = {
            "dirichlet": {"both": ck.Dirichlet(ck.VertexData(source, exact))},
            "robin": {
                "left": ck.Robin(1.0, 2.0, ck.VertexData(source, -slope + 2 * exact)),
                "right": ck.Robin(1.0, 2.0, ck.VertexData(source, slope + 2 * exact)),
            },
        }[condition]
        f = ck.ScreenedPoisson(lambda x: 7 * x[:, 0] * x[:, 1] + 3 * x[:, 2])
        scene = ck.Scene(ck.source("analytic.sphere"), f, [ck.Boundary("ring", source, **made)])
        errors.append(np.abs(ck.solve(scene, h).evaluate(sphere_points()) - u(sphere_points())).max())
    assert order_of(spacings, errors) >= 1.7
    assert errors[-1] < 3e-3


def test_a_right_hand_side_at_the_vertices_of_a_mesh_is_of_second_order():
    spacings, errors, gaps = [0.4, 0.2, 0.1], [], []

    def f(x):
        return 7 * x[:, 0] * x[:, 1] + 3 * x[:, 2]

    for h, halvings in zip(spacings, (2, 3, 4), strict=True):
        mesh, vertices = icosphere(halvings)
        solutions = [
            ck.solve(ck.Scene(mesh, ck.ScreenedPoisson(data)), h).evaluate(sphere_points())
            for data in (ck.VertexData(mesh, f(vertices)), f)
        ]
        errors.append(np.abs(solutions[0] - u(sphere_points())).max())
        gaps.append(np.abs(solutions[0] - solutions[1]).max())
    assert order_of(spacings, errors) >= 1.8
    assert order_of(spacings, gaps) >= 1.8
    assert errors[-1] < 1e-2


def test_channels_and_lists_of_channels():
    source, ring = polyline(50)
    two = ck.VertexData(source, ring[:, :2])
    np.testing.assert_allclose(two(ring), ring[:, :2], atol=1e-14)
    assert ck.VertexData(source, ring[:, 0])(ring[:5]).shape == (5,)
    together = ck.Boundary("ring", source, both=ck.Dirichlet(two))
    apart = ck.Boundary("ring", source, both=ck.Dirichlet([ck.VertexData(source, ring[:, k]) for k in range(2)]))
    scenes = [ck.Scene(ck.source("analytic.sphere"), ck.Laplace(), [one]) for one in (together, apart)]
    assert [scene.channels for scene in scenes] == [2, 2]
    read = [ck.solve(scene, 0.2).evaluate(sphere_points(50)) for scene in scenes]
    np.testing.assert_allclose(read[0], read[1], atol=1e-12)


def test_values_are_copied_and_given_in_the_order_of_the_points():
    line = ck.source("mesh.polyline", points=[[0, 0], [0, 0], [1, 0], [3, 0]])  # the repeated point keeps its row
    values = np.array([9.0, 1.0, 2.0, 4.0])
    data = ck.VertexData(line, values)
    values[:] = 0.0
    assert data([[0.5, 0.0], [2.0, 0.0]])[1] == pytest.approx(3.0)
    points = ck.source("points", at=[[0, 0], [1, 0]])
    assert ck.VertexData(points, [5.0, 7.0])([[0.9, 0.0]]).tolist() == [7.0]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.zeros(7), r"shape \(50,\) or \(50, channels\), one row a vertex of the source, got \(7,\)"),
        (np.zeros((50, 1, 1)), r"got \(50, 1, 1\)"),
        (np.zeros((50, 0)), r"got \(50, 0\)"),
        (np.where(np.arange(50) == 3, np.nan, 0.0), "finite: 1 of 50 rows are not, the first is row 3"),
        ("warm", "must be numbers"),
    ],
)
def test_values_that_are_none(values, message):
    with pytest.raises(ck.InputError, match=message):
        ck.VertexData(polyline(50)[0], values)


def test_a_source_without_vertices_is_refused():
    with pytest.raises(ck.InputError, match="carries no values; per-vertex data belong to a mesh"):
        ck.VertexData(ck.source("analytic.sphere"), [1.0])


TOML = """
[surface]
kind = "mesh.triangles"
file = "ball.off"

[[boundary]]
name = "ring"
kind = "mesh.polyline"
file = "ring.npy"
both = {{ dirichlet = {boundary} }}

[problem]
kind = "screened"
f = {f}
"""


@pytest.fixture
def folder(tmp_path):
    """Return a folder with a mesh of 162 vertices, a polyline of 40 points, and arrays for both."""
    import trimesh

    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / "ball.off")
    np.save(tmp_path / "ring.npy", polyline(40)[1])
    np.save(tmp_path / "forty.npy", np.linspace(0, 1, 40))
    np.save(tmp_path / "all.npy", np.linspace(0, 1, 162))
    np.save(tmp_path / "seven.npy", np.zeros(7))
    (tmp_path / "text.npy").write_text("warm")
    return tmp_path


def scene_of(folder, boundary, f="1.0"):
    (folder / "scene.toml").write_text(TOML.format(boundary=boundary, f=f))
    return ck.load_scene(folder / "scene.toml").scene


def test_in_a_scene_file_the_boundary_comes_before_the_surface(folder):
    scene = scene_of(folder, '{ values = "forty.npy" }', '[{ values = "all.npy" }, 2.0]')
    data = scene.boundaries[0].both.value
    assert (data.source, scene.problem.f[0].source) == (scene.boundaries[0].source, scene.surface)
    assert scene.channels == 2
    on_surface = scene_of(folder, '{ values = "all.npy" }')
    assert on_surface.boundaries[0].both.value.source is on_surface.surface


def test_rows_that_fit_both_belong_to_the_one_that_is_named(folder):
    np.save(folder / "ring.npy", polyline(162)[1])
    with pytest.raises(ck.SceneError, match="which fits boundary and surface; add of = 'boundary'"):
        scene_of(folder, '{ values = "all.npy" }')
    scene = scene_of(folder, '{ values = "all.npy", of = "surface" }')
    assert scene.boundaries[0].both.value.source is scene.surface


@pytest.mark.parametrize(
    ("boundary", "message"),
    [
        ('{ values = "seven.npy" }', r"has the shape \(7,\), where boundary has 40 vertices and surface has 162"),
        ('{ values = "forty.npy", of = "surface" }', r"where surface has 162 vertices; give one row a vertex"),
        ('{ values = "all.npy", of = "nose" }', "with of = 'boundary' or 'surface' if need be"),
        ('{ values = "all.npy", at = 3 }', "must be { values = 'FILE.npy' }"),
        ("{ values = 3 }", "must be { values = 'FILE.npy' }"),
        ("{ numbers = 3 }", "must be a number, a formula, { values = 'FILE.npy' }"),
        ('{ values = "absent.npy" }', "no file 'absent.npy'"),
        ('{ values = "text.npy" }', "'text.npy' is not a .npy file with an array of numbers"),
    ],
)
def test_tables_of_values_that_are_none(folder, boundary, message):
    with pytest.raises(ck.InputError, match=message):
        scene_of(folder, boundary)


def test_the_edge_takes_values_of_the_surface(folder):
    import trimesh

    half = trimesh.creation.icosphere(subdivisions=2)
    half = trimesh.Trimesh(half.vertices, half.faces[half.triangles_center[:, 2] > 0])
    half.export(folder / "half.off")
    np.save(folder / "rim.npy", half.vertices[:, 0])
    (folder / "edge.toml").write_text(
        '[surface]\nkind = "mesh.triangles"\nfile = "half.off"\nedge = { dirichlet = { values = "rim.npy" } }\n'
        '[problem]\nkind = "laplace"\n'
    )
    scene = ck.load_scene(folder / "edge.toml").scene
    assert scene.edge.value.source is scene.surface
