"""Junctions of members of different dimension: orders, conservation, symmetry, and where no law covers them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from union_problems import (
    BALL,
    RING,
    ROD,
    SPHERE,
    VESSEL,
    exchange,
    in_ball,
    on_ring,
    on_sphere,
    ring_on_sphere,
    rod_on_sphere,
)

import cpmkit as ck
from cpmkit.errors import InputError, SceneError
from cpmkit.forms.galerkin.unions.part_scenes import scenes_by_dimension
from cpmkit.manifold.meetings import meetings_of

DISC = ck.source("solid", of=ck.source("analytic.circle"))
CIRCLE = ck.source("analytic.circle")
PLACES = {1: on_ring(), 2: on_sphere(), 3: in_ball()}
IN_DISC = {1: on_ring()[:, :2], 2: in_ball()[:, :2]}


def errors(problem, spacings, points=PLACES, **options):
    found = []
    for spacing in spacings:
        solution = ck.solve(problem.scene, spacing, estimate=False, **options)
        assert solution.discretized.form == "galerkin"
        assert solution.report.iterations <= 30
        found.append(problem.largest_error(solution, points))
    return np.array(found)


def order(found, spacings):
    return np.polyfit(np.log(spacings), np.log(found), 1)[0]


@pytest.mark.parametrize("conductance", [0.01, 1.0, 100.0])
def test_a_curve_in_a_surface_is_of_third_order_whatever_it_conducts(conductance):
    spacings = (0.28, 0.2, 0.14)
    found = errors(ring_on_sphere(conductance), spacings, origin=[0.013, 0.027, 0.041])
    assert order(found, spacings) > 2.5
    assert found[1] < 5e-4


def test_a_curve_in_lattice_planes_is_as_exact():
    assert errors(ring_on_sphere(1.0), [0.2], origin=[0.0, 0.0, 0.0]) < 5e-4
    assert errors(ring_on_sphere(1.0), [0.2], origin=[0.0, 0.0, 0.1]) < 5e-4


@pytest.mark.parametrize("resistance", [0.0, 1.0])
def test_a_solid_and_its_boundary_exchange_at_third_order(resistance):
    spacings = (0.4, 0.28, 0.2)
    found = errors(exchange(resistance), spacings, origin=[0.013, 0.027, 0.041])
    assert order(found, spacings) > 2.0
    assert found[2] < 1e-3


@pytest.mark.parametrize("resistance", [0.0, 0.5])
def test_a_disc_and_its_boundary_exchange_at_third_order(resistance):
    spacings = (0.2, 0.14, 0.1, 0.07)
    found = errors(exchange(resistance, DISC, CIRCLE), spacings, IN_DISC)
    assert order(found, spacings) > 2.5
    assert found[2] < 2e-4


@pytest.mark.parametrize("radius", [0.01, 0.05])
def test_a_rod_on_a_sphere_has_the_value_of_its_radius_at_any_spacing(radius):
    rng, expected = np.random.default_rng(0), np.array(rod_on_sphere(radius))
    for spacing in (0.2, 0.14, 0.1):
        for _ in range(2):
            turn = Rotation.random(random_state=rng)
            place = [turn.apply(x) for x in np.array([[1, 0, 0], [3, 0, 0], [2, 0, 0], [-1, 0, 0]])]
            rod = ck.source("analytic.segment", start=place[0], end=place[1])
            both = ck.source("union", members=[SPHERE, rod])
            edge, junctions = {1001: ck.Dirichlet(1.0)}, ck.Junction(radius=radius)
            scene = ck.Scene(both, ck.ScreenedPoisson(0.0), edge=edge, junctions=junctions)
            solution = ck.solve(scene, spacing, estimate=False)
            on_rod, opposite = solution.of_dimension(1), solution.of_dimension(2).evaluate(place[3])
            found = np.array([on_rod.evaluate(place[0]), on_rod.evaluate(place[2]), opposite])
            np.testing.assert_allclose(found, expected, rtol=0.006)


@pytest.mark.parametrize("seed", range(6))
def test_the_end_of_a_turned_curve_is_no_place_inside_it(seed):
    """Turned by a rotation, the end lies off the curve's own by rounding."""
    vector = Rotation.random(random_state=np.random.default_rng(seed)).as_rotvec()
    turned = ck.source("moved", of=ck.source("union", members=[SPHERE, ROD]), rotation=vector)
    scene = ck.Scene(turned, ck.ScreenedPoisson(1.0), junctions=ck.Junction(radius=0.05))
    assert [part.boundaries for _, part in scenes_by_dimension(scene)] == [(), ()]


