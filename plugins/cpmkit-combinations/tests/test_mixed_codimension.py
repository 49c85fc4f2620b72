"""Surfaces joined by segments, as one manifold: values pass through the joints, and sides are each piece's own."""

import re

import numpy as np
import pytest
from cpmkit_combinations.cases import mixed_union

import cpmkit as ck
from cpmkit.errors import InputError, SceneError

SPHERE = ck.source("analytic.sphere")
ROD = ck.source("analytic.segment", start=[1.0, 0, 0], end=[3.0, 0, 0])
THIN = ck.Junction(radius=0.05)
DUMBBELL = ck.source("union", members=[SPHERE, ck.source("analytic.sphere", center=[4.0, 0, 0]), ROD])


def on(name, source, **sides):
    return ck.Boundary(name, source, **sides)


def latitude(x, name, **sides):
    """The circle around the x axis at x."""
    return on(name, ck.source("analytic.circle", center=[x, 0, 0], normal=[1, 0, 0], radius=np.sqrt(1 - x**2)), **sides)


def test_a_sphere_takes_the_value_that_reaches_it_through_a_rod():
    """Nothing else is set on the second sphere: it is at the rod's value, and the rod's is that of the first."""
    cut = latitude(-0.5, "cut", both=ck.Dirichlet(2.0))
    solution = ck.solve(ck.Scene(DUMBBELL, ck.Laplace(), [cut], junctions=THIN), 0.1)
    points = np.array([[5.0, 0, 0], [4.0, 1, 0], [2.0, 0, 0], [0, 1, 0]])
    assert np.abs(solution.evaluate(points) - 2.0).max() < 1e-5


def test_along_a_rod_between_two_values_the_solution_is_linear():
    """Both spheres hold their values by circles around the joints; in between u'' = 0."""
    ends = [
        latitude(0.8, "first", both=ck.Dirichlet(0.0)),
        on(
            "second",
            ck.source("analytic.circle", center=[3.2, 0, 0], normal=[1, 0, 0], radius=0.6),
            both=ck.Dirichlet(1.0),
        ),
    ]
    solution = ck.solve(ck.Scene(DUMBBELL, ck.Laplace(), ends, junctions=THIN), 0.1)
    x = np.linspace(1.4, 2.6, 25)
    u = solution.evaluate(np.stack([x, 0 * x, 0 * x], axis=1))
    slope, value = np.polyfit(x, u, 1)
    assert np.abs(u - (slope * x + value)).max() < 1e-8
    assert abs(slope * 2.0 + value - 0.5) < 1e-3
    # 1 over the resistances of the rod and, twice, of the surface from .05 to .6
    assert slope == pytest.approx(1 / (2 + np.log(np.tan(np.arcsin(0.6) / 2) / np.tan(0.025)) / np.pi), rel=0.02)


def test_a_cut_on_the_rod_has_two_sides():
    """Left of a point on a curve is where the curve comes from: the first sphere."""
    pin = ck.source("analytic.point", at=[2.0, 0, 0])
    cut = on("cut", pin, left=ck.Dirichlet(1.0), right=ck.Dirichlet(3.0))
    solution = ck.solve(ck.Scene(DUMBBELL, ck.Laplace(), [cut], junctions=THIN), 0.2)
    assert np.abs(solution.evaluate([[-1.0, 0, 0], [1.5, 0, 0], [2.5, 0, 0], [5.0, 0, 0]]) - [1, 1, 3, 3]).max() < 1e-6


@pytest.mark.slow
def test_the_papers_object_keeps_the_maximum_principle():
    circle = ck.source("analytic.circle", center=[0, 0, 0.1], normal=[0, 0, 1], radius=np.sqrt(0.25**2 - 0.01))
    ring = ck.source("analytic.circle", center=[0, 0, 0], normal=[0, 0, 1], radius=0.8)
    scene = ck.Scene(
        mixed_union(),
        ck.Laplace(),
        [
            on("circle", circle, left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0)),
            on("ring", ring, both=ck.Dirichlet(3.0)),
        ],
    )
    solution = ck.solve(scene, 0.02, form="collocation")
    assert [
        text.startswith("Members 2 (a curve) and 0 (a surface) of the union meet") for text in solution.warnings
    ] == [True]
    u = solution.evaluate(scene.surface.mesh(0.02)[0])
    assert u.min() > -0.01
    assert u.max() < 3.01
    below, above, joint, torus = solution.evaluate([[0, 0, -0.25], [0, 0, 0.25], [0.325, 0, 0], [0, 0.4, 0]])
    assert 0 < below < 0.2
    assert abs(above - 1) < 1e-6
    assert 0.5 < joint < 2.7
    assert torus > 2.9


