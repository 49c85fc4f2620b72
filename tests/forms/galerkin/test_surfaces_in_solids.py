"""Surfaces inside solids in space that reach the skin, cross and end on each other, in the Galerkin form."""

import numpy as np
import pytest
from model_problems import order_of
from solid_problems import f, u

import cpmkit as ck

BALL = ck.source("solid", of=ck.source("analytic.sphere"))
BOX = ck.source("analytic.box", lower=[-1.0, -1.0, -1.0], upper=[1.0, 1.0, 1.0])
#: A rotation that leaves no axis in a lattice plane.
TURN = np.linalg.qr(np.array([[1.0, 0.0, 0.2], [0.0, 1.0, 0.1], [-0.2, -0.1, 1.0]]))[0]
Z = np.array([0.0, 0.0, 1.0])


def mesh(vertices, faces):
    return ck.source("mesh.triangles", vertices=np.asarray(vertices), faces=faces, closest="faceted")


def plate(low, high, z, turn=None):
    """Return the rectangle between the corners ``low`` and ``high`` of a plane at height z, turned about zero."""
    (a, b), (c, d) = low, high
    corners = np.array([[a, b, z], [c, b, z], [c, d, z], [a, d, z]], dtype=float)
    return mesh(corners @ (np.eye(3) if turn is None else turn), [[0, 1, 2], [0, 2, 3]])


def sphere(radius, *center):
    return ck.source("analytic.sphere", radius=radius, center=center)


def tube(sides, radius, length):
    """Return a prism without its ends."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    vertices = np.concatenate([np.column_stack([ring, np.full(sides, z)]) for z in (-length / 2, length / 2)])
    faces = [[k, (k + 1) % sides, k + sides] for k in range(sides)]
    faces += [[(k + 1) % sides, (k + 1) % sides + sides, k + sides] for k in range(sides)]
    return mesh(vertices @ TURN, faces)


def inside(source, count=3000):
    points = np.random.default_rng(0).uniform(*source.bounds, (count, source.dim))
    return points[source.closest_point(points).edge < 0]


def linear(x):
    return x @ np.array([1.0, -0.7, 0.4]) + 0.3


WIDE = ((-3, -3), (3, 3))
SURFACES = {
    "a plane": [plate(*WIDE, 0.13)],
    "a plane on a lattice plane": [plate(*WIDE, 0.0)],
    "a turned plane": [plate(*WIDE, 0.1, TURN)],
    "through edges of the box": [plate(*WIDE, 0.0, np.array([[1, 0, 0], [0, 0.6, 0.8], [0, -0.8, 0.6]]))],
    "with an end inside": [plate((-3, -3), (0.1, 3), 0.13)],
    "turned, with an end inside": [plate((-3, -3), (0.1, 3), 0.13, TURN)],
    "with a corner inside": [plate((-3, -3), (0.1, 0.2), 0.13, TURN)],
    "a sphere across": [sphere(0.8, 0.7, 0.2, 0.1)],
    "two planes that cross": [plate(*WIDE, 0.13), plate(*WIDE, 0.1, TURN[[2, 0, 1]])],
    "a plane that ends on another": [
        plate(*WIDE, 0.13),
        mesh([[0.1, -3, 0.13], [0.1, 3, 0.13], [0.1, 3, 3], [0.1, -3, 3]], [[0, 1, 2], [0, 2, 3]]),
    ],
    "two spheres that cross inside": [sphere(0.4, -0.2, 0.0, 0.0), sphere(0.4, 0.2, 0.0, 0.05)],
    "a tube": [tube(12, 0.4, 4.0)],
    "a sphere across a tube": [tube(8, 0.4, 4.0), sphere(0.6, 0.35, 0.15, 0.1)],
}


@pytest.mark.parametrize("solid", ["box", "ball"])
@pytest.mark.parametrize("name", SURFACES)
def test_linear_functions_pass_every_surface_unchanged(name, solid):
    """To the solver's tolerance in a box; on a ball to the error of its skin without any surface."""
    condition = [{"across": ck.Transmission()}, {"both": ck.Dirichlet(linear)}][list(SURFACES).index(name) % 2]
    boundaries = [ck.Boundary(f"b{k}", surface, **condition) for k, surface in enumerate(SURFACES[name])]
    source, limit = (BALL, 5e-4) if solid == "ball" else (BOX, 5e-4 if "sphere" in name else 1e-5)
    points = inside(source)
    scene = ck.Scene(source, ck.ScreenedPoisson(linear), boundaries, edge=ck.Dirichlet(linear))
    found = ck.solve(scene, 0.4, form="galerkin")
    assert np.abs(found.evaluate(points) - linear(points)).max() < limit