def test_a_curve_that_passes_through_a_surface_is_cut_there():
    """By symmetry nothing flows along the rod at the centre of the sphere: both halves are rods that end there."""
    through = ck.source("analytic.segment", start=[-3.0, 0, 0], end=[3.0, 0, 0])
    ends, junctions = {1000: ck.Dirichlet(1.0), 1001: ck.Dirichlet(1.0)}, ck.Junction(radius=0.05)
    both = ck.source("union", members=[SPHERE, through])
    scene = ck.Scene(both, ck.ScreenedPoisson(0.0), edge=ends, junctions=junctions)
    solution = ck.solve(scene, 0.1, estimate=False).of_dimension(1)
    x = np.array([0.5, 0.0, -0.5]), np.array([1.5, 2.0, 2.5])
    inside, outside = (solution.evaluate(np.stack([each, 0 * each, 0 * each], axis=1)) for each in x)
    joint = solution.evaluate([1.0, 0, 0])
    np.testing.assert_allclose(inside, joint * np.cosh(x[0]) / np.cosh(1.0), rtol=1e-5)
    slope = (1 - joint * np.cosh(2.0)) / np.sinh(2.0)
    np.testing.assert_allclose(outside, joint * np.cosh(x[1] - 1) + slope * np.sinh(x[1] - 1), rtol=1e-5)


SCENES = {
    "ring": ([SPHERE, RING], ck.Junction()),
    "ball": ([BALL, SPHERE], ck.Junction(resistance=0.5)),
    "ball, continuous": ([SPHERE, BALL], ck.Junction()),
    "rod": ([SPHERE, ROD], ck.Junction(radius=0.05)),
    "vessel": ([BALL, VESSEL], ck.Junction(radius=0.05, resistance=0.1)),
    "ring and rod": ([SPHERE, RING, ROD], {(0, 2): ck.Junction(radius=0.05), (0, 1): ck.Junction(resistance=0.1)}),
}


def scene_of(name, problem):
    members, junctions = SCENES[name]
    return ck.Scene(ck.source("union", members=members), problem, junctions=junctions)


@pytest.mark.parametrize("name", SCENES)
def test_constants_total_symmetry_and_signs(name):
    steady = scene_of(name, ck.ScreenedPoisson(2.0, c=1.0))
    form = ck.discretize(steady, 0.35)
    matrix = form.stiffness(steady.problem.terms()).to_csr()
    assert abs(matrix - matrix.T).max() == 0
    assert np.abs(form.at_points(ck.solve(steady, 0.35).values) - 2.0).max() < 1e-9
    laplace = ck.discretize(scene_of(name, ck.Laplace()), 0.35).stiffness(ck.Laplace().terms())
    assert np.abs(laplace.apply(form.constant)).max() < 1e-11 * np.abs(laplace.diagonal).max()
    eigenvalues = ck.solve(scene_of(name, ck.Eigen(count=4)), 0.35).eigenvalues
    assert eigenvalues[0] == pytest.approx(0.0, abs=1e-9)
    assert eigenvalues[1] > 0.01
    warm = ck.Heat(initial=lambda x: np.exp(-4 * ((x - [1.0, 0, 0]) ** 2).sum(axis=1)), until=1.0, step=0.02)
    short = ck.Heat(initial=warm.initial, until=0.02, step=0.02)
    first, last = (ck.solve(scene_of(name, problem), 0.35) for problem in (short, warm))
    np.testing.assert_allclose(last.totals, first.totals, rtol=1e-11)


