"""Diffusivities that are tensors: the laws that numbers keep too, orders beside every condition, and refusals."""

import numpy as np
import pytest
from curved_problems import TORUS_RADII, Manufactured, by_tensor, tensor_on_sphere, to_sphere, to_torus
from model_problems import on_circle, order_of, sphere_points

import cpmkit as ck
from cpmkit.errors import InputError, SceneError

SPHERE, CIRCLE = ck.source("analytic.sphere"), ck.source("analytic.circle", center=(0, 0))
HEIGHT = 0.3
RADIUS = np.sqrt(1 - HEIGHT**2)
RING = ck.source("analytic.circle", center=[0, 0, HEIGHT], normal=[0, 0, 1], radius=RADIUS)
MATRIX = np.array([[2.0, 0.4, 0.1], [0.4, 1.0, -0.3], [0.1, -0.3, 3.0]])
POINTS = sphere_points(500)


def solved(problem, spacing, boundaries=(), surface=SPHERE, edge=None, **options):
    scene = ck.Scene(surface, problem, list(boundaries), **({} if edge is None else {"edge": edge}))
    return ck.solve(scene, spacing, form="galerkin", **options)


def f(x):
    return x[:, 0] * x[:, 1] + x[:, 2]


def by_size(x):
    return 1.5 + x[:, 2]


@pytest.mark.parametrize("tensor", [2.5 * np.eye(3), lambda x: by_size(x)[:, None, None] * np.eye(3)])
def test_the_identity_times_a_number_is_that_number(tensor):
    number = by_size if callable(tensor) else 2.5
    low = ck.source("analytic.circle", center=[0, 0, -HEIGHT], normal=[0, 0, 1], radius=RADIUS)
    curves = [
        ck.Boundary("ring", RING, left=ck.Robin(1.0, 2.0, 1.0), right=ck.Dirichlet(0.5)),
        ck.Boundary("low", low, across=ck.Transmission(jump=0.3, flux=0.2, resistance=0.1)),
    ]
    two = [solved(ck.Elliptic(f, diffusivity=a, c=1.0), 0.4, curves) for a in (number, tensor)]
    values = [one.evaluate(POINTS) for one in two]
    assert np.abs(values[0] - values[1]).max() < 1e-11 * np.ptp(values[0])
    assert two[0].flux("ring", "left") == pytest.approx(two[1].flux("ring", "left"), rel=1e-9)


def test_a_list_of_rows_is_an_array_and_a_function():
    rows = [[lambda x, e=entry: np.full(len(x), e) for entry in row] for row in MATRIX]
    givens = [MATRIX, MATRIX.tolist(), rows, lambda x: np.tile(MATRIX, (len(x), 1, 1))]
    found = [solved(ck.Elliptic(f, diffusivity=one, c=1.0), 0.4).evaluate(POINTS) for one in givens]
    assert all(np.abs(one - found[0]).max() < 1e-12 for one in found[1:])


def test_a_scene_with_its_axes_exchanged():
    turn = np.eye(3)[[1, 2, 0]]
    ring = ck.source("analytic.circle", center=turn @ [0, 0, HEIGHT], normal=turn @ [0, 0, 1], radius=RADIUS)
    values = [
        solved(
            ck.Elliptic(lambda x, T=T: f(x @ T), diffusivity=T @ MATRIX @ T.T, c=1.0),
            0.3,
            [ck.Boundary("ring", curve, left=ck.Neumann(1.0), right=ck.Dirichlet(0.0))],
        ).evaluate(POINTS @ T.T)
        for T, curve in ((np.eye(3), RING), (turn, ring))
    ]
    assert np.abs(values[0] - values[1]).max() < 1e-3 * np.ptp(values[0])


def conormal(x):
    """Out of the left of the ring, which is above it: the slope towards smaller heights."""
    x = to_sphere(x)
    down = np.array([0, 0, -1.0]) + x[:, 2:] * x
    return to_sphere(down)


def slanted(flux, sign):
    """What Neumann takes: the flux over b . A b."""

    def datum(x):
        b = sign * conormal(x)
        return np.sum(flux(to_sphere(x)) * b, axis=1) / np.einsum("ni,ij,nj->n", b, MATRIX, b)

    return datum


def ring_problem(kind):
    u, right, flux = tensor_on_sphere(MATRIX, np.array([0.3, 1.0, -0.5]))
    laws = {
        "dirichlet": lambda _: ck.Dirichlet(u),
        "neumann": lambda sign: ck.Neumann(slanted(flux, sign)),
        "robin": lambda sign: ck.Robin(1.0, 2.0, lambda x: slanted(flux, sign)(x) + 2 * u(x)),
    }
    sides = {"left": laws[kind](1), "right": laws[kind](-1)} if kind in laws else {"across": ck.Transmission()}
    problem = ck.Elliptic(lambda x: right(x) + u(x), diffusivity=MATRIX, c=1.0)
    return problem, [ck.Boundary("ring", RING, **sides)], u, flux


