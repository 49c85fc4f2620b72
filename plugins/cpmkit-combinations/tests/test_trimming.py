"""A trimmed manifold has a true edge: its feet, normals and solutions are those of the same shape in closed form."""

import numpy as np
import pytest
from bare import Bare
from cpmkit_combinations.trimmed import trimmed_source
from cpmkit_combinations.union import union
from model_problems import sphere_points

import cpmkit as ck
from cpmkit.errors import InputError
from cpmkit.plugin import HasMesh, HasNormals, HasTangents, HasTranslation

SPHERE, TORUS = ck.source("analytic.sphere"), ck.source("analytic.torus")


def around(source, count=1500):
    lower, upper = source.bounds
    return np.random.default_rng(0).uniform(lower - 0.5, upper + 0.5, (count, source.dim))


@pytest.mark.parametrize("surface", [SPHERE, Bare(SPHERE)], ids=["own normals", "closest points alone"])
def test_a_sphere_is_trimmed_to_a_cap(surface):
    found = trimmed_source(of=surface, trim="0.35 - z")
    cap = ck.source("analytic.cap", height=0.35)
    x = around(cap)
    feet, exact = found.closest_point(x), cap.closest_point(x)
    assert np.abs(feet.distance - exact.distance).max() < 1e-10
    assert np.abs(feet.points - exact.points).max() < 1e-6
    assert (feet.edge == exact.edge).all()
    assert not feet.doubtful.any()


@pytest.mark.parametrize("edge", [ck.Neumann(0.0), ck.Dirichlet(lambda p: p[:, 0])], ids=["neumann", "dirichlet"])
@pytest.mark.parametrize(("form", "apart"), [("collocation", 1e-9), ("galerkin", 4e-5)])
def test_solutions_on_a_trimmed_sphere_are_those_on_the_cap(edge, form, apart):
    """The same closest points; the meshes that splines are summed over are two, which a tenth of the error tells."""
    cap = ck.source("analytic.cap", height=0.35)
    points = cap.closest_point(sphere_points(500)).points
    values = []
    for surface in (cap, trimmed_source(of=SPHERE, trim=lambda p: 0.35 - p[:, 2])):
        scene = ck.Scene(surface, ck.ScreenedPoisson(lambda p: p[:, 0] * p[:, 1] + 1), edge=edge)
        values.append(ck.solve(scene, 0.2, origin=np.zeros(3), form=form).evaluate(points))
    assert np.abs(values[0] - values[1]).max() < apart


def test_a_circle_is_trimmed_to_an_arc_with_its_ends_in_order():
    found = trimmed_source(of=ck.source("analytic.circle", center=[0, 0]), trim="-y")
    arc = ck.source("analytic.arc", start=0.0, end=np.pi)
    x = around(arc)
    feet, exact = found.closest_point(x), arc.closest_point(x)
    assert np.abs(feet.points - exact.points).max() < 1e-10
    assert (feet.edge == exact.edge).all()


def test_the_end_that_an_arc_keeps_keeps_its_number():
    arc = ck.source("analytic.arc", start=0.3, end=5.0)
    found = trimmed_source(of=arc, trim="-0.5 - y")
    shorter = ck.source("analytic.arc", start=0.3, end=7 * np.pi / 6)
    x = around(arc)
    assert (found.closest_point(x).edge == shorter.closest_point(x).edge).all()


def test_feet_are_the_nearest_of_what_is_left():
    """Where the closest point of the whole is cut away, the nearest may lie on another part instead of the edge."""
    inner = ck.source("analytic.sphere", radius=0.8)
    both = union(members=[SPHERE, inner])
    found = trimmed_source(of=both, trim=lambda p: np.minimum(np.linalg.norm(p, axis=1) - 0.9, p[:, 2] - 0.5))
    x = around(SPHERE, 500)
    feet = found.closest_point(x)
    cap = ck.source("analytic.cap", axis=[0, 0, -1], height=-0.5)
    exact = np.minimum(cap.closest_point(x).distance, inner.closest_point(x).distance)
    cut_away = (both.closest_point(x).points[:, 2] > 0.5) & (np.linalg.norm(both.closest_point(x).points, axis=1) > 0.9)
    assert (cut_away & (feet.edge == -1)).sum() > 20
    assert (cut_away & (feet.edge == 0)).sum() > 5
    assert np.abs(feet.distance - exact).max() < 1e-10
    assert feet.doubtful.mean() < 0.02


def test_edges_are_numbered_from_the_longest_and_after_them_those_of_the_whole():
    found = trimmed_source(of=ck.source("analytic.cylinder", length=2.0), trim="0.3 - hypot(x - 1, z)")
    assert set(found.closest_point(around(SPHERE)).edge) == {-1, 0, 1, 2}
    rims = found.closest_point(np.array([[1.0, 0, -2], [1.0, 0, 2]]))
    assert rims.edge.tolist() == [1, 2]


def test_abilities_are_those_of_the_whole():
    has = (HasNormals, HasTangents, HasMesh, HasTranslation)
    for whole, trim in ((SPHERE, "z"), (Bare(SPHERE), "z"), (ck.source("analytic.circle", center=[0, 0]), "y")):
        found = trimmed_source(of=whole, trim=trim)
        assert [isinstance(found, each) for each in has] == [isinstance(whole, each) for each in has]


def test_the_mesh_ends_on_the_edge():
    found = trimmed_source(of=SPHERE, trim="z - 0.4")
    vertices, cells = found.mesh(0.05)
    a, b, c = np.swapaxes(vertices[cells], 0, 1)
    assert abs(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() - 2 * np.pi * 1.4) < 0.02
    edges = np.sort(np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]]), axis=1)
    once, times = np.unique(edges, axis=0, return_counts=True)
    rim = np.unique(once[times == 1])
    assert np.abs(vertices[rim, 2] - 0.4).max() < 1e-12
    assert len(rim) > 60


def test_a_trimmed_surface_can_be_trimmed_again():
    bowl = trimmed_source(of=trimmed_source(of=SPHERE, trim="z - 0.5"), trim="x - 0.3")
    feet = bowl.closest_point(around(SPHERE))
    assert feet.points[:, 0].max() < 0.3 + 1e-11
    assert feet.points[:, 2].max() < 0.5 + 1e-11
    assert set(feet.edge) == {-1, 0, 1}


def test_a_trimmed_surface_far_from_zero_is_trimmed_at_the_same_place():
    far = trimmed_source(of=ck.source("analytic.sphere", center=[1e9, 0, 0]), trim="z").translate(
        np.array([-1e9, 0, 0])
    )
    feet = far.closest_point(np.array([[0.6, 0, 0.9], [0.6, 0, -0.8]]))
    assert np.abs(feet.points - [[1, 0, 0], [0.6, 0, -0.8]]).max() < 1e-6


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: trimmed_source(of=SPHERE, trim="z - 2"), "trim does not change its sign"),
        (lambda: trimmed_source(of=SPHERE, trim="2 - z"), "trim does not change its sign"),
        (lambda: trimmed_source(of=SPHERE, trim="x * y"), "branches"),
        (lambda: trimmed_source(of=SPHERE, trim=None), "trim must be a formula"),
        (
            lambda: trimmed_source(of=ck.source("analytic.circle", center=[0, 0]), trim="x * y"),
            "one piece of the curve",
        ),
        (lambda: trimmed_source(of="a ball", trim="z"), "of must be a closest point source"),
    ],
)
def test_what_cannot_be_trimmed_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