def test_species_inside_and_on_the_membrane_react_each_by_its_own_law():
    """Without space: du/dt = -u, dv/dt = v - v^2 apart; with an exchange the total changes by the reactions alone."""
    cell = ck.source("union", members=[BALL, SPHERE])
    laws = ck.MemberData(cell, [lambda u: -u, lambda v: v - v**2])
    initial = ck.MemberData(cell, [2.0, 0.2])
    equation = ck.ReactionDiffusion(initial, laws, kappa=ck.MemberData(cell, [1.0, 0.1]), until=0.5, step=0.01)
    apart = ck.solve(ck.Scene(cell, equation, junctions=ck.Junction(resistance=1e9)), 0.4)
    assert apart.of_dimension(3).mean() == pytest.approx(2 * np.exp(-0.5), rel=1e-3)
    assert apart.of_dimension(2).mean() == pytest.approx(1 / (1 + 4 * np.exp(-0.5)), rel=1e-3)
    decay = ck.MemberData(cell, [lambda u: -u, lambda v: -v])
    equation = ck.ReactionDiffusion(initial, decay, kappa=1.0, until=0.5, step=0.01, frames=1)
    joined = ck.solve(ck.Scene(cell, equation, junctions=ck.Junction(resistance=0.5)), 0.4)
    total = joined.integrate(dim=3) + joined.integrate(dim=2)
    assert joined.of_dimension(2).frames[-1].mean() == joined.of_dimension(2).mean()
    with pytest.raises(InputError, match="is a junction, and its flux enters another member"):
        joined.flux("edge")
    assert total == pytest.approx(np.exp(-0.5) * (2 * 4 * np.pi / 3 + 0.2 * 4 * np.pi), rel=1e-3)


@pytest.mark.parametrize("name", ["ring", "ball", "rod", "vessel"])
def test_two_sources_are_reciprocal(name):
    second = {"ring": [0.0, 1.0, 0], "ball": [0.1, 0.2, 0.1], "rod": [2.0, 0, 0], "vessel": [-0.39, 0.09, 0.125]}
    places = np.array([[0.0, -0.6, 0.3] if name == "vessel" else [0.0, 0.6, 0.8], second[name]])
    found = [
        ck.solve(scene_of(name, ck.ScreenedPoisson(ck.PointSource(place[None]))), 0.25).evaluate(other)
        for place, other in (places, places[::-1])
    ]
    assert found[0] == pytest.approx(found[1], rel=1e-6)


@pytest.mark.parametrize("name", ["ring", "ball", "rod", "vessel"])
def test_a_moved_turned_and_scaled_scene_has_the_same_solution(name):
    """At the scale s, integrals over a member of dimension m have the factor s^m, and the coefficients s^-m."""
    members, law = SCENES[name]
    turn, shift, scale = Rotation.from_euler("xyz", [0.3, 0.7, -0.4]), np.array([2.0, -1.0, 0.5]), 2.0
    dims = [member.manifold_dim for member in members]
    places = {
        1: {"ring": on_ring(50), "vessel": VESSEL.closest_point(in_ball(20)).points}.get(
            name, np.array([[1.5, 0, 0], [2, 0, 0]])
        ),
        2: on_sphere(50),
        3: in_ball(50) if name != "vessel" else in_ball(50)[VESSEL.closest_point(in_ball(50)).distance > 0.42],
    }
    one = ck.solve(scene_of(name, ck.Elliptic(f=lambda x: x[:, 0], c=1.0)), 0.18)
    motion = {"rotation": turn.as_matrix(), "translation": shift, "scale": scale}
    moved = ck.source("moved", of=ck.source("union", members=members), **motion)

    def f(m):
        return lambda x: scale**-m * turn.inv().apply((x - shift) / scale)[:, 0]

    data = {"f": [f(m) for m in dims], "c": [scale**-m for m in dims], "diffusivity": [scale ** (2 - m) for m in dims]}
    problem = ck.Elliptic(**{key: ck.MemberData(moved, values) for key, values in data.items()})
    radius = None if law.radius is None else scale * law.radius
    junctions = ck.Junction(scale ** min(dims) * law.resistance, radius)
    other = ck.solve(ck.Scene(moved, problem, junctions=junctions), 0.36)
    for m in dims:
        found = other.of_dimension(m).evaluate(scale * turn.apply(places[m]) + shift)
        np.testing.assert_allclose(found, one.of_dimension(m).evaluate(places[m]), atol=2e-3)


