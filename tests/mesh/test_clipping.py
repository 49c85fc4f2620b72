"""Triangles clipped at knot planes: pieces in one cell each, no area lost, polynomials integrated exactly."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.mesh import polygon_rules
from cpmkit.mesh.cell_quadrature import quadrature, triangles_to_clip
from cpmkit.plugin import Mesh

SPACING = 0.2
#: Long enough to cross several knot planes of each axis.
TRIANGLE = Mesh.of(np.array([[0.03, -0.11, 0.05], [0.71, 0.13, -0.4], [0.2, 0.66, 0.35]]), np.array([[0, 1, 2]]))


def quadratic(x):
    return 1 + x[:, 0] * x[:, 1] - 2 * x[:, 2] ** 2 + x[:, 1] * x[:, 2] + x[:, 0]


@pytest.mark.parametrize("spacing", [SPACING, SPACING / 100])
def test_pieces_integrate_quadratics_exactly(spacing):
    """Those of the smaller spacing are more than there is room for at first."""
    plain, clipped = quadrature(TRIANGLE), quadrature(TRIANGLE, spacing)
    assert len(clipped) > 10 * len(plain)
    assert clipped.weights @ quadratic(clipped.points) == pytest.approx(
        plain.weights @ quadratic(plain.points), rel=1e-12
    )
    np.testing.assert_allclose(clipped.normals, np.tile(plain.normals[:1], (len(clipped), 1, 1)), atol=1e-12)


@pytest.mark.parametrize(("taken", "degree"), [(1, 1), (3, 2), (4, 3)])
def test_pieces_are_integrated_from_within(taken, degree):
    """The rule of a piece on random convex polygons, drawn out up to 10,000 times: exact, weights positive."""
    from scipy.spatial import ConvexHull

    rng, gauss = np.random.default_rng(0), np.polynomial.legendre.leggauss(4)
    at, weight = 0.5 * (gauss[0] + 1), 0.5 * gauss[1]
    powers = np.array([(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)])
    for _ in range(300):
        corners = rng.normal(size=(rng.integers(3, 8), 2))
        corners[:, 1] *= 10.0 ** rng.uniform(-4, 1)
        corners = corners[ConvexHull(corners).vertices]
        piece, places, shares = np.zeros((34, 5)), np.empty((taken, 2)), np.empty(taken)
        piece[: len(corners), :2] = corners
        room = np.empty(5), np.empty(4), np.empty((34, 2))
        area = polygon_rules.polygon_rule(piece, len(corners), taken, *room, places, shares)

        def powers_at(x, corners=corners):
            y = (x - corners.mean(axis=0)) / np.ptp(corners, axis=0)
            return np.prod(y[:, None] ** powers, axis=2)

        a, b = corners[1:-1] - corners[0], corners[2:] - corners[0]
        places_of = corners[0] + at[:, None, None, None] * (a + at[:, None, None] * (b - a))
        weights = (weight * at)[:, None, None] * weight[:, None] * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        exact = weights.ravel() @ powers_at(places_of.reshape(-1, 2))
        np.testing.assert_allclose(area * shares @ powers_at(places), exact, atol=1e-12 * area)
        assert (shares > 0.1).all()
        ahead = np.roll(corners, -1, axis=0) - corners
        off = places[:, None] - corners
        assert (ahead[:, 0] * off[..., 1] - ahead[:, 1] * off[..., 0] > 0).all()


def test_each_cell_holds_as_much_as_lies_in_it():
    """The area in each lattice cell, counted by a fine grid of points on the triangle."""
    clipped = quadrature(TRIANGLE, SPACING)
    n = 800
    i, j = (x.ravel() for x in np.indices((n, n)))
    up, down = i + j < n, i + j < n - 1
    r = np.concatenate([(i[up] + 1 / 3) / n, (i[down] + 2 / 3) / n])
    s = np.concatenate([(j[up] + 1 / 3) / n, (j[down] + 2 / 3) / n])
    a, b, c = TRIANGLE.vertices
    fine = a + np.outer(r, b - a) + np.outer(s, c - a)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a))
    cells = lambda x: np.floor(x / SPACING + 0.5).astype(int) @ [10000, 100, 1]  # noqa: E731
    for cell, count in zip(*np.unique(cells(fine), return_counts=True), strict=True):
        counted = count / len(fine) * area
        weight = clipped.weights[cells(clipped.points) == cell].sum()
        assert weight == pytest.approx(counted, abs=2e-3 * SPACING**2)


def test_samples_lie_in_the_cells_of_their_pieces_in_any_unit():
    for unit in (1e-6, 1.0, 1e6):
        mesh = Mesh.of(unit * TRIANGLE.vertices, TRIANGLE.cells)
        clipped = quadrature(mesh, unit * SPACING)
        reference = quadrature(TRIANGLE, SPACING)
        np.testing.assert_allclose(clipped.points, unit * reference.points, rtol=1e-9, atol=1e-12 * unit)
        t = np.abs(clipped.points / (unit * SPACING) - np.round(clipped.points / (unit * SPACING)))
        assert len(clipped) == len(reference)
        assert t.max() < 0.5


def test_every_triangle_has_samples_even_without_area():
    vertices = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.15, 0, 0], [0.1, 0.1, 0.1], [0.1, 0.1, 0.1 + 1e-13]])
    mesh = Mesh.of(vertices, np.array([[0, 1, 2], [3, 3, 3], [0, 3, 4], [0, 1, 3]]))
    clipped = quadrature(mesh, 0.05)
    assert set(clipped.cell) == {0, 1, 2, 3}
    assert np.all(np.diff(clipped.cell) >= 0)
    assert np.isfinite(clipped.points).all()
    np.testing.assert_allclose(np.linalg.norm(clipped.normals[:, 0], axis=1), 1, rtol=1e-12)
    assert clipped.weights.sum() == pytest.approx(quadrature(mesh).weights.sum(), rel=1e-12)


@pytest.mark.parametrize("height", [1e-9, 5e-4, 1e-3, 2e-3, 1e-2])
def test_triangles_that_lie_nearly_in_a_knot_plane_count_once(height):
    """Corners a little above and below z = h/2, in an order in which each part would hold most of them."""
    at = np.random.default_rng(0).uniform(0, 0.3, (200, 3, 2))
    z = 0.05 + 0.1 * height * np.random.default_rng(1).uniform(-2, 2, (200, 3, 1))
    vertices = np.concatenate([at, z], axis=2).reshape(-1, 3)
    mesh = Mesh.of(vertices, np.arange(600).reshape(-1, 3))
    clipped = quadrature(mesh, 0.1)
    area = np.bincount(clipped.cell, clipped.weights)
    np.testing.assert_allclose(area, quadrature(mesh).weights.reshape(-1, 3).sum(axis=1), rtol=1e-9)
    assert len(clipped) < 100 * len(mesh.cells)


def test_curved_triangles_keep_their_area():
    """A triangle on the unit sphere, with its midpoints: the area is that of the quadratic map, whatever the pieces."""
    angle = np.linspace(0, 0.3, 3)
    vertices = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    vertices = np.concatenate([vertices[::2], [[0, np.sin(0.3), np.cos(0.3)]]])
    middles = vertices[[[1, 2, 0]]] + vertices[[[2, 0, 1]]]
    middles /= np.linalg.norm(middles, axis=2)[..., None]
    mesh, errors = Mesh.of(vertices, np.array([[0, 1, 2]]), middles), []
    fine = quadrature(mesh, 0.003).weights.sum()
    for spacing in (0.2, 0.1, 0.05):
        errors.append(abs(quadrature(mesh, spacing).weights.sum() / fine - 1))
    assert errors[0] < 1e-4
    assert errors[-1] < 0.3 * errors[0]


#: Corners and midpoints, in spacings, of a triangle of Spot that runs along y = -17/2 and z = -5/2 at once.
ALONG_TWO_PLANES = np.array(
    [
        [-1.1698125, -8.53429679, -2.48364601],
        [-1.59443386, -8.51970912, -2.57422995],
        [-1.33391802, -8.31216766, -2.7052339],
        [-1.47029414, -8.40455659, -2.63099251],
        [-1.25218342, -8.42116037, -2.59232973],
        [-1.39119801, -8.49604331, -2.50268002],
    ]
)


def test_curved_triangles_that_cross_planes_often_count_once():
    """Edges that bend to and fro over planes: pieces that cross them four times were counted twice, again and again."""
    rng, count = np.random.default_rng(0), 4000
    frames = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    corners = np.array([[1.0, 0, 0], [-0.5, 0.8, 0], [-0.5, -0.8, 0]]) + 0.2 * rng.normal(size=(count, 3, 3))
    corners = rng.uniform(0, 1, (count, 1, 3)) + 0.25 * corners @ frames
    chords = 0.5 * (corners[:, [1, 2, 0]] + corners[:, [2, 0, 1]])
    size = np.linalg.norm(np.ptp(corners, axis=1), axis=1)[:, None, None]
    nodes = np.concatenate([corners, chords + 0.03 * size * rng.normal(size=chords.shape)], axis=1)
    nodes = np.concatenate([nodes, ALONG_TWO_PLANES[None]])
    gauss, weight = np.polynomial.legendre.leggauss(24)
    r, along = (x.ravel() for x in np.meshgrid(0.5 * (gauss + 1), 0.5 * (gauss + 1), indexing="ij"))
    area = areas_at(nodes, r, along * (1 - r)) @ (np.outer(weight, weight).ravel() / 4 * (1 - r))
    mesh = Mesh.of(nodes[:, :3].reshape(-1, 3), np.arange(3 * len(nodes)).reshape(-1, 3), nodes[:, 3:])
    clipped = quadrature(mesh, 1.0)
    weight = np.bincount(clipped.cell, clipped.weights)
    assert np.quantile(np.abs(weight / area - 1), 0.99) < 2e-3
    assert np.abs(weight / area - 1).max() < 1e-2
    assert weight[-1] == pytest.approx(area[-1], rel=1e-3)
    assert np.bincount(clipped.cell).max() < 100


def areas_at(nodes, r, s):
    """Return |x_r x x_s| (m, q) of curved triangles at places."""
    t, none = 1 - r - s, 0 * r
    along = np.stack([4 * r - 1, none, 1 - 4 * t, -4 * s, 4 * (t - r), 4 * s], axis=1) @ nodes
    across = np.stack([none, 4 * s - 1, 1 - 4 * t, 4 * (t - s), -4 * r, 4 * r], axis=1) @ nodes
    return np.linalg.norm(np.cross(along, across), axis=2)


def test_how_samples_are_taken_is_an_option():
    scene = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(1.0))
    counts = {
        how: ck.discretize(scene, 0.2, form="galerkin", samples=how).sampled.interior
        for how in ("auto", "plain", "clipped")
    }
    assert counts["auto"] == counts["clipped"] != counts["plain"]
    assert counts["clipped"] < 1.6 * counts["plain"]
    with pytest.raises(ck.InputError, match="samples must be 'auto', 'plain' or 'clipped', got 'fine'"):
        ck.discretize(scene, 0.2, form="galerkin", samples="fine")


@pytest.mark.parametrize(
    ("sampling", "bend", "clipped"),
    [("plain", "flat", [0, 0]), ("auto", "flat", [0, 1]), ("clipped", "flat", [1, 1]), ("auto", "normals", [1, 1])],
)
def test_flat_triangles_are_left_whole_where_they_are_small_beside_a_cell(sampling, bend, clipped):
    vertices = np.array([[0.0, 0, 0], [0.09, 0, 0], [0, 0.04, 0], [0.09, -0.14, 0]])
    mesh = Mesh.of(vertices, np.array([[0, 1, 2], [0, 3, 1]]))
    np.testing.assert_array_equal(triangles_to_clip(mesh, sampling, bend, SPACING), clipped)


def test_large_flat_triangles_cost_fewer_samples_than_small_whole_ones_and_leave_no_more_error():
    """A square of two triangles at three spacings, root mean squares over positions of the lattice."""
    square = ck.source(
        "mesh.triangles",
        vertices=[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
        faces=[[0, 1, 2], [0, 2, 3]],
        closest="faceted",
    )

    def u(x):
        return np.cos(np.pi * x[:, 0]) * np.cos(np.pi * x[:, 1])

    scene = ck.Scene(square, ck.ScreenedPoisson(lambda x: (1 + 2 * np.pi**2) * u(x)))
    points = np.column_stack([np.random.default_rng(0).uniform(0, 1, (500, 2)), np.zeros(500)])
    rms, counted = {"plain": [], "auto": []}, {}
    for spacing in (0.16, 0.11, 0.08):
        for samples, errors in rms.items():
            found = []
            for k in range(4):
                origin = spacing * np.random.default_rng(k).uniform(0, 1, 3) - 1.0
                solution = ck.solve(scene, spacing, form="galerkin", samples=samples, origin=origin)
                found.append(solution.evaluate(points) - u(points))
            errors.append(np.sqrt(np.mean(np.square(found))))
            counted[samples] = len(solution.discretized.sampled.samples)
        assert counted["auto"] < counted["plain"]
    assert np.all(np.array(rms["auto"]) <= 1.1 * np.array(rms["plain"]))
    assert np.log2(rms["auto"][0] / rms["auto"][2]) > 1.5
