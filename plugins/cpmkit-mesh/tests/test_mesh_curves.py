"""The edges and the creases of a mesh are curves with a direction, with ends and with the data of the mesh."""

import numpy as np
import pytest
from cpmkit_mesh import edge_loop, feature_edges, triangles
from cpmkit_mesh.chains import order_chains

import cpmkit as ck
from cpmkit.errors import InputError
from cpmkit.plugin import HasMesh, HasTangents, HasTranslation, HasValues


def length(curve):
    return np.linalg.norm(np.diff(curve.vertices[curve.segments], axis=1), axis=2).sum()


def block(sizes=(1.0, 1.0, 1.0)):
    """Return a box of twelve triangles wound outwards."""
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) * np.array(sizes)
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return corners, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def annulus(columns=24):
    """Return a flat ring from radius 1 to 2, seen counterclockwise from above."""
    angle = 2 * np.pi * np.arange(columns) / columns
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    a = np.arange(columns)
    b = (a + 1) % columns
    faces = np.concatenate([np.stack([a, a + columns, b + columns], axis=1), np.stack([a, b + columns, b], axis=1)])
    return np.concatenate([ring, 2 * ring]), faces


def tangled(count, rng):
    """Return the edges of a random graph, in random order and direction."""
    pairs = np.argwhere(np.triu(rng.uniform(size=(count, count)) < 1.5 / count, 1))
    pairs = rng.permutation(pairs)
    return np.where(rng.uniform(size=(len(pairs), 1)) < 0.5, pairs, pairs[:, ::-1])


@pytest.mark.parametrize("seed", range(20))
def test_chains_hold_every_edge_once_and_end_where_other_than_two_edges_meet(seed):
    rng = np.random.default_rng(seed)
    edges, positions = tangled(40, rng), rng.normal(size=(40, 3))
    chains = order_chains(edges, positions)
    along = chains.vertices[chains.segments()]
    np.testing.assert_array_equal(np.unique(np.sort(along, axis=1), axis=0), np.unique(np.sort(edges, axis=1), axis=0))
    assert len(along) == len(edges)
    degree, ends = np.bincount(edges.ravel(), minlength=40)[chains.vertices], chains.ends()
    assert (degree[ends >= 0] != 2).all()
    number = np.arange(len(chains.vertices))
    first = np.r_[True, np.diff(chains.chain) != 0][number]
    assert ((degree == 2) | (ends >= 0) | (first & chains.closed[chains.chain])).all()
    steps = np.linalg.norm(np.diff(positions[along], axis=1)[:, 0], axis=1)
    lengths = np.bincount(chains.chain[chains.segments()[:, 0]], steps)
    assert (np.diff(lengths) <= 1e-12).all()


@pytest.mark.parametrize("seed", range(20))
def test_a_chain_travels_the_way_of_most_of_its_edges(seed):
    rng = np.random.default_rng(seed)
    edges, positions = tangled(40, rng), rng.normal(size=(40, 3))
    chains = order_chains(edges, positions)
    along = chains.vertices[chains.segments()]
    forward = np.isin(along @ [40, 1], edges @ [40, 1])
    assert (np.bincount(chains.chain[chains.segments()[:, 0]], 2.0 * forward - 1.0) >= 0).all()


def test_walking_along_an_edge_loop_the_mesh_is_on_the_left():
    points, faces = annulus()
    rim = edge_loop(vertices=points, faces=faces)
    x = np.random.default_rng(1).normal(size=(500, 3)) * [1, 1, 0]
    feet = rim.closest_point(x)
    left = np.cross([0, 0, 1.0], rim.tangents(feet))
    radius = np.linalg.norm(feet.points, axis=1)
    towards = feet.points * np.where(radius > 1.5, -1.0, 1.0)[:, None]
    assert (np.einsum("nk,nk->n", left, towards) > 0.9 * radius).all()
    assert rim.closed
    assert (feet.edge == -1).all()


