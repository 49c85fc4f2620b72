"""Which side of a boundary is left does not depend on chance: not on the spacing, not on the lattice."""

import re
from itertools import pairwise

import numpy as np
import pytest
from bare import Bare

import cpmkit as ck
from cpmkit.forms.collocation.side_view import put_on_lattice
from cpmkit.grid.lattice import Lattice
from cpmkit.plugin import localize

STRIP = ck.source("parametric.moebius")
SPHERE = ck.source("analytic.sphere")
TOP, BOTTOM = [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]


def circle(height, normal=TOP):
    center, radius = height * np.asarray(normal), np.sqrt(1 - height**2)
    return ck.source("analytic.circle", center=center, radius=radius, normal=normal)


def unlike(source, **more):
    return ck.Boundary("cut", source, left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0), **more)


def scene(surface, *boundaries):
    return ck.Scene(surface, ck.Laplace(), boundaries)


def signed(of, point, spacing, origin=0.0):
    """Return the signed distance, left positive, of a point from a scene's first boundary on some lattice."""
    lattice = Lattice(np.broadcast_to(origin, of.surface.dim) * 1.0, spacing)
    seen = put_on_lattice(of.boundaries[0], localize(of.surface, lattice.origin), lattice, spacing, of.oriented)
    return seen.side_view(lattice.to_local(np.atleast_2d(point)), np.inf, spacing).signed[0]


@pytest.mark.parametrize("sides", ["both", "left and right"])
def test_a_surface_without_normals_is_cut_as_well_as_one_with_them(sides):
    """At a fifth of the radius normals at two feet differ by more than a right angle; it was 1.32 for 1."""
    given = {"both": ck.Dirichlet(1.0)} if sides == "both" else {"left": ck.Dirichlet(1.0), "right": ck.Dirichlet(1.0)}
    lower = ck.Boundary("lower", circle(-0.5), both=ck.Dirichlet(-0.5))
    solution = ck.solve(scene(Bare(SPHERE), ck.Boundary("upper", circle(0.5), **given), lower), 0.2)
    assert solution.evaluate([TOP, BOTTOM]) == pytest.approx([1.0, -0.5], abs=1e-6)


def test_a_cloud_is_cut_on_a_coarse_grid():
    t, z = np.pi * (1 + np.sqrt(5)) * np.arange(1200), 1 - (2 * np.arange(1200) + 1) / 1200
    points = np.stack([np.sqrt(1 - z**2) * np.cos(t), np.sqrt(1 - z**2) * np.sin(t), z], axis=1)
    cloud = ck.source("pointcloud.points", points=points)
    ends = [ck.Boundary(str(h), circle(h), both=ck.Dirichlet(value)) for h, value in ((0.5, 1.0), (-0.5, -0.5))]
    assert ck.solve(scene(cloud, *ends), 0.2).evaluate([TOP, BOTTOM]) == pytest.approx([1.0, -0.5], abs=1e-3)


@pytest.mark.parametrize("surface", [SPHERE, Bare(SPHERE)], ids=["own normals", "bare surface"])
@pytest.mark.parametrize("bare_curve", [False, True], ids=["own tangents", "bare curve"])
def test_unlike_sides_need_someone_who_says_which_is_left(surface, bare_curve):
    curve = Bare(circle(0.3)) if bare_curve else circle(0.3)
    if surface is SPHERE and not bare_curve:
        assert signed(scene(surface, unlike(curve)), TOP, 0.2) > 0
        return
    with pytest.raises(
        ck.SceneError, match="unlike conditions on its sides, and nothing says which side is left"
    ) as told:
        signed(scene(surface, unlike(curve)), TOP, 0.2)
    one, other = _points_in(str(told.value))
    for point, opposite in ((one, other), (other, one)):
        chosen = scene(surface, unlike(curve, left_of=point))
        assert signed(chosen, point, 0.2) > 0 > signed(chosen, opposite, 0.2)


def _points_in(message):
    return [np.array([float(x) for x in found.split(",")]) for found in re.findall(r"\[([^\]]*)\]", message)]