@pytest.mark.parametrize("kind", ["values", "a jump"])
def test_a_sphere_across_a_ball_is_of_third_order(kind):
    center, spacings, errors = np.array([1.0, 0.05, -0.02]), [0.4, 0.28, 0.2], []

    def is_in(x):
        return np.linalg.norm(x - center, axis=1) < 1

    conditions = {"across": ck.Transmission(jump=-1.0)}
    if kind == "values":
        conditions = {"left": ck.Dirichlet(u), "right": ck.Dirichlet(lambda x: u(x) + 1)}
    problem = ck.ScreenedPoisson(lambda x: f(x) + is_in(x))
    boundary = ck.Boundary("c", sphere(1.0, *center), **conditions)
    scene = ck.Scene(BALL, problem, [boundary], edge=ck.Dirichlet(lambda x: u(x) + is_in(x)))
    points = inside(BALL)
    for spacing in spacings:
        found = ck.solve(scene, spacing)
        assert found.discretized.form == "galerkin"
        assert found.report.iterations < 35
        errors.append(float(np.abs(found.evaluate(points) - u(points) - is_in(points)).max()))
    assert order_of(spacings, errors) > 2.6
    assert errors[-1] < 4e-4
    assert 0.5 < float(np.max(found.error.largest)) * np.ptp(found.evaluate(points)) / errors[-1] < 3


def test_each_of_four_pieces_has_a_solution_of_its_own():
    """Two planes that cross in a box: a linear function plus another constant on each piece, by fluxes on all sides."""
    slope, normals = np.array([1.0, -0.7, 0.4]), np.stack([Z @ TURN, Z @ TURN[[2, 0, 1]]])
    heights, constants = np.array([0.13, -0.1]), np.array([0.4, -0.8])

    def exact(x):
        return x @ slope + (x @ normals.T > heights) @ constants

    boundaries = []
    for name, normal, height in zip("ab", normals, heights, strict=True):
        surface = plate(*WIDE, height, TURN if name == "a" else TURN[[2, 0, 1]])
        flux = float(slope @ normal)  # normals of the plate point to its left
        boundaries.append(ck.Boundary(name, surface, left=ck.Neumann(-flux), right=ck.Neumann(flux)))
    scene = ck.Scene(BOX, ck.ScreenedPoisson(exact), boundaries, edge=ck.Dirichlet(exact))
    found = ck.solve(scene, 0.4)
    points = inside(BOX)
    points = points[np.abs(points @ normals.T - heights).min(axis=1) > 1e-6]
    assert np.abs(found.evaluate(points) - exact(points)).max() < 1e-6
    assert found.flux("a", "left") + found.flux("a", "right") == pytest.approx(0.0, abs=1e-6)


def in_sphere(x, center=(0.5, 0.1, 0.2)):
    return np.linalg.norm(x - center, axis=1) < 0.6


def above_turned(x):
    return x @ TURN.T[:, 2] > 0.1


def above_oblique(x):
    return (x - [0, 0, 0.1]) @ np.cross([1, 0, 0.2], [0, 1, 0.1]) > 0


def in_tube(x):
    angle = (np.arange(8) + 0.5) * np.pi / 4
    normals = np.stack([np.cos(angle), np.sin(angle)])
    return ((x @ TURN.T)[:, :2] @ normals).max(axis=1) < 0.4 * np.cos(np.pi / 8)


OBLIQUE = np.array([[-3, -3, -0.8], [3, -3, 0.4], [3, 3, 1.0], [-3, 3, -0.2]])
DIAGONAL = np.array([[-1, -1, -1], [2, 2, -1], [2, 2, 2], [-1, -1, 2]])
TWO = [[0, 1, 2], [0, 2, 3]]
CUBE = ck.source("analytic.box", lower=[0.0, 0.0, 0.0], upper=[1.0, 1.0, 1.0])
TURNED, SMALL = (plate(*WIDE, 0.1, TURN), above_turned), (sphere(0.6, 0.5, 0.1, 0.2), in_sphere)
MIDDLE = (0.35, 0.15, 0.1)
OTHER = (sphere(0.6, *MIDDLE), lambda x: in_sphere(x, MIDDLE))
#: Solid, spacing, and walls with functions that are true on one side.
ROOMS = {
    "a turned plane and a sphere": (BALL, 0.32, [TURNED, SMALL]),
    # the edge of the plane on the skin pierces the sphere within rounding of the plane
    "at another spacing": (BALL, 0.3, [TURNED, SMALL]),
    "an oblique plane and a sphere": (BALL, 0.4, [(mesh(OBLIQUE, TWO), above_oblique), SMALL]),
    # edges where they meet are bent more than triangles are thick
    "a sphere across a tube": (BALL, 0.4, [(tube(8, 0.4, 4.0), in_tube), OTHER]),
    # the wall passes through edges of lattice cells too
    "a plane through edges of a cube": (CUBE, 0.37, [(mesh(DIAGONAL, TWO), lambda x: x[:, 0] > x[:, 1])]),
}


