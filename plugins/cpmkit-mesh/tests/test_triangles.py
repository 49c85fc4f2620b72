"""A mesh source checks what comes in, and its records say on which triangle, where in it and on which rim."""

import numpy as np
import pytest
from cpmkit_mesh import triangles

from cpmkit import ClosestPointSource
from cpmkit.errors import InputError
from cpmkit.plugin import HasMesh, HasNormals, HasTangents, HasTranslation, HasValues

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
NAN = np.array([[0.0, 0, 0], [1, 0, np.nan], [0, 1, 0]])


def strip(columns, height, base=0.0):
    """Return an open cylinder of radius 1 wound outwards."""
    angle = 2 * np.pi * np.arange(columns) / columns
    ring = np.stack([np.cos(angle), np.sin(angle), np.full(columns, base)], axis=1)
    a = np.arange(columns)
    b = (a + 1) % columns
    faces = np.concatenate([np.stack([a, b, b + columns], axis=1), np.stack([a, b + columns, a + columns], axis=1)])
    return np.concatenate([ring, ring + np.array([0, 0, height])]), faces


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({}, "needs a file, or both vertices and faces"),
        ({"vertices": TRIANGLE}, "needs a file, or both vertices and faces"),
        ({"file": "a.obj", "vertices": TRIANGLE}, "got both"),
        ({"file": "nowhere.obj"}, "no file 'nowhere.obj'"),
        ({"vertices": TRIANGLE, "faces": [[0, 1, 2]], "closest": "nearest"}, "'smooth' or 'faceted', got 'nearest'"),
        ({"vertices": TRIANGLE, "faces": [[0, 1, 3]]}, "from 0 to 2, got indices from 0 to 3"),
        ({"vertices": TRIANGLE, "faces": [[-1, 1, 2]]}, "got indices from -1 to 2"),
        ({"vertices": TRIANGLE, "faces": [[0, 1], [0, 1, 2]]}, "three or more a face, got a face of 2 corners"),
        ({"vertices": TRIANGLE, "faces": np.zeros((0, 3), int)}, "three or more a face, got no faces"),
        ({"vertices": TRIANGLE, "faces": [[0, 1, [2]]]}, "three or more a face, got"),
        ({"vertices": TRIANGLE, "faces": [0, 1, 2]}, "three or more a face, got"),
        ({"vertices": TRIANGLE, "faces": [[0, 1, 1.5]]}, "whole numbers"),
        ({"vertices": [["a", "b", "c"]], "faces": [[0, 0, 0]]}, "vertices must be an array of numbers"),
        ({"vertices": np.zeros((0, 3)), "faces": [[0, 1, 2]]}, r"vertices must have shape \(n, 3\)"),
        ({"vertices": TRIANGLE[:, :1], "faces": [[0, 1, 2]]}, r"vertices must have shape \(n, 3\) or \(n, 2\)"),
        ({"vertices": NAN, "faces": [[0, 1, 2]]}, "must be finite: 1 of 3 .* first 1"),
        ({"vertices": TRIANGLE, "faces": [[0, 1, 1], [2, 2, 2]]}, "No triangle has three different corners, of 2"),
        ({"vertices": TRIANGLE[[0, 0, 1]], "faces": [[0, 1, 2]]}, "No triangle has three different corners"),
    ],
)
def test_wrong_input_is_answered_in_one_sentence(keys, message):
    with pytest.raises(InputError, match=message):
        triangles(**keys)


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
def test_queries_are_checked(closest):
    mesh = triangles(vertices=TRIANGLE, faces=[[0, 1, 2]], closest=closest)
    with pytest.raises(InputError, match="finite"):
        mesh.closest_point(np.full((1, 3), np.nan))
    with pytest.raises(InputError, match=r"shape \(n, 3\)"):
        mesh.closest_point(np.zeros((1, 2)))
    empty = mesh.closest_point(np.zeros((0, 3)))
    assert empty.points.shape == (0, 3)
    assert mesh.normals(empty).shape == (0, 3)


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
def test_a_mesh_is_a_source_with_normals_values_a_mesh_and_translation(sphere, closest):
    points, faces = sphere(1)
    mesh = triangles(vertices=points, faces=faces, closest=closest)
    for contract in (ClosestPointSource, HasNormals, HasValues, HasMesh, HasTranslation):
        assert isinstance(mesh, contract)
    assert not isinstance(mesh, HasTangents)
    assert (mesh.dim, mesh.manifold_dim, mesh.exact) == (3, 2, closest == "faceted")
    np.testing.assert_array_equal(mesh.bounds, [[-1, -1, -1], [1, 1, 1]])
    np.testing.assert_array_equal(mesh.mesh(0.1)[0], points)
    np.testing.assert_array_equal(mesh.mesh(0.1)[1], faces)


