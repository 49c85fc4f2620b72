"""Boundaries inside solids in the Galerkin form: both sides, crossings, ends, membranes, cracks, and refusals."""

import numpy as np
import pytest
from model_problems import order_of
from solid_problems import f, gradient, u

import cpmkit as ck

SQUARE = ck.source("analytic.box", lower=[-1.0, -1.0], upper=[1.0, 1.0])
DISK = ck.source("solid", of=ck.source("analytic.circle"))
BALL = ck.source("solid", of=ck.source("analytic.sphere"))
HOLE = ck.source("analytic.circle", radius=0.4, center=[0.1, 0.0])
RING = ck.source("solid", of=ck.source("union", members=[ck.source("analytic.circle"), HOLE]))
ELL = [[-1, -1], [1, -1], [1, 0.1], [0.1, 0.1], [0.1, 1], [-1, 1], [-1, -1]]
ELL = ck.source("solid", of=ck.source("mesh.polyline", points=ELL))
T = np.linspace(0, 1, 40)


def line(*points):
    return ck.source("mesh.polyline", points=np.array(points, dtype=float))


def circle(radius, *center):
    return ck.source("analytic.circle", radius=radius, center=center)


def inside(source, count=4000):
    points = np.random.default_rng(0).uniform(*source.bounds, (count, source.dim))
    return points[source.closest_point(points).edge < 0]


def solve(source, curves, condition, spacing, problem, edge=0.0):
    boundaries = [ck.Boundary(f"b{number}", curve, **condition) for number, curve in enumerate(curves)]
    return ck.solve(ck.Scene(source, problem, boundaries, edge=edge), spacing, form="galerkin")


#: Corners of a square in the plane z = 0, and of one in y = 0.
SQUARE_FACES = 0.4 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
UPRIGHT_FACES = SQUARE_FACES[:, [0, 2, 1]]


def plates(*squares):
    """Return one mesh of squares, given by their corners."""
    faces = [[4 * k, 4 * k + i, 4 * k + i + 1] for k in range(len(squares)) for i in (1, 2)]
    return ck.source("mesh.triangles", vertices=np.concatenate(squares), faces=faces, closest="faceted")


def box(half):
    vertices, faces = ck.source("analytic.box", lower=[-half] * 3, upper=[half] * 3).mesh(10.0)
    return ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")


def linear(x):
    return x @ np.array([1.0, -0.7]) + 0.3


CURVES = {
    "a line through": (SQUARE, [line([-2, 0.1], [2, 0.2])]),
    "on knot planes": (SQUARE, [line([-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5])]),
    "through the middles of cells": (SQUARE, [line([-2, 0.0], [2, 0.0]), line([0.0, -2], [0.0, 2])]),
    "both diagonals": (SQUARE, [line([-1, -1], [1, 1]), line([-1, 1], [1, -1])]),
    "a line with corners and two ends": (SQUARE, [line([-0.8, -0.3], [-0.2, 0.4], [0.1, -0.5], [0.6, 0.5])]),
    "an end on another": (SQUARE, [line([-2, 0.1], [2, 0.1]), line([0.1, -2], [0.1, 0.1])]),
    "three that meet": (SQUARE, [line([0, 0], [0.7, 0.1]), line([0, 0], [-0.3, 0.6]), line([0, 0], [-0.3, -0.6])]),
    "two ends that face each other": (SQUARE, [line([-0.8, 0], [-0.03, 0]), line([0.03, 0], [0.8, 0])]),
    "smaller than a cell": (SQUARE, [line([0.01, 0.02], [0.05, 0.03]), circle(0.03, 0.4, 0.4)]),
    "a strip thinner than a cell": (SQUARE, [line([-2, 0.0], [2, 0.0]), line([-2, 0.01], [2, 0.012])]),
    "beside the edge": (SQUARE, [line([-0.8, -0.99], [0.8, -0.99])]),
    "circles that cross": (DISK, [circle(0.4, -0.2, 0.0), circle(0.4, 0.25, 0.1), line([-2, 0.1], [2, 0.3])]),
    "a circle that leaves": (DISK, [circle(0.7, 0.6, 0.2)]),
    "between two edges": (RING, [line([0.2, 0.1], [0.3, 2]), line([0.1, 0], [-2, 0])]),
    "from a reentrant corner": (ELL, [line([0.1, 0.1], [-0.6, -0.7])]),
    "a figure of eight": (SQUARE, [line(*np.c_[0.7 * np.sin(2 * np.pi * T), 0.5 * np.sin(4 * np.pi * T)])]),
    "a spiral": (SQUARE, [line(*np.c_[(0.1 + 0.7 * T) * np.cos(9 * T), (0.1 + 0.7 * T) * np.sin(9 * T)])]),
}


