"""A mesh finds a foot on every sheet near a query: all local minima of the distance, and no others."""

import numpy as np
import pytest
from cpmkit_mesh import triangles
from cpmkit_mesh.box_tree import build_tree, project_onto_primitives
from cpmkit_mesh.conformance import cases
from cpmkit_mesh.local_minima import local_minima

import cpmkit as ck
from cpmkit.plugin import HasLocalMinima, localize
from cpmkit.testing import ConformanceCase, run_laws


def box(lower, upper, cuts=1):
    """Return the box between two corners, wound outwards, each side cut into ``cuts`` squared squares."""
    points, faces = [], []
    step = np.arange(cuts + 1) / cuts
    p, q = (part.ravel() for part in np.meshgrid(step, step, indexing="ij"))
    i, j = (part.ravel() for part in np.meshgrid(np.arange(cuts), np.arange(cuts), indexing="ij"))
    a = i * (cuts + 1) + j
    square = np.concatenate([np.stack([a, a + cuts + 1, a + cuts + 2], 1), np.stack([a, a + cuts + 2, a + 1], 1)])
    for axis in range(3):
        for end in (0.0, 1.0):
            side = np.roll(np.stack([np.full_like(p, end), p, q], axis=1), axis, axis=1)
            faces.append((square if end else square[:, ::-1]) + len(points) * len(p))
            points.append(side)
    return lower + np.concatenate(points) * (np.asarray(upper) - lower), np.concatenate(faces)


def wedge(angle, cuts=4):
    """Return two unit squares that meet along x at an angle."""
    flat = np.array([[i / cuts, j / cuts] for i in range(cuts + 1) for j in range(-cuts, cuts + 1)])
    width = 2 * cuts + 1
    height = np.abs(flat[:, 1])
    points = np.stack([flat[:, 0], flat[:, 1] * np.sin(angle / 2), height * np.cos(angle / 2)], axis=1)
    a = np.array([i * width + j for i in range(cuts) for j in range(width - 1)])
    return points, np.concatenate([np.stack([a, a + width, a + width + 1], 1), np.stack([a, a + width + 1, a + 1], 1)])


def bumpy(rng, sphere):
    points, faces = sphere(2)
    return points * (1 + 0.25 * rng.uniform(-1, 1, (len(points), 1))), faces


def all_minima(mesh, x, radius):
    """Return the sorted distances and points of all local minima of one query, found without tree or adjacency.

    A triangle's foot is one if no triangle that contains it, wherever it is in the list, has a nearer one.
    """
    corners = mesh.vertices[mesh.faces]
    tree, count = build_tree(corners), len(corners)
    slots = np.arange(count)
    feet = project_onto_primitives(tree, np.repeat(x[None], count, axis=0), slots)
    pairs = project_onto_primitives(tree, np.repeat(feet.point, count, axis=0), np.tile(slots, count))
    touches = pairs.distance.reshape(count, count) < 1e-9
    least = np.where(touches, feet.distance, np.inf).min(axis=1)
    minimal = (feet.distance <= least + 1e-12) & (feet.distance <= radius)
    places = feet.point[minimal].round(7) + 0.0
    first = np.unique(places, axis=0, return_index=True)[1]
    order = first[np.argsort(feet.distance[minimal][first])]
    return feet.point[minimal][order], feet.distance[minimal][order]


def faceted(mesh):
    return triangles(vertices=mesh[0], faces=mesh[1], closest="faceted")


def meshes(rng, sphere, cap):
    points, faces = sphere(2)
    two = np.concatenate([points, 1.2 * points]), np.concatenate([faces, faces + len(points)])
    flipped = bumpy(rng, sphere)
    flipped = flipped[0], np.where(rng.random(len(flipped[1]))[:, None] < 0.5, flipped[1], flipped[1][:, ::-1])
    fan = (
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 1], [0, -1, 1], [0, 0.2, -1.0]]),
        np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]),
    )
    return [box([0, 0, 0], [1, 1, 0.1], 3), wedge(0.6), bumpy(rng, sphere), cap(2), two, flipped, fan]


