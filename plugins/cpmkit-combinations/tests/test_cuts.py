"""A plane or a function cuts a surface in a curve that is as exact as the surface, with left where it is positive."""

import numpy as np
import pytest
from bare import Bare
from cpmkit_combinations.cut import function_cut, plane_cut
from model_problems import max_error, order_of, rotation, sphere_points, sphere_poisson

import cpmkit as ck
from cpmkit.errors import InputError

SPHERE, TORUS = ck.source("analytic.sphere"), ck.source("analytic.torus")
TILTED = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])


def around(source, count=1000):
    lower, upper = source.bounds
    return np.random.default_rng(0).uniform(lower - 0.3, upper + 0.3, (count, source.dim))


@pytest.mark.parametrize("surface", [SPHERE, Bare(SPHERE)], ids=["own normals", "closest points alone"])
def test_a_plane_cuts_a_sphere_in_a_circle(surface):
    cut = plane_cut(surface=surface, point=0.3 * TILTED, normal=5 * TILTED)
    circle = ck.source("analytic.circle", center=0.3 * TILTED, radius=np.sqrt(0.91), normal=TILTED)
    x = around(SPHERE)
    found, exact = cut.closest_point(x), circle.closest_point(x)
    assert cut.deviation < 1e-11
    assert np.abs(found.distance - exact.distance).max() < 1e-10
    axis = np.linalg.norm(np.cross(x - 0.3 * TILTED, TILTED), axis=1)
    off_axis = axis > 0.1
    assert np.abs(found.points - exact.points)[off_axis].max() < 1e-6
    if surface is SPHERE:
        assert np.abs(found.points - exact.points)[off_axis].max() < 1e-9
        assert np.abs(cut.tangents(found) - circle.tangents(exact))[off_axis].max() < 1e-9


def test_a_cut_lies_on_the_surface_and_where_the_function_vanishes():
    cut = function_cut(surface=TORUS, phi="sin(3 * x) + y * z + 0.1")
    feet = cut.closest_point(around(TORUS))
    assert np.abs(np.sin(3 * feet.points[:, 0]) + feet.points[:, 1] * feet.points[:, 2] + 0.1).max() < 1e-10
    assert TORUS.closest_point(feet.points).distance.max() < 1e-10
    assert len(cut.pieces) == 4


@pytest.mark.parametrize(("size", "place"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e9)])
def test_a_cut_is_as_exact_in_any_unit_and_far_from_zero(size, place):
    center = np.full(3, place)
    sphere = ck.source("analytic.sphere", radius=size, center=center)
    cut = plane_cut(surface=sphere, point=center + [0, 0, 0.5 * size], normal=[0, 0, 1]).translate(-center)
    points = cut.mesh(0.1 * size)[0]
    assert np.abs(points[:, 2] / size - 0.5).max() < 1e-10
    assert np.abs(np.linalg.norm(points, axis=1) / size - 1).max() < 1e-10


def test_a_plane_cuts_a_torus_in_two_loops_the_longer_first():
    cut = plane_cut(surface=TORUS, point=[0, 0, 0], normal=[0, 0, 1])
    feet = cut.closest_point(np.array([[3.0, 0, 0], [0.5, 0, 0]]))
    assert np.abs(feet.points - [[1.4, 0, 0], [0.6, 0, 0]]).max() < 1e-11
    assert cut.piece(feet).tolist() == [0, 1]
    vertices, cells = cut.mesh(0.05)
    length = np.linalg.norm(vertices[cells[:, 1]] - vertices[cells[:, 0]], axis=1).sum()
    assert abs(length - 4 * np.pi) < 1e-3
    assert (np.bincount(cells.ravel()) == 2).all()


def test_a_cut_ends_exactly_on_the_edge_of_the_surface():
    cylinder = ck.source("analytic.cylinder")
    cut = plane_cut(surface=cylinder, point=[0.1, 0, 0], normal=[1, 0.4, 0.2])
    assert [piece.closed for piece in cut.pieces] == [False, False]
    ends = np.concatenate([piece.points[[0, -1]] for piece in cut.pieces]) + cut.shift
    assert np.abs(np.abs(ends[:, 2]) - 1).max() < 1e-12
    assert np.abs((ends - [0.1, 0, 0]) @ [1, 0.4, 0.2]).max() < 1e-12
    assert sorted(cut.closest_point(ends * [1, 1, 1.5]).edge) == [0, 0, 1, 1]
    assert cut.mesh(0.1)[1].shape[0] == cut.mesh(0.1)[0].shape[0] - 2