@pytest.mark.parametrize("name", CURVES)
def test_linear_functions_pass_every_boundary_unchanged(name):
    source, curves = CURVES[name]
    points = inside(source)
    for condition in {"across": ck.Transmission()}, {"both": ck.Dirichlet(linear)}:
        found = solve(source, curves, condition, 0.2, ck.ScreenedPoisson(linear), ck.Dirichlet(linear))
        assert np.abs(found.evaluate(points) - linear(points)).max() < 1e-7, condition


@pytest.mark.parametrize("seed", range(3))
def test_pieces_between_lines_have_solutions_of_their_own(seed):
    """Lines across a square: a linear function plus another constant on each piece, by the flux on both sides."""
    rng, slope = np.random.default_rng(seed), np.array([1.0, -0.7])
    angles, offsets, constants = rng.uniform(0, 2 * np.pi, 2), rng.uniform(-0.4, 0.4, 2), rng.uniform(-1, 1, 4)
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def exact(x):
        return x @ slope + constants[(x @ normals.T > offsets) @ [1, 2]]

    boundaries = []
    for number, (normal, offset) in enumerate(zip(normals, offsets, strict=True)):
        along, flux = 3 * np.array([-normal[1], normal[0]]), float(slope @ normal)
        curve = line(offset * normal - along, offset * normal + along)
        boundaries.append(ck.Boundary(f"b{number}", curve, left=ck.Neumann(flux), right=ck.Neumann(-flux)))
    scene = ck.Scene(SQUARE, ck.ScreenedPoisson(exact), boundaries, edge=ck.Dirichlet(exact))
    points = inside(SQUARE)
    points = points[np.abs(points @ normals.T - offsets).min(axis=1) > 1e-6]
    found = ck.solve(scene, 0.1, form="galerkin")
    assert np.abs(found.evaluate(points) - exact(points)).max() < 1e-6


def out_of(center):
    return lambda x: (x - center) / np.linalg.norm(x - center, axis=1)[:, None]


#: The solid, a circle or sphere inside or across it, its centre and radius.
ROUND = {
    "in a disk": (DISK, [0.1, 0.05], 0.5, [0.2, 0.1, 0.05]),
    "across a disk": (DISK, [1.0, 0.05], 1.0, [0.2, 0.1, 0.05]),
    "in a ball": (BALL, [0.1, 0.05, -0.02], 0.5, [0.4, 0.3, 0.2]),
}


@pytest.mark.parametrize("kind", ["values", "fluxes", "a jump"])
@pytest.mark.parametrize("name", ROUND)
def test_curved_boundaries_are_of_third_order(name, kind):
    source, center, radius, spacings = ROUND[name]
    shape = "analytic.circle" if source.dim == 2 else "analytic.sphere"
    out = out_of(np.array(center))

    def is_in(x):
        return np.linalg.norm(x - center, axis=1) < radius

    def flux(x):
        return np.sum(gradient(x) * out(x), axis=1)

    inner, outer = {
        "values": (ck.Dirichlet(lambda x: u(x) + 1), ck.Dirichlet(u)),
        "fluxes": (ck.Neumann(flux), ck.Neumann(lambda x: -flux(x))),
        "a jump": (None, None),
    }[kind]
    # left of a circle that runs counterclockwise is inside, left of a sphere is where its normals point
    sides = {"left": inner, "right": outer} if source.dim == 2 else {"left": outer, "right": inner}
    jump = ck.Transmission(jump=1.0 if source.dim == 2 else -1.0)
    conditions = sides if inner else {"across": jump}
    boundary = ck.Boundary("c", ck.source(shape, radius=radius, center=center), **conditions)
    scene = ck.Scene(
        source, ck.ScreenedPoisson(lambda x: f(x) + is_in(x)), [boundary], edge=ck.Dirichlet(lambda x: u(x) + is_in(x))
    )
    points = inside(source)
    errors = []
    for spacing in spacings:
        found = ck.solve(scene, spacing, form="galerkin")
        errors.append(float(np.abs(found.evaluate(points) - u(points) - is_in(points)).max()))
    assert order_of(spacings, errors) > 2.6
    assert errors[-1] < (1e-5 if source.dim == 2 else 5e-4)
    if (name, kind) != ("across a disk", "fluxes"):  # a value meets a flux at 60 degrees, where u may be singular
        assert 0.5 < float(np.max(found.error.largest)) * np.ptp(found.evaluate(points)) / errors[-1] < 3


