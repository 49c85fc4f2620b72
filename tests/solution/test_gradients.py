"""Surface gradients and fluxes are of second order, up to boundaries and edges and on both of their sides."""

import numpy as np
import pytest
from bare import Bare
from model_problems import THETA_C, circle_jump, on_circle, order_of, origins, rotation, sphere_points

import cpmkit as ck
from cpmkit.grid.band import tensor_weights

NORMAL, HEIGHT = rotation()[2], 0.3
RADIUS = np.sqrt(1 - HEIGHT**2)
LENGTH = 2 * np.pi * RADIUS
SPACINGS = [0.2, 0.14, 0.1]
POINTS, UP_TO_A_RIM = sphere_points(1500), [0.2, 0.1, 0.05]


def u(x):
    return x[:, 0] * x[:, 1] + x[:, 2]


def gradient_of_u(x):
    ambient = np.stack([x[:, 1], x[:, 0], np.ones(len(x))], axis=1)
    return ambient - np.sum(ambient * x, axis=1, keepdims=True) * x


def two_sided(wrap=lambda source: source, **sides):
    """u = w^2 above the plane w = n . x = HEIGHT, which is left, and 3 + w below."""
    circle = wrap(ck.source("analytic.circle", center=HEIGHT * NORMAL, radius=RADIUS, normal=NORMAL))
    f = ck.ScreenedPoisson(lambda x: np.where((w := x @ NORMAL) > HEIGHT, 7 * w**2 - 2, 3 * w + 3))
    return ck.Scene(ck.source("analytic.sphere"), f, [ck.Boundary("circle", circle, **sides)])


SIDES = {
    "dirichlet": {"left": ck.Dirichlet(HEIGHT**2), "right": ck.Dirichlet(3 + HEIGHT)},
    "neumann": {"left": ck.Neumann(-2 * HEIGHT * RADIUS), "right": ck.Neumann(RADIUS)},
    "mixed": {"left": ck.Robin(1.0, 2.0, -2 * HEIGHT * RADIUS + 2 * HEIGHT**2), "right": ck.Dirichlet(3 + HEIGHT)},
}


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
@pytest.mark.parametrize("dim", [2, 3])
def test_slopes_are_the_derivatives_of_the_weights(dim, degree):
    fractions, step = np.random.default_rng(0).uniform(size=(20, dim)), 1e-6
    slopes = np.stack([tensor_weights(fractions, degree, axis) for axis in range(dim)], axis=1)
    for axis, shift in enumerate(step * np.eye(dim)):
        difference = tensor_weights(fractions + shift, degree) - tensor_weights(fractions - shift, degree)
        np.testing.assert_allclose(slopes[:, axis], difference / (2 * step), atol=1e-7)
    np.testing.assert_allclose(slopes.sum(axis=2), 0.0, atol=1e-13)


def test_the_gradient_on_a_closed_surface_is_tangential_and_of_second_order():
    scene = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(lambda x: 7 * x[:, 0] * x[:, 1] + 3 * x[:, 2]))
    read = [ck.solve(scene, h).gradient(1.02 * POINTS) for h in SPACINGS]
    errors = [np.abs(one - gradient_of_u(POINTS)).max() for one in read]
    assert order_of(SPACINGS, errors) >= 1.9
    assert errors[-1] < 4e-4
    assert np.abs(np.sum(read[0] * POINTS, axis=1)).max() < 1e-12


