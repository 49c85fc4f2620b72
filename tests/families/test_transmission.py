"""Both sides of a boundary coupled: jumps in value and flux, other conductivities, a contact that resists."""

import numpy as np
import pytest
from model_problems import max_error, order_of, origins, rotation, sphere_points
from two_materials import circle_problem

import cpmkit as ck

SPACINGS = (0.1, 0.05, 0.025, 0.0125)


@pytest.mark.parametrize(
    ("k_a", "k_b", "resistance"),
    [(1.0, 1.0, 0.0), (5.0, 1.0, 0.0), (1.0, 20.0, 0.0), (1.0, 1.0, 0.7), (3.0, 1.0, 2.0)],
)
def test_a_circle_of_two_materials(k_a, k_b, resistance):
    """Rms over origins: a single position of the nodes may be lucky."""
    spacings = SPACINGS[:3]
    errors = [
        np.sqrt(
            np.mean(
                [
                    max_error(*circle_problem(k_a, k_b, resistance), h, origin=o * h, form="collocation") ** 2
                    for o in origins(2)[:3]
                ]
            )
        )
        for h in spacings
    ]
    assert errors[-1] <= 6e-3
    assert order_of(spacings, errors) >= 1.8


@pytest.mark.parametrize(("k_a", "k_b", "resistance"), [(1.0, 1.0, 0.7), (3.0, 1.0, 2.0), (1.0, 5.0, 0.0)])
def test_a_circle_of_two_materials_at_order_one(k_a, k_b, resistance):
    spacings = (0.1, 0.05, 0.025)
    errors = [max_error(*circle_problem(k_a, k_b, resistance), h, order=1) for h in spacings]
    assert order_of(spacings, errors) >= 0.8
    assert errors[-1] <= 1e-2


def sphere_problem(k_left=4.0, k_right=1.0, height=0.2):
    """-div(k grad u) = f, u = w on the left of a small circle and 2 - 3 w on its right, w = axis . x."""
    axis = rotation()[:, 2]
    circle = ck.source("analytic.circle", center=height * axis, radius=np.sqrt(1 - height**2), normal=axis)

    def w(x):
        return x @ axis

    def left(x):
        return w(x) > height

    steep = np.sqrt(1 - height**2)  # the slope of w towards the left; outward slopes are -steep and -3 steep
    across = ck.Transmission(
        jump=height - (2 - 3 * height), flux=-(k_left + 3 * k_right) * steep, left=k_left, right=k_right
    )
    scene = ck.Scene(
        ck.source("analytic.sphere"),
        ck.Elliptic(
            lambda x: np.where(left(x), (2 * k_left + 1) * w(x), -3 * (2 * k_right + 1) * w(x) + 2),
            diffusivity=lambda x: np.where(left(x), k_left, k_right),
            c=1.0,
        ),
        [ck.Boundary("seam", circle, across=across, left_of=axis)],
    )
    points = sphere_points()
    points = points[np.abs(w(points) - height) > 1e-6]
    return scene, points, np.where(left(points), w(points), 2 - 3 * w(points))


@pytest.mark.slow
def test_a_sphere_of_two_materials():
    spacings = (0.2, 0.1, 0.05)
    errors = [max_error(*sphere_problem(), h) for h in spacings]
    assert errors[-1] <= 1e-2
    assert order_of(spacings, errors) >= 1.8


def test_nothing_happens_across_an_idle_seam():
    """Equal materials, no jump: the solution is the one without the boundary, to second order."""
    axis = rotation()[:, 2]
    circle = ck.source("analytic.circle", center=0.2 * axis, radius=np.sqrt(0.96), normal=axis)
    f = ck.ScreenedPoisson(lambda x: 7 * x[:, 0] * x[:, 1], c=1.0)
    idle = ck.Boundary("idle", circle, across=ck.Transmission())
    points = sphere_points()
    exact = points[:, 0] * points[:, 1]
    for h in (0.3, 0.2):
        bare = max_error(ck.Scene(ck.source("analytic.sphere"), f), points, exact, h)
        assert max_error(ck.Scene(ck.source("analytic.sphere"), f, [idle]), points, exact, h) <= 1.5 * bare


