"""Unions, motions and solids answer as what they are made of does, and say what they cannot take."""

import numpy as np
import pytest
import trimesh

import cpmkit as ck
from cpmkit.errors import CpmkitError
from cpmkit.plugin import HasMesh, HasNormals, HasTangents, HasTranslation, HasValues

CIRCLE = ck.source("analytic.circle")
SPHERE = ck.source("analytic.sphere")
SEGMENT = ck.source("analytic.segment", start=[1.0, 0, 0], end=[3.0, 0, 0])
BOX = ck.source("analytic.box", lower=[0, 0, 0], upper=[1, 1, 1])
QUERIES = np.random.default_rng(0).normal(size=(500, 3)) * 2


def union(*members):
    return ck.source("union", members=list(members))


def test_the_nearest_member_answers():
    both = union(SPHERE, SEGMENT)
    feet = both.closest_point(QUERIES)
    alone = [one.closest_point(QUERIES) for one in (SPHERE, SEGMENT)]
    nearest = np.argmin([one.distance for one in alone], axis=0)
    assert 0 < nearest.sum() < 500
    assert np.array_equal(feet.element, nearest)
    assert np.array_equal(feet.points, np.where(nearest[:, None] == 0, alone[0].points, alone[1].points))


def test_edges_of_members_keep_apart():
    ends = union(SPHERE, SEGMENT).closest_point([[4.0, 0, 0], [1.0, 0, 0], [2.0, 1.0, 0]]).edge
    assert ends.tolist() == [1001, -1, -1]


def test_a_mixed_union_has_no_dimension_of_its_own():
    assert union(SPHERE, SEGMENT).manifold_dim is None
    assert union(SPHERE, SPHERE).manifold_dim == 2


def test_a_union_has_the_abilities_that_all_members_have():
    assert isinstance(union(SPHERE, SPHERE), HasNormals)
    assert not isinstance(union(SPHERE, SEGMENT), HasNormals)
    assert isinstance(union(SPHERE, SEGMENT), HasMesh)
    assert isinstance(union(SPHERE, SEGMENT), HasTranslation)


def test_unions_of_unions_are_flat():
    assert len(union(union(SPHERE, SEGMENT), SEGMENT).members) == 3


def test_a_mixed_mesh_pads_short_cells():
    vertices, cells = union(SPHERE, SEGMENT).mesh(0.5)
    segments = cells[cells[:, 2] < 0]
    assert len(segments)
    assert (segments[:, :2] >= 0).all()
    assert np.allclose(vertices[segments[:, :2]].reshape(-1, 3)[:, 1:], 0)


@pytest.mark.parametrize("of", [SPHERE, SEGMENT, ck.source("analytic.torus")], ids=["sphere", "segment", "torus"])
def test_moving_agrees_with_the_plugin_that_moves_its_own(of):
    keys = {"rotation": [0.3, -1.1, 0.7], "translation": [4.0, -2.0, 7.0], "scale": 3.0}
    ours, own = ck.source("moved", of=of, **keys), of.move(**keys)
    x = 3 * QUERIES + [4.0, -2.0, 7.0]
    a, b = ours.closest_point(x), own.closest_point(x)
    assert np.abs(a.points - b.points).max() < 1e-13 * 20
    assert np.array_equal(a.edge, b.edge)
    for ability in (HasNormals, HasTangents, HasMesh, HasValues, HasTranslation):
        assert isinstance(ours, ability) == isinstance(own, ability)
    if isinstance(own, HasNormals):
        assert np.abs(ours.normals(a) - own.normals(b)).max() < 1e-12


def test_the_members_of_a_union_move_with_it():
    moved = ck.source("moved", of=union(SPHERE, SEGMENT), scale=2.0)
    assert moved.closest_point([[9.0, 0, 0]]).points.tolist() == [[6.0, 0, 0]]
    assert len(moved.members) == 2


def test_a_circle_in_a_circle_makes_a_hole_whichever_way_they_run():
    inner = ck.source("moved", of=CIRCLE, rotation=1.0, scale=0.5)
    ring = ck.source("solid", of=union(CIRCLE, inner))
    feet = ring.closest_point([[0.75, 0], [0.1, 0], [2.0, 0]])
    assert np.allclose(feet.points, [[0.75, 0], [0.5, 0], [1.0, 0]])
    assert feet.edge.tolist() == [-1, 1000, 0]


def test_a_polygon_encloses_its_inside():
    corners = [[0, 0], [2, 0], [2, 2], [1, 0.5], [0, 2], [0, 0]]
    for points in (corners, corners[::-1]):
        area = ck.source("solid", of=ck.source("mesh.polyline", points=points))
        feet = area.closest_point([[0.5, 0.4], [1.0, 0.8], [1.0, 1.5], [-1, -1], [1.0, 0.4]])
        assert (feet.distance == 0).tolist() == [True, False, False, False, True]
        assert feet.points[3].tolist() == [0, 0]