@pytest.mark.parametrize("form", ["collocation", "galerkin"])
@pytest.mark.parametrize("edge", ["dirichlet", "neumann"])
def test_the_gradient_is_of_second_order_up_to_a_rim(edge, form):
    rim = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    rim = np.stack([RADIUS * np.cos(rim), RADIUS * np.sin(rim), np.full(200, HEIGHT)], axis=1)
    conormal = (HEIGHT * rim - [0, 0, 1]) / RADIUS
    conditions = {
        "dirichlet": ck.Dirichlet(u),
        "neumann": ck.Neumann(lambda x: np.sum(gradient_of_u(x) * (HEIGHT * x - [0, 0, 1]) / RADIUS, axis=1)),
    }
    f = ck.ScreenedPoisson(lambda x: 7 * x[:, 0] * x[:, 1] + 3 * x[:, 2])
    scene = ck.Scene(ck.source("analytic.cap", height=HEIGHT), f, edge=conditions[edge])
    points = np.concatenate([POINTS[POINTS[:, 2] > HEIGHT], rim])
    solutions = [ck.solve(scene, h, form=form) for h in UP_TO_A_RIM]
    errors = [np.abs(one.gradient(points) - gradient_of_u(points)) for one in solutions]
    if form == "collocation":
        assert order_of(UP_TO_A_RIM, [one.max() for one in errors]) >= 1.8
        assert errors[-1].max() < 1.5e-2
    else:  # the greatest error falls more slowly from 0.1 to 0.05, at a fiftieth of the other form's
        assert order_of(UP_TO_A_RIM, [np.sqrt(np.mean(one**2)) for one in errors]) >= 1.9
        assert errors[-1].max() < 5e-4
    exact = np.mean(np.sum(gradient_of_u(rim) * conormal, axis=1)) * LENGTH
    fluxes = [abs(one.flux("edge") - exact) / LENGTH for one in solutions]
    assert order_of(UP_TO_A_RIM, fluxes) >= (1.8 if edge == "dirichlet" else 1.5)  # 2e-3 already at spacing 0.2
    assert fluxes[-1] < 1e-2
    assert solutions[0].flux(0) == solutions[0].flux("edge")


@pytest.mark.parametrize(
    ("sides", "form"),
    [
        ("mixed", "collocation"),
        ("mixed", "galerkin"),
        ("neumann", "collocation"),
        ("dirichlet", "galerkin"),
        pytest.param("dirichlet", "collocation", marks=pytest.mark.slow),
        pytest.param("neumann", "galerkin", marks=pytest.mark.slow),
    ],
)
def test_gradients_and_fluxes_beside_a_boundary_belong_to_their_sides(sides, form):
    """Fluxes of splines are within 1e-3 from the coarsest spacing on, and then depend on where the lattice lies."""
    scene, on = (
        two_sided(**SIDES[sides]),
        ck.source("analytic.circle", center=HEIGHT * NORMAL, radius=RADIUS, normal=NORMAL),
    )
    up = NORMAL - (POINTS @ NORMAL)[:, None] * POINTS
    exact = np.where((POINTS @ NORMAL > HEIGHT)[:, None], 2 * (POINTS @ NORMAL)[:, None], 1.0) * up
    errors, left, right, density = [], [], [], []
    # at 0.2 there is no room beside the boundary, so that it is read plainly
    spacings = [0.15, 0.12, 0.1] if form == "galerkin" else [0.15, 0.1, 0.07 if sides == "neumann" else 0.05]
    for h in spacings:
        solution = ck.solve(scene, h, form=form)
        errors.append(np.abs(solution.gradient(POINTS) - exact).max())
        left.append(abs(solution.flux("circle", "left") + 2 * HEIGHT * RADIUS * LENGTH) / LENGTH)
        right.append(abs(solution.flux("circle", "right") - RADIUS * LENGTH) / LENGTH)
        read = solution.flux_density("circle", "right", on.mesh(0.1)[0])
        density.append(np.abs(read - RADIUS).max())
    if form == "galerkin":
        assert order_of(spacings, errors) >= 1.8
        assert max(errors[-1], left[-1], right[-1]) < 1e-3
        assert max(*left, *right) < 1e-3
        assert density[0] < 3e-3
        assert density[-1] < 1.5e-3
        return
    for values in (errors, left, right, density):
        assert order_of(spacings, values) >= 1.8
        assert values[-1] < 2.5e-2


