"""Effects of rounding on a mesh are repaired, with a warning; real detail stays."""

import numpy as np
import pytest
from cpmkit_mesh import triangles

import cpmkit as ck
from cpmkit.errors import InputError


def square(steps=8, at=0.0):
    """Return the unit square at a height, cut into triangles."""
    s = np.linspace(0, 1, steps + 1)
    points = np.stack([np.repeat(s, steps + 1), np.tile(s, steps + 1), np.full((steps + 1) ** 2, at)], axis=1)
    i, j = np.divmod(np.arange(steps * steps), steps)
    a = i * (steps + 1) + j
    b, c, d = a + steps + 1, a + steps + 2, a + 1
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def soup(points, faces, noise):
    corners = points[faces].reshape(-1, 3)
    rng = np.random.default_rng(0)
    return corners + noise * rng.uniform(-1, 1, corners.shape), np.arange(len(corners)).reshape(-1, 3)


def warnings_of(mesh, spacing=0.1):
    advice = mesh.advice(spacing)
    return " ".join((*advice.warnings, *advice.closest_point_warnings))


def assert_same_surface(mesh, other, tolerance=1e-12):
    assert len(mesh.adjacency.boundary) == len(other.adjacency.boundary)
    x = np.random.default_rng(0).uniform(-0.5, 1.5, (500, 3))
    one, two = mesh.closest_point(x), other.closest_point(x)
    np.testing.assert_allclose(one.points, two.points, atol=tolerance)
    np.testing.assert_array_equal(one.edge, two.edge)


@pytest.mark.parametrize("extra", [[[2, 3, 4]], [[2, 3, 4], [4, 5, 6]], [[2, 3, 4], [2, 4, 5]], [[4, 3, 2], [2, 6, 4]]])
def test_a_triangle_without_area_along_a_rim_changes_nothing(extra):
    points, faces = square()
    mesh = triangles(vertices=points, faces=np.concatenate([faces, extra]))
    assert_same_surface(mesh, triangles(vertices=points, faces=faces))
    assert f"{len(extra)} triangles of the mesh have their corners on a line, the first near (0, " in warnings_of(mesh)


@pytest.mark.parametrize("flipped", [False, True])
def test_a_triangle_without_area_inside_leaves_no_gap(flipped):
    """A vertex on the diagonal of a square, of which one triangle knows and the other does not."""
    points, faces = square()
    a, b, c = faces[10]
    middle = len(points)
    cap = [a, middle, c] if not flipped else [c, middle, a]
    cut = np.concatenate([np.delete(faces, 10, axis=0), [[a, b, middle], [middle, b, c], cap]])
    mesh = triangles(vertices=np.concatenate([points, [0.5 * (points[a] + points[c])]]), faces=cut)
    assert len(mesh.faces) == len(faces) + 2
    assert mesh.adjacency.consistent
    assert (mesh.adjacency.neighbours != -1).all()
    assert_same_surface(mesh, triangles(vertices=points, faces=faces))
    assert "1 triangles of the mesh have their corners on a line" in warnings_of(mesh)
    feet = mesh.closest_point(points + 0.01)
    np.testing.assert_allclose(mesh.interpolate(np.concatenate([points, points[[a]]]) * 0 + 1.0, feet), 1.0)


@pytest.mark.parametrize("vertices", [[[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 0, 0], [1, 1, 1], [3, 3, 3 + 1e-12]]])
def test_a_mesh_without_area_is_refused(vertices):
    with pytest.raises(InputError, match="No triangle of 1 has an area"):
        triangles(vertices=vertices, faces=[[0, 1, 2]])
    along = [[0, -k, 0] for k in (0, 3, 1, 2)]
    with pytest.raises(InputError, match="No triangle of 3 has an area"):
        triangles(vertices=along, faces=[[0, 1, 2], [0, 1, 3], [0, 2, 3]])


@pytest.mark.parametrize("noise", [0.0, 1e-16, 1e-10, 1e-7])
@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (1e-6, 0.0), (1e6, 1e6)])
def test_triangles_separated_by_rounding_are_joined(noise, scale, offset):
    points, faces = square()
    torn, cells = soup(points, faces, noise)
    mesh = triangles(vertices=scale * torn + offset, faces=cells)
    assert len(mesh.vertices) == len(points)
    assert len(mesh.adjacency.boundary) == 32
    assert len(set(mesh.adjacency.loop)) == 1
    assert ("were merged" in warnings_of(mesh, 0.1 * scale)) or noise < 1e-10