@pytest.mark.parametrize("name", ["ring", "ball", "rod"])
def test_the_estimate_is_about_the_error(name):
    problem = {"ring": ring_on_sphere(1.0), "ball": exchange(1.0)}.get(name)
    if problem is not None:
        solution = ck.solve(problem.scene, 0.2)
        true = problem.largest_error(solution, PLACES)
        assert 0.5 < solution.error.error[0] / true < 3
        return
    both = ck.source("union", members=[SPHERE, ROD])
    edge, junctions = {1001: ck.Dirichlet(1.0)}, ck.Junction(radius=0.05)
    solution = ck.solve(ck.Scene(both, ck.ScreenedPoisson(0.0), edge=edge, junctions=junctions), 0.1)
    true = abs(solution.of_dimension(1).evaluate([2.0, 0, 0]) - rod_on_sphere(0.05)[1])
    assert solution.error.error[0] > true


def test_the_flux_into_a_curve_is_read_at_its_cut():
    """From both sides of the equator 2 pi flow into it, with the conormals out of them."""
    surface = ck.solve(ring_on_sphere(1.0).scene, 0.14).of_dimension(2)
    for side in ("left", "right"):
        assert surface.flux("junction 1", side) == pytest.approx(-2 * np.pi, rel=5e-3)


def test_solutions_are_saved_read_by_dimension_and_integrated(tmp_path):
    problem = exchange(1.0)
    solution = ck.solve(problem.scene, 0.28)
    solution.save(tmp_path / "solution.npz")
    again = ck.load(tmp_path / "solution.npz", problem.scene)
    assert np.array_equal(again.values, solution.values)
    assert solution.integrate(1.0, dim=3) == pytest.approx(4 * np.pi / 3, rel=1e-3)
    assert solution.integrate(1.0, dim=2) == pytest.approx(4 * np.pi, rel=1e-3)
    assert solution.mean(dim=2) == solution.of_dimension(2).mean()
    with pytest.raises(InputError, match="2 and 3"):
        solution.of_dimension(1)
    with pytest.raises(InputError, match="2 and 3"):
        solution.integrate()
    plain = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(1.0)), 0.4)
    assert plain.of_dimension(2) is plain


def test_fluxes_and_sides_are_those_of_the_members():
    cut = ck.Boundary("cut", ck.source("analytic.point", at=[2.0, 0, 0]), left=1.0, right=3.0)
    high = ck.source("analytic.circle", center=[0, 0, 0.6], normal=[0, 0, 1], radius=0.8)
    both = ck.source("union", members=[SPHERE, ROD])
    boundaries = [cut, ck.Boundary("high", high, left=0.0, right=0.5)]
    edge, junctions = {1001: ck.Dirichlet(5.0)}, ck.Junction(radius=0.05)
    solution = ck.solve(ck.Scene(both, ck.Laplace(), boundaries, edge, junctions), 0.14)
    assert solution.flux(1001) == pytest.approx(2.0, rel=1e-6)
    with pytest.raises(InputError, match=r"the edge of member 1 is a junction.*dim=2\)"):
        solution.flux(1000)
    assert solution.flux("cut", "right") == pytest.approx(-2.0, rel=1e-6)
    np.testing.assert_allclose(solution.evaluate([[2.0, 0, 0]], side="both"), [[1.0, 3.0]], atol=1e-6)
    np.testing.assert_allclose(solution.evaluate([[0.8, 0, 0.6]], side="both"), [[0.0, 0.5]], atol=1e-3)
    assert solution.evaluate([0, 0, 1.0]) == pytest.approx(0.0, abs=1e-6)
    # what comes along the rod leaves through the circle
    assert solution.flux("cut", "left") == pytest.approx(-solution.flux("high", "right"), rel=1e-6)
    np.testing.assert_allclose(solution.gradient([[2.5, 0, 0]]), [[2.0, 0, 0]], atol=1e-6)


@pytest.mark.parametrize(
    ("members", "sentence"),
    [
        ([BALL, ck.source("analytic.segment", start=[0.0, 0, 0], end=[2.0, 0, 0])], "in part only"),
        ([BALL, ROD], "in a point or along an edge"),
        ([BALL, RING], "meet along a curve"),
        ([ck.source("trimmed", of=SPHERE, trim="x - 0.3"), RING], "in part only"),
    ],
)
def test_what_no_law_covers_is_refused_unless_collocation_is_given(members, sentence):
    scene = ck.Scene(ck.source("union", members=members), ck.ScreenedPoisson(1.0))
    with pytest.raises(SceneError, match=sentence):
        ck.discretize(scene, 0.3, form="galerkin")
    for options in ({}, {"degree": 3}):
        with pytest.raises(SceneError, match=f"{sentence}.*; form='collocation' takes it"):
            ck.discretize(scene, 0.3, **options)
    assert ck.discretize(scene, 0.3, form="collocation").form == "collocation"