@pytest.mark.parametrize(("inner", "outer", "resistance"), [(1.0, 1.0, 1.0), (1e3, 1.0, 0.1), (1.0, 1e3, 0.0)])
def test_two_materials_with_a_resistance_between_them(inner, outer, resistance):
    """-div(k grad u) = 1 in the unit disk, of another material within half of its radius."""

    def exact(x):
        r = np.linalg.norm(x, axis=1)
        centre = 0.75 / (4 * outer) + resistance / 4 + 0.25 / (4 * inner)
        return np.where(r < 0.5, centre - r**2 / (4 * inner), (1 - r**2) / (4 * outer))

    def conductivity(x):
        return np.where(np.linalg.norm(x, axis=1) < 0.5, inner, outer)

    problem, points = ck.Elliptic(f=1.0, diffusivity=conductivity), inside(DISK)
    membrane = {"across": ck.Transmission(resistance=resistance)}
    found = solve(DISK, [circle(0.5, 0.0, 0.0)], membrane, 0.1, problem, ck.Dirichlet(0.0))
    assert np.abs(found.evaluate(points) - exact(points)).max() < 3e-7 * np.ptp(exact(points))
    assert -inner * found.flux("b0", side="left") == pytest.approx(np.pi / 4, rel=1e-6)
    assert outer * found.flux("b0", side="right") == pytest.approx(np.pi / 4, rel=1e-6)
    assert not found.warnings


def test_each_side_of_a_boundary_is_read():
    sphere, sides = ck.source("analytic.sphere", radius=0.5), {"left": 2.0, "right": 1.0}
    found = solve(BALL, [sphere], sides, 0.25, ck.Laplace(), ck.Dirichlet(2.0))
    at = np.random.default_rng(0).normal(size=(50, 3))
    at *= 0.5 / np.linalg.norm(at, axis=1)[:, None]
    for scale in (1.0, 1 - 1e-9, 1 + 1e-9):
        assert found.evaluate(scale * at, side="left") == pytest.approx(2)
        assert found.evaluate(scale * at, side="right") == pytest.approx(1)
    assert found.evaluate(0.9999 * at) == pytest.approx(1)
    assert found.evaluate(1.0001 * at) == pytest.approx(2)
    assert found.signed_distance("b0", [[0.4, 0.0, 0.0], [0.0, 0.6, 0.0]]) == pytest.approx([-0.1, 0.1])


def test_points_on_knot_planes_and_in_thin_strips_are_read_on_their_side():
    sides, at = {"left": 1.0, "right": 0.0}, np.linspace(-0.9, 0.9, 7)
    found = solve(SQUARE, [line([-2, 0.1], [2, 0.1])], sides, 0.2, ck.ScreenedPoisson(0.0), ck.Neumann(0.0))
    assert found.evaluate([[0.0, 0.1]], side="both") == pytest.approx(np.array([[1.0, 0.0]]), abs=1e-2)
    strip = solve(SQUARE, [line([-2, 0.995], [2, 0.995])], sides, 0.2, ck.ScreenedPoisson(0.0), ck.Neumann(0.0))
    assert strip.evaluate(np.stack([at, 0 * at + 0.9951], axis=1)) == pytest.approx(1.0, abs=1e-3)
    fold = line([-2, 0], [0.5, 0], [0.5, 0.01], [-2, 0.01])
    found = solve(SQUARE, [fold], {"right": 0.0, "left": 1.0}, 0.2, ck.ScreenedPoisson(0.0))
    assert found.evaluate([[0.1, 0.002], [0.1, 0.005], [0.1, 0.008]]) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("name", ["a line", "a curve"])
