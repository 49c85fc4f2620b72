"""Each condition holds on the side it is given on, at edges and inside, with its order."""

import numpy as np
import pytest
from arc_problems import EDGES, arc_problem, theta, tilted_circle
from bare import Bare
from model_problems import max_error, on_circle, order_of, origins, sphere_points

import cpmkit as ck

SPACINGS = (0.1, 0.05, 0.025, 0.0125)
THETA_C = 1.022 * np.pi


@pytest.mark.parametrize("name", EDGES)
def test_ends_of_an_arc(name):
    edge, bound = EDGES[name]
    problem = arc_problem(edge)
    errors = [max_error(*problem, h) for h in SPACINGS]
    assert errors[-1] <= bound
    assert order_of(SPACINGS, errors) >= 1.8
    first = [max_error(*problem, h, order=1) for h in SPACINGS]
    assert 0.8 <= order_of(SPACINGS, first) <= 1.6


def circle_problem(left, right, extra=()):
    """-u'' + u = f on the circle cut at theta_C, u = sin 2 s + cos(s) / 2 + 0.7 s, s travelled since the cut."""

    def s(x):
        return np.mod(theta(x) - THETA_C, 2 * np.pi)

    scene = ck.Scene(
        ck.source("analytic.circle", center=(0, 0)),
        ck.ScreenedPoisson(lambda x: 5 * np.sin(2 * s(x)) + np.cos(s(x)) + 0.7 * s(x), c=1.0),
        [
            ck.Boundary(
                "cut", ck.source("analytic.point", at=on_circle(np.array([THETA_C]))[0]), left=left, right=right
            ),
            *extra,
        ],
    )
    t = np.linspace(1e-6, 2 * np.pi - 1e-6, 2000)
    return scene, on_circle(THETA_C + t), np.sin(2 * t) + np.cos(t) / 2 + 0.7 * t


# At s = 0 u = 0.5, at s = 2 pi u = 0.5 + 1.4 pi; u' = 2.7 at both. Outward is +s on the left, -s on the right.
AT_LEFT, AT_RIGHT, SLOPE = 0.5 + 1.4 * np.pi, 0.5, 2.7


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (ck.Neumann(SLOPE), ck.Neumann(-SLOPE)),
        (ck.Dirichlet(AT_LEFT), ck.Neumann(-SLOPE)),
        (ck.Neumann(SLOPE), ck.Dirichlet(AT_RIGHT)),
        (ck.Dirichlet(AT_LEFT), ck.Dirichlet(AT_RIGHT)),
        (ck.Robin(1, 3, SLOPE + 3 * AT_LEFT), ck.Robin(1, 3, -SLOPE + 3 * AT_RIGHT)),
        (ck.Robin(1, 3, SLOPE + 3 * AT_LEFT), ck.Dirichlet(AT_RIGHT)),
        (ck.Neumann(SLOPE), ck.Robin(0.5, 1.5, -0.5 * SLOPE + 1.5 * AT_RIGHT)),
    ],
    ids=["NN", "DN", "ND", "DD", "RR", "RD", "NR"],
)
def test_each_side_of_a_cut_keeps_its_own_condition(left, right):
    problem = circle_problem(left, right)
    errors = np.array([[max_error(*problem, h, origin=h * o) for o in origins(2)[:4]] for h in SPACINGS[:3]])
    rms = np.sqrt(np.mean(errors**2, axis=1))
    assert rms[-1] <= 5e-6
    assert order_of(SPACINGS[:3], rms) >= 2.7


def test_zero_neumann_is_the_default_edge_at_both_orders():
    t = np.linspace(0.3, 2.7, 1000)
    k = np.pi / 2.4
    exact = np.cos(k * (t - 0.3))
    scene = ck.Scene(
        ck.source("analytic.arc", center=(0, 0), radius=1.0, start=0.3, end=2.7),
        ck.ScreenedPoisson(lambda x: (1 + k * k) * np.cos(k * (theta(x) - 0.3)), c=1.0),
    )

    def rms(order):
        errors = [
            [max_error(scene, on_circle(t), exact, h, order=order, origin=h * o) for o in origins(2)[:6]]
            for h in SPACINGS[:3]
        ]
        return np.sqrt(np.mean(np.square(errors), axis=1))

    assert order_of(SPACINGS[:3], rms(2)) >= 1.8
    assert 0.8 <= order_of(SPACINGS[:3], rms(1)) <= 1.4