def test_left_is_where_the_function_is_positive():
    cut = function_cut(surface=TORUS, phi="z - 0.2 * sin(3 * x)")
    feet = cut.closest_point(around(TORUS))
    left = np.cross(TORUS.normals(TORUS.closest_point(feet.points)), cut.tangents(feet))
    assert np.abs(left - cut.leftward(feet)).max() < 1e-4
    beside = feet.points + 1e-3 * left
    assert (beside[:, 2] > 0.2 * np.sin(3 * beside[:, 0])).all()
    assert cut.left_of[2] > 0.2 * np.sin(3 * cut.left_of[0])


@pytest.mark.parametrize("surface", [SPHERE, Bare(SPHERE)], ids=["own normals", "closest points alone"])
def test_the_left_value_holds_where_the_function_is_positive(surface):
    cut = plane_cut(surface=surface, point=[0, 0, 0.1], normal=TILTED)
    sides = {"left": ck.Dirichlet(1.0), "right": ck.Dirichlet(0.0), "left_of": cut.left_of}
    solution = ck.solve(ck.Scene(surface, ck.Laplace(), [ck.Boundary("cut", cut, **sides)]), 0.2)
    points = sphere_points(500)
    assert np.abs(solution.evaluate(points) - ((points - [0, 0, 0.1]) @ TILTED > 0)).max() < 1e-6


@pytest.mark.parametrize(
    ("form", "order", "bound", "apart"), [("collocation", 1.9, 1.2e-3, 1e-9), ("galerkin", 2.8, 4e-4, 3e-6)]
)
def test_poisson_with_dirichlet_data_on_a_plane_cut_converges(form, order, bound, apart):
    normal = rotation()[0]
    given, points, exact = sphere_poisson([normal])
    cut = plane_cut(surface=SPHERE, point=[0, 0, 0], normal=normal)
    scene = ck.Scene(SPHERE, given.problem, [ck.Boundary("cut", cut, both=given.boundaries[0].both)])
    spacings = (0.2, 0.1, 0.05) if form == "collocation" else (0.3, 0.2, 0.14)
    errors = [max_error(scene, points, exact, spacing, form=form) for spacing in spacings]
    assert order_of(spacings, errors) > order
    assert errors[-1] < bound
    assert (
        abs(errors[0] - max_error(given, points, exact, spacings[0], form=form)) < apart
    )  # of the circle in closed form


def test_a_smooth_mesh_is_cut_as_exactly_as_it_samples_the_sphere():
    import trimesh

    circle = ck.source("analytic.circle", center=0.3 * TILTED, radius=np.sqrt(0.91), normal=TILTED)
    off = []
    for level in (3, 4):
        ball = trimesh.creation.icosphere(level)
        mesh = ck.source("mesh.triangles", vertices=ball.vertices, faces=ball.faces)
        cut = plane_cut(surface=mesh, point=0.3 * TILTED, normal=TILTED)
        assert cut.closed
        off.append(circle.closest_point(cut.mesh(0.05)[0]).distance.max())
    assert off[1] < 2e-3
    assert off[0] / off[1] > 3.5


