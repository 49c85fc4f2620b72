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


@pytest.mark.parametrize("edge", ["by loop", "by position", "in parts of a loop"])
def test_the_rim_of_a_fracture_in_space_has_the_values_of_the_edge_where_it_reaches_them(edge):
    """As in the plane; on the sides without values, and where the rim is inside, nothing flows through it."""
    block = ck.source("analytic.box", lower=[0.0, 0, 0], upper=[2.0, 1, 1])
    warm, cold, insulated = ck.Dirichlet(1.0), ck.Dirichlet(0.0), ck.Neumann(0.0)
    conditions = {
        "by loop": {0: warm, 1: cold, 2: insulated, 3: insulated, 4: insulated, 5: insulated},
        "by position": [(warm, "x < 1e-9"), (cold, "x > 2 - 1e-9"), insulated],
        "in parts of a loop": {0: [(warm, "y < 2"), cold], 1: cold, **dict.fromkeys(range(2, 6), insulated)},
    }
    for width in (1.0, 0.6):  # the narrower one has a rim inside
        corners = [[0, 0, 0.5], [2, 0, 0.5], [2, width, 0.5], [0, width, 0.5]]
        fracture = ck.source("mesh.triangles", vertices=corners, faces=[[0, 1, 2], [0, 2, 3]], closest="faceted")
        union = ck.source("union", members=[block, fracture])
        problem = ck.Elliptic(f=0.0, diffusivity=ck.MemberData(union, [1.0, 5.0]))
        found = ck.solve(ck.Scene(union, problem, edge=conditions[edge]), 0.25, estimate=False)
        points = np.random.default_rng(0).uniform([0, 0, 0], [2, width, 1], (100, 3))
        assert found.of_dimension(3).evaluate(points) == pytest.approx(1 - points[:, 0] / 2, abs=1e-4)
        points[:, 2] = 0.5
        assert found.of_dimension(2).evaluate(points) == pytest.approx(1 - points[:, 0] / 2, abs=1e-4)


@pytest.mark.parametrize("spacing", [0.2, 0.15, 0.1])
@pytest.mark.parametrize("is_reversed", [False, True])
@pytest.mark.parametrize("solid", ["box", "disc"])
def test_the_flux_through_each_end_of_a_fracture_is_read(solid, is_reversed, spacing):
    """Rounding decides whether an end on the edge is the edge's or the fracture's: the flux of both is read."""
    inner, outer = [0.1, 0.2], {"box": [0.1, -1.0], "disc": [0.6, -0.8]}[solid]
    ends = [inner, outer] if is_reversed else [outer, inner]
    union = ck.source("union", members=[SOLIDS[solid], ck.source("analytic.segment", start=ends[0], end=ends[1])])
    loops = range(4 if solid == "box" else 1)
    scene = ck.Scene(union, ck.Elliptic(f=1.0), edge={loop: ck.Dirichlet("x") for loop in loops})
    found = ck.solve(scene, spacing, estimate=False)
    assert found.flux(1000 + (not is_reversed)) == 0.0  # nothing leaves through the end inside
    through = [found.flux(loop) for loop in (*loops, 1000 + is_reversed)]
    total = found.integrate(1.0, dim=2) + found.integrate(1.0, dim=1)
    assert sum(through) == pytest.approx(-total, rel=1e-6)
    # a number of an end inside is as good as that of any other
    pinned = {**scene.edge, 1000 + (not is_reversed): ck.Dirichlet(3.0)}
    found = ck.solve(ck.Scene(union, scene.problem, edge=pinned), spacing, estimate=False)
    assert found.of_dimension(1).evaluate([inner]) == pytest.approx([3.0], abs=0.01)


SOLIDS = {"box": SQUARE, "disc": ck.source("solid", of=ck.source(SOURCES[2]))}
CONDITIONS = {
    "one": ck.Dirichlet("x"),
    "table": {0: ck.Dirichlet("x"), 1: ck.Dirichlet("x"), 2: ck.Dirichlet("x"), 3: ck.Dirichlet("x")},
    "parts": [(ck.Dirichlet("x"), "x < 0"), ck.Dirichlet("x")],
}


def random_segments(count, corners):
    """Segments of at least the length 0.8 whose coordinates are rounded to 0.1, to ``corners`` of the square too."""
    rng = np.random.default_rng(0)
    ends = rng.uniform(-0.64, 0.64, (20 * count, 2, 2)).round(1)
    if corners:
        ends[::5, 1] = np.where(ends[::5, 1] < 0, -1, 1)
    return ends[np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) > 0.8][:count]


@pytest.mark.parametrize(("solid", "edge"), [("box", "one"), ("box", "table"), ("disc", "one"), ("disc", "parts")])
def test_fractures_may_end_anywhere_in_a_solid(solid, edge):
    """Rounding decides whether the closest point to an end is on the edge: the solid's conditions hold all the same."""
    for start, end in random_segments(40, corners=solid == "box"):
        union = ck.source("union", members=[SOLIDS[solid], ck.source("analytic.segment", start=start, end=end)])
        found = ck.solve(ck.Scene(union, ck.Laplace(), edge=CONDITIONS[edge]), 0.2, estimate=False)
        assert found.of_dimension(2).evaluate([[-0.9, 0.1]]) == pytest.approx([-0.9], abs=0.1)
        if np.abs(end).max() == 1:  # at a corner the end of the fracture has the value of the edge
            assert found.of_dimension(1).evaluate([end]) == pytest.approx(end[:1], abs=1e-4)


