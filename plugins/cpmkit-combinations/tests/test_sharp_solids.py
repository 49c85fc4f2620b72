"""Solids of sharp meshes and polygons contain exactly the points that their boundary encloses."""

from functools import cache

import numpy as np
import pytest

import cpmkit as ck

RNG = np.random.default_rng(5)
TURN = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
CORNERS = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def tetrahedron(*vertices):
    return np.array(vertices, dtype=float), CORNERS


def star(seed, least):
    """A sphere of triangles with corners at random radii, the least ``least``: spikes and reentrant ones."""
    from scipy.spatial import ConvexHull

    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(60, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    hull = ConvexHull(directions)
    faces = hull.simplices.astype(np.int64)
    inward = np.linalg.det(directions[faces]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return directions * rng.choice([1.0, least], 60)[:, None], faces


def shells(first, second):
    return np.concatenate([first[0], second[0]]), np.concatenate([first[1], second[1] + len(first[0])])


def scaled(mesh, factor):
    centre = mesh[0].mean(axis=0)
    return centre + factor * (mesh[0] - centre), mesh[1]


def reversed_mesh(mesh):
    return mesh[0], mesh[1][:, ::-1]


CORNER = tetrahedron([0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1])
WEDGE = np.array([[0, 0, 0], [0, 1, 0], [1, 0, -1e-3], [1, 1, -1e-3], [1, 0, 1e-3], [1, 1, 1e-3]])
STAR = star(0, 0.05)
MESHES = {
    "corner": CORNER,
    "corner, reversed": reversed_mesh(CORNER),
    "corner, turned": (1e3 * CORNER[0] @ TURN.T + 7.0, CORNER[1]),
    "corner, tiny": (1e-6 * CORNER[0] @ TURN.T, CORNER[1]),
    "needle": tetrahedron([0, 0, 0], [1e-3, 0, 0], [0, 1e-3, 0], [0, 0, 1]),
    "leaning needle": tetrahedron([0, 0, 0], [1e-2, 0, 0], [0, 1e-2, 0], [1, 1, 1]),
    "sliver": tetrahedron([0, 0, 1e-4], [1, 1, 1e-4], [0, 1, 0], [1, 0, 0]),
    "flat": tetrahedron([0, 0, 0], [1, 0, 0], [0, 1, 0], [0.3, 0.3, 1e-3]),
    "wedge": (
        WEDGE,
        np.array([[0, 1, 2], [2, 1, 3], [0, 4, 1], [4, 5, 1], [0, 2, 4], [1, 5, 3], [2, 3, 4], [4, 3, 5]]),
    ),
    "star": STAR,
    "sharper star": star(1, 0.01),
    "star, reversed": reversed_mesh((STAR[0] @ TURN.T, STAR[1])),
    "hollow": shells(CORNER, reversed_mesh(scaled(CORNER, 0.5))),
    "hollow, wound alike": shells(CORNER, scaled(CORNER, 0.5)),
    "hollow star, the inner first": shells((0.8 * STAR[0], STAR[1]), STAR),
    "three shells": shells(shells(CORNER, scaled(CORNER, 0.6)), scaled(CORNER, 0.3)),
    "a thin shell": shells(CORNER, scaled(CORNER, 1 - 1e-6)),
    "two apart": shells(CORNER, (CORNER[0] + [0.6, 0.6, 0.6], CORNER[1][:, ::-1])),
    "shells that touch in a vertex": shells(
        CORNER, tetrahedron([0, 0, 0], [0.2, 0.1, 0.1], [0.1, 0.2, 0.1], [0.1, 0.1, 0.2])
    ),
}


def turns(x, vertices, faces):
    """How often the triangles wind around each of ``x``, by their solid angles."""

    def dot(v, w):
        return v[0] * w[0] + v[1] * w[1] + v[2] * w[2]

    a, b, c = (vertices[faces[:, k]].T[:, None] - x.T[:, :, None] for k in range(3))
    p, q, r = (np.sqrt(dot(side, side)) for side in (a, b, c))
    normal = [b[k - 2] * c[k - 1] - b[k - 1] * c[k - 2] for k in range(3)]
    halves = np.arctan2(dot(a, normal), p * q * r + dot(a, b) * r + dot(b, c) * p + dot(c, a) * q)
    return halves.sum(axis=1) / (2 * np.pi)


def encloses(x, vertices, faces):
    """Whether an odd number of components, each wound consistently, encloses each of ``x``."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_array((np.ones(len(links)), links.T), shape=(len(vertices),) * 2)
    part = connected_components(graph, directed=False)[1][faces[:, 0]]
    return sum(np.abs(turns(x, vertices, faces[part == k])).round() for k in np.unique(part)) % 2 == 1


def queries(vertices, faces):
    """Points all around, on lattices through the corners, and near vertices, edges and faces at many distances."""
    rng = np.random.default_rng(2)
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    size = np.ptp(vertices, axis=0).max()
    axes = [np.linspace(low - 0.25 * size, high + 0.25 * size, 13) for low, high in zip(lower, upper, strict=True)]
    shares = np.concatenate([np.eye(3), 0.5 - 0.5 * np.eye(3), rng.dirichlet(np.ones(3), 6)])
    on = np.einsum("qc,fck->fqk", shares, vertices[faces]).reshape(-1, 3)
    away = rng.normal(size=(8, len(on), 3)) * (size * 10.0 ** -np.arange(1, 9))[:, None, None]
    around = rng.uniform(lower - 0.3 * size, upper + 0.3 * size, (2000, 3))
    return np.concatenate([around, np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3), (on + away).reshape(-1, 3)])


@cache
def queries_of(name):
    """The queries around a mesh, and whether it encloses each."""
    x = queries(*MESHES[name])
    return x, encloses(x, *MESHES[name])


def off_surface(name, surface):
    """The queries that do not lie on the mesh, to rounding, and whether it encloses each."""
    x, is_enclosed = queries_of(name)
    off = surface.closest_point(x).distance > 1e-10 * np.ptp(surface.vertices)
    return x[off], is_enclosed[off]


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
@pytest.mark.parametrize("name", MESHES)
def test_a_solid_contains_what_its_mesh_encloses(name, closest):
    vertices, faces = MESHES[name]
    surface = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest=closest)
    (x, expected), solid = off_surface(name, surface), ck.source("solid", of=surface)
    assert 0 < expected.sum() < len(x)
    assert np.flatnonzero((solid.closest_point(x).edge < 0) != expected).tolist() == []
    there = np.array([3.0, 2.0, 1.0]) * np.ptp(vertices)
    far = surface.closest_point(x).distance > 1e-7 * np.ptp(vertices)
    assert ((solid.translate(there).closest_point(x + there).edge < 0) == expected)[far].all()


@pytest.mark.parametrize("name", ["corner", "needle", "sharper star", "hollow, wound alike"])
def test_solids_of_moved_meshes_and_of_unions(name):
    vertices, faces = MESHES[name]
    surface = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    moved = ck.source("moved", of=surface, rotation=[0.3, 0.2, 0.5], translation=[1.0, 2.0, 3.0], scale=2.0)
    x, expected = off_surface(name, surface)
    at = moved._to_world(x)
    hole = ck.source("moved", of=surface, translation=[9.0, 0.0, 0.0])
    for of in (moved, ck.source("union", members=[moved, hole])):
        assert ((ck.source("solid", of=of).closest_point(at).edge < 0) == expected).mean() > 0.9999


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    "points",
    [
        [[0, 0], [1, 0], [1, 1e-4]],
        [[0, 0], [1, 1e-7], [2, 0], [1, 2e-7]],
        [[0, 0], [1, 0], [0.01, 0.01], [0, 1], [-0.01, 0.01], [-1, 0], [-0.01, -0.01], [0, -1], [0.01, -0.01]],
    ],
    ids=["needle", "sliver", "star"],
)
def test_an_area_contains_what_its_polygon_encloses(points, turned):
    points = np.array(points, dtype=float)[:: -1 if turned else 1]
    curve = ck.source("mesh.polyline", points=points, closed=True)
    on = np.concatenate([points + t * (np.roll(points, -1, axis=0) - points) for t in (0.0, 1e-6, 0.3, 0.5)])
    away = RNG.normal(size=(10, len(on), 2)) * (10.0 ** -np.arange(10))[:, None, None]
    lattice = np.stack(np.meshgrid(np.linspace(-1.5, 2.5, 33), np.linspace(-1.5, 1.5, 25)), axis=-1)
    x = np.concatenate([(on + away).reshape(-1, 2), lattice.reshape(-1, 2), RNG.uniform(-1.5, 2.5, (2000, 2))])
    x = x[curve.closest_point(x).distance > 1e-10]
    a, b = points - x[:, None], np.roll(points, -1, axis=0) - x[:, None]
    angles = np.arctan2(a[:, :, 0] * b[:, :, 1] - a[:, :, 1] * b[:, :, 0], (a * b).sum(axis=2))
    expected = np.abs(angles.sum(axis=1)) > np.pi
    assert ((ck.source("solid", of=curve).closest_point(x).edge < 0) == expected).all()


def test_shells_that_nearly_coincide_are_refused_with_the_distance():
    surface = ck.source("mesh.triangles", vertices=MESHES["a thin shell"][0], faces=MESHES["a thin shell"][1])
    scene = ck.Scene(ck.source("solid", of=surface), ck.ScreenedPoisson(1.0), edge=ck.Neumann(0.0))
    with pytest.raises(ck.CpmkitError, match=r"thinner than .*, or two parts of its boundary lie upon each other"):
        ck.solve(scene, 0.1, form="galerkin")


VOLUMES = {
    "corner": 1 / 6,
    "corner, reversed": 1 / 6,
    "leaning needle": 1e-4 / 6,
    "sliver": 1e-4 / 3,
    "flat": 1e-3 / 6,
    "wedge": 1e-3,
    "hollow": 7 / 48,
    "hollow, wound alike": 7 / 48,
    "three shells": (1 - 0.6**3 + 0.3**3) / 6,
}


@pytest.mark.parametrize("name", VOLUMES)
def test_volumes(name):
    solid = ck.source("solid", of=ck.source("mesh.triangles", vertices=MESHES[name][0], faces=MESHES[name][1]))
    solution = ck.solve(ck.Scene(solid, ck.ScreenedPoisson(1.0), edge=ck.Neumann(0.0)), 0.1, form="galerkin")
    assert solution.integrate() == pytest.approx(VOLUMES[name], rel=1e-8)


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
@pytest.mark.parametrize("name", ["corner", "corner, reversed", "hollow, wound alike"])
def test_both_forms_solve_in_sharp_solids(name, form):
    def linear(x):
        return x @ [1.0, 2.0, -1.0] + 3.0

    surface = ck.source("mesh.triangles", vertices=MESHES[name][0], faces=MESHES[name][1])
    (x, is_enclosed), solid = off_surface(name, surface), ck.source("solid", of=surface)
    x = x[is_enclosed]
    scene = ck.Scene(solid, ck.ScreenedPoisson(linear), edge=ck.Dirichlet(linear))
    found = ck.solve(scene, 0.12, form=form).evaluate(x)
    assert np.abs(found - linear(x)).max() < {"galerkin": 1e-5, "collocation": 0.05}[form]
