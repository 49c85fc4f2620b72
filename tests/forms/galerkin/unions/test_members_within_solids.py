"""Members that divide a solid, as fractures in rock and membranes inside a cell: orders, balance, positions."""

import numpy as np
import pytest
from union_problems import Problem, in_ball

import cpmkit as ck

INNER = 0.5
SQUARE = ck.source("analytic.box", lower=[-1.0, -1.0], upper=[1.0, 1.0])
SOURCES = {2: "analytic.circle", 3: "analytic.sphere"}
POINTS = {2: in_ball()[:, :2], 3: in_ball()}


def shell_in_ball(dim: int, resistance: float, c: float = 2.0) -> Problem:
    """-Lap u = 1 in the unit ball, 0 on its edge; a shell of radius .5 with c v = what the two sides give to it."""
    ball, shell = ck.source("solid", of=ck.source(SOURCES[dim])), ck.source(SOURCES[dim], radius=INNER)
    both = ck.source("union", members=[ball, shell])
    problem = ck.Elliptic(f=ck.MemberData(both, [1.0, 0.0]), c=ck.MemberData(both, [0.0, c]))
    scene = ck.Scene(both, problem, edge=ck.Dirichlet(0.0), junctions=ck.Junction(resistance=resistance))
    # outside u = (1 - r^2) / 2d - C g(r), g the potential of the shell with the flux 1 per area
    g = -INNER * np.log(INNER) if dim == 2 else INNER**2 * (1 / INNER - 1)
    v = ((1 - INNER**2) / (2 * dim) + resistance * INNER / dim) / (1 + c * (g + resistance))

    def u(x):
        r = np.linalg.norm(x, axis=1)
        potential = -INNER * np.log(r) if dim == 2 else INNER**2 * (1 / r - 1)
        inside = v + (INNER**2 - r**2) / (2 * dim) + resistance * INNER / dim
        return np.where(r < INNER, inside, (1 - r**2) / (2 * dim) - c * v * potential)

    return Problem(scene, {dim: u, dim - 1: lambda x: np.full(len(x), v)})


@pytest.mark.parametrize(
    ("dim", "resistance", "spacings", "bound"),
    [(2, 0.0, (0.2, 0.14, 0.1), 6e-5), (2, 1.0, (0.2, 0.14, 0.1), 6e-5), (3, 1.0, (0.36, 0.25, 0.18), 6e-4)],
)
def test_a_shell_in_a_ball_is_of_third_order(dim, resistance, spacings, bound):
    problem, errors = shell_in_ball(dim, resistance), []
    shell = INNER * POINTS[dim] / np.linalg.norm(POINTS[dim], axis=1)[:, None]
    for spacing in spacings:
        found = ck.solve(problem.scene, spacing, estimate=False)
        assert found.discretized.form == "galerkin"
        assert found.report.iterations < 35
        errors.append(problem.largest_error(found, {dim: POINTS[dim], dim - 1: shell}))
    assert np.polyfit(np.log(spacings), np.log(errors), 1)[0] > 2.5
    assert errors[-1] < bound


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_what_enters_a_network_of_fractures_leaves_the_square(turn):
    """Two crossing fractures, one of which ends on the edge, conduct ten times as well as the square."""
    c, s = np.cos(turn), np.sin(turn)
    lines = [np.array([[-0.7, -0.2], [0.6, 0.3]]), np.array([[-0.1, -0.5], [0.1, 0.7]])]
    fractures = [ck.source("mesh.polyline", points=line @ [[c, s], [-s, c]]) for line in lines]
    square = ck.source("moved", of=SQUARE, rotation=turn)
    union = ck.source("union", members=[square, *fractures])
    problem = ck.Elliptic(f=1.0, diffusivity=ck.MemberData(union, [1.0, 10.0, 10.0]))
    edge = {loop: ck.Dirichlet(0.0) for loop in range(4)}
    found = ck.solve(ck.Scene(union, problem, edge=edge), 0.1, estimate=False)
    length = sum(float(np.linalg.norm(np.diff(line, axis=0))) for line in lines)
    assert found.flux("edge") == pytest.approx(-4 - length, rel=1e-6)
    at = np.array([[0.3, 0.5], [-0.4, -0.6], [0.05, 0.1]])
    reference = [0.4783, 0.3283, 0.5851]  # at spacings down to 0.0125, extrapolated
    assert found.of_dimension(2).evaluate(at @ [[c, s], [-s, c]]) == pytest.approx(reference, abs=0.01)


@pytest.mark.parametrize("edge", ["by loop", "by position", "one"])
def test_a_fracture_from_edge_to_edge_has_the_values_there(edge):
    """u = 1 - x / 2 in a block and in a fracture along it, whose ends have the values of the block's edge."""
    block = ck.source("analytic.box", lower=[0.0, 0.0], upper=[2.0, 1.0])
    union = ck.source("union", members=[block, ck.source("mesh.polyline", points=[[0, 0.5], [2, 0.5]])])
    warm, cold, insulated = ck.Dirichlet(1.0), ck.Dirichlet(0.0), ck.Neumann(0.0)
    conditions = {
        "by loop": {0: warm, 1: cold, 2: insulated, 3: insulated},
        "by position": [(warm, "x < 1e-9"), (cold, "x > 2 - 1e-9"), insulated],
        "one": ck.Dirichlet(lambda x: 1 - x[:, 0] / 2),
    }
    problem = ck.Elliptic(f=0.0, diffusivity=ck.MemberData(union, [1.0, 20.0]))
    found = ck.solve(ck.Scene(union, problem, edge=conditions[edge]), 0.1)
    points = np.random.default_rng(0).uniform([0, 0], [2, 1], (200, 2))
    assert found.of_dimension(2).evaluate(points) == pytest.approx(1 - points[:, 0] / 2, abs=1e-9)
    assert found.of_dimension(1).evaluate([[0, 0.5], [2, 0.5]]) == pytest.approx([1.0, 0.0], abs=1e-9)
    assert found.flux("edge") == pytest.approx(0.0, abs=1e-9)


def test_a_nucleus_inside_a_cell_with_a_membrane():
    """A cell whose boundary has an equation of its own may have further boundaries inside."""
    circle = ck.source("analytic.circle")
    cell = ck.source("union", members=[ck.source("solid", of=circle), circle])
    nucleus = ck.source("analytic.circle", radius=INNER)
    envelope = ck.Boundary("envelope", nucleus, across=ck.Transmission(resistance=1.0))
    problem = ck.Elliptic(f=ck.MemberData(cell, [1.0, 0.0]), c=ck.MemberData(cell, [0.0, 1.0]))
    found = ck.solve(ck.Scene(cell, problem, [envelope], junctions=ck.Junction(resistance=1.0)), 0.1)
    r = np.linalg.norm(POINTS[2], axis=1)
    exact = 1.0 + (1 - r**2) / 4 + 0.25 * (r < INNER)
    assert np.abs(found.of_dimension(2).evaluate(POINTS[2]) - exact).max() < 1e-6