@pytest.mark.parametrize("kind", ["dirichlet", "neumann", "transmission"])
def test_the_order_beside_conditions(kind):
    spacings, errors = (0.5, 0.36, 0.25), []
    problem, boundaries, u, _ = ring_problem(kind)
    for spacing in spacings:
        off = solved(problem, spacing, boundaries).evaluate(POINTS) - u(POINTS)
        errors.append(np.sqrt(np.mean(off**2)) / np.ptp(u(POINTS)))
    assert order_of(spacings, errors) > 2
    assert errors[-1] < 6e-4


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["dirichlet", "neumann", "robin", "transmission"])
def test_the_order_at_finer_spacings(kind):
    spacings, errors = (0.2, 0.1, 0.05), []
    problem, boundaries, u, _ = ring_problem(kind)
    for spacing in spacings:
        off = solved(problem, spacing, boundaries).evaluate(POINTS) - u(POINTS)
        errors.append(np.sqrt(np.mean(off**2)) / np.ptp(u(POINTS)))
    assert order_of(spacings, errors) > 2.3


@pytest.mark.slow
def test_the_order_on_a_torus_with_a_tensor_that_varies():
    def tensor(x):
        a, b, o = 2 + x[:, 0], 1 + x[:, 1] ** 2, 0.3 + 0 * x[:, 0]
        return np.stack(
            [np.stack(row, axis=1) for row in ((a, o, 0 * o), (o, b, o * x[:, 2]), (0 * o, o * x[:, 2], a))], 1
        )

    case = Manufactured(to_torus, lambda x: x[:, 0] * x[:, 1] + x[:, 2], by_tensor(to_torus, tensor))
    points = to_torus(np.random.default_rng(0).normal(size=(500, 3)))
    torus, errors, spacings = (
        ck.source("analytic.torus", major=TORUS_RADII[0], minor=TORUS_RADII[1]),
        [],
        (0.2, 0.14, 0.1),
    )
    problem = ck.Elliptic(lambda x: case.f(x) + case.u(x), diffusivity=tensor, c=1.0)
    for spacing in spacings:
        errors.append(np.abs(solved(problem, spacing, surface=torus).evaluate(points) - case.u(points)).max())
    assert order_of(spacings, errors) > 2


def test_a_rim_with_the_slanted_derivative():
    """A cap of the sphere with Neumann data on its rim: the flux that is read is the one that was given."""
    spacings, errors = (0.4, 0.28, 0.2), []
    u, right, flux = tensor_on_sphere(MATRIX, np.array([0.3, 1.0, -0.5]))
    cap = ck.source("analytic.cap")
    points = POINTS[POINTS[:, 2] > 0.02]
    problem = ck.Elliptic(lambda x: right(x) + u(x), diffusivity=MATRIX, c=1.0)
    for spacing in spacings:
        solution = solved(problem, spacing, surface=cap, edge=ck.Neumann(slanted(flux, 1)))
        errors.append(np.sqrt(np.mean((solution.evaluate(points) - u(points)) ** 2)))
    assert order_of(spacings, errors) > 2
    angle = 2 * np.pi * np.arange(400) / 400
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    assert solution.flux("edge") == pytest.approx(2 * np.pi * slanted(flux, 1)(rim).mean(), abs=1e-5)
    assert solved(problem, 0.3, surface=cap).flux("edge") == 0.0


def test_the_flux_density_is_of_the_slanted_derivative():
    problem, boundaries, _, flux = ring_problem("dirichlet")
    angle = 2 * np.pi * np.arange(60) / 60
    on = np.stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), HEIGHT + 0 * angle], axis=1)
    solution, exact = solved(problem, 0.3, boundaries), slanted(flux, 1)(on)
    assert np.abs(solution.flux_density("ring", "left", on[::4]) - exact[::4]).max() < 0.02 * np.ptp(exact)
    assert solution.flux("ring", "left") == pytest.approx(2 * np.pi * RADIUS * exact.mean(), abs=2e-3)


def along(x):
    """On the circle, 4 along and 7 across, of which nothing is seen."""
    t = np.stack([-x[:, 1], x[:, 0]], axis=1) / np.linalg.norm(x, axis=1)[:, None]
    return 7 * np.eye(2) - 3 * t[:, :, None] * t[:, None, :]