def test_a_radius_without_a_place_for_it_is_refused():
    scene = ck.Scene(
        ck.source("union", members=[SPHERE, RING]), ck.ScreenedPoisson(1.0), junctions=ck.Junction(radius=0.1)
    )
    with pytest.raises(SceneError, match=r"got 0\.1 where no member does so; leave it out"):
        ck.discretize(scene, 0.3)


def test_where_members_lie_on_each_other_u_is_that_of_the_lowest_dimension():
    solution = ck.solve(exchange(0.5).scene, 0.3, estimate=False)
    at = on_sphere(300)
    np.testing.assert_array_equal(solution.evaluate(at), solution.of_dimension(2).evaluate(at))
    np.testing.assert_array_equal(solution.evaluate(0.9 * at), solution.of_dimension(3).evaluate(0.9 * at))


@pytest.mark.parametrize("dry_run", [False, True])
def test_an_explanation_lists_the_junctions(dry_run):
    parts = ck.explain(scene_of("ring and rod", ck.ScreenedPoisson(1.0)), 0.3, dry_run=dry_run).parts
    found = {part.name: (part.amount, part.reason) for part in parts if part.name.startswith("junction")}
    assert found["junction 1/0"][0] == "along"
    assert "resistance 0.1" in found["junction 1/0"][1]
    assert found["junction 2/0"][0] == "1 point"
    assert "radius 0.05" in found["junction 2/0"][1]


def test_a_curve_on_a_membrane_belongs_to_the_membrane():
    cell = ck.source("union", members=[BALL, SPHERE])
    pole = ck.source("analytic.circle", center=[0, 0, 0.6], normal=[0, 0, 1], radius=0.8)
    scene = ck.Scene(cell, ck.Laplace(), [ck.Boundary("pole", pole, both=2.0)])
    solution = ck.solve(scene, 0.3)
    assert solution.discretized.form == "galerkin"
    np.testing.assert_allclose([solution.of_dimension(m).mean() for m in (2, 3)], 2.0, rtol=1e-6)


def test_an_edge_on_another_member_has_no_condition():
    cell = ck.source("union", members=[BALL, SPHERE])
    with pytest.raises(SceneError, match="lies on another member of the union"):
        ck.solve(ck.Scene(cell, ck.ScreenedPoisson(1.0), edge={0: ck.Dirichlet(1.0)}), 0.4)
    everywhere = ck.Scene(cell, ck.ScreenedPoisson(1.0), edge=ck.Dirichlet(5.0))
    assert ck.solve(everywhere, 0.4).evaluate([0, 0, 0]) == pytest.approx(1.0)


@pytest.mark.parametrize(("thickness", "spacing"), [(0.004, 0.1), (0.008, 0.1), (0.1, 0.1)])
def test_both_skins_of_a_thin_solid_keep_their_conditions(thickness, spacing):
    """u is 1 outside; what passes the annulus and the resistance is c v = v on the circle inside."""
    outer = ck.source("analytic.circle", radius=1 + thickness)
    ring = ck.source("solid", of=ck.source("union", members=[outer, CIRCLE]))
    both = ck.source("union", members=[ring, CIRCLE])
    problem = ck.Elliptic(f=0.0, c=ck.MemberData(both, [0.0, 1.0]))
    scene = ck.Scene(both, problem, edge={0: ck.Dirichlet(1.0)}, junctions=ck.Junction(resistance=1.0))
    found = ck.solve(scene, spacing).of_dimension(1).evaluate([1.0, 0.0])
    assert found == pytest.approx(1 / (2 + np.log(1 + thickness)), rel=1e-4)