@pytest.mark.parametrize(
    ("form", "order", "bounds"), [("collocation", 1.9, (0.1, 5e-4)), ("galerkin", 0, (3e-4, 1e-4))]
)
def test_the_flux_out_of_a_side_of_a_point_on_a_curve(form, order, bounds):
    """10 / pi; that of splines is right to 3e-5 of it from the coarsest spacing on, and falls unevenly from there."""
    spacings = [0.05, 0.025, 0.0125]
    scene, tangent = circle_jump()[0], np.array([-np.sin(THETA_C), np.cos(THETA_C)])
    flux, slope = [], []
    for h in spacings:
        solutions = [ck.solve(scene, h, origin=shift * h, form=form) for shift in origins(2)[:4]]
        flux.append(np.sqrt(np.mean([(one.flux("cut", "left") - 10 / np.pi) ** 2 for one in solutions])))
        here = on_circle(np.array([THETA_C]))
        slope.append(
            np.sqrt(np.mean([(one.gradient(here, side="right")[0] @ tangent - 10 / np.pi) ** 2 for one in solutions]))
        )
    assert order_of(spacings, flux) >= order
    assert order_of(spacings, slope) >= order
    assert max(flux[0], slope[0]) < bounds[0]
    assert max(flux[-1], slope[-1]) < bounds[1]


def test_what_flows_out_of_the_rim_is_the_integral_of_the_laplacian():
    disc, f, spacings = (
        ck.source("solid", of=ck.source("analytic.circle")),
        lambda x: 1 + x[:, 0] ** 2,
        [0.1, 0.05, 0.025],
    )
    scene = ck.Scene(disc, ck.Poisson(f), edge=ck.Dirichlet(0.0))
    gaps = []
    for h in spacings:
        solution = ck.solve(scene, h)
        gaps.append(abs(solution.flux("edge") + solution.integrate(lambda x, _: f(x))))
    assert order_of(spacings, gaps) >= 1.8
    assert gaps[-1] < 0.01 * np.pi


def test_what_flows_out_of_both_sides_of_a_curve_is_the_integral_over_both_pieces():
    f = ck.Poisson(lambda x: 1 + x[:, 2] + x[:, 0] * x[:, 1])
    circle = ck.source("analytic.circle", center=HEIGHT * NORMAL, radius=RADIUS, normal=NORMAL)
    scene = ck.Scene(ck.source("analytic.sphere"), f, [ck.Boundary("circle", circle, both=ck.Dirichlet(0.0))])
    solution = ck.solve(scene, 0.1)
    out = solution.flux("circle", "left") + solution.flux("circle", "right")
    assert out == pytest.approx(-4 * np.pi, rel=4e-3)


def test_a_boundary_without_a_mesh_has_the_same_flux():
    sides = SIDES["dirichlet"]
    bare = ck.solve(two_sided(Bare, **sides, left_of=NORMAL), 0.15)
    assert bare.flux("circle", "right") == pytest.approx(RADIUS * LENGTH, rel=0.03)
    assert bare.flux("circle", "right") == pytest.approx(
        ck.solve(two_sided(**sides), 0.15).flux("circle", "right"), rel=1e-3
    )


def test_channels_have_gradients_and_fluxes_each():
    sides = {"left": ck.Dirichlet([6.0, 12.0]), "right": ck.Dirichlet([0.0, 0.0])}
    scene = ck.Scene(
        ck.source("analytic.circle"),
        ck.Laplace(),
        [ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), **sides)],
    )
    solution = ck.solve(scene, 0.05)
    slope = 6 / (2 * np.pi)
    assert solution.gradient([[0, 1.0], [0, -1.0]]).shape == (2, 2, 2)
    np.testing.assert_allclose(solution.gradient([[0, 1.0]])[0], [[-slope, 0], [-2 * slope, 0]], atol=2e-3)
    np.testing.assert_allclose(solution.flux("cut", "left"), [slope, 2 * slope], rtol=5e-3)
    assert solution.flux_density("cut", "right", [[1.0, 0.0]]).shape == (1, 2)
    assert solution.gradient(np.zeros((0, 2))).shape == (0, 2, 2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("circle",), "side of 'circle' must be 'left' or 'right': a flux leaves one side"),
        (("nose", "left"), "no boundary has the name 'nose'"),
        (("nose",), "no boundary has the name 'nose'; the scene has 'circle'"),
        (("edge",), "has no edge with a flux; it is closed"),
        (("edge", "left"), "the edge has one side only"),
        (("circle", "up"), "must be 'left' or 'right'"),
    ],
)
def test_fluxes_that_are_none(arguments, message):
    solution = ck.solve(two_sided(**SIDES["dirichlet"]), 0.25)
    with pytest.raises(ck.InputError, match=message):
        solution.flux(*arguments)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nose", "no boundary has the name 'nose'; the scene has 'circle'"),
        ("edge", r"with two sides, got 'edge'; solution\.flux\('edge'\) is the flux through the edge"),
        ("circle", "side of 'circle' must be 'left' or 'right'"),
    ],
)
def test_flux_densities_that_are_none(name, message):
    solution = ck.solve(two_sided(**SIDES["dirichlet"]), 0.25)
    with pytest.raises(ck.InputError, match=message):
        solution.flux_density(name, None, [[1.0, 0.0]])


