"""Conditions for parts of an edge, by position: right where they meet, the same however written, or refused."""

import pickle

import numpy as np
import pytest
from model_problems import order_of, sphere_points

import cpmkit as ck

HEIGHT = 0.3
RADIUS = np.sqrt(1 - HEIGHT**2)
CAP = ck.source("analytic.cap", height=HEIGHT)
POINTS = sphere_points(2000)
POINTS = POINTS[POINTS[:, 2] > HEIGHT]
SPACINGS = (0.2, 0.14, 0.1)


def u(x):
    return x[:, 0] * x[:, 1] + x[:, 2]


def flux(x):
    """The slope of u out of the cap, along the meridian."""
    outward = (HEIGHT * x - [0, 0, 1]) / RADIUS
    ambient = np.stack([x[:, 1], x[:, 0], np.ones(len(x))], axis=1)
    return np.sum((ambient - np.sum(ambient * x, axis=1, keepdims=True) * x) * outward, axis=1)


EQUATION = ck.ScreenedPoisson(lambda x: 7 * x[:, 0] * x[:, 1] + 3 * x[:, 2])


def error(edge, spacing, **options):
    solution = ck.solve(ck.Scene(CAP, EQUATION, edge=edge), spacing, **options)
    return np.sqrt(np.mean((solution.evaluate(POINTS) - u(POINTS)) ** 2))


@pytest.mark.parametrize("shift", [0.0, 0.4])
def test_value_flux_and_robin_on_parts_of_one_rim_are_of_third_order(shift):
    robin = ck.Robin(1.0, 1.0, lambda x: u(x) + flux(x))
    edge = [(u, "x < 0"), (robin, lambda x: x[:, 1] < 0), ck.Neumann(flux)]
    errors = [error(edge, h, origin=[shift * h, 0.0, shift * h / 2]) for h in SPACINGS]
    assert order_of(SPACINGS, errors) > 2.6
    assert errors[-1] < 3e-5


def test_finite_elements_take_the_same_parts():
    edge = [(ck.Dirichlet(u), "x < 0.1"), ck.Neumann(flux)]
    errors = [error(edge, h, backend="fem") for h in SPACINGS]
    assert order_of(SPACINGS, errors) > 1.7
    assert errors[-1] < error(ck.Neumann(flux), SPACINGS[-1], backend="fem")


def test_one_condition_in_two_parts_is_that_condition():
    scenes = [ck.Scene(CAP, EQUATION, edge=edge) for edge in (u, [(u, "x < 0.1"), ck.Dirichlet(u)])]
    whole, parts = (ck.solve(scene, 0.2, solver_tolerance=1e-12).evaluate(POINTS) for scene in scenes)
    np.testing.assert_allclose(parts, whole, atol=1e-10)


def test_ends_of_a_curve_and_loops_of_a_table_take_parts_too():
    """u = x on a segment and on a tube, whose rims are loops 0 and 1."""
    segment = ck.source("analytic.segment", start=[0.0, 0.1], end=[1.0, 0.1])
    edge = [(0.0, "x < 0.5"), ck.Neumann(1.0)]
    solution = ck.solve(ck.Scene(segment, ck.Laplace(), edge=edge), 0.1)
    np.testing.assert_allclose(solution.evaluate([[0.3, 0.1], [1.0, 0.1]]), [0.3, 1.0], atol=1e-9)
    tube = ck.source("analytic.cylinder", radius=0.5, length=1.0)
    table = {0: "z", 1: [(ck.Dirichlet("z"), "x < 0"), ck.Dirichlet("z")]}
    at = np.array([[0.5, 0.0, 0.2], [0.0, -0.5, -0.3]])
    found = ck.solve(ck.Scene(tube, ck.Laplace(), edge=table), 0.2, solver_tolerance=1e-12).evaluate(at)
    np.testing.assert_allclose(found, at[:, 2], atol=1e-5)


def test_a_scene_file_gives_parts(tmp_path):
    file = tmp_path / "cap.toml"
    file.write_text(
        """
        [surface]
        kind = "analytic.cap"
        height = 0.3
        edge = [{ dirichlet = "x*y + z", where = "x < 0.1" }, { neumann = 0.0 }]
        [problem]
        kind = "screened"
        f = "7*x*y + 3*z"
        [discretization]
        spacing = 0.2
        """
    )
    scene = ck.load_scene(file).scene
    same = ck.Scene(CAP, EQUATION, edge=[("x*y + z", "x < 0.1"), ck.Neumann(0.0)])
    got, want = (ck.solve(one, 0.2) for one in (scene, same))
    np.testing.assert_allclose(got.evaluate(POINTS), want.evaluate(POINTS), atol=1e-12)
    assert got.summary()["scene"]["edge"] == [["dirichlet of position", "x < 0.1"], ["neumann 0.0", None]]
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(got)).evaluate(POINTS), got.evaluate(POINTS))


def test_other_data_on_the_same_parts_need_no_new_tables():
    left = "x < 0"
    prepared = ck.prepare(ck.Scene(CAP, EQUATION, edge=[(0.0, left), ck.Neumann(0.0)]), 0.2)
    other = [(1.0, left), ck.Neumann(0.5)]
    again = prepared.solve(data={"edge": [(1.0, prepared.scene.edge.parts[0].where), ck.Neumann(0.5)]})
    fresh = ck.solve(ck.Scene(CAP, EQUATION, edge=other), 0.2)
    np.testing.assert_allclose(again.evaluate(POINTS), fresh.evaluate(POINTS), atol=1e-9)
    for wrong in (1.0, [(1.0, "x < 0.5"), ck.Neumann(0.5)], [(ck.Neumann(1.0), left), ck.Neumann(0.5)]):
        with pytest.raises(ck.SceneError, match="edge"):
            prepared.solve(data={"edge": wrong})


@pytest.mark.parametrize(
    ("edge", "messages"),
    [
        ([(u, "x < 0")], r"no part of `edge` holds at \d+ of \d+ points of the edge, such as .*; add a last condition"),
        ([(u, "x < -2"), 0.0], "part 0 of `edge`, dirichlet where x < -2, holds at no point of the edge"),
        ([ck.Neumann(0), (u, "x < 0")], "part 0 of `edge`, neumann, has no `where` and holds on the rest"),
        ([(u, "x <"), 0.0], "`where` of part 0 of the edge: the formula"),
        ([(u, 3), 0.0], "must be a formula such as 'x < 0', or a function of points, got 3"),
        ([(u, "t < 0"), 0.0], "depends on t, and parts of the edge stay where they are"),
        ([(ck.Transmission(), "x < 0"), 0.0], "`edge` must be Dirichlet, Neumann, Robin .*, got Transmission"),
    ],
)
def test_parts_that_are_none_are_refused(edge, messages):
    with pytest.raises(ck.SceneError, match=messages):
        ck.solve(ck.Scene(CAP, EQUATION, edge=edge), 0.2)


def test_the_other_form_and_closed_surfaces_refuse_parts():
    edge = [(u, "x < 0"), ck.Neumann(0.0)]
    with pytest.raises(ck.SceneError, match=r"takes one condition for each loop of the edge.*form='galerkin'"):
        ck.solve(ck.Scene(CAP, EQUATION, edge=edge), 0.2, form="collocation")
    with pytest.raises(ck.SceneError, match="closed and has no edge"):
        ck.solve(ck.Scene(ck.source("analytic.sphere"), EQUATION, edge=edge), 0.2)