def test_a_level_set_is_cut_like_the_finest_polyline():
    """The Dziuk surface and the plane of the table of accepted errors, there a polyline of 6,000 points."""
    from cpmkit_levelset import dziuk

    surface = dziuk()
    cut = plane_cut(surface=surface, point=0.1 * TILTED, normal=TILTED)
    angle = 2 * np.pi * np.arange(6000) / 6000
    first = np.cross(TILTED, [0, 1, 0.1]) / np.linalg.norm(np.cross(TILTED, [0, 1, 0.1]))
    rays = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * np.cross(TILTED, first)
    low, high = np.zeros(6000), np.full(6000, 3.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        x, y, z = (0.1 * TILTED + middle[:, None] * rays).T
        outside = (x - z**2) ** 2 + y**2 + z**2 > 1
        low, high = np.where(outside, low, middle), np.where(outside, middle, high)
    points = 0.1 * TILTED + low[:, None] * rays
    assert cut.closest_point(points).distance.max() < 1e-10
    line = ck.source("mesh.polyline", points=points, closed=True)
    values = []
    for boundary in (cut, line):
        given = ck.Boundary("cut", boundary, both=ck.Dirichlet(lambda p: p[:, 0] * p[:, 1]))
        scene = ck.Scene(surface, ck.Poisson(lambda p: p[:, 0]), [given])
        values.append(ck.solve(scene, 0.25, origin=np.zeros(3)).evaluate(surface.mesh(0.25)[0]))
    assert np.abs(values[0] - values[1]).max() < 1e-5  # the error is 1e-2


def test_a_curve_is_cut_in_points():
    circle = ck.source("analytic.circle", center=[0, 0])
    found = plane_cut(surface=circle, point=[0.6, 0], normal=[1, 0]).mesh(1.0)[0]
    assert np.abs(found - [[0.6, -0.8], [0.6, 0.8]]).max() < 1e-12
    ring = ck.source("analytic.circle", normal=[0, 0, 1])
    assert len(function_cut(surface=ring, phi="x * y").mesh(1.0)[0]) == 4


def test_a_cut_of_a_surface_without_an_orientation_ends_on_its_rim():
    strip = ck.source("parametric.moebius")
    cut = plane_cut(surface=strip, point=[0, 0, 0], normal=[1, 0.4, 0.2], resolution=64)
    assert [piece.closed for piece in cut.pieces] == [False, False]
    assert cut.deviation < 1e-8


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: plane_cut(surface=SPHERE, point=[0, 0, 1.5], normal=[0, 0, 1]), "does not change its sign"),
        (lambda: plane_cut(surface=SPHERE, point=[0, 0, 1], normal=[0, 0, 1]), "does not change its sign"),
        (lambda: plane_cut(surface=TORUS, point=[0, 0, 0.4], normal=[0, 0, 1]), "does not change its sign"),
        (lambda: plane_cut(surface=TORUS, point=[0.6, 0, 0], normal=[1, 0, 0]), r"branches .* near \[0.6"),
        (lambda: function_cut(surface=SPHERE, phi="x * y"), "branches or touches itself near"),
        (lambda: function_cut(surface=SPHERE, phi="x > 0.2"), "the cut .* near"),
        (lambda: function_cut(surface=SPHERE, phi="(x > 0.2) - 0.5"), "phi jumps from -0.5 to 0.5 near"),
        (lambda: function_cut(surface=SPHERE, phi="log(x)"), "phi must be finite on the manifold, got nan"),
        (lambda: function_cut(surface=SPHERE, phi=3.0), "phi must be a formula in x, y, z or a function of points"),
        (lambda: function_cut(surface=SPHERE, phi=lambda p: p), "phi must return shape"),
        (lambda: plane_cut(surface=SPHERE, point=[0, 0, 0], normal=[0, 0, 0]), "normal must not be zero"),
        (lambda: plane_cut(surface=SPHERE, point=[0, 0], normal=[0, 0, 1]), "point must be 3 finite numbers"),
        (lambda: plane_cut(surface=SPHERE, point=[0, 0, 0], normal=[0, 0, 1], resolution=2.5), "resolution must be"),
        (lambda: plane_cut(surface="sphere", point=[0, 0, 0], normal=[0, 0, 1]), "surface must be a closest point"),
        (
            lambda: plane_cut(surface=ck.source("analytic.point", at=[0, 0, 0]), point=[0, 0, 0], normal=[0, 0, 1]),
            "of dimension 0",
        ),
    ],
)
def test_what_is_no_cut_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_a_cut_has_a_left_on_a_surface_with_one_side():
    """A plane cuts the Moebius strip twice; each half keeps its constant, although no normal could say left."""
    strip = ck.source("parametric.moebius")
    plane = ck.source("cut.plane", surface=strip, point=[0, 0.01, 0], normal=[0, 1, 0])
    cut = ck.Boundary("cut", plane, left=ck.Dirichlet(1), right=ck.Dirichlet(0))
    solution = ck.solve(ck.Scene(strip, ck.Laplace(), [cut]), 0.14, solver_tolerance=1e-10)
    points = strip.mesh(0.14)[0]
    away = np.abs(points[:, 1] - 0.01) > 1e-3
    assert np.abs(solution.evaluate(points[away]) - (points[away, 1] > 0.01)).max() < 1e-9