def test_a_ball_is_what_a_mesh_of_a_sphere_encloses():
    vertices, faces = SPHERE.mesh(0.2)
    for turned in (faces, faces[:, ::-1]):
        ball = ck.source("solid", of=ck.source("mesh.triangles", vertices=vertices, faces=turned))
        radius = np.linalg.norm(QUERIES, axis=1)
        feet = ball.closest_point(QUERIES)
        clear = np.abs(radius - 1) > 0.02
        assert np.array_equal((feet.distance == 0)[clear], (radius < 1)[clear])


def test_an_area_of_the_plane_is_filled_with_triangles():
    disc = ck.source("solid", of=CIRCLE)
    vertices, triangles = disc.mesh(0.05)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert (areas > 0).all()
    assert abs(areas.sum() - np.pi) < 0.01 * np.pi


def test_the_sides_of_a_box_are_its_edges():
    box = ck.source("analytic.box", lower=[0, 0, 0], upper=[1, 2, 3])
    outside = [[-1, 1, 1], [2, 1, 1], [0.5, -1, 1], [0.5, 3, 1], [0.5, 1, -1], [0.5, 1, 4], [0.5, 0.5, 0.5]]
    assert box.closest_point(outside).edge.tolist() == [0, 1, 2, 3, 4, 5, -1]


@pytest.mark.parametrize(
    ("kind", "keys", "says"),
    [
        ("union", {"members": []}, "members must be a list of sources"),
        ("union", {"members": [SPHERE, 3]}, "member 1 must be a closest point source"),
        ("union", {"members": [SPHERE, CIRCLE]}, "same space"),
        ("moved", {"of": 3}, "the source to move must be a closest point source"),
        ("moved", {"of": SPHERE, "scale": 0}, "scale must be a finite number above zero"),
        ("moved", {"of": CIRCLE, "rotation": [0, 0, 1]}, "rotation must be an angle"),
        ("solid", {"of": SEGMENT}, r"dimension 1 in 3D\.$"),
        ("solid", {"of": BOX}, "dimension 3 in 3D; unite surfaces, such as a faceted mesh of a box, not solids"),
        ("solid", {"of": ck.source("analytic.cap")}, "is open and encloses nothing"),
        ("solid", {"of": ck.source("pointcloud.points", points=SPHERE.mesh(0.2)[0])}, "no normals"),
        ("analytic.box", {"lower": [0, 0], "upper": [1, 0]}, "upper must be above lower"),
    ],
)
def test_what_cannot_be_combined_is_refused(kind, keys, says):
    with pytest.raises(CpmkitError, match=says) as caught:
        ck.source(kind, **keys)
    assert str(caught.value).count(". ") == 0


def test_combinations_in_a_scene_file(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(
        """
        [surface]
        kind = "union"
        members = [
          { kind = "moved", scale = 0.5, of = { kind = "analytic.sphere" } },
          { kind = "analytic.segment", start = [0.5, 0, 0], end = [2, 0, 0] },
        ]
        [[boundary]]
        name = "end"
        kind = "analytic.point"
        at = [2, 0, 0]
        both = { dirichlet = 1.0 }
        [problem]
        kind = "laplace"
        """
    )
    scene = ck.load_scene(file).scene
    assert scene.surface.closest_point([[9.0, 0, 0]]).points.tolist() == [[2.0, 0, 0]]
    assert [one.manifold_dim for one in scene.surface.members] == [2, 1]


def test_a_key_that_is_wrong_inside_is_named(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(
        '[surface]\nkind = "moved"\nof = { kind = "analytic.sphere", raduis = 1 }\n[problem]\nkind = "laplace"'
    )
    with pytest.raises(CpmkitError, match=r"'analytic\.sphere' has the unknown key 'raduis'"):
        ck.load_scene(file)


@pytest.mark.parametrize(
    ("kind", "key", "others"),
    [
        ("moved", "of", {"scale": 2.0}),
        ("solid", "of", {}),
        ("trimmed", "of", {"trim": "z"}),
        ("union", "members", {}),
        ("cut.plane", "surface", {"point": [0, 0, 0.1], "normal": [0, 0, 1]}),
        ("cut.function", "surface", {"phi": "z - 0.1"}),
    ],
)
def test_meshes_of_other_libraries_are_taken_as_a_scene_takes_them(kind, key, others):
    mesh = trimesh.creation.icosphere(2)
    given = [mesh, ck.Scene(mesh, ck.ScreenedPoisson(1.0)).surface]
    first, second = (ck.source(kind, **{key: [one] if key == "members" else one}, **others) for one in given)
    x = np.random.default_rng(0).normal(size=(20, 3))
    np.testing.assert_array_equal(first.closest_point(x).points, second.closest_point(x).points)