def two_sided_sphere(surface, circle, axis, height=0.2):
    """u = w on the left of a small circle, 3 - w / 2 on its right, w = axis . x, each harmonic of degree 1."""

    def w(x):
        return x @ axis

    def u(x):
        return np.where(w(x) > height, w(x), 3 - w(x) / 2)

    scene = ck.Scene(
        surface,
        ck.Poisson(lambda x: np.where(w(x) > height, 2 * w(x), -w(x))),
        [ck.Boundary("circle", circle, left=ck.Dirichlet(height), right=ck.Dirichlet(3 - height / 2), left_of=axis)],
    )
    points = sphere_points()
    return scene, points, u(points)


@pytest.mark.parametrize("bare_surface", [False, True], ids=["normals of the source", "normals by differences"])
@pytest.mark.parametrize("bare_circle", [False, True], ids=["tangents of the source", "tangents by differences"])
def test_a_jump_across_a_circle_on_the_sphere(bare_surface, bare_circle):
    circle, axis = tilted_circle()
    surface = ck.source("analytic.sphere")
    problem = two_sided_sphere(
        Bare(surface) if bare_surface else surface, Bare(circle) if bare_circle else circle, axis
    )
    errors = [max_error(*problem, h) for h in (0.4, 0.28, 0.2)]
    assert errors[-1] <= 6e-4
    assert order_of((0.4, 0.28, 0.2), errors) >= 1.7


def test_a_wall_keeps_two_pieces_apart():
    circle, axis = tilted_circle()
    scene = ck.Scene(
        ck.source("analytic.sphere"),
        ck.ScreenedPoisson(lambda x: np.where(x @ axis > 0.2, 1.0, 5.0), c=2.0),
        [ck.Boundary("wall", circle, both=ck.Neumann(0.0))],
    )
    points = sphere_points()
    points = points[np.abs(points @ axis - 0.2) > 1e-6]
    values = ck.solve(scene, 0.1).evaluate(points)
    np.testing.assert_allclose(values, np.where(points @ axis > 0.2, 0.5, 2.5), rtol=1e-8)


def test_two_cuts_three_spacings_apart_lose_nothing_and_nearer_ones_stay_local():
    h = 0.0125

    def errors(gap):
        second = THETA_C + gap * h
        cut = ck.source("analytic.point", at=on_circle(np.array([second]))[0])
        extra = [
            ck.Boundary(
                "second", cut, left=ck.Dirichlet(lambda x: u_mid(x)), right=ck.Dirichlet(lambda x: 5 + u_mid(x))
            )
        ]
        scene, points, exact = circle_problem(ck.Dirichlet(5 + AT_LEFT), ck.Dirichlet(AT_RIGHT), extra)
        s = np.mod(theta(points) - THETA_C, 2 * np.pi)
        inside = s < gap * h
        lifted = ck.Scene(
            scene.surface,
            ck.ScreenedPoisson(
                lambda x: scene.problem.f(x) + 5 * (np.mod(theta(x) - THETA_C, 2 * np.pi) > gap * h), c=1.0
            ),
            scene.boundaries,
        )
        difference = np.abs(ck.solve(lifted, h).evaluate(points) - exact - 5 * ~inside)
        return difference[inside].max(), difference[~inside].max()

    def u_mid(x):
        s = np.mod(theta(x) - THETA_C, 2 * np.pi)
        return np.sin(2 * s) + np.cos(s) / 2 + 0.7 * s

    short, rest = errors(3.0)
    assert short <= 2e-4
    assert rest <= 2e-4
    short, rest = errors(1.5)
    assert short <= 0.1  # order 1 there
    assert rest <= 2e-4