def test_a_face_of_a_box_alone_exchanges():
    """u = 1.5 + y - y^2/2 in a square with f = 1, and v = 1 on its lower side with R = .5 and c = 1."""
    box = ck.source("analytic.box", lower=[0.0, 0.0], upper=[1.0, 1.0])
    side = ck.source("analytic.segment", start=[0.0, 0.0], end=[1.0, 0.0])
    both = ck.source("union", members=[box, side])
    problem = ck.Elliptic(f=ck.MemberData(both, [1.0, 0.0]), c=ck.MemberData(both, [0.0, 1.0]))
    scene = ck.Scene(both, problem, junctions=ck.Junction(resistance=0.5))
    y = np.array([0.1, 0.5, 0.9])
    for spacing in (0.2, 0.1):
        solution = ck.solve(scene, spacing, origin=[0.03, 0.01])
        found = solution.of_dimension(2).evaluate(np.stack([0.4 + 0 * y, y], axis=1))
        np.testing.assert_allclose(found, 1.5 + y - y**2 / 2, atol=1e-4)


def test_rods_that_end_at_one_point_share_the_surface_there():
    """Two rods are one of twice the conductivity; a rod through a surface is two rods that end there."""
    again = ck.source("analytic.segment", start=[1.0, 0, 0], end=[1.0 + 2**0.5, 2**0.5, 0])
    found = []
    for members, a in (([SPHERE, ROD, again], [1.0, 1.0, 1.0]), ([SPHERE, ROD], [1.0, 2.0])):
        both = ck.source("union", members=members)
        data = ck.MemberData(both, a)
        f = ck.MemberData(both, [0.0, *a[1:]])
        problem = ck.Elliptic(f=f, c=data, diffusivity=data)
        solution = ck.solve(ck.Scene(both, problem, junctions=ck.Junction(radius=0.05)), 0.15, estimate=False)
        found.append(solution.of_dimension(1).evaluate([1.0, 0, 0]))
    assert found[0] == pytest.approx(found[1], rel=2e-3)
    halves = [ck.source("analytic.segment", start=[s, 0, 0], end=[e, 0, 0]) for s, e in ((-3.0, 1.0), (1.0, 3.0))]
    found = []
    for rods in (halves, [ck.source("analytic.segment", start=[-3.0, 0, 0], end=[3.0, 0, 0])]):
        both = ck.source("union", members=[SPHERE, *rods])
        problem = ck.Elliptic(f=ck.MemberData(both, [0.0] + [1.0] * len(rods)), c=1.0)
        solution = ck.solve(ck.Scene(both, problem, junctions=ck.Junction(radius=0.05)), 0.15, estimate=False)
        found.append(solution.of_dimension(1).evaluate([[1.0, 0, 0], [1.5, 0, 0], [-1.0, 0, 0]]))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-6)


def test_all_crossings_of_a_curve_are_found():
    """A long line through a sphere, and a wave through a plane."""
    rod = ck.source("analytic.segment", start=[-60.0, 0.2, 0.1], end=[60.0, 0.2, 0.1])
    (meeting,) = meetings_of(ck.source("union", members=[SPHERE, rod]))
    assert len(meeting.places) == 2
    np.testing.assert_allclose(np.linalg.norm(meeting.places, axis=1), 1.0, atol=1e-6)
    x = np.linspace(-2.0, 2.0, 801)
    wave = ck.source("mesh.polyline", points=np.stack([x, 0.3 * np.sin(10 * np.pi * x + 0.1), 0 * x], axis=1))
    corners = [[-3.0, 0, -3], [3, 0, -3], [3, 0, 3], [-3, 0, 3]]
    plane = ck.source("mesh.triangles", vertices=corners, faces=[[0, 1, 2], [0, 2, 3]], closest="faceted")
    (meeting,) = meetings_of(ck.source("union", members=[plane, wave]))
    assert meeting.how == "points"
    assert len(meeting.places) == 40
    tangent = ck.source("analytic.segment", start=[1.0, -2.0, 0], end=[1.0, 2.0, 0])
    (meeting,) = meetings_of(ck.source("union", members=[SPHERE, tangent]))
    np.testing.assert_allclose(meeting.places, [[1.0, 0, 0]], atol=1e-2)


def test_a_boundary_that_crosses_a_curve_in_a_surface_is_named():
    both = ck.source("union", members=[SPHERE, RING])
    meridian = ck.source("analytic.circle", normal=[1, 0, 0])
    alone = [ck.Boundary("meridian", meridian, both=1.0)]
    (warning,) = ck.discretize(ck.Scene(both, ck.ScreenedPoisson(0.0), alone), 0.3).warnings()
    assert "crosses member 1 of the union near" in warning
    pins = [ck.Boundary(f"pin {y}", ck.source("analytic.point", at=[0, y, 0]), both=1.0) for y in (-1, 1)]
    solution = ck.solve(ck.Scene(both, ck.ScreenedPoisson(0.0), [*alone, *pins]), 0.2)
    assert not any("crosses member" in text for text in solution.warnings)
    assert solution.of_dimension(1).evaluate([0.0, 1.0, 0.0]) == pytest.approx(1.0, rel=1e-4)