def test_a_point_on_the_left_that_the_sources_have_on_the_right_is_refused():
    assert signed(scene(SPHERE, unlike(circle(0.3), left_of=TOP)), TOP, 0.2) > 0
    with pytest.raises(ck.SceneError, match="on its right, as the surface's own normal"):
        signed(scene(SPHERE, unlike(circle(0.3), left_of=BOTTOM)), TOP, 0.2)
    with pytest.raises(ck.SceneError, match="is on neither side of some piece of it"):
        signed(scene(Bare(SPHERE), unlike(circle(0.3), left_of=[np.sqrt(0.91), 0, 0.3])), TOP, 0.2)


def test_the_two_points_of_the_refusal_serve_far_from_zero():
    place = np.array([1e6, -3e5, 2e6])
    surface, curve = (ck.source("moved", of=one, translation=place, scale=1e-2) for one in (SPHERE, circle(0.3)))
    with pytest.raises(ck.SceneError, match="give left_of") as told:
        signed(scene(Bare(surface), unlike(curve)), place, 1e-3, place)
    one, other = _points_in(str(told.value))
    chosen = scene(Bare(surface), unlike(curve, left_of=one))
    assert signed(chosen, one, 1e-3, place) > 0 > signed(chosen, other, 1e-3, place)


def test_errors_of_a_rule_are_reported_before_anything_is_built():
    both = ck.Boundary("cut", circle(0.3), both=ck.Dirichlet(1.0))
    assert "left is named by a rule" in str(ck.explain(scene(Bare(SPHERE), both), 0.2, dry_run=True))
    assert "left is named by a rule" not in str(ck.explain(scene(SPHERE, both), 0.2, dry_run=True))
    chosen = ck.Boundary("cut", circle(0.3), both=ck.Dirichlet(1.0), left_of=TOP)
    assert "left is named by left_of" in str(ck.explain(scene(Bare(SPHERE), chosen), 0.2, dry_run=True))


def test_left_is_the_same_at_every_spacing_and_on_every_lattice():
    """The first sample of the lattice decided: one of forty circles changed its left with the spacing."""
    random = np.random.default_rng(3)
    for normal in random.normal(size=(12, 3)):
        normal = normal / np.linalg.norm(normal)
        both = ck.Boundary("cut", circle(0.3, normal), both=ck.Dirichlet(1.0))
        for surface in (Bare(SPHERE), Bare(ck.source("analytic.sphere"))):
            sides = [
                signed(scene(surface, both), normal, h, origin) > 0
                for h, origin in ((0.1, 0.0), (0.05, 0.01), (0.04, 0.0))
            ]
            assert sides == [True] * 3  # outward normals by the rule, as the sphere's own


@pytest.mark.parametrize(("scale", "offset"), [(1e-6, 0.0), (1.0, 1e6), (1e6, -1e9)])
def test_left_does_not_depend_on_size_and_place(scale, offset):
    moved = [ck.source("moved", of=one, scale=scale, translation=[offset] * 3) for one in (SPHERE, circle(0.3))]
    place = offset + scale * np.array(TOP)
    assert signed(scene(Bare(moved[0]), unlike(Bare(moved[1]), left_of=place)), place, 0.1 * scale, offset) > 0


def test_left_of_chooses_each_piece_of_a_boundary():
    """Each of two circles has the point on its left, however they travel."""
    pieces = ck.source("union", members=[Bare(circle(0.5)), Bare(circle(0.5, BOTTOM)), circle(-0.7)])
    given = scene(Bare(SPHERE), unlike(pieces, left_of=TOP))
    for height, left in ((0.6, True), (0.4, False), (-0.45, True), (-0.55, False), (-0.65, True), (-0.75, False)):
        point = [np.sqrt(1 - height**2), 0.0, height]
        assert (signed(given, point, 0.05) > 0) == left


@pytest.mark.parametrize("interior", [np.pi / 2, np.pi / 4])
def test_the_direction_of_a_curve_without_tangents_goes_round_its_corners(interior):
    """Two corners of the triangle turn by 135 degrees: the tangents there point apart, and yet go on."""
    height = np.tan(interior) if interior < np.pi / 2 else 1.0
    corners = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, height], [-1.0, 0.0]])
    inside = corners[:3].mean(axis=0)
    triangle = Bare(ck.source("mesh.polyline", points=corners))
    area = ck.source("analytic.box", lower=[-2, -2], upper=[2, 3])
    given = scene(area, unlike(triangle, left_of=inside))
    for a, b in pairwise(corners):
        for share in (0.05, 0.5, 0.95):
            on = (1 - share) * a + share * b
            assert signed(given, on + 0.02 * (inside - on), 0.05) > 0 > signed(given, on - 0.02 * (inside - on), 0.05)


