"""Which side of a boundary is left is found once a scene, and needs no lattice."""

import subprocess
import sys
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from bare import Bare
from layouts import build_layout

import cpmkit as ck
from cpmkit.scene.oriented import orient

SPHERE = ck.source("analytic.sphere")
TOP = [0.0, 0.0, 1.0]


@dataclass(frozen=True, eq=False)
class Counting(Bare):
    """A source without abilities that keeps how many points it was asked for."""

    target: list[int] = field(default_factory=list)

    def closest_point(self, x, /):
        self.target.append(len(x))
        return super().closest_point(x)


def cut(height=0.3, curve=Bare, **more):
    circle = ck.source("analytic.circle", center=[0, 0, height], radius=np.sqrt(1 - height**2), normal=TOP)
    return ck.Boundary("cut", curve(circle), left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0), **more)


def bare_scene():
    return ck.Scene(Counting(SPHERE), ck.Laplace(), [cut(curve=Counting, left_of=TOP)])


def queries(scene, work, **options):
    """How many points of the surface and of the boundary ``work(scene, **options)`` asks for."""
    sources = scene.surface, scene.boundaries[0].source
    before = [sum(one.target) for one in sources]
    work(scene, **options)
    return np.array([sum(one.target) - known for one, known in zip(sources, before, strict=True)])


def test_signs_are_found_once_whatever_the_spacings_and_lattices():
    """A layout of a scene that knows its left asks for exactly so much less than one of a new scene."""
    kept = bare_scene()
    found = queries(kept, lambda scene: scene.oriented(scene.boundaries[0]))
    left = kept.oriented(kept.boundaries[0]).left
    assert found.tolist() == list(left.queries)
    assert 0 < found.sum() < 60 * len(left.signs.points)
    for spacing, origin in ((0.25, None), (0.2, [0.01, 0.0, 0.02]), (0.16, None), (0.25, None)):
        first, again = (queries(scene, build_layout, spacing=spacing, origin=origin) for scene in (bare_scene(), kept))
        assert (first - again).tolist() == found.tolist()
    assert kept.oriented(kept.boundaries[0]).left is left


def test_no_closest_point_is_computed_where_the_sources_say_which_side_is_left():
    given = ck.Scene(SPHERE, ck.Laplace(), [cut(curve=lambda circle: circle)])
    assert given.oriented(given.boundaries[0]).left.queries == (0, 0)


def test_all_spacings_and_the_boundary_itself_agree_on_left():
    random = np.random.default_rng(5).normal(size=(200, 3))
    points = random / np.linalg.norm(random, axis=1, keepdims=True)
    points = points[np.abs(points[:, 2] - 0.3) > 1e-3]
    for surface, boundary in ((SPHERE, cut(left_of=TOP)), (Bare(SPHERE), cut(left_of=[0, 0, -1.0]))):
        scene = ck.Scene(surface, ck.Laplace(), [boundary])
        itself = scene.oriented(boundary)
        signs = [np.sign(itself.signed_distance(points - itself.left.origin, 0.01))]
        for spacing, origin in ((0.2, None), (0.13, [0.03, 0.01, 0.0])):
            layout = build_layout(scene, spacing, origin=origin)
            view = layout.boundaries.on_lattice[0].side_view(layout.lattice.to_local(points), np.inf, spacing)
            signs.append(np.sign(view.signed))
        up = np.sign(points[:, 2] - 0.3) * np.sign(boundary.left_of[2])
        assert all(np.array_equal(one, up) for one in signs)