@pytest.mark.parametrize("name", ROOMS)
def test_insulated_rooms_do_not_leak(name):
    """Walls divide a solid into rooms with constants of their own, to what sources at points beyond walls change."""
    solid, spacing, walls = ROOMS[name]

    def exact(x):
        return sum((k + 1.0) * side(x) for k, (_, side) in enumerate(walls))

    boundaries = [ck.Boundary(f"b{k}", surface, both=ck.Neumann(0.0)) for k, (surface, _) in enumerate(walls)]
    scene = ck.Scene(solid, ck.ScreenedPoisson(exact), boundaries, edge=ck.Neumann(0.0))
    points = inside(solid)
    assert np.abs(ck.solve(scene, spacing, estimate=False).evaluate(points) - exact(points)).max() < 5e-3


def test_an_insulated_wall_through_a_box_keeps_heat_and_divides_the_modes():
    wall = ck.Boundary("wall", plate(*WIDE, 0.1), both=ck.Neumann(0.0))
    insulated = ck.Neumann(0.0)
    problem = ck.Heat(lambda x: (x[:, 2] < 0.1) * (1 + x[:, 1]), until=0.2, step=0.05)
    heat = ck.solve(ck.Scene(BOX, problem, [wall], edge=insulated), 0.3)
    points = inside(BOX)
    assert np.abs(heat.evaluate(points[points[:, 2] > 0.1])).max() < 1e-6
    assert heat.integrate() == pytest.approx(4.4, rel=1e-9)
    modes = ck.solve(ck.Scene(BOX, ck.Eigen(count=6), [wall], edge=insulated), 0.3)
    assert modes.eigenvalues == pytest.approx([0.0, 0.0, *[np.pi**2 / 4] * 4], abs=2e-3)


@pytest.mark.parametrize(
    ("solid", "spacing", "limit"),
    [(BOX, 0.4, 1e-6), pytest.param(BALL, 0.3, 2e-3, marks=pytest.mark.slow)],
    ids=["box", "ball"],
)
def test_the_order_and_the_place_of_surfaces_do_not_matter(solid, spacing, limit):
    surfaces = SURFACES["two planes that cross"]
    points, values = inside(solid), []
    points = points[np.abs(points @ np.stack([Z, Z @ TURN[[2, 0, 1]]]).T - [0.13, 0.1]).min(axis=1) > 1e-3]
    for order, move in (([0, 1], np.zeros(3)), ([1, 0], np.zeros(3)), ([0, 1], np.array([0.31, 0.17, -0.07]))):
        moved = [ck.source("moved", of=source, translation=move) for source in (solid, *surfaces)]
        data = ck.Dirichlet(lambda x, move=move: linear(x - move))
        conditions = [{"across": ck.Transmission(resistance=0.5)}, {"both": data}]
        boundaries = [ck.Boundary(f"b{k}", moved[k + 1], **conditions[k]) for k in order]
        scene = ck.Scene(moved[0], ck.ScreenedPoisson(1.0), boundaries)
        values.append(ck.solve(scene, spacing).evaluate(points + move))
    assert np.abs(values[1] - values[0]).max() < limit
    assert np.abs(values[2] - values[0]).max() < limit


def test_a_fracture_across_a_ball_conducts():
    """A disc in the plane z = 0 of a ball, both with u = x: what the disc has is no source on either side."""
    angle = 2 * np.pi * np.arange(64) / 64
    rim = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(64)])
    disc = mesh([*rim, [0.0, 0.0, 0.0]], [[k, (k + 1) % 64, 64] for k in range(64)])
    both = ck.source("union", members=[BALL, disc])
    problem = ck.Elliptic(f=0.0, diffusivity=ck.MemberData(both, [1.0, 5.0]))
    found = ck.solve(ck.Scene(both, problem, edge=ck.Dirichlet("x")), 0.4)
    assert found.discretized.form == "galerkin"
    points = inside(BALL)
    assert np.abs(found.of_dimension(3).evaluate(points) - points[:, 0]).max() < 1e-3


def test_surfaces_that_are_refused():
    crossing = [[-0.4, -0.4, 0], [0.4, -0.4, 0], [0, 0.4, 0], [-0.4, 0, -0.3], [0.4, 0, -0.3], [0, 0.1, 0.4]]
    refused = {
        "crosses itself near": mesh(crossing, [[0, 1, 2], [3, 4, 5]]),
        "lies outside the solid": sphere(0.3, 3.0, 0.0, 0.0),
        "or they are nearly tangent there": sphere(1.0, 0.02, 0.0, 0.0),
    }
    for words, surface in refused.items():
        scene = ck.Scene(BALL, ck.Laplace(), [ck.Boundary("b", surface, both=1.0)], edge=ck.Dirichlet(0.0))
        with pytest.raises((ck.SceneError, ck.ResolutionError), match=words):
            ck.solve(scene, 0.3, form="galerkin")