def test_equal_data_need_no_left_on_a_surface_that_has_none():
    core = ck.source("analytic.circle", normal=TOP)
    for left, right in ((ck.Dirichlet([1.0, 2.0]), ck.Dirichlet((1, 2))), (ck.Neumann(0.0), ck.Neumann(0))):
        equal = scene(STRIP, ck.Boundary("core", core, left=left, right=right))
        assert not equal.oriented(equal.boundaries[0]).left.known
        assert np.isfinite(signed(equal, [1.1, 0.0, 0.0], 0.1))
    with pytest.raises(ck.SceneError, match="has no left side"):
        signed(scene(STRIP, unlike(core, left_of=[1.2, 0, 0])), [1.1, 0.0, 0.0], 0.1)


def test_the_two_sides_of_a_curve_without_a_left_cannot_be_read():
    core = ck.Boundary("core", ck.source("analytic.circle", normal=TOP), both=ck.Dirichlet(1.0))
    solution = ck.solve(scene(STRIP, core), 0.14)
    with pytest.raises(ck.InputError, match="must be 'left' or 'right' of a boundary that has sides"):
        solution.evaluate([[1.0, 0.0, 0.0]], side={"core": "left"})


def test_a_side_is_left_or_right_also_without_boundaries():
    solution = ck.solve(scene(STRIP), 0.14)
    with pytest.raises(ck.InputError, match="side must be 'left' or 'right'"):
        solution.evaluate([[1.0, 0.0, 0.0]], side="above")


def test_a_boundary_that_branches_takes_one_condition():
    """Where two lines cross no direction of travel can be carried on; u = x y vanishes on both."""
    lines = [
        ck.source("analytic.segment", start=start, end=end) for start, end in (([-1, 0], [1, 0]), ([0, -1], [0, 1]))
    ]
    axes = ck.Boundary("axes", Bare(ck.source("union", members=lines)), both=ck.Dirichlet(0.0))
    area = ck.source("analytic.box", lower=[-1, -1], upper=[1, 1])
    given = ck.Scene(area, ck.Laplace(), [axes], edge=ck.Dirichlet(lambda x: x[:, 0] * x[:, 1]))
    points = np.random.default_rng(0).uniform(-0.95, 0.95, (200, 2))
    assert ck.solve(given, 0.1).evaluate(points) == pytest.approx(points[:, 0] * points[:, 1], abs=2e-4)


def test_equal_data_on_the_sides_of_a_point_on_a_surface_are_those_of_both():
    pin = ck.source("analytic.point", at=TOP)
    f = ck.ScreenedPoisson(1.0)
    pair = ck.Boundary("pin", pin, left=ck.Dirichlet(0.5), right=ck.Dirichlet(0.5))
    both = ck.Boundary("pin", pin, both=ck.Dirichlet(0.5))
    one, other = (ck.solve(ck.Scene(SPHERE, f, [boundary]), 0.25).evaluate([BOTTOM]) for boundary in (pair, both))
    assert one == other
    with pytest.raises(ck.SceneError, match="so it has no left and right"):
        signed(scene(SPHERE, unlike(pin)), TOP, 0.2)


def test_a_contact_that_is_the_same_from_both_sides_needs_no_left():
    for across, fine in ((ck.Transmission(resistance=0.5), True), (ck.Transmission(jump=1.0), False)):
        given = scene(Bare(SPHERE), ck.Boundary("contact", circle(0.3), across=across))
        if fine:
            assert signed(given, TOP, 0.2) > 0
        else:
            with pytest.raises(ck.SceneError, match="give left_of"):
                signed(given, TOP, 0.2)


def test_a_nonlinear_flux_on_both_sides_needs_no_left():
    given = ck.Scene(
        Bare(SPHERE), ck.ScreenedPoisson(1.0), [ck.Boundary("hot", circle(0.3), both=ck.NonlinearFlux(lambda u: 1 - u))]
    )
    assert ck.solve(given, 0.25).evaluate([TOP, BOTTOM]) == pytest.approx([1.0, 1.0], abs=1e-6)