def test_members_that_almost_touch_are_named():
    rod = ck.source("analytic.segment", start=[1.05, 0, 0], end=[3.0, 0, 0])
    scene = ck.Scene(ck.source("union", members=[SPHERE, rod]), ck.ScreenedPoisson(1.0))
    assert ck.discretize(scene, 0.04).warnings() == ()
    (warning,) = ck.discretize(scene, 0.2).warnings()
    assert "Members 1 and 0 of the union come within 0.05 of each other near (1.05, 0, 0)" in warning


def test_a_curve_on_a_surface_needs_a_radius_and_room():
    both = ck.source("union", members=[SPHERE, ROD])
    with pytest.raises(SceneError, match="radius r of the curve's cross section"):
        ck.solve(ck.Scene(both, ck.ScreenedPoisson(1.0)), 0.3)
    cap = ck.source("trimmed", of=SPHERE, trim="0.9 - x")
    near_edge = ck.source("union", members=[cap, ROD])
    with pytest.raises(SceneError, match="nearer to the edge of the surface"):
        ck.solve(ck.Scene(near_edge, ck.ScreenedPoisson(1.0), junctions=ck.Junction(radius=0.01)), 0.3)


@pytest.mark.parametrize(
    ("junctions", "sentence"),
    [
        (1.0, "must be a ck.Junction"),
        (None, r"leave it out for a continuous u. Got None; the union has the members 0 to 1\."),
        ({(0, 2): ck.Junction()}, "the members 0 to 1"),
        ({(0, 1): 0.1}, r"Got 0.1 for \(0, 1\)"),
    ],
)
def test_junctions_that_are_none_are_refused(junctions, sentence):
    with pytest.raises(SceneError, match=sentence):
        ck.Scene(ck.source("union", members=[SPHERE, ROD]), ck.ScreenedPoisson(1.0), junctions=junctions)
    for bad in ({"resistance": -1.0}, {"radius": 0.0}):
        with pytest.raises(InputError, match="of a junction"):
            ck.Junction(**bad)


def test_the_flux_into_a_member_is_refused_with_the_integral_that_it_is():
    cell = ck.source("union", members=[BALL, SPHERE])
    f, c = ck.MemberData(cell, [1.0, 0.0]), ck.MemberData(cell, ["0.1", 0.5])
    solution = ck.solve(ck.Scene(cell, ck.Elliptic(f=f, c=c), junctions=ck.Junction(resistance=0.5)), 0.3)
    for edge in ("edge", 0):
        with pytest.raises(InputError, match=r"member 0 is a junction.*integral of c u - f.*dim=2\)"):
            solution.flux(edge)
        with pytest.raises(InputError, match="lies on another member of the union, which its flux enters"):
            solution.of_dimension(3).flux(edge)
    with pytest.raises(InputError, match=r"lie in the members . and . of the union, and data by member differ there"):
        solution.integrate(lambda x, u: c(x) * u - f(x), dim=2)
    into = solution.integrate(lambda x, u: 0.5 * u, dim=2)
    assert into == pytest.approx(solution.integrate(lambda x, u: 1 - 0.1 * u, dim=3), rel=1e-6)


@pytest.mark.parametrize(
    ("edge", "sentence"),
    [
        ({0: 1.0}, r"`edge` has the loops 0, and the manifold's loops 1001 are missing"),
        ({1001: 1.0, 1005: 1.0}, r"condition for loop 1005, and .* its loops are 1000, 1001"),
    ],
)
def test_loops_of_members_have_their_numbers_in_the_union(edge, sentence):
    both = ck.source("union", members=[SPHERE, ROD])
    scene = ck.Scene(both, ck.ScreenedPoisson(0.0), edge=edge, junctions=ck.Junction(radius=0.05))
    with pytest.raises(SceneError, match=sentence):
        ck.solve(scene, 0.3)