def test_eigenvalues_and_heat_on_a_circle():
    eigen = solved(ck.Eigen(5, diffusivity=along), 0.1, surface=CIRCLE)
    assert np.allclose(eigen.eigenvalues, [0, 4, 4, 16, 16], atol=2e-3)
    theta = np.linspace(0, 2 * np.pi, 50)
    heat = solved(ck.Heat(lambda x: x[:, 0] + 1, until=0.25, step=0.005, kappa=along), 0.1, surface=CIRCLE)
    assert np.abs(heat.evaluate(on_circle(theta)) - 1 - np.exp(-1) * np.cos(theta)).max() < 1e-4


def test_iterations_do_not_grow_with_the_ratio_to_a_hundred():
    e = np.array([1, 0.7, 0.3]) / np.linalg.norm([1, 0.7, 0.3])
    for ratio, most in ((100, 28), (1000, 60)):
        tensor = np.eye(3) + (ratio - 1) * np.outer(e, e)
        solution = solved(ck.Elliptic(lambda x: x[:, 0] * x[:, 1], diffusivity=tensor), 0.2, solver="multigrid")
        assert solution.report.iterations <= most


def test_another_tensor_on_the_same_tables():
    prepared = ck.prepare(ck.Scene(SPHERE, ck.Elliptic(f, c=1.0)), 0.4)
    for tensor in (MATRIX, 2 * MATRIX):
        problem = ck.Elliptic(f, diffusivity=tensor, c=1.0)
        assert np.array_equal(prepared.solve(problem=problem).values, solved(problem, 0.4).values)


def test_what_is_refused():
    flat = np.diag([1.0, 1.0, 0.0])
    with pytest.raises(InputError, match=r"positive definite .* near \(.*\) whose smallest eigenvalue there is"):
        solved(ck.Elliptic(f, diffusivity=flat - 1e-3 * np.eye(3), c=1.0), 0.4)
    with pytest.raises(InputError, match="symmetric tensor"):
        ck.Elliptic(f, diffusivity=[[1, 2, 0], [0, 1, 0], [0, 0, 1]])
    with pytest.raises(InputError, match="3 by 3"):
        ck.Elliptic(f, diffusivity=[[1, 2], [0, 1], [0, 0]])
    with pytest.raises(SceneError, match=r"\(2, 2\) where the manifold lies in 3D"):
        ck.Scene(SPHERE, ck.Elliptic(f, diffusivity=np.eye(2)))
    with pytest.raises(InputError, match="shape"):
        solved(ck.Elliptic(f, diffusivity=lambda x: np.ones((len(x), 2, 2)), c=1.0), 0.4)
    with pytest.raises(SceneError, match="no diffusivity that is a tensor"):
        ck.solve(ck.Scene(SPHERE, ck.Elliptic(f, diffusivity=MATRIX, c=1.0)), 0.4, form="collocation")
    prepared = ck.prepare(ck.Scene(SPHERE, ck.Elliptic(f, c=1.0)), 0.4, form="collocation")
    with pytest.raises(SceneError, match="no diffusivity that is a tensor"):
        prepared.solve(problem=ck.Elliptic(f, diffusivity=MATRIX, c=1.0))
    ring = ck.Boundary("ring", RING, across=ck.Transmission(left=1.0, right=2.0))
    with pytest.raises(SceneError, match="which no number is"):
        solved(ck.Elliptic(f, diffusivity=MATRIX, c=1.0), 0.4, [ring])


@pytest.mark.parametrize(("poor", "thin"), [(0.3, False), (1e-3, True)])
def test_layers_along_the_direction_that_conducts_worst_are_warned_of_and_estimated(poor, thin):
    """Without conditions and with c = 1 they are sqrt(poor) wide; estimates were a fourth to a seventh of the error."""
    at = sphere_points(600)
    along = np.array([1.0, 0.7, 0.3]) / np.linalg.norm([1.0, 0.7, 0.3])
    tensor = np.eye(3) + (poor - 1.0) * np.outer(along, along)
    scene = ck.Scene(SPHERE, ck.Elliptic("x", diffusivity=tensor, c=1.0))
    fine = ck.solve(scene, 0.1, estimate=False).evaluate(at)
    solution = ck.solve(scene, 0.2)
    off = np.abs(solution.evaluate(at) - fine) / np.ptp(fine)
    assert 0.4 < solution.error.largest[0] / off.max() < 3
    assert 0.4 < solution.error.rms[0] / np.sqrt(np.mean(off**2)) < 4
    assert ("along the direction that conducts worst" in solution.error.slow) == thin
    told = [text for text in solution.warnings if "conducts so badly along one direction" in text]
    assert len(told) == thin


def test_without_a_reaction_layers_are_as_thin_as_the_ratio_of_the_conductivities_says():
    scene = ck.Scene(SPHERE, ck.Elliptic("x", diffusivity=np.diag([1.0, 1.0, 1e-3])))
    with pytest.warns(ck.CpmkitWarning, match=r"layers 0.16 spacings wide.*a spacing of 0.035 or less resolves them"):
        ck.solve(scene, 0.2)