def test_separate_triangles_solve_as_a_whole_mesh():
    points, faces = square()

    def f(x):
        return (1 + np.pi**2) * np.cos(np.pi * x[:, 0])

    probe = np.random.default_rng(0).uniform(0.05, 0.95, (200, 3)) * [1, 1, 0]
    values = []
    for vertices, cells in ((points, faces), soup(points, faces, 1e-7)):
        scene = ck.Scene(triangles(vertices=vertices, faces=cells), ck.ScreenedPoisson(f, c=1.0))
        values.append(ck.solve(scene, 0.1).evaluate(probe))
    np.testing.assert_allclose(values[1], values[0], atol=1e-5)


def test_sheets_seams_and_corners_that_are_really_there_are_kept(sphere):
    """Two squares a hundredth of their edges apart, a slit as wide, a ball of edges 1e-7 beside one of edges 1."""
    points, faces = square()
    above = square(at=0.01 * 0.125)[0]
    pair = triangles(vertices=np.concatenate([points, above]), faces=np.concatenate([faces, faces + len(points)]))
    assert len(pair.vertices) == 2 * len(points)
    right = points + [1 + 0.01 * 0.125, 0, 0]
    slit = triangles(vertices=np.concatenate([points, right]), faces=np.concatenate([faces, faces + len(points)]))
    assert len(slit.vertices) == 2 * len(points)
    ball, cells = sphere(2)
    sizes = triangles(vertices=np.concatenate([ball, 1e-7 * ball]), faces=np.concatenate([cells, cells + len(ball)]))
    assert len(sizes.vertices) == 2 * len(ball)


def test_there_is_a_warning_of_triangles_left_out(sphere):
    points, faces = sphere(1)
    cells = np.concatenate([faces, faces[:2, ::-1], [[0, 0, 1]]])
    mesh = triangles(vertices=np.concatenate([points, [[np.nan, 0, 0], [np.inf, 1, 1]]]), faces=cells)
    unused, left_out = mesh.advice(0.1).warnings[:2]
    assert unused.startswith(f"2 vertices of the mesh hold NaN or infinity, the first is number {len(points)};")
    assert left_out.startswith("3 of 35 triangles of the mesh name a place twice or repeat an earlier triangle")


def test_places_are_the_users(sphere):
    """Of a solution, whose mesh was moved to the lattice's origin."""
    cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float) + 100
    faces = [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
    ]
    mesh = triangles(vertices=cube, faces=[*faces, [1, 5, 7], [1, 7, 3]])
    flipped = triangles(vertices=cube, faces=[*faces, [1, 5, 7], [1, 3, 7]])
    for source, form, says in [
        (mesh, "collocation", "edges of the mesh turn by"),
        (flipped, "collocation", "wound against"),
        (flipped, "galerkin", "wound against"),
    ]:
        solution = ck.solve(ck.Scene(source, ck.ScreenedPoisson(1.0)), 0.2, form=form)
        (warning,) = [text for text in solution.warnings if says in text]
        place = [float(x) for x in warning.split("near (")[1].split(")")[0].split(",")]
        assert min(place) >= 100
        assert max(place) <= 101


def test_components_are_counted_and_there_is_a_warning_where_they_touch(sphere):
    points, faces = sphere(2)

    def pair(*offset):
        both = np.concatenate([points, points + offset])
        return triangles(vertices=both, faces=np.concatenate([faces, faces + len(points)]))

    assert warnings_of(triangles(vertices=points, faces=faces)) == ""
    assert warnings_of(pair(3, 0, 0)) == "The mesh has 2 pieces that share no edge; each is solved by itself."
    for offset in [(1.3, 0.2, 0.1), (2.0, 0, 0), (2.04, 0, 0)]:
        text = warnings_of(pair(*offset))
        assert text.startswith(
            "The mesh has 2 pieces that share no edge; each is solved by itself. Pieces of the mesh nearly meet"
        )
        place = np.array([float(x) for x in text.split("near (")[1].split(")")[0].split(",")])
        assert abs(np.linalg.norm(place) - 1) < 0.15
        assert abs(np.linalg.norm(place - offset) - 1) < 0.15
    assert "meet" not in warnings_of(pair(2.2, 0, 0))


def test_large_triangles_that_pass_through_each_other_meet():
    """The ends of their edges are 50 spacings away from where they cross."""
    flat = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    corners = np.concatenate([5 * flat, 5 * flat[:, [2, 0, 1]] + [0.3, 0, 0], 5 * flat + [0, 0, 9]])
    cells = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = triangles(vertices=corners, faces=np.concatenate([cells, cells + 4, cells + 8]))
    assert "The mesh has 3 pieces" in warnings_of(mesh)
    assert abs(float(warnings_of(mesh).split("near (")[1].split(",")[0]) - 0.3) < 0.05
    parallel = np.concatenate([5 * flat, 5 * flat + [0, 0, 0.3]])
    assert "meet" not in warnings_of(triangles(vertices=parallel, faces=np.concatenate([cells, cells + 4])))