ROD_ON_SPHERE = ck.source("union", members=[SPHERE, ROD])
DISK = ck.source("solid", of=ck.source("analytic.circle"))
BALL = ck.source("solid", of=SPHERE)
SIDE = ck.source("analytic.segment", start=[1.0, 0], end=[2.0, 0])
MEETING = {
    "curve on surface": (
        ROD_ON_SPHERE,
        r"Members 1 \(a curve\) and 0 \(a surface\) of the union meet near \(1, 0, 0\)",
    ),
    "moved": (
        ck.source("moved", of=ROD_ON_SPHERE, translation=[0, 0, 5.0]),
        r"Members 1 \(a curve\) and 0 \(a surface\) of the union meet near \(1, 0, 5\)",
    ),
    "nested": (
        ck.source("union", members=[ck.source("analytic.point", at=[0, 0, 0.0]), ROD_ON_SPHERE]),
        r"Members 2 \(a curve\) and 1 \(a surface\) of the union meet near \(1, 0, 0\)",
    ),
    "curve on solid": (
        ck.source("union", members=[DISK, SIDE]),
        r"Members 1 \(a curve\) and 0 \(a solid\) of the union meet near \(1, 0\)",
    ),
    "surface on solid": (
        ck.source("union", members=[BALL, ck.source("analytic.sphere", center=[1.5, 0, 0])]),
        r"Members 1 \(a surface\) and 0 \(a solid\) of the union meet near ",
    ),
    "point on curve": (
        ck.source("union", members=[ROD, ck.source("analytic.point", at=[2.0, 0, 0])]),
        r"Members 1 \(points\) and 0 \(a curve\) of the union meet near \(2, 0, 0\)",
    ),
    "trimmed": (
        ck.source("union", members=[ck.source("trimmed", of=SPHERE, trim="z - 0.5"), ROD]),
        r"Members 1 \(a curve\) and 0 \(a surface\) of the union meet near \(1, 0, 0\)",
    ),
}


@pytest.mark.parametrize(("union", "sentence"), MEETING.values(), ids=MEETING)
@pytest.mark.parametrize("spacing", [0.2, 0.05])
def test_parts_of_unlike_dimension_that_meet_are_named_before_anything_is_built(union, sentence, spacing):
    warnings = ck.explain(ck.Scene(union, ck.ScreenedPoisson(1.0)), spacing, form="collocation").warnings
    assert re.search(sentence, warnings[0])


@pytest.mark.parametrize(("turns", "named"), [(1, 2), (2, 3)])
def test_all_places_at_which_a_curve_crosses_a_surface_are_named_in_one_order(turns, named):
    """A circle crosses a sphere twice, and one with waves four times; moving both moves the places alone."""
    t = np.linspace(0, 2 * np.pi, 200)
    radius = 1.0 + (0.2 * np.cos(2 * t) if turns == 2 else 0.0)
    points = np.stack([radius * np.cos(t) + (0.7 if turns == 1 else 0.0), radius * np.sin(t), 0 * t], axis=1)
    union = ck.source("union", members=[SPHERE, ck.source("mesh.polyline", points=points)])
    found = set()
    for shift in (0.0, 1e-3):
        moved = ck.source("moved", of=union, translation=[0, 0, shift])
        scene = ck.Scene(moved, ck.ScreenedPoisson(1.0))
        for spacing in (0.1, 0.05):
            (warning,) = ck.explain(scene, spacing, form="collocation").warnings
            found.add(tuple(re.findall(r"\((\S+), (\S+), \S+\)", warning)))
        with pytest.warns(ck.CpmkitWarning, match="of the union meet"):
            solution = ck.solve(scene, 0.1, estimate=False, form="collocation")
        assert warning in solution.warnings
    assert ("and 1 more:" in warning) is (turns == 2)
    (places,) = found
    assert len(places) == named
    np.testing.assert_allclose(np.linalg.norm(np.array(places, dtype=float), axis=1), 1.0, atol=1e-3)


@pytest.mark.parametrize("spacing", [0.2, 0.1, 0.07])
def test_what_flows_through_a_joint_is_warned_of_and_has_no_estimate(spacing):
    """At .07 the rod's end had been taken for an edge of the manifold, and its error been estimated."""
    scene = ck.Scene(ROD_ON_SPHERE, ck.ScreenedPoisson(lambda points: points[:, 0]))
    with pytest.warns(ck.CpmkitWarning, match=r"Members 1 \(a curve\) and 0 \(a surface\) of the union meet"):
        solution = ck.solve(scene, spacing, estimate=True, form="collocation")
    assert solution.estimated is None
    again = lambda spacing, origin: ck.solve(scene, spacing, origin=origin, form="collocation")  # noqa: E731
    estimates = (
        lambda: solution.error,
        lambda: ck.estimate_error(scene, spacing, form="collocation"),
        lambda: ck.estimate_error_by(again, solution),
    )
    for estimate in estimates:
        with pytest.raises(InputError, match="The error of this solution has no estimate"):
            estimate()


@pytest.mark.parametrize("target", [{"tolerance": 0.5}, {"seconds": 1.0}, {"memory": 1e9}])
def test_no_target_is_taken_where_no_error_can_be_estimated(target):
    with pytest.raises(InputError, match="of which there is none here; give a spacing"):
        ck.solve(ck.Scene(ROD_ON_SPHERE, ck.ScreenedPoisson(1.0)), form="collocation", **target)