def test_an_unused_vertex_may_be_anything():
    vertices = np.concatenate([TRIANGLE, [[np.nan, 0, 0], [9, 9, 9]]])
    mesh = triangles(vertices=vertices, faces=[[0, 1, 2]])
    np.testing.assert_array_equal(mesh.bounds, [[0, 0, 0], [1, 1, 0]])
    assert mesh.value_count == 5


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
def test_records_name_the_users_triangles_and_vertices(sphere, closest):
    """Split corners, unused vertices and a repeated corner do not shift the numbers."""
    points, faces = sphere(2)
    soup = np.concatenate([[[9.0, 9, 9]], points[faces].reshape(-1, 3)])
    cells = np.concatenate([[[1, 1, 2]], np.arange(1, len(soup)).reshape(-1, 3)])
    mesh = triangles(vertices=soup, faces=cells, closest=closest)
    assert len(mesh.vertices) == len(points)
    assert len(mesh.adjacency.boundary) == 0
    feet = mesh.closest_point(np.random.default_rng(1).normal(size=(1000, 3)))
    assert feet.element.min() > 0
    np.testing.assert_allclose(np.einsum("nc,nck->nk", feet.local, soup[cells[feet.element]]), feet.points, atol=1e-14)
    coordinates = np.where(np.arange(len(soup))[:, None] > 0, soup, np.nan)
    np.testing.assert_allclose(mesh.interpolate(coordinates, feet), feet.points, atol=1e-14)
    np.testing.assert_allclose(mesh.interpolate(coordinates[:, 0], feet), feet.points[:, 0], atol=1e-14)
    with pytest.raises(InputError, match=f"each of the {len(soup)} vertices, got shape"):
        mesh.interpolate(points, feet)
    taken = feet.take(np.array([5, 3]))
    np.testing.assert_array_equal(mesh.normals(taken), mesh.normals(feet)[[5, 3]])


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
def test_normals_are_interpolated_and_follow_the_winding(sphere, closest):
    points, faces = sphere(3)
    x = np.random.default_rng(2).normal(size=(1000, 3))
    mesh = triangles(vertices=points, faces=faces, closest=closest)
    feet = mesh.closest_point(x)
    outwards = feet.points / np.linalg.norm(feet.points, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.normals(feet), outwards, atol=1e-12)
    inside_out = triangles(vertices=points, faces=faces[:, ::-1], closest=closest)
    np.testing.assert_allclose(inside_out.normals(inside_out.closest_point(x)), -outwards, atol=1e-12)


def test_loops_are_numbered_by_decreasing_length():
    (low, first), (high, second) = strip(12, 0.5), strip(24, 0.5, base=3.0)
    high = high * [0.5, 0.5, 1]
    mesh = triangles(vertices=np.concatenate([high, low]), faces=np.concatenate([second, first + len(high)]))
    loop, start = mesh.adjacency.loop, mesh.vertices[mesh.adjacency.boundary[:, 0]]
    assert sorted(np.bincount(loop)) == [12, 12, 24, 24]
    assert set(loop[start[:, 2] < 1]) == {0, 1}
    assert set(loop[start[:, 2] > 1]) == {2, 3}


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
def test_feet_on_the_rim_carry_its_loop(closest):
    mesh = triangles(vertices=strip(40, 0.5)[0], faces=strip(40, 0.5)[1], closest=closest)
    rng = np.random.default_rng(3)
    angle, z = rng.uniform(0, 2 * np.pi, 2000), rng.uniform(-0.3, 0.8, 2000)
    radius = rng.uniform(0.9, 1.1, 2000)
    feet = mesh.closest_point(np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1))
    inside = (z > 0) & (z < 0.5)
    assert (feet.edge[inside] == -1).all()
    lower, upper = feet.edge[z < 0], feet.edge[z > 0.5]
    assert len(set(lower)) == len(set(upper)) == 1
    assert {*lower, *upper} == {0, 1}


def test_a_rim_vertex_is_on_the_rim_whichever_triangle_holds_the_foot(cap):
    points, faces = cap(3)
    mesh = triangles(vertices=points, faces=faces, closest="faceted")
    rim = np.unique(mesh.adjacency.boundary)
    assert (mesh.closest_point(mesh.vertices[rim]).edge == 0).all()
    inner = np.setdiff1d(np.arange(len(mesh.vertices)), rim)
    assert (mesh.closest_point(mesh.vertices[inner]).edge == -1).all()


def test_where_three_sheets_meet_there_is_no_rim():
    """Three half planes share an edge: it is no boundary, and feet near it are still found."""
    vertices = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0.5], [-0.5, 0.9, 0.5], [-0.5, -0.9, 0.5]])
    mesh = triangles(vertices=vertices, faces=[[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    assert len(mesh.adjacency.boundary) == 6
    feet = mesh.closest_point(np.array([[0.01, 0.02, 0.5], [0.0, 0, 0.5]]))
    assert np.isfinite(feet.points).all()
    assert (feet.edge == -1).all()


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
def test_triangles_that_wind_against_each_other_make_no_difference_to_feet(sphere, closest):
    points, faces = sphere(3)
    mixed = faces.copy()
    mixed[::3] = mixed[::3, ::-1]
    x = np.random.default_rng(4).normal(size=(2000, 3))
    one, other = (triangles(vertices=points, faces=cells, closest=closest) for cells in (faces, mixed))
    np.testing.assert_allclose(one.closest_point(x).points, other.closest_point(x).points, atol=1e-12)


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
@pytest.mark.parametrize("offset", [[1.0, -2.0, 3.0], [1e9, 0.0, 1e9]])
def test_a_translated_mesh_answers_translated(sphere, closest, offset):
    points, faces = sphere(2)
    points = np.round(points * 2**20)  # whole numbers, which no offset here rounds
    mesh = triangles(vertices=points, faces=faces, closest=closest)
    x = np.round(np.random.default_rng(5).normal(size=(500, 3)) * 2**20)
    there = mesh.translate(np.array(offset))
    back = there.translate(-np.array(offset))
    np.testing.assert_array_equal(back.closest_point(x).points, mesh.closest_point(x).points)
    feet, moved = mesh.closest_point(x), there.closest_point(x + offset)
    np.testing.assert_allclose(moved.points - offset, feet.points, atol=1e-6)
    np.testing.assert_allclose(there.normals(moved), mesh.normals(feet), atol=1e-9)