def test_a_curve_that_crosses_itself_encloses_its_loop(name):
    """u = 1 in one loop and 0 elsewhere, with no flux through the curve."""
    loop = np.array([[0.4 - 0.98 / 1.7, 0.9 * 0.98 / 1.7 - 0.39], [0.3, 0.51], [0.4, -0.39]])
    curve = line([-0.7, -0.29], loop[1], loop[2], [-0.6, 0.51])
    if name == "a curve":
        formulas = ["0.7*sin(t)", "0.5*sin(2*t)"]
        curve = ck.source("parametric.curve", x=formulas, range=[0, "2*pi"], periodic=True)

    def in_loop(x):
        if name == "a curve":
            height = 0.5 * np.sin(2 * np.arcsin(np.clip(np.abs(x[:, 0]) / 0.7, 0, 1)))
            return 1.0 * ((x[:, 0] < 0) & (x[:, 0] > -0.7) & (np.abs(x[:, 1]) < height))
        edges = np.roll(loop, -1, axis=0) - loop
        across = edges[:, 0] * (x[:, None, 1] - loop[:, 1]) - edges[:, 1] * (x[:, None, 0] - loop[:, 0])
        return 1.0 * (across < 0).all(axis=1)

    insulated = ck.Neumann(0.0)
    found = solve(SQUARE, [curve], {"both": insulated}, 0.13, ck.ScreenedPoisson(in_loop), insulated)
    points = inside(SQUARE)
    off = np.abs(found.evaluate(points) - in_loop(points))
    assert np.sort(off)[-5] < 1e-6


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_a_crack_with_its_tip(angle):
    """sqrt(r) sin(theta / 2) has no flux through the crack; as on surfaces, the root of its error falls with h."""
    turn, tip = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), np.array([0.07, 0.03])

    def exact(x):
        y = (x - tip) @ turn
        return np.sqrt(np.hypot(*y.T)) * np.sin(np.arctan2(y[:, 1], y[:, 0]) / 2)

    crack, points, spacings = line(tip - 3 * turn[:, 0], tip), inside(SQUARE), [0.2, 0.1, 0.05]
    errors = []
    for spacing in spacings:
        found = solve(SQUARE, [crack], {"both": ck.Neumann(0.0)}, spacing, ck.Laplace(), ck.Dirichlet(exact))
        errors.append(float(np.sqrt(np.mean((found.evaluate(points) - exact(points)) ** 2))))
    assert errors[-1] < 4e-3
    assert order_of(spacings, errors) > 0.9
    assert "boundaries end inside" in found.error.slow


def test_an_open_surface_in_a_ball():
    """What flows out of a hot plate flows out of the ball, half of it from each side, in every position."""
    corners = [[-0.4, -0.4, 0.0], [0.4, -0.4, 0.0], [0.4, 0.4, 0.0], [-0.4, 0.4, 0.0]]
    fluxes = []
    for turn in ([0.0, 0.0, 0.0], [0.3, 0.5, 0.1]):
        plate = ck.source("mesh.triangles", vertices=corners, faces=[[0, 1, 2], [0, 2, 3]], closest="faceted")
        plate = ck.source("moved", of=plate, rotation=turn)
        found = solve(BALL, [plate], {"both": ck.Dirichlet(1.0)}, 0.27, ck.Laplace(), ck.Dirichlet(0.0))
        sides = [found.flux("b0", side=side) for side in ("left", "right")]
        assert sides[0] == pytest.approx(sides[1], rel=0.03)
        assert sum(sides) + found.flux("edge") == pytest.approx(0.0, abs=1e-6)
        fluxes.append(sum(sides))
    assert fluxes[0] == pytest.approx(fluxes[1], rel=0.05)


def test_an_insulated_wall_keeps_heat_on_its_side_and_doubles_eigenvalues():
    wall = [line([0.1, -2], [0.1, 2])]
    insulated = ck.Neumann(0.0)
    problem = ck.Heat(lambda x: (x[:, 0] < 0.1) * (1 + x[:, 1]), until=0.2, step=0.02)
    heat = solve(SQUARE, wall, {"both": insulated}, 0.1, problem, insulated)
    points = inside(SQUARE)
    right = points[points[:, 0] > 0.1]
    assert np.abs(heat.evaluate(right)).max() < 1e-6
    assert heat.integrate() == pytest.approx(2.2, rel=1e-9)
    modes = solve(SQUARE, wall, {"both": insulated}, 0.1, ck.Eigen(count=4), insulated)
    assert modes.eigenvalues == pytest.approx([0.0, 0.0, np.pi**2 / 4, np.pi**2 / 4], abs=1e-4)