def test_a_point_on_a_surface_has_no_flux():
    pin = ck.Boundary("pin", ck.source("analytic.point", at=[0, 0, 1.0]), both=ck.Dirichlet(1.0))
    solution = ck.solve(ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(0.0), [pin]), 0.2)
    with pytest.raises(ck.InputError, match="side of 'pin' must be 'left' or 'right' of a boundary that has sides"):
        solution.flux("pin", "left")


@pytest.mark.parametrize(("form", "share"), [("galerkin", 0.02), ("collocation", 0.35)])
def test_the_flux_through_a_part_is_that_of_the_points_where_a_formula_holds(form, share):
    """u = x on a cap: du/db = 0.3 cos(t) along the rim of radius sqrt(0.91)."""
    rim = ck.Dirichlet("x")
    cap = ck.Scene(ck.source("analytic.cap", height=0.3), ck.ScreenedPoisson("3*x"), edge=rim)
    solution = ck.solve(cap, 0.2, form=form)
    half = solution.flux("edge", where="x > 0")
    assert half == pytest.approx(0.6 * np.sqrt(0.91), rel=share)
    assert half + solution.flux(0, where=lambda x: x[:, 0] <= 0) == pytest.approx(solution.flux("edge"), abs=1e-12)
    with pytest.raises(ck.InputError, match=r"`where` holds at no point of 'edge', got 'x > 5'"):
        solution.flux("edge", where="x > 5")
    with pytest.raises(ck.InputError, match="`where` must be a formula"):
        solution.flux("edge", where=3)


def test_parts_of_the_skin_of_a_box_have_fluxes_and_other_numbers_are_named():
    """u = x / 2."""
    box = ck.source("analytic.box", lower=[0, 0, 0], upper=[2, 1, 1])
    faces = [(ck.Dirichlet(0.0), "x < 1e-9"), (ck.Dirichlet(1.0), "x > 2 - 1e-9"), ck.Neumann(0.0)]
    solution = ck.solve(ck.Scene(box, ck.Laplace(), edge=faces), 0.25)
    through = [solution.flux(0), solution.flux("edge", where="x < 1e-9"), solution.flux("edge", where="x > 2 - 1e-9")]
    assert through == pytest.approx([-0.5, -0.5, 0.5], abs=1e-6)
    with pytest.raises(ck.InputError, match="no loop 6; its loops are 0, 1, 2, 3, 4, 5"):
        solution.flux(6)


def test_the_flux_through_a_part_of_a_boundary():
    solution = ck.solve(two_sided(**SIDES["dirichlet"]), 0.25)
    parts = [solution.flux("circle", "left", where) for where in ("x > 0.1", "x <= 0.1")]
    assert sum(parts) == pytest.approx(solution.flux("circle", "left"), rel=1e-9)


def test_an_edge_with_a_steklov_condition_says_what_its_flux_is():
    ball = ck.source("solid", of=ck.source("analytic.sphere"))
    modes = ck.solve(ck.Scene(ball, ck.Eigen(count=2), edge=ck.Steklov()), 0.5)
    with pytest.raises(ck.InputError, match=r"with ck\.Steklov\(\) is not computed: it is the eigenvalue times"):
        modes.flux("edge")
    forms = ck.solve(ck.Scene(ball, ck.Poisson(1.0), edge=ck.Dirichlet(0.0)), 0.5, form="collocation")
    with pytest.raises(ck.InputError, match="the form 'collocation' computes no flux"):
        forms.flux("edge")