CAP_EDGES = {
    # outward at the rim z = 0.35 of the cap: b = -(e_z - z x) / sqrt(1 - z^2)
    "Dirichlet": (lambda value, flux: ck.Dirichlet(value), 5e-4),
    "Neumann": (lambda value, flux: ck.Neumann(flux), 5e-4),
    "Robin": (lambda value, flux: ck.Robin(1.0, 2.0, lambda x: flux(x) + 2 * value(x)), 5e-4),
}


@pytest.mark.parametrize("name", CAP_EDGES)
def test_the_rim_of_a_cap(name):
    """-Lap u + u = f with u = x z + y on the part z >= 0.35 of the unit sphere; a node at its centre.

    The error depends on where the nodes lie, most at 0.2 (Neumann 0.003 to 0.008).
    """
    make, bound = CAP_EDGES[name]

    def u(x):
        return x[:, 0] * x[:, 2] + x[:, 1]

    def flux(x):
        z = x[:, 2]
        across = (np.array([0, 0, -1.0]) + z[:, None] * x) / np.sqrt(np.maximum(1 - z * z, 1e-12))[:, None]
        return across[:, 0] * z + across[:, 2] * x[:, 0] + across[:, 1]

    scene = ck.Scene(
        ck.source("analytic.cap", height=0.35),
        ck.ScreenedPoisson(lambda x: 7 * x[:, 0] * x[:, 2] + 3 * x[:, 1], c=1.0),
        edge=make(u, flux),
    )
    points = sphere_points(9000)
    points = points[points[:, 2] >= 0.35]
    spacings = (0.3, 0.2, 0.14)
    errors = [max_error(scene, points, u(points), h, origin=[0, 0, 0]) for h in spacings]
    assert errors[-1] <= bound
    assert order_of(spacings, errors) >= 1.8


def test_a_robin_condition_that_feeds_needs_a_fine_grid():
    problem = arc_problem(ck.Robin(1.0, -9.0, 0.0))
    with pytest.raises(ck.ResolutionError, match=r"too coarse for the Robin condition alpha=1, beta=-9.* try 0\.\d+"):
        ck.solve(problem[0], 0.1, form="collocation")
    fine = ck.solve(problem[0], 0.01, form="collocation").evaluate(problem[1])
    np.testing.assert_allclose(ck.solve(problem[0], 0.1, form="galerkin").evaluate(problem[1]), fine, atol=3e-4)


@pytest.mark.parametrize(("alpha", "beta", "other"), [(0.0, 1.0, "Dirichlet"), (1.0, 0.0, "Neumann")])
def test_a_robin_condition_of_another_kind_is_refused(alpha, beta, other):
    with pytest.raises(ck.InputError, match=f"other than zero, got 0.0; use {other}"):
        ck.Robin(alpha, beta)


def test_robin_in_a_scene_file(tmp_path):
    file = tmp_path / "scene.toml"
    table = '[surface]\nkind = "analytic.arc"\nstart = 0\nend = 2\nedge = { robin = %s }\n[problem]\nkind = "laplace"'
    file.write_text(table % '[1.0, 2.0, "x"]')
    edge = ck.load_scene(file).scene.edge
    assert (edge.alpha, edge.beta) == (1.0, 2.0)
    assert edge.gamma(np.array([[0.5, 0.0]])) == 0.5
    file.write_text(table % "2.0")
    with pytest.raises(ck.SceneError, match=r"robin of edge must be \[alpha, beta, gamma\], got 2.0"):
        ck.load_scene(file)


@pytest.mark.slow
def test_each_rim_of_a_tube_has_its_own_condition():
    """u = exp(z) sin(theta) on a cylinder: a value on one rim, a flux through the other, and the other way round."""

    def u(x):
        return np.exp(x[:, 2]) * x[:, 1]

    tube = ck.source("analytic.cylinder", radius=1.0, length=1.6)
    points = tube.closest_point(2 * sphere_points()).points
    top = {k: tube.closest_point(np.array([[2.0, 0.0, z]])).edge[0] for k, z in (("low", -3.0), ("high", 3.0))}
    flux = {"low": ck.Neumann(lambda x: -u(x)), "high": ck.Neumann(u)}
    for given, free in (("low", "high"), ("high", "low")):
        edge = {int(top[given]): ck.Dirichlet(u), int(top[free]): flux[free]}
        scene = ck.Scene(tube, ck.ScreenedPoisson(u, c=1.0), edge=edge)
        spacings = (0.2, 0.1, 0.067)
        errors = [max_error(scene, points, u(points), h) for h in spacings]
        assert order_of(spacings, errors) >= 1.8
        first = [max_error(scene, points, u(points), h, order=1) for h in spacings]
        assert 0.7 <= order_of(spacings, first) <= 1.6


