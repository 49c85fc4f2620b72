"""Surfaces joined by segments, as one manifold: values pass through the joints, and sides are each piece's own."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.combinations.cases import mixed_union
from cpmkit.errors import SceneError

SPHERE = ck.source("analytic.sphere")
ROD = ck.source("analytic.segment", start=[1.0, 0, 0], end=[3.0, 0, 0])
DUMBBELL = ck.source("union", members=[SPHERE, ck.source("analytic.sphere", center=[4.0, 0, 0]), ROD])


def on(name, source, **sides):
    return ck.Boundary(name, source, **sides)


def latitude(x, name, **sides):
    """The circle around the x axis at x."""
    return on(name, ck.source("analytic.circle", center=[x, 0, 0], normal=[1, 0, 0], radius=np.sqrt(1 - x**2)), **sides)


def test_a_sphere_takes_the_value_that_reaches_it_through_a_rod():
    """Nothing else is set on the second sphere: it is at the rod's value, and the rod's is that of the first."""
    cut = latitude(-0.5, "cut", both=ck.Dirichlet(2.0))
    solution = ck.solve(ck.Scene(DUMBBELL, ck.Laplace(), [cut]), 0.1)
    points = np.array([[5.0, 0, 0], [4.0, 1, 0], [2.0, 0, 0], [0, 1, 0]])
    assert np.abs(solution.evaluate(points) - 2.0).max() < 1e-5


def test_along_a_rod_between_two_values_the_solution_is_linear():
    """Both spheres hold their values by circles around the joints; in between u'' = 0.

    The joints are balls of a few spacings: the value half way is off by a part of that.
    """
    ends = [
        latitude(0.8, "first", both=ck.Dirichlet(0.0)),
        on(
            "second",
            ck.source("analytic.circle", center=[3.2, 0, 0], normal=[1, 0, 0], radius=0.6),
            both=ck.Dirichlet(1.0),
        ),
    ]
    solution = ck.solve(ck.Scene(DUMBBELL, ck.Laplace(), ends), 0.05)
    x = np.linspace(1.4, 2.6, 25)
    u = solution.evaluate(np.stack([x, 0 * x, 0 * x], axis=1))
    slope, value = np.polyfit(x, u, 1)
    assert np.abs(u - (slope * x + value)).max() < 2e-3
    assert abs(slope * 2.0 + value - 0.5) < 0.02
    assert slope > 0.3


def test_a_cut_on_the_rod_has_two_sides():
    """Left of a point on a curve is where the curve comes from: the first sphere."""
    pin = ck.source("analytic.point", at=[2.0, 0, 0])
    cut = on("cut", pin, left=ck.Dirichlet(1.0), right=ck.Dirichlet(3.0))
    solution = ck.solve(ck.Scene(DUMBBELL, ck.Laplace(), [cut]), 0.1)
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
    solution = ck.solve(scene, 0.02)
    assert solution.warnings == ()
    u = solution.evaluate(scene.surface.mesh(0.02)[0])
    assert u.min() > -0.01
    assert u.max() < 3.01
    below, above, joint, torus = solution.evaluate([[0, 0, -0.25], [0, 0, 0.25], [0.325, 0, 0], [0, 0.4, 0]])
    assert 0 < below < 0.2
    assert abs(above - 1) < 1e-6
    assert 0.5 < joint < 2.7
    assert torus > 2.9


def test_a_boundary_over_pieces_of_several_dimensions_is_refused():
    across = ck.source("mesh.polyline", points=[[0, 0, 1], [1, 0, 0], [1.5, 0, 0]])
    scene = ck.Scene(DUMBBELL, ck.Laplace(), [on("across", across, both=ck.Dirichlet(1.0))])
    with pytest.raises(SceneError, match="runs over pieces of the dimensions 1 and 2"):
        ck.solve(scene, 0.3)


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
    solution = ck.solve(ck.Scene(apart, ck.Laplace(), cuts), 0.1)
    u = solution.evaluate([[1.0, 0, 0], [-1.0, 0, 0], [4.0, 0, 0], [2.0, 0, 0]])
    assert np.abs(u - [1, 2, 3, 4]).max() < 1e-6
    (free,) = ck.solve(ck.Scene(apart, ck.Laplace(), cuts[:1]), 0.1).imbalances
    assert free.near[0] > 1.5


def test_a_union_of_one_is_that_one():
    """Its records do not name the place on the member, which a mesh needs for its normals."""
    vertices, faces = SPHERE.mesh(0.2)
    alone = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    cut = latitude(0.3, "cut", left=ck.Dirichlet(1.0), right=ck.Dirichlet(2.0))
    points = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0.5, 0.8, 0.3]])
    one, other = (
        ck.solve(ck.Scene(surface, ck.ScreenedPoisson(1.0), [cut]), 0.15).evaluate(alone.closest_point(points).points)
        for surface in (alone, ck.source("union", members=[alone]))
    )
    assert np.abs(one - other).max() < 1e-8