def test_two_sources_on_two_sides_of_a_membrane_are_reciprocal():
    def solve_with(center):
        problem = ck.ScreenedPoisson(lambda x: np.exp(-20 * np.sum((x - center) ** 2, axis=1)))
        return solve(DISK, [circle(0.5, 0.0, 0.0)], {"across": ck.Transmission(resistance=0.7)}, 0.1, problem)

    first, second = np.array([0.1, 0.2]), np.array([-0.7, 0.1])
    one, two = solve_with(first), solve_with(second)
    weight = [lambda x, v, c=c: v * np.exp(-20 * np.sum((x - c) ** 2, axis=1)) for c in (second, first)]
    assert one.integrate(weight[0]) == pytest.approx(two.integrate(weight[1]), rel=3e-5)


def test_a_moved_turned_and_scaled_scene_has_the_same_solution(tmp_path):
    membrane, move = {"across": ck.Transmission(resistance=0.5)}, {"rotation": 0.7, "translation": [50.0, -20.0]}
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])

    def back(x):
        return (x - [50.0, -20.0]) @ turn / 1e-3

    curve, points = circle(0.4, 0.1, 0.0), inside(DISK)
    plain = solve(DISK, [curve], membrane, 0.1, ck.Elliptic(f=f), ck.Dirichlet(linear))
    source, moved = (ck.source("moved", of=of, scale=1e-3, **move) for of in (DISK, curve))
    problem = ck.Elliptic(f=lambda x: f(back(x)), diffusivity=1e-6)
    membrane = {"across": ck.Transmission(resistance=0.5 / 1e-3)}
    there = solve(source, [moved], membrane, 1e-4, problem, ck.Dirichlet(lambda x: linear(back(x))))
    found = there.evaluate(1e-3 * points @ turn.T + [50.0, -20.0])
    near = np.abs(np.linalg.norm(points - [0.1, 0.0], axis=1) - 0.4) < 1e-3
    assert np.abs(found - plain.evaluate(points))[~near].max() < 5e-4
    plain.save(tmp_path / "disk.npz")
    assert np.array_equal(ck.load(tmp_path / "disk.npz", plain.scene).evaluate(points), plain.evaluate(points))


def test_boundaries_that_are_refused():
    condition, problem = {"both": ck.Dirichlet(0.0)}, ck.Laplace()
    refused = {
        "touches boundary 'b0'": [line([-2, 0.1], [2, 0.1]), line([-2, 0.1], [0.5, 0.1])],
        "touches the boundary of the solid": [line([-1.0, -0.5], [-1.0, 0.5])],
        "ends 0.0007.* from boundary 'b0' near": [line([-2, 0.1], [2, 0.13]), line([0.1, -2], [0.1, 0.115])],
        "lies outside the solid": [circle(0.2, 3.0, 0.0)],
    }
    for words, curves in refused.items():
        with pytest.raises(ck.SceneError, match=words):
            solve(SQUARE, curves, condition, 0.1, problem)
    with pytest.raises(ck.SceneError, match="boundary 'b0' crosses itself near"):
        solve(BALL, [plates(SQUARE_FACES, UPRIGHT_FACES)], condition, 0.3, problem)
    for surfaces in (
        [box(0.2), box(0.5)],
        [ck.source("analytic.sphere", radius=0.2), plates(SQUARE_FACES + [0, 0, 0.4])],
    ):
        boundaries = [ck.Boundary(f"b{number}", surface, **condition) for number, surface in enumerate(surfaces)]
        ck.discretize(ck.Scene(BALL, problem, boundaries), 0.3, form="galerkin")
    ring = [ck.source("analytic.circle", radius=0.5, center=[0.0, 0.0, 0.0], normal=[0, 0, 1])]
    with pytest.raises(ck.SceneError, match="takes curves in a plane solid, or surfaces in one in space"):
        solve(BALL, ring, condition, 0.2, problem)
