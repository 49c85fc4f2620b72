"""Vertices on edges of other triangles are joined to them, where rounding put them there or as far as is asked for."""

import numpy as np
import pytest
from cpmkit_mesh import triangles

import cpmkit as ck
from cpmkit.errors import InputError


def grid(corner, first, second, n):
    """Return the parallelogram at ``corner``, n by n squares, each cut into two triangles."""
    s = np.linspace(0, 1, n + 1)
    points = np.array(corner) + s[:, None, None] * np.array(first) + s[None, :, None] * np.array(second)
    i, j = np.divmod(np.arange(n * n), n)
    a = i * (n + 1) + j
    b, c, d = a + n + 1, a + n + 2, a + 1
    return points.reshape(-1, 3), np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def together(*parts):
    start = np.cumsum([0, *(len(points) for points, _ in parts)])
    faces = np.concatenate([cells + start[k] for k, (_, cells) in enumerate(parts)])
    return np.concatenate([points for points, _ in parts]), faces


def beside(n, m, gap=0.0):
    return together(
        grid([0.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0], n), grid([1.0 + gap, 0, 0], [1.0, 0, 0], [0, 1.0, 0], m)
    )


def flipped(points, seed):
    return points if seed is None else points @ np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]


def area(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


@pytest.mark.parametrize("seed", [None, 1])
@pytest.mark.parametrize(("n", "m"), [(1, 2), (2, 1), (4, 8), (1, 3), (3, 4), (7, 5)])
def test_parts_with_unlike_divisions_are_one_mesh(n, m, seed):
    points, faces = beside(n, m)
    mesh = triangles(vertices=flipped(points, seed), faces=faces)
    assert mesh.component.max() == 0
    assert mesh.adjacency.consistent
    assert len(mesh.adjacency.boundary) == 3 * n + 3 * m
    assert area(mesh) == pytest.approx(2.0, rel=1e-12)
    inside = len(np.setdiff1d(np.arange(1, n) * m, np.arange(m) * n)) + len(
        np.setdiff1d(np.arange(1, m) * n, np.arange(n) * m)
    )
    assert mesh.repaired.notes[0].startswith(
        f"{inside} vertices of the mesh lie on edges of other triangles, the first"
    )
    assert (np.diff(mesh.repaired.given_index) > 0).all()
    x = flipped(np.random.default_rng(0).uniform([0, 0, 0], [2, 1, 0], (200, 3)), seed)
    feet = mesh.closest_point(x)
    np.testing.assert_allclose(feet.points, x, atol=1e-12)
    values = flipped(points, seed) @ [1.0, 2, 3]
    np.testing.assert_allclose(mesh.interpolate(values, feet), x @ [1.0, 2, 3], atol=1e-12)


@pytest.mark.parametrize("options", [{"form": "galerkin"}, {"form": "collocation"}, {"backend": "fem"}])
def test_what_is_joined_is_crossed(options):
    """u = x on two unit squares that are divided by three and by four."""
    points, faces = beside(3, 4)
    edge = [(ck.Dirichlet("x"), "x < 1e-4"), (ck.Dirichlet("x"), "x > 1.9999"), ck.Neumann(0.0)]
    if options.get("form") == "collocation":  # it takes no conditions by position
        edge = ck.Dirichlet("x")
    scene = ck.Scene((points, faces), ck.Laplace(), edge=edge)
    with pytest.warns(ck.CpmkitWarning, match="5 vertices of the mesh lie on edges of other triangles"):
        solution = ck.solve(scene, spacing=0.1, **options)
    at = np.array([[0.98, 0.3, 0], [1.02, 0.3, 0], [1.5, 0.5, 0]])
    np.testing.assert_allclose(solution.evaluate(at), at[:, 0], atol=2e-3)


def test_a_box_of_faces_with_unlike_divisions_is_closed():
    x, y, z = np.eye(3)
    sides = [(0 * x, y, x), (z, x, y), (0 * x, z, y), (x, y, z), (0 * x, x, z), (y, z, x)]
    points, faces = together(*(grid(*side, n) for n, side in enumerate(sides, 1)))
    mesh = triangles(vertices=points, faces=faces)
    assert len(mesh.adjacency.boundary) == 0
    assert (mesh.component.max(), mesh.adjacency.consistent) == (0, True)
    assert area(mesh) == pytest.approx(6.0, rel=1e-12)


def test_a_wall_on_an_edge_inside_a_floor_is_joined_to_it():
    floor, wall = grid([-1.0, 0, 0], [2.0, 0, 0], [0, 1.0, 0], 2), grid([0.0, 0, 0], [0, 0, 1.0], [0, 1.0, 0], 3)
    points, faces = together(floor, wall)
    mesh = triangles(vertices=points, faces=faces)
    assert mesh.component.max() == 0
    assert any(
        text.startswith("4 edges of the mesh are shared by three") for text in mesh.advice(0.1).closest_point_warnings
    )
    assert area(mesh) == pytest.approx(3.0, rel=1e-12)


@pytest.mark.parametrize(
    ("gap", "weld", "joined"), [(1e-3, None, 0), (1e-3, 2e-3, 1), (1e-2, 2e-3, 0), (2e-2, 0.03, 1)]
)
def test_gaps_are_closed_up_to_a_tolerance(gap, weld, joined):
    points, faces = beside(3, 4, gap)
    mesh = triangles(vertices=points, faces=faces, weld=weld)
    assert mesh.component.max() == 1 - joined
    assert len(mesh.adjacency.boundary) == (21 if joined else 28)
    assert any(text.startswith("2 vertices at rims of the mesh lie up to") for text in mesh.repaired.notes) == bool(
        joined
    )
    assert any(text.startswith("5 vertices of the mesh lie on") for text in mesh.repaired.notes) == bool(joined)


def test_no_tolerance_makes_triangles_vanish():
    points, faces = beside(3, 4, 0.02)
    mesh = triangles(vertices=points, faces=faces, weld=10.0)
    assert mesh.component.max() == 0
    assert area(mesh) > 1.9
    with pytest.raises(InputError, match="weld must be a finite number above zero, got -1"):
        triangles(vertices=points, faces=faces, weld=-1)