def test_an_oriented_boundary_has_feet_left_and_tips_without_a_lattice():
    arc = ck.source("analytic.arc", normal=TOP, x_axis=[1, 0, 0], start=0.0, end=np.pi / 2)
    found = orient(ck.Boundary("arc", arc, both=ck.Dirichlet(1.0)), SPHERE)
    assert found.has_sides
    assert found.has_left
    beside = np.array([[1.0, 1.0, 0.2], [1.0, 1.0, -0.2], [1.0, -0.5, 0.1]])
    points = beside / np.linalg.norm(beside, axis=1, keepdims=True) - found.left.origin
    feet, on = found.feet(points)
    left = found.leftward(feet, on, 0.01)
    assert on.points[0] + found.left.origin == pytest.approx(np.array([1.0, 1.0, 0.0]) / np.sqrt(2))
    assert found.tangents(feet, on, left, 0.01)[0] == pytest.approx(np.array([-1.0, 1.0, 0.0]) / np.sqrt(2))
    assert left[:2] == pytest.approx(np.array([TOP, TOP]))
    signed = found.signed_distance(points, 0.01)
    assert signed[:2] == pytest.approx(points[:2, 2], rel=1e-12)
    assert np.isnan(signed[2])
    assert found.open_ends(feet, on, 0.01).tolist() == [False, False, True]


def test_a_boundary_seen_from_elsewhere_keeps_its_left():
    scene = bare_scene()
    itself = scene.oriented(scene.boundaries[0])
    origin = np.array([0.4, -0.1, 0.2])
    sources = [replace(one, shift=origin, origin=origin) for one in (itself.source, itself.surface)]
    moved = itself.relative_to(origin, *sources)
    points = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]])
    assert moved.signed_distance(points - origin, 0.01) == pytest.approx(
        itself.signed_distance(points - itself.left.origin, 0.01)
    )


def test_the_dimension_along_a_boundary_is_that_of_the_piece_it_runs_on():
    """On a line that stands on a cap a point parts the line, and has no sides on the cap."""
    cap = ck.source("analytic.cap")
    line = ck.source("analytic.segment", start=[0, 0, 1.0], end=[0, 0, 2.0])
    both = ck.source("union", members=[cap, line])
    for place, dimension in ([0, 0, 1.5], 1), ([0.6, 0, 0.8], 2):
        pin = ck.Boundary("pin", ck.source("analytic.point", at=place), both=ck.Dirichlet(1.0))
        found = orient(pin, both)
        assert (found.dimension, found.has_sides) == (dimension, dimension == 1)


def test_no_form_is_imported_for_it():
    program = """
import sys
import cpmkit as ck
circle = ck.source("analytic.circle", normal=[0, 0, 1])
scene = ck.Scene(ck.source("analytic.sphere"), ck.Laplace(), [ck.Boundary("cut", circle, both=ck.Dirichlet(1.0))])
found = scene.oriented(scene.boundaries[0])
assert found.signed_distance(scene.surface.closest_point(found.left.origin[None] + [[1, 0, 1]]).points, 0.1)[0] > 0
print([name for name in sys.modules if name.startswith("cpmkit.forms")])
"""
    told = subprocess.run([sys.executable, "-P", "-c", program], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"


def test_a_curve_beside_the_surface_stands_for_its_projection():
    """Points of the projection are their own feet, and conormals are perpendicular to it, not to the curve."""
    torus = ck.source("analytic.torus", major=1.0, minor=0.4)
    formulas = ["1.08*cos(t)", "1.08*sin(t)", "0.37 + 0.08*sin(5*t)"]
    wave = ck.source("parametric.curve", x=formulas, range=[0, "2*pi"], periodic=True)
    oriented = orient(ck.Boundary("wave", wave, both=ck.Dirichlet(0.0)), torus)
    t = np.linspace(0, 2 * np.pi, 4001)
    points = torus.closest_point(np.stack([1.08 * np.cos(t), 1.08 * np.sin(t), 0.37 + 0.08 * np.sin(5 * t)], 1)).points
    middle, along = points[1:-1], points[2:] - points[:-2]
    along /= np.linalg.norm(along, axis=1)[:, None]
    feet, on = oriented.feet(middle - oriented.left.origin)
    assert np.abs(on.points + oriented.left.origin - middle).max() < 1e-10
    left = oriented.leftward(feet, on, 0.05)
    assert np.abs((left * along).sum(axis=1)).max() < 1e-3