FRACTURES = {
    "crossing": [[[-0.5, 0.5], [0.5, -0.5]], [[-0.7, -0.5], [0.7, 0.5]]],
    "end to end": [[[-0.5, 0.3], [0.1, 0.1]], [[0.1, 0.1], [0.5, -0.6]]],
    "one ends on the other": [[[-0.5, 0.3], [0.5, -0.3]], [[0.3, 0.6], [0.1, -0.06]]],
}


@pytest.mark.parametrize("fractures", FRACTURES)
def test_fractures_that_meet_and_parts_of_the_edge(fractures):
    """A list of parts of the edge is the same as a table, although no fracture has a free end where they hold."""
    segments = [ck.source("analytic.segment", start=start, end=end) for start, end in FRACTURES[fractures]]
    union = ck.source("union", members=[SQUARE, *segments])
    cold, warm, insulated = ck.Dirichlet(0.0), ck.Dirichlet(1.0), ck.Neumann(0.0)
    edges = (
        {0: cold, 1: warm, 2: insulated, 3: insulated},
        [(cold, "x < -1 + 1e-9"), (warm, "x > 1 - 1e-9"), insulated],
    )
    problem = ck.Elliptic(diffusivity=ck.MemberData(union, [1.0, 5.0, 5.0]))
    found = [ck.solve(ck.Scene(union, problem, edge=edge), 0.1, estimate=False).of_dimension(1) for edge in edges]
    ends = np.reshape(FRACTURES[fractures], (-1, 2))
    assert found[0].evaluate(ends) == pytest.approx(found[1].evaluate(ends), abs=1e-9)


def test_a_part_of_the_edge_may_hold_on_one_member_of_a_union():
    rod = ck.source("analytic.segment", start=[1, 0, 0], end=[3, 0, 0])
    cap = ck.source("trimmed", of=ck.source("analytic.sphere"), trim="z - 0.9")
    union, junctions = ck.source("union", members=[cap, rod]), ck.Junction(radius=0.05)
    edge = [(ck.Dirichlet(1.0), "x > 2"), ck.Dirichlet(1.0)]
    found = ck.solve(ck.Scene(union, ck.Laplace(), edge=edge, junctions=junctions), 0.2, estimate=False)
    assert found.evaluate([[2, 0, 0]]) == pytest.approx([1.0], abs=1e-6)
    nowhere = [(ck.Dirichlet(1.0), "x > 4"), ck.Dirichlet(1.0)]
    with pytest.raises(ck.SceneError, match="holds at no point of the edge"):
        ck.solve(ck.Scene(union, ck.Laplace(), edge=nowhere, junctions=junctions), 0.2)


def test_the_member_for_which_a_spacing_is_too_coarse_is_named():
    union = ck.source("union", members=[SQUARE, ck.source("analytic.segment", start=[0, 0], end=[0.1, 0])])
    with pytest.raises(ck.ResolutionError, match=r"too coarse for member 1 of the union, whose largest side is 0\.1"):
        ck.solve(ck.Scene(union, ck.Laplace(), edge=ck.Dirichlet("x")), 0.25)


def test_each_side_of_a_fracture_has_the_whole_resistance():
    """Across a strip of length 2, u rises by 1/3 on each side of a fracture, and by R q = 1/6 from each side to v."""
    block = ck.source("analytic.box", lower=[0.0, 0.0], upper=[2.0, 1.0])
    union = ck.source("union", members=[block, ck.source("analytic.segment", start=[1, 0], end=[1, 1])])
    insulated = ck.Neumann(0.0)
    edge = {0: ck.Dirichlet(0.0), 1: ck.Dirichlet(1.0), 2: insulated, 3: insulated}
    found = ck.solve(ck.Scene(union, ck.Laplace(), edge=edge, junctions=ck.Junction(resistance=0.5)), 0.1)
    at = [[1.0, 0.3], [1.0, 0.8]]
    both = found.evaluate(at, side="both")
    assert (both == found.of_dimension(2).evaluate(at, side="both")).all()
    assert np.sort(both.ravel()) == pytest.approx([1 / 3, 1 / 3, 2 / 3, 2 / 3], abs=1e-7)
    assert found.of_dimension(1).evaluate(at) == pytest.approx([0.5, 0.5], abs=1e-7)


def test_a_surface_that_ends_inside_a_ball():
    ball = ck.source("solid", of=ck.source(SOURCES[3]))
    bowl = ck.source("trimmed", of=ck.source("analytic.sphere", radius=0.5), trim="z - 0.1")
    union = ck.source("union", members=[ball, bowl])
    edge = [(ck.Dirichlet("x"), "x < 0"), ck.Dirichlet("x")]
    found = ck.solve(ck.Scene(union, ck.Laplace(), edge=edge), 0.4, estimate=False)
    assert found.of_dimension(3).evaluate([[-0.9, 0.1, 0.0]]) == pytest.approx([-0.9], abs=0.1)


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