def test_the_left_of_an_edge_loop_is_the_mesh_for_a_solution_too(sphere, cap):
    """Data on the left of the hemisphere's rim, on the whole sphere, are found on the hemisphere."""
    flipped = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    (points, faces), (half, above) = sphere(3), cap(3)
    rim = edge_loop(vertices=half @ flipped.T, faces=above)
    whole = triangles(vertices=points @ flipped.T, faces=faces)
    condition = ck.Boundary("rim", rim, left=ck.Dirichlet(1.0), right=ck.Dirichlet(5.0))
    values = ck.solve(ck.Scene(whole, ck.Laplace(), [condition]), 0.2).evaluate(points @ flipped.T)
    winding = np.sign(np.linalg.det(flipped))  # a reflection turns the normals inwards
    np.testing.assert_allclose(values[points[:, 2] * winding > 0.1], 1.0 if winding > 0 else 5.0, atol=1e-7)
    np.testing.assert_allclose(values[points[:, 2] * winding < -0.1], 5.0 if winding > 0 else 1.0, atol=1e-7)


def test_loops_have_the_numbers_that_feet_on_the_rim_have():
    points, faces = annulus()
    mesh = triangles(vertices=points, faces=faces, closest="faceted")
    outside, inside = mesh.closest_point(np.array([[3.0, 0, 0], [0.1, 0, 0]])).edge
    assert length(edge_loop(surface=mesh, loop=int(outside))) == pytest.approx(48 * 2 * np.sin(np.pi / 24))
    assert length(edge_loop(surface=mesh, loop=int(inside))) == pytest.approx(48 * np.sin(np.pi / 24))
    assert length(edge_loop(surface=mesh)) == pytest.approx(48 * 3 * np.sin(np.pi / 24))