def test_a_channel_each_for_different_kinds_of_data():
    """Three right-hand sides in one solve are those of three solves."""
    circle, axis = tilted_circle()
    data = [2.0, lambda x: x[:, 0], lambda x: np.exp(x[:, 1])]

    def solved(left, right, f):
        boundary = ck.Boundary("circle", circle, left=left, right=right, left_of=axis)
        return ck.solve(ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(f), [boundary]), 0.3).values

    together = solved(ck.Dirichlet(data), ck.Robin(1.0, 2.0, data), data)
    for channel, one in enumerate(data):
        alone = solved(ck.Dirichlet(one), ck.Robin(1.0, 2.0, one), one)
        np.testing.assert_allclose(together[:, channel : channel + 1], alone, atol=1e-7)


def test_a_robin_factor_that_varies_along_the_boundary():
    circle, axis = tilted_circle()

    def u(x):
        return x @ axis

    def beta(x):
        return 2 + x[:, 0]

    steep = np.sqrt(1 - 0.2**2)
    boundary = ck.Boundary(
        "circle",
        circle,
        left=ck.Robin(1.0, beta, lambda x: -steep + beta(x) * u(x)),
        right=ck.Robin(2.0, beta, lambda x: 2 * steep + beta(x) * u(x)),
        left_of=axis,
    )
    scene = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(lambda x: 3 * u(x), c=1.0), [boundary])
    spacings = (0.4, 0.28, 0.2)
    errors = [max_error(scene, sphere_points(), u(sphere_points()), h) for h in spacings]
    assert order_of(spacings, errors) >= 1.8


def test_a_moebius_strip_takes_equal_data_and_refuses_different_ones():
    """Along the core of the strip there is no left; a wall there is fine, a jump is not."""
    strip = ck.source("parametric.moebius")
    t = np.linspace(0, 2 * np.pi, 401)
    core = ck.source("mesh.polyline", points=strip.closest_point(np.stack([np.cos(t), np.sin(t), 0 * t], 1)).points)
    equal = ck.Boundary("core", core, both=ck.Dirichlet(2.0))
    for form in ("collocation", "galerkin"):
        solution = ck.solve(ck.Scene(strip, ck.ScreenedPoisson(2.0, c=1.0), [equal]), 0.2, form=form)
        np.testing.assert_allclose(solution.evaluate(strip.mesh(0.2)[0]), 2.0, atol=1e-8)
    different = ck.Boundary("core", core, left=ck.Dirichlet(2.0), right=ck.Dirichlet(3.0))
    with pytest.raises(ck.SceneError, match="no left"):
        ck.solve(ck.Scene(strip, ck.ScreenedPoisson(2.0, c=1.0), [different]), 0.2)


@pytest.mark.slow
def test_right_hand_sides_that_jump_at_a_boundary_on_which_nodes_lie():
    """A circle in a plane of nodes: they count as left, and read what holds there."""
    axis = np.array([0.0, 0.0, 1.0])
    circle = ck.source("analytic.circle", normal=axis)
    spacings = (0.2, 0.1, 0.067)
    problem = two_sided_sphere(ck.source("analytic.sphere"), circle, axis, height=0.0)
    upside_down = two_sided_sphere(
        ck.source("analytic.sphere"), ck.source("analytic.circle", normal=-axis), -axis, height=0.0
    )
    for scene, points, exact in (problem, upside_down):
        points, exact = points[np.abs(points[:, 2]) > 1e-6], exact[np.abs(points[:, 2]) > 1e-6]
        errors = [max_error(scene, points, exact, h, origin=[0, 0, 0]) for h in spacings]
        assert errors[-1] <= 2e-3
        assert order_of(spacings, errors) >= 1.8