def test_an_infinite_resistance_is_a_wall():
    axis = rotation()[:, 2]
    circle = ck.source("analytic.circle", center=0.2 * axis, radius=np.sqrt(0.96), normal=axis)
    f = ck.ScreenedPoisson(lambda x: np.where(x @ axis > 0.2, 1.0, 5.0), c=2.0)
    seam = ck.Boundary("seam", circle, across=ck.Transmission(resistance=1e12))
    values = ck.solve(ck.Scene(ck.source("analytic.sphere"), f, [seam]), 0.2).evaluate(np.array([axis, -axis]))
    np.testing.assert_allclose(values, [0.5, 2.5], rtol=1e-6)


def test_one_side_pins_the_other():
    """A Dirichlet point on one side of a seam fixes the constant on both."""
    scene = ck.Scene(
        ck.source("analytic.circle"),
        ck.Laplace(),
        [
            ck.Boundary("pin", ck.source("analytic.point", at=[1, 0]), both=ck.Dirichlet(3.0)),
            ck.Boundary("one", ck.source("analytic.point", at=[0, 1]), across=ck.Transmission(jump=1.0)),
            ck.Boundary("two", ck.source("analytic.point", at=[0, -1]), across=ck.Transmission(jump=-1.0)),
        ],
    )
    values = ck.solve(scene, 0.05).evaluate([[np.sqrt(0.5), np.sqrt(0.5)], [-1, 0]])
    np.testing.assert_allclose(values, [3.0, 2.0], atol=1e-6)


@pytest.mark.parametrize("wrong", [{"left": 0.0}, {"right": -1.0}, {"resistance": -1.0}, {"left": np.nan}])
def test_what_a_transmission_refuses(wrong):
    with pytest.raises(ck.InputError, match=r"of Transmission.* above zero"):
        ck.Transmission(**wrong)


def test_a_point_on_a_surface_transmits_nothing():
    point = ck.Boundary("point", ck.source("analytic.point", at=[0, 0, 1]), across=ck.Transmission())
    with pytest.raises(ck.SceneError, match="has no left and right"):
        ck.solve(ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(1.0), [point]), 0.2)


def test_across_beside_another_condition_is_refused():
    with pytest.raises(ck.SceneError, match="give `both`, or `left` and `right`, or `across`"):
        ck.Boundary("b", ck.source("analytic.point", at=[1, 0]), both=ck.Neumann(), across=ck.Transmission())


def test_in_a_scene_file(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(
        '[surface]\nkind = "analytic.circle"\n[[boundary]]\nname = "seam"\nkind = "analytic.point"\nat = [1, 0]\n'
        'across = { jump = "x", left = 2.0, resistance = 0.5 }\n[problem]\nkind = "elliptic"\nc = 1.0\n'
    )
    across = ck.load_scene(file).scene.boundaries[0].across
    assert (across.left, across.right, across.resistance) == (2.0, None, 0.5)
    assert across.jump(np.array([[1.0, 0.0]])) == 1.0


def test_two_seams_cut_nothing_apart():
    """One constant is free on the circle, and no crossing is told of: the two halves hang together at both seams."""
    seams = [
        ck.Boundary(name, ck.source("analytic.point", at=at), across=ck.Transmission(resistance=0.5))
        for name, at in (("east", [1, 0]), ("west", [-1, 0]))
    ]
    solution = ck.solve(ck.Scene(ck.source("analytic.circle"), ck.Poisson(lambda x: x[:, 1]), seams), 0.1)
    (defect,) = solution.imbalances
    assert defect.share == 1.0
    assert solution.warnings == ()
