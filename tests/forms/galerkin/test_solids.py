"""Solids in the Galerkin form: linear functions to rounding, third order for every condition, and every source."""

import numpy as np
import pytest
from model_problems import order_of
from scipy.spatial.transform import Rotation
from solid_problems import f, gradient, u

import cpmkit as ck
from cpmkit.forms.galerkin.solids.skin import cell_components
from cpmkit.mesh.mesh import Mesh

RNG = np.random.default_rng(0)
IN_BOX = {dim: RNG.uniform(-0.5, 0.5, (400, dim)) for dim in (2, 3)}
SLOPE = np.array([1.0, -2.0, 0.7])


class Box:
    """A square or cube of side 1, moved and turned at random."""

    def __init__(self, dim, seed):
        rng = np.random.default_rng(seed)
        angle, self.shift = rng.normal(size=1 if dim == 2 else 3), rng.uniform(size=dim)
        rotation = Rotation.from_rotvec([0, 0, *angle] if dim == 2 else angle)
        self.turn = rotation.as_matrix()[:dim, :dim]
        move = {"rotation": float(angle[0]) if dim == 2 else angle, "translation": self.shift}
        self.source = ck.source("analytic.box", lower=[-0.5] * dim, upper=[0.5] * dim, **move)
        self.points = IN_BOX[dim] @ self.turn.T + self.shift

    def normal(self, x):
        y = (x - self.shift) @ self.turn
        rows, axis = np.arange(len(y)), np.abs(y).argmax(axis=1)
        normals = np.zeros_like(y)
        normals[rows, axis] = np.sign(y[rows, axis])
        return normals @ self.turn.T


def conditions(value, flux, faces):
    """Conditions of each kind, and of all kinds on faces of a box in turn."""
    robin = ck.Robin(1.0, 2.0, lambda x: flux(x) + 2 * value(x))
    kinds = {"dirichlet": ck.Dirichlet(value), "neumann": ck.Neumann(flux), "robin": robin}
    return {**kinds, "mixed": {k: list(kinds.values())[k % 3] for k in range(faces)}}


@pytest.mark.parametrize(("dim", "spacing", "seed"), [*((2, 0.13, k) for k in range(10)), (3, 0.3, 0), (3, 0.3, 1)])
def test_linear_functions_are_exact(dim, spacing, seed):
    box = Box(dim, seed)

    def linear(x):
        return x @ SLOPE[:dim] + 0.3

    for name, edge in conditions(linear, lambda x: box.normal(x) @ SLOPE[:dim], 2 * dim).items():
        found = ck.solve(ck.Scene(box.source, ck.ScreenedPoisson(linear), edge=edge), spacing, form="galerkin")
        assert np.abs(found.evaluate(box.points) - linear(box.points)).max() < 1e-10, name


def errors(source, edge, points, spacings, **options):
    scene = ck.Scene(source, ck.ScreenedPoisson(f), edge=edge)
    solved = [ck.solve(scene, h, form="galerkin", **options) for h in spacings]
    return [float(np.abs(each.evaluate(points) - u(points)).max()) for each in solved]


def on_unit_ball(kind):
    """A condition on the unit circle or sphere."""
    return conditions(u, lambda x: np.sum(gradient(x) * x, axis=1), 0)[kind]


def inside(source, count=3000):
    lower, upper = np.asarray(source.bounds)
    points = np.random.default_rng(1).uniform(lower, upper, (count, source.dim))
    return points[source.closest_point(points).edge < 0]