def test_feet_are_the_minima_that_a_search_of_all_triangles_finds(sphere, cap):
    rng = np.random.default_rng(1)
    for mesh in map(faceted, meshes(rng, sphere, cap)):
        x = rng.uniform(*(mesh.bounds + [[-0.3], [0.3]]), (25, 3))
        rows, feet = mesh.local_minima(x, 0.8)
        for row in range(len(x)):
            points, distance = all_minima(mesh, x[row], 0.8)
            of_sheet = rows == row
            np.testing.assert_allclose(feet.distance[of_sheet], distance, atol=1e-12)
            apart = np.linalg.norm(feet.points[of_sheet][:, None] - points, axis=2)
            assert (apart.min(axis=0, initial=1.0) < 1e-7).all()


def test_a_thin_box_has_a_foot_on_each_side():
    """Between its plates two, and near a side wall three; on top one and, through the plate, a second."""
    mesh = faceted(box([0, 0, 0], [1, 1, 0.1], 4))
    x = np.array([[0.45, 0.52, 0.03], [0.05, 0.52, 0.03], [0.45, 0.52, 0.2], [0.45, 0.52, 0.6]])
    rows, feet = mesh.local_minima(x, 0.35)
    np.testing.assert_array_equal(rows, [0, 0, 1, 1, 1, 2, 2])
    np.testing.assert_allclose(feet.distance, [0.03, 0.07, 0.03, 0.05, 0.07, 0.1, 0.2], atol=1e-15)
    np.testing.assert_allclose(feet.points[3], [0, 0.52, 0.03], atol=1e-15)


@pytest.mark.parametrize("closest", ["faceted", "smooth"])
def test_a_folded_plate_has_two_feet_inside_the_fold_and_one_outside(closest):
    points, faces = wedge(0.6, 8)
    mesh = triangles(vertices=points, faces=faces, closest=closest)
    inside, outside = [0.5, 0.02, 0.62], [0.5, 0.0, -0.1]
    rows, feet = mesh.local_minima(np.array([inside, outside]), 0.5)
    np.testing.assert_array_equal(rows, [0, 0, 1])
    np.testing.assert_array_less(feet.points[1, 1] * feet.points[0, 1], 0)
    np.testing.assert_allclose(feet.points[2], [0.5, 0, 0], atol=1e-12)


