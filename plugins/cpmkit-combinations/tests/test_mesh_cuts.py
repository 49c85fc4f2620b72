"""A plane cuts a triangle mesh edge by edge: closed where the mesh is, of exact length, left where its normal is."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.errors import InputError

trimesh = pytest.importorskip("trimesh")
X, Y, Z = np.eye(3)
SHAPES = {
    "icosphere": trimesh.creation.icosphere(subdivisions=3),
    "torus": trimesh.creation.torus(1.0, 0.4),
    "box": trimesh.creation.box(),
    "fine box": trimesh.creation.box().subdivide().subdivide(),
}


def mesh_of(shape, **keys):
    return ck.source("mesh.triangles", vertices=shape.vertices, faces=shape.faces, **keys)


def cut_of(surface, point, normal):
    return ck.source("cut.plane", surface=surface, point=point, normal=normal)


def length_of(curve):
    vertices, segments = curve.mesh(1.0)
    return np.linalg.norm(vertices[segments[:, 1]] - vertices[segments[:, 0]], axis=1).sum()


def perimeter(piece):
    points = np.concatenate([piece.points, piece.points[: int(piece.closed)]])
    return np.linalg.norm(np.diff(points, axis=0), axis=1).sum()


def chords(radius, count):
    """Return the length of a regular polygon inscribed in a circle."""
    return 2 * count * radius * np.sin(np.pi / count)


def assert_is_section(curve, surface, point, normal, length):
    assert length_of(curve) == pytest.approx(length, rel=1e-9)
    lengths = [perimeter(piece) for piece in curve.pieces]
    assert sum(lengths) == pytest.approx(length, rel=1e-9)
    assert (np.diff(lengths) < 1e-9 * length).all()
    vertices, segments = curve.mesh(1.0)
    assert np.abs((vertices - point) @ normal).max() < 1e-6
    assert surface.closest_point(vertices).distance.max() < 1e-9
    middles = vertices[segments].mean(axis=1)
    feet = curve.closest_point(middles)
    left, tangents = curve.leftward(feet), curve.tangents(feet)
    assert np.abs(np.sum(left * tangents, axis=1)).max() < 1e-9
    beside = surface.closest_point(middles + 1e-4 * left).points
    assert ((beside - point) @ normal > -1e-9).all()
    assert ((surface.closest_point(middles - 1e-4 * left).points - point) @ normal < 1e-9).all()


PLANES = [
    # through vertices alone: of the icosphere's equators, of polygons of 32 corners
    ("icosphere", [0, 0, 0], Z, "trimesh"),
    ("icosphere", [0, 0, 0], X, "trimesh"),
    ("icosphere", [0, 0, 0.3], Z, "trimesh"),
    ("icosphere", SHAPES["icosphere"].vertices[20], Y, "trimesh"),
    ("icosphere", SHAPES["icosphere"].vertices[3], X + Y, "trimesh"),
    ("icosphere", [0.05, 0.02, 0.4], np.array([1, 2, 3.0]), "trimesh"),
    # along edges
    ("torus", [0, 0, 0], Z, chords(1.4, 32) + chords(0.6, 32)),
    ("torus", [0, 0, 0], X, 2 * chords(0.4, 32)),
    # through saddles of the mesh: the section touches itself there
    ("torus", [0.6, 0, 0], X, "trimesh"),
    ("torus", [1.0, 0, 0], X, "trimesh"),
    # faces lie in the plane
    ("box", [0, 0, 0.5], Z, 4.0),
    ("box", [0, 0, -0.5], Z, 4.0),
    ("fine box", [0, 0.5, 0], Y, 4.0),
    ("fine box", [0.25, 0, 0], X, 4.0),
    ("fine box", [0.1, 0, 0], -X, 4.0),
    ("box", [0, 0, 0], X + Y, 2 + 2 * np.sqrt(2)),
    ("box", [0, 0, 0], X + Y + Z, 6 / np.sqrt(2)),
]


@pytest.mark.parametrize(("name", "point", "normal", "length"), PLANES)
def test_any_plane_cuts_a_closed_mesh_in_closed_curves_of_exact_length(name, point, normal, length):
    shape = SHAPES[name]
    exact = shape.section(plane_normal=normal, plane_origin=point).length if length == "trimesh" else length
    surface = mesh_of(shape, closest="faceted")
    curve = cut_of(surface, point, normal)
    assert curve.closed
    assert_is_section(curve, surface, point, normal, exact)
    smooth = cut_of(mesh_of(shape), point, normal)
    assert np.array_equal(smooth.mesh(1.0)[0], curve.mesh(1.0)[0])


def test_a_cut_of_an_open_mesh_ends_on_its_rim():
    shape = SHAPES["fine box"]
    top = np.abs(shape.triangles_center[:, 2] - 0.5) > 1e-9
    surface = ck.source("mesh.triangles", vertices=shape.vertices, faces=shape.faces[top], closest="faceted")
    for x in (0.0, 0.1, 0.25):
        curve = cut_of(surface, [x, 0, 0], X)
        assert_is_section(curve, surface, [x, 0, 0], X, 3.0)
        vertices, segments = curve.mesh(1.0)
        ends = vertices[np.bincount(segments.ravel()) == 1]
        np.testing.assert_allclose(ends[np.argsort(ends[:, 1])], [[x, -0.5, 0.5], [x, 0.5, 0.5]], atol=1e-9)
        assert sorted(curve.closest_point(ends + [0, 0, 0.1]).edge) == [0, 1]


def test_a_moved_mesh_is_cut_edge_by_edge():
    surface = ck.source("moved", of=mesh_of(SHAPES["box"]), rotation=[0, 0, 0.3], translation=[5, 6, 7], scale=2.0)
    curve = cut_of(surface, [5, 6, 8], Z)
    assert length_of(curve) == pytest.approx(8.0)
    assert curve.left_of[2] > 8


def test_a_cut_has_a_left_on_a_mesh_with_one_side():
    strip = ck.source("parametric.moebius")
    vertices, faces = strip.mesh(0.1)
    surface = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")
    curve = cut_of(surface, [0, 0.01, 0], Y)
    feet = curve.closest_point(curve.mesh(1.0)[0][curve.segments].mean(axis=1))
    assert (curve.leftward(feet)[:, 1] > 0).all()


@pytest.mark.parametrize(
    ("name", "point", "normal", "form"),
    [
        ("icosphere", [0, 0, 0], Z, "galerkin"),
        ("torus", [0.6, 0, 0], X, "galerkin"),
        ("box", [0, 0, 0.5], Z, "galerkin"),
        ("box", [0, 0, 0.5], Z, "collocation"),
        pytest.param("icosphere", [0, 0, 0], Z, "collocation", marks=pytest.mark.slow),
        pytest.param("torus", [0.6, 0, 0], X, "collocation", marks=pytest.mark.slow),
        pytest.param("torus", [0, 0, 0], Z, "galerkin", marks=pytest.mark.slow),
        pytest.param("box", [0, 0, 0], X + Y + Z, "collocation", marks=pytest.mark.slow),
    ],
)
@pytest.mark.filterwarnings("ignore::cpmkit.CpmkitWarning")
def test_the_left_value_holds_where_the_normal_points(name, point, normal, form):
    """Each side of the plane keeps its constant."""
    shape = SHAPES[name]
    surface = mesh_of(shape)
    sides = ck.Boundary("cut", cut_of(surface, point, normal), left=ck.Dirichlet(1), right=ck.Dirichlet(0))
    solution = ck.solve(ck.Scene(surface, ck.Laplace(), [sides]), 0.2, form=form)
    points = trimesh.sample.sample_surface(shape, 400, seed=1)[0]
    height = (points - point) @ normal
    away = (np.abs(height) > 0.05) | (np.abs(points[:, :2]).max(axis=1) < 0.45 if name == "box" else False)
    assert np.abs(solution.evaluate(points[away]) - (height[away] > -1e-9)).max() < 1e-6


@pytest.mark.parametrize(
    ("name", "point", "normal"),
    [("icosphere", [0, 0, 1], Z), ("torus", [0, 0, 0.4], Z), ("torus", [0, 0, 0.4], -Z), ("box", [0, 0, 2], Z)],
)
def test_a_plane_that_touches_or_misses_a_mesh_is_refused(name, point, normal):
    with pytest.raises(
        InputError, match="the distance from the plane does not change its sign on the mesh: it is from"
    ):
        cut_of(mesh_of(SHAPES[name]), point, normal)


def test_a_real_mesh_is_cut_at_any_height(real_mesh):
    vertices, faces = ck.read_mesh(real_mesh("spot.obj"))
    surface, shape = ck.source("mesh.triangles", vertices=vertices, faces=faces), trimesh.Trimesh(vertices, faces)
    for axis in np.eye(3):
        low, high = (vertices @ axis).min(), (vertices @ axis).max()
        for height in (0.7 * low + 0.3 * high, 0.0, *np.sort(vertices @ axis)[[1000, 2000]]):
            curve = cut_of(surface, height * axis, axis)
            assert curve.closed
            exact = shape.section(plane_normal=axis, plane_origin=height * axis).length
            assert length_of(curve) == pytest.approx(exact, rel=1e-5)