@pytest.mark.parametrize("kind", ["dirichlet", "neumann", "robin"])
@pytest.mark.parametrize(
    ("shape", "spacings", "bound"),
    [("analytic.circle", [0.2, 0.1, 0.05], 4e-6), ("analytic.sphere", [0.4, 0.2, 0.133], 1.2e-4)],
)
def test_disks_and_balls_are_of_third_order(shape, spacings, bound, kind):
    source = ck.source("solid", of=ck.source(shape))
    found = errors(source, on_unit_ball(kind), inside(source), spacings)
    assert found[-1] < bound
    assert order_of(spacings, found) > 2.6


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("dim", "spacing", "bound"), [(2, 0.1, 3e-5), (3, 0.2, 3e-4)])
def test_turned_boxes_with_fluxes(dim, spacing, bound, seed):
    box = Box(dim, seed)
    edge = ck.Neumann(lambda x: np.sum(gradient(x) * box.normal(x), axis=1))
    assert errors(box.source, edge, box.points, [spacing])[0] < bound


CIRCLE, HOLE = ck.source("analytic.circle"), ck.source("analytic.circle", center=[0.2, 0.1], radius=0.4)
ELL = [[0, 0], [1, 0], [1, 0.5], [0.5, 0.5], [0.5, 1], [0, 1], [0, 0]] @ np.array([[0.8, 0.6], [-0.6, 0.8]])
CUBOID = ck.source("analytic.box", lower=[0, 0, 0], upper=[1, 0.8, 0.6], rotation=[0.3, 0.2, 0.5]).mesh(1.0)
SOURCES = {
    "level set": (ck.source("levelset.expression", phi="x**2 + y**2 - 1", bounds=[[-1.3] * 2, [1.3] * 2]), 0.1),
    "hole": (ck.source("union", members=[CIRCLE, HOLE]), 0.1),
    "polygon": (ck.source("mesh.polyline", points=ELL), 0.1),
    "torus": (ck.source("analytic.torus", major=1.0, minor=0.5), 0.25),
    "level set in space": (
        ck.source("levelset.expression", phi="x**2 + y**2 + z**2 - 1", bounds=[[-1.3] * 3, [1.3] * 3]),
        0.3,
    ),
    "closed mesh": (ck.source("mesh.triangles", vertices=CUBOID[0], faces=CUBOID[1], closest="faceted"), 0.2),
}


@pytest.mark.parametrize("name", SOURCES)
def test_every_closed_source_encloses_a_solid(name):
    source, spacing = SOURCES[name]
    solid = ck.source("solid", of=source)
    assert errors(solid, ck.Dirichlet(u), inside(solid), [spacing])[0] < 0.02 * spacing**2.5