def test_a_smooth_mesh_finds_both_of_two_spheres(sphere):
    points, faces = sphere(4)
    both = np.concatenate([points, 1.1 * points]), np.concatenate([faces, faces + len(points)])
    mesh = triangles(vertices=both[0], faces=both[1])
    rng = np.random.default_rng(2)
    direction = rng.normal(size=(500, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    rows, feet = mesh.local_minima(rng.uniform(0.97, 1.13, (500, 1)) * direction, 0.2)
    np.testing.assert_array_equal(rows, np.repeat(np.arange(500), 2))
    radius = np.sort(np.linalg.norm(feet.points, axis=1).reshape(-1, 2), axis=1)
    np.testing.assert_allclose(radius, [[1, 1.1]] * 500, atol=5e-3)
    apart = feet.points / np.linalg.norm(feet.points, axis=1, keepdims=True) - np.repeat(direction, 2, axis=0)
    assert np.linalg.norm(apart, axis=1).max() < 1e-3
    assert not feet.doubtful.any()


def test_the_first_foot_is_the_closest_point_to_the_last_digit(troublesome):
    points, faces = troublesome
    for closest in ("faceted", "smooth"):
        mesh = triangles(vertices=points, faces=faces, closest=closest)
        x = np.random.default_rng(3).uniform(*mesh.bounds, (2000, 3))
        nearest, (rows, feet) = mesh.closest_point(x), mesh.local_minima(x, 60.0)
        in_reach = np.flatnonzero(nearest.distance <= 60)
        first = np.searchsorted(rows, in_reach)
        np.testing.assert_array_equal(np.unique(rows), in_reach)
        for name in ("points", "distance", "edge", "element", "local"):
            np.testing.assert_array_equal(getattr(feet, name)[first], getattr(nearest, name)[in_reach])


def test_answers_do_not_depend_on_the_number_of_threads(monkeypatch, sphere):
    points, faces = bumpy(np.random.default_rng(4), sphere)
    mesh = triangles(vertices=points, faces=faces)
    x = np.random.default_rng(5).uniform(-1, 1, (10_000, 3))
    answers = []
    for threads in ("1", "3"):
        monkeypatch.setenv("CPMKIT_THREADS", threads)
        answers.append(mesh.local_minima(x, 0.4))
    (rows, feet), (others, there) = answers
    np.testing.assert_array_equal(rows, others)
    np.testing.assert_array_equal(feet.points, there.points)


def test_the_search_measures_few_triangles_however_many_lie_within_the_radius(sphere):
    """Four times as many triangles within the radius: less than half again as many are measured."""
    x = np.random.default_rng(6).normal(size=(500, 3))
    x *= np.random.default_rng(7).uniform(0.9, 1.1, (500, 1)) / np.linalg.norm(x, axis=1, keepdims=True)
    measured = []
    for level in (4, 5, 6):
        mesh = faceted(sphere(level))
        measured.append(local_minima(mesh._tree, mesh._vertex_triangles, x, 0.5).measured / len(x))
    assert measured[1] < 1.5 * measured[0]
    assert measured[2] < 1.5 * measured[1]
    assert measured[2] < 100
    assert len(mesh.faces) / 16 > 2000  # as many lie within the radius


def test_thin_parts_of_a_fish_have_a_foot_on_each_side(real_mesh):
    """Points inside, below one side: where that side's foot is not the nearest, it is found."""
    mesh = triangles(file=real_mesh("fish.obj"))
    size, middle = np.ptp(mesh.bounds, axis=0).max(), mesh.vertices[mesh.faces[::3]].mean(axis=1)
    feet = mesh.closest_point(middle)
    normals = mesh.normals(feet)
    below = middle - 0.03 * size * normals
    nearest = mesh.closest_point(below)
    thin = np.einsum("nk,nk->n", mesh.normals(nearest), normals) < -0.9
    assert thin.sum() > 300
    rows, minima = mesh.local_minima(below[thin], 0.031 * size)
    of_sheet = np.linalg.norm(minima.points - middle[thin][rows], axis=1) < 0.004 * size
    assert len(np.unique(rows[of_sheet])) > 0.9 * thin.sum()


def test_local_minima_of_moved_meshes_and_unions_from_the_lattice(sphere):
    points, faces = sphere(2)
    ball = triangles(vertices=points, faces=faces)
    flipped = ck.source("moved", of=ball, rotation=[0.3, -1.1, 0.7], translation=[4.0, -2.0, 7.0], scale=3.0)
    both = ck.source("union", members=[ball, ck.source("analytic.sphere", radius=1.2)])
    for kind, make in (("moved", lambda: flipped), ("union", lambda: both)):
        assert isinstance(make(), HasLocalMinima)
        run_laws(ConformanceCase(kind, "with a mesh", make, None, 0.15, 0.3))
    rows, feet = both.local_minima([[1.1, 0, 0], [0, 0.9, 0]], 0.2)
    assert rows.tolist() == [0, 0, 1]
    assert sorted(feet.element[:2]) == [0, 1]
    mixed = ck.source("union", members=[ball, ck.source("analytic.segment", start=[1.0, 0, 0], end=[3.0, 0, 0])])
    assert not isinstance(mixed, HasLocalMinima)
    assert localize(ball, np.zeros(3)).has_local_minima
    assert not localize(both, np.zeros(3)).has_local_minima
    origin = np.array([0.5, -3.0, 0.25])
    local = localize(both, origin)
    there = local.local_minima(np.array([[1.1, 0, 0]]) - origin, 0.2)[1]
    np.testing.assert_allclose(there.points + origin, feet.points[:2], atol=1e-14)
    assert local.queries["points"] == 1


def test_every_case_of_a_mesh_has_the_ability():
    made = [case.make() for case in cases() if case.kind == "mesh.triangles"]
    assert len(made) == 6
    assert all(isinstance(mesh, HasLocalMinima) for mesh in made)