def test_a_loop_that_touches_itself_closes_all_the_same():
    """Two triangles that share a corner have one rim; it passes that corner twice."""
    points = np.array([[0.0, 0, 0], [1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
    rim = edge_loop(vertices=points, faces=[[0, 2, 1], [0, 3, 4]])
    assert rim.closed
    assert len(rim.segments) == 6
    assert length(edge_loop(vertices=points, faces=[[0, 2, 1], [0, 3, 4]], loop=0)) == pytest.approx(length(rim))


def test_the_creases_of_a_box_are_its_twelve_edges():
    points, faces = block((1.0, 2.0, 3.0))
    creases = feature_edges(vertices=points, faces=faces)
    assert len(creases.segments) == 12
    assert length(creases) == pytest.approx(24.0)
    assert not creases.closed
    feet = creases.closest_point(np.array([[-0.1, -0.1, 1.5], [-1, -1, -1.0], [0.5, 0.0, -0.2]]))
    np.testing.assert_allclose(feet.points, [[0, 0, 1.5], [0, 0, 0], [0.5, 0, 0]], atol=1e-15)
    np.testing.assert_array_equal(feet.edge, [-1, 0, -1])
    sides = [length(feature_edges(vertices=points, faces=faces, chain=k)) for k in (0, 3, 4, 7, 8, 11)]
    np.testing.assert_allclose(sides, [3, 3, 2, 2, 1, 1])


def test_only_edges_sharper_than_the_angle_are_creases(sphere):
    points, faces = block()
    with pytest.raises(InputError, match="turns by more than 91 degrees; the sharpest of this mesh turns by 90"):
        feature_edges(vertices=points, faces=faces, angle=91)
    with pytest.raises(InputError, match=r"the sharpest of this mesh turns by 11\.2"):
        feature_edges(vertices=sphere(3)[0], faces=sphere(3)[1])


def test_a_crease_does_not_depend_on_the_winding():
    points, faces = block()
    flipped = faces.copy()
    flipped[::2] = flipped[::2, ::-1]
    assert len(feature_edges(vertices=points, faces=flipped).segments) == 12


def test_where_three_triangles_meet_there_is_a_feature_edge():
    points = np.array([[0, 0, 0], [0, 0, 1], [1, 0.1, 0.5], [1, 0, 0.5], [-1, 0, 0.5]])
    fan = feature_edges(vertices=points, faces=[[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    np.testing.assert_array_equal(fan.vertices, [[0, 0, 0], [0, 0, 1]])
    np.testing.assert_array_equal(
        fan.closest_point(np.array([[1, 0, -1.0], [1, 0, 0.5], [0, 0, 2.0]])).edge, [0, -1, 1]
    )


@pytest.mark.parametrize("make", [edge_loop, feature_edges])
def test_curves_of_a_mesh_have_the_meshs_data(make):
    """One row of data a vertex that the user gave, unused and doubled ones too."""
    points, faces = annulus()
    points = points * [1, 1, 0] + np.where(np.arange(len(points))[:, None] < 24, [0, 0, 3.0], 0)  # a steep skirt
    soup = np.concatenate([[[9.0, 9, 9]], points[faces].reshape(-1, 3)])
    cells = np.arange(1, len(soup)).reshape(-1, 3)
    lid = np.concatenate([cells, [[1, 1, 2]]])
    curve = make(vertices=soup, faces=lid, **({"angle": 10.0} if make is feature_edges else {}))
    for ability in (HasTangents, HasValues, HasMesh, HasTranslation):
        assert isinstance(curve, ability)
    assert (curve.dim, curve.manifold_dim, curve.exact, curve.value_count) == (3, 1, True, len(soup))
    feet = curve.closest_point(np.random.default_rng(3).normal(size=(200, 3)))
    np.testing.assert_allclose(curve.interpolate(soup, feet), feet.points, atol=1e-14)


def test_a_scene_file_takes_the_scenes_own_surface(tmp_path):
    from cpmkit import load_scene

    points, faces = block()
    rows = [f"v {x} {y} {z}" for x, y, z in points] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    (tmp_path / "box.obj").write_text("\n".join(rows))
    (tmp_path / "scene.toml").write_text(
        '[surface]\nkind = "mesh.triangles"\nfile = "box.obj"\n'
        '[[boundary]]\nname = "edges"\nkind = "mesh.feature_edges"\nangle = 60\nboth = { dirichlet = 1.0 }\n'
        '[problem]\nkind = "laplace"\n'
    )
    (boundary,) = load_scene(tmp_path / "scene.toml").scene.boundaries
    assert len(boundary.source.segments) == 12


@pytest.mark.parametrize(
    ("make", "keys", "message"),
    [
        (edge_loop, {}, "takes one mesh, .* got none"),
        (edge_loop, {"file": "a.obj", "surface": "b"}, "got 2"),
        (edge_loop, {"surface": "sphere"}, "surface of the kind mesh.triangles, got str"),
        (edge_loop, dict(zip(("vertices", "faces"), block(), strict=True)), "needs an open mesh; this one is closed"),
        (edge_loop, {"mesh": annulus, "loop": 2}, "loop must be a whole number from 0 to 1, .* got 2"),
        (edge_loop, {"mesh": annulus, "loop": True}, "got True"),
        (feature_edges, {"mesh": block, "chain": 12}, "chain must be a whole number from 0 to 11"),
        (feature_edges, {"mesh": block, "angle": 180}, "between 0 and 180"),
        (feature_edges, {"mesh": block, "angle": "sharp"}, "angle must be a finite number above zero"),
        (feature_edges, {}, "mesh.feature_edges takes one mesh"),
    ],
)
def test_wrong_input_is_answered_in_one_sentence(make, keys, message):
    keys = dict(keys)
    if "mesh" in keys:
        keys["vertices"], keys["faces"] = keys.pop("mesh")()
    with pytest.raises(InputError, match=message):
        make(**keys)


@pytest.mark.parametrize(
    ("point", "normal", "message"), [([0, 0], [0, 0, 1], "point must"), ([0, 0, 0], [0, 0, np.nan], "normal must")]
)
def test_a_plane_that_is_no_point_and_normal_of_space_is_refused(sphere, point, normal, message):
    points, faces = sphere(1)
    with pytest.raises(InputError, match=message):
        triangles(vertices=points, faces=faces).plane_section(point, normal)