def test_flat_and_curved_parts_of_one_boundary():
    """A polygon with a round hole, and a disc beside a square: third order, and exact areas."""
    outer = np.array([[-1.0, -1.0], [1.0, -1.1], [1.05, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
    x, y = outer.T
    area = 0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) - np.pi * 0.4**2
    members = [ck.source("mesh.polyline", points=outer), HOLE]
    holed = ck.source("solid", of=ck.source("union", members=members))
    spacings = [0.2, 0.1, 0.05]
    found = errors(holed, ck.Dirichlet(u), inside(holed), spacings)
    assert found[-1] < 4e-6
    assert order_of(spacings, found) > 2.8
    scene = ck.Scene(holed, ck.ScreenedPoisson(1.0))
    assert ck.solve(scene, 0.1, form="galerkin").integrate(1) == pytest.approx(area, abs=1e-6)
    square = ck.source("analytic.box", lower=[1.5, -0.5], upper=[2.5, 0.5])
    beside = ck.source("union", members=[ck.source("solid", of=CIRCLE), square])
    solution = ck.solve(ck.Scene(beside, ck.ScreenedPoisson(1.0)), 0.1, form="galerkin")
    assert solution.integrate(1) == pytest.approx(np.pi + 1, abs=1e-5)


def test_a_cuboid_with_a_round_hole():
    box = ck.source("mesh.triangles", vertices=2 * CUBOID[0], faces=CUBOID[1], closest="faceted")
    middle = 2 * CUBOID[0].mean(axis=0)
    members = [box, ck.source("analytic.sphere", center=middle, radius=0.3)]
    holed = ck.source("solid", of=ck.source("union", members=members))
    spacings = [0.28, 0.2, 0.14]
    found = errors(holed, ck.Dirichlet(u), inside(holed), spacings)
    assert found[-1] < 5e-5
    assert order_of(spacings, found) > 2.7


def test_a_solid_that_is_moved_as_a_whole():
    ball = ck.source("moved", of=ck.source("solid", of=ck.source("analytic.sphere")), scale=0.5, translation=[1, 2, 3])
    assert errors(ball, ck.Dirichlet(u), inside(ball), [0.15])[0] < 1e-3


def test_parts_of_a_skin_have_conditions_of_their_own():
    disk = ck.source("solid", of=CIRCLE)
    edge = [(on_unit_ball("dirichlet"), "x < 0.1"), (on_unit_ball("robin"), "y < 0.2"), on_unit_ball("neumann")]
    assert errors(disk, edge, inside(disk), [0.1])[0] < 3e-5


def test_functions_are_evaluated_inside_alone():
    """Quadrature points outside the solid are reflected: sqrt(1 - r^2) is not defined there."""
    disk, seen = ck.source("solid", of=CIRCLE), []

    def source(x):
        seen.append(float(np.linalg.norm(x, axis=1).max()))
        return f(x)

    ck.solve(ck.Scene(disk, ck.ScreenedPoisson(source), edge=ck.Dirichlet(u)), 0.2, form="galerkin")
    assert max(seen) < 1 + 1e-9


def test_iterations_do_not_grow():
    ball = ck.source("solid", of=ck.source("analytic.sphere"))
    counts = {
        (kind, h): ck.solve(
            ck.Scene(ball, ck.ScreenedPoisson(f), edge=on_unit_ball(kind)), h, form="galerkin", solver="multigrid"
        ).report.iterations
        for kind in ("dirichlet", "neumann")
        for h in (0.25, 0.15)
    }
    assert max(counts.values()) <= 30


def test_the_error_at_reentrant_corners_is_known():
    corners = np.array([[0, 0], [1, 0], [1, 0.5], [0.5, 0.5], [0.5, 1], [0, 1]]) @ [[0.8, 0.6], [-0.6, 0.8]]
    solid = ck.source("solid", of=ck.source("mesh.polyline", points=corners, closed=True))
    scene = ck.Scene(solid, ck.Poisson(1.0), edge=ck.Dirichlet(0.0))
    fine = ck.solve(scene, 0.0125, form="galerkin")
    feet = solid.closest_point(RNG.uniform(-0.6, 1.4, (1000, 2)))
    x = feet.points[feet.edge < 0]
    for spacing in (0.1, 0.05):
        solution = ck.solve(scene, spacing, form="galerkin")
        true = np.sqrt(np.mean((solution.evaluate(x) - fine.evaluate(x)) ** 2)) / np.ptp(fine.evaluate(x))
        assert 0.5 < solution.error.rms[0] / true < 3.5
        assert "reentrant" in solution.error.slow
    box = ck.Scene(ck.source("analytic.box", lower=[0, 0], upper=[1, 1]), ck.Poisson(1.0), edge=ck.Dirichlet(0.0))
    assert not ck.solve(box, 0.1, form="galerkin").error.slow


def test_components_of_a_skin_do_not_depend_on_the_first_corners_of_its_cells():
    corners = np.concatenate([np.eye(3), -np.eye(3)])  # an octahedron: the first edges of its cells fall into two parts
    cells = [[0, 1, 2], [3, 2, 1], [3, 4, 2], [4, 2, 0], [0, 1, 5], [3, 5, 1], [3, 4, 5], [4, 5, 0]]
    count, part = cell_components(
        Mesh.of(np.concatenate([corners, corners + 4]), np.array([*cells, *np.add(cells, 6)]))
    )
    assert count == 2
    assert part.tolist() == [0] * 8 + [1] * 8