def test_parts_nearer_than_four_spacings_are_joined_and_a_tolerance_is_not_reached_there():
    """Farther apart they are not: the values there are those of the parts alone."""
    rod = ck.source("analytic.segment", start=[1.4, 0, 0], end=[3.0, 0, 0])
    apart = ck.Scene(ck.source("union", members=[SPHERE, rod]), ck.ScreenedPoisson(lambda points: points[:, 0]))
    assert "come within 0.4 of each other near (1.4, 0, 0)" in ck.explain(apart, 0.11, form="collocation").warnings[0]
    assert ck.explain(apart, 0.09, form="collocation").warnings == ()
    far = ck.solve(apart, 0.09, form="collocation")
    alone = ck.solve(ck.Scene(SPHERE, apart.problem), 0.09, form="collocation", origin=far.discretization()["origin"])
    points = np.array([[1.0, 0, 0], [0, 0, 1.0], [-1.0, 0, 0]])
    assert np.abs(far.evaluate(points) - alone.evaluate(points)).max() < 1e-3
    coarse = ck.solve(apart, memory=2e7, form="collocation")
    assert np.isnan(coarse.solve_history.error)
    assert "not known at spacing" in coarse.solve_history.summary


def test_parts_of_unlike_dimension_far_from_each_other_have_estimates():
    rod = ck.source("analytic.segment", start=[3.0, 0, 0], end=[4.0, 0, 0])
    scene = ck.Scene(ck.source("union", members=[SPHERE, rod]), ck.ScreenedPoisson(lambda points: points[:, 0]))
    assert ck.solve(scene, 0.2).error.largest[0] < 0.1


def test_a_boundary_over_pieces_of_several_dimensions_is_refused():
    across = ck.source("mesh.polyline", points=[[0, 0, 1], [1, 0, 0], [1.5, 0, 0]])
    scene = ck.Scene(DUMBBELL, ck.Laplace(), [on("across", across, both=ck.Dirichlet(1.0))], junctions=THIN)
    for form in ("collocation", "galerkin"):
        with pytest.raises(SceneError, match="runs over pieces of the dimensions 1 and 2"):
            ck.solve(scene, 0.3, form=form)


def test_pieces_that_do_not_touch_are_solved_beside_each_other():
    apart = ck.source("union", members=[SPHERE, ck.source("analytic.sphere", center=[3.0, 0, 0])])
    cuts = [
        latitude(0.5, "one", left=ck.Dirichlet(1.0), right=ck.Dirichlet(2.0)),
        on(
            "other",
            ck.source("analytic.circle", center=[3, 0, 0], normal=[1, 0, 0]),
            left=ck.Dirichlet(3.0),
            right=ck.Dirichlet(4.0),
        ),
    ]
    solution = ck.solve(ck.Scene(apart, ck.Laplace(), cuts), 0.2)
    u = solution.evaluate([[1.0, 0, 0], [-1.0, 0, 0], [4.0, 0, 0], [2.0, 0, 0]])
    assert np.abs(u - [1, 2, 3, 4]).max() < 1e-6
    (free,) = ck.solve(ck.Scene(apart, ck.Laplace(), cuts[:1]), 0.2).imbalances
    assert free.near[0] > 1.5


def test_a_union_of_one_is_that_one():
    """Its records do not name the place on the member, which a mesh needs for its normals."""
    vertices, faces = SPHERE.mesh(0.3)
    alone = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    cut = latitude(0.3, "cut", left=ck.Dirichlet(1.0), right=ck.Dirichlet(2.0))
    points = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0.5, 0.8, 0.3]])
    one, other = (
        ck.solve(ck.Scene(surface, ck.ScreenedPoisson(1.0), [cut]), 0.2).evaluate(alone.closest_point(points).points)
        for surface in (alone, ck.source("union", members=[alone]))
    )
    assert np.abs(one - other).max() < 1e-8


@pytest.mark.parametrize("order", [1, -1])
def test_an_end_in_another_member_is_no_edge_of_the_union(order):
    rod = ck.source("analytic.segment", start=[1, 0, 0], end=[3, 0, 0])
    union = ck.source("union", members=[ck.source("analytic.sphere"), rod][::order])
    inside = np.random.default_rng(0).uniform(0.05, 0.95, 200)[:, None] * [1, 0, 0]
    assert (union.closest_point(inside).edge == -1).all()
    free = 1001 if order == 1 else 1
    assert union.closest_point([[3.1, 0, 0]]).edge.tolist() == [free]
    scene = ck.Scene(union, ck.ScreenedPoisson(1.0), edge={free: ck.Dirichlet(1.0)}, junctions=THIN)
    for form in ("collocation", "galerkin"):
        assert ck.solve(scene, 0.3, form=form, estimate=False).evaluate([[3, 0, 0]]) == pytest.approx(1.0)
