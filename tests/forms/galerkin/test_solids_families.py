"""Equations of every family on solids, their laws, integrals, files, and what the Galerkin form refuses there."""

import re

import numpy as np
import pytest
from exact_eigenvalues import ball_eigenvalues, cube_eigenvalues
from model_problems import order_of
from scipy.special import j0, jn_zeros, jnp_zeros

import cpmkit as ck

DISK = ck.source("solid", of=ck.source("analytic.circle"))
BALL = ck.source("solid", of=ck.source("analytic.sphere"))
CUBE = ck.source("analytic.box", lower=[0.0] * 3, upper=[1.0] * 3, rotation=[0.3, 0.2, 0.5])
BELOW_ONE = np.random.default_rng(0).uniform(-0.7, 0.7, (300, 2))


def solve(source, problem, spacing, edge=None, **options):
    scene = ck.Scene(source, problem) if edge is None else ck.Scene(source, problem, edge=edge)
    return ck.solve(scene, spacing, form="galerkin", **options)


def disk_eigenvalues(count):
    squares = [jnp_zeros(m, 3)[k] ** 2 for m in range(6) for k in range(3) for _ in range(2 if m else 1)]
    return np.sort([0.0, *squares])[:count]


@pytest.mark.parametrize(
    ("source", "spacing", "exact"),
    [(DISK, 0.1, disk_eigenvalues(8)), (BALL, 0.2, ball_eigenvalues(10)), (CUBE, 0.12, cube_eigenvalues(10))],
    ids=["disk", "ball", "cube"],
)
def test_eigenvalues(source, spacing, exact):
    found = solve(source, ck.Eigen(len(exact)), spacing).eigenvalues
    assert abs(found[0]) < 1e-9
    assert np.abs(found[1:] / exact[1:] - 1).max() < 1e-3
    assert (found[1:] > exact[1:] * (1 - 1e-6)).all()


def test_steklov_eigenvalues_of_a_disk():
    found = solve(DISK, ck.Eigen(5), 0.1, ck.Steklov()).eigenvalues
    assert np.abs(found - [0, 1, 1, 2, 2]).max() < 1e-6


def test_heat_with_values_on_the_skin():
    first, spacings, errors = jn_zeros(0, 1)[0], [0.2, 0.1, 0.05], []
    for h in spacings:
        heat = ck.Heat(lambda x: j0(first * np.hypot(*x.T)), until=0.1, step=h**1.5 / 20)
        found = solve(DISK, heat, h, ck.Dirichlet(0.0)).evaluate(BELOW_ONE)
        errors.append(np.abs(found - np.exp(-0.1 * first**2) * j0(first * np.hypot(*BELOW_ONE.T))).max())
    assert order_of(spacings, errors) > 2.4


def test_total_heat_is_kept():
    heat = ck.Heat(lambda x: np.exp(-4 * np.sum((x - 0.3) ** 2, axis=1)), until=0.1, step=0.01, frames=5)
    totals = np.array([frame.totals for frame in solve(DISK, heat, 0.2).frames])
    assert np.ptp(totals) < 1e-11 * np.abs(totals).max()


def test_integrals_over_the_inside_and_fluxes_through_the_skin():
    ball = solve(BALL, ck.Poisson(6.0), 0.2, ck.Dirichlet(0.0))  # 1 - r^2
    assert ball.integrate(1) == pytest.approx(4 / 3 * np.pi, rel=3e-5)
    assert ball.integrate() == pytest.approx(4 * np.pi * (1 / 3 - 1 / 5), rel=1e-4)
    assert ball.mean() == pytest.approx(0.4, rel=1e-4)
    assert ball.flux("edge") == pytest.approx(-8 * np.pi, rel=3e-5)
    with pytest.raises(ck.InputError, match=r"no flux through the edge of a solid in space; use form='galerkin'"):
        ck.solve(ck.Scene(BALL, ck.Laplace(), edge=ck.Dirichlet("x")), 0.3, form="collocation").flux("edge")
    disk = solve(DISK, ck.ScreenedPoisson(1.0), 0.1)
    assert disk.integrate(lambda x, values: x[:, 0] ** 2) == pytest.approx(np.pi / 4, rel=1e-6)


#: Equations whose solution is x.
PROBLEMS = {
    "velocity": ck.Elliptic("1 - y", velocity=lambda x: np.stack([1 - x[:, 1], x[:, 0]], axis=1)),
    "strong velocity": ck.Elliptic("50*(1 - y)", velocity=lambda x: 50 * np.stack([1 - x[:, 1], x[:, 0]], axis=1)),
    "diffusivity": ck.Elliptic(-1.0, diffusivity=lambda x: 2 + x[:, 0]),
    "tensor": ck.Elliptic(0.0, diffusivity=[[2.0, 0.5], [0.5, 1.0]]),
    "nonlinear": ck.NonlinearDiffusion(lambda values: 1 + values**2, "-2*x"),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_coefficients(name):
    found = solve(DISK, PROBLEMS[name], 0.2, ck.Dirichlet("x")).evaluate(BELOW_ONE)
    assert np.abs(found - BELOW_ONE[:, 0]).max() < 2e-5


def test_reactions_and_waves():
    def reaction(values):
        return np.stack([values[:, 0] * (1 - values[:, 0]), -values[:, 1]], axis=1)

    spread = ck.ReactionDiffusion([0.5, 0.2], reaction, [0.1, 0.1], until=1.0, step=0.01)
    found = solve(DISK, spread, 0.2).evaluate(BELOW_ONE)
    assert np.abs(found - [1 / (1 + np.exp(-1)), 0.2 * np.exp(-1)]).max() < 1e-3
    first = jn_zeros(0, 1)[0]
    wave = ck.Wave(lambda x: j0(first * np.hypot(*x.T)), until=1.0, step=0.005)
    found = solve(DISK, wave, 0.1, ck.Dirichlet(0.0)).evaluate(BELOW_ONE)
    assert np.abs(found - np.cos(first) * j0(first * np.hypot(*BELOW_ONE.T))).max() < 2e-3


def test_moving_turning_and_scaling_a_scene_change_little():
    """The answers of one scene at two places and sizes, and those of two positions of the lattice."""

    def answer(scale, move, turn, **options):
        circle = ck.source("analytic.circle", radius=scale, center=move)
        problem = ck.Poisson(lambda x: np.exp(((x - move) @ turn)[:, 0] / scale) / scale**2)
        scene = ck.Scene(ck.source("solid", of=circle), problem, edge=ck.Dirichlet(0.0))
        solution = ck.solve(scene, 0.1 * scale, form="galerkin", **options)
        return solution.evaluate(scale * (BELOW_ONE @ turn.T) + move)

    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    first = answer(1.0, np.zeros(2), np.eye(2))
    assert np.abs(answer(1000.0, np.array([3e5, -2e5]), np.eye(2)) - first).max() < 1e-9
    assert np.abs(answer(1.0, np.zeros(2), turn) - first).max() < 5e-5
    assert np.abs(answer(1.0, np.zeros(2), np.eye(2), origin=[0.037, 0.021]) - first).max() < 5e-5


def test_reciprocity_of_two_sources():
    def spot(at):
        return lambda x: np.exp(-20 * np.sum((x - np.array(at)) ** 2, axis=1))

    first, second = ([0.3, 0.2], [-0.4, 0.1])
    answers = [solve(DISK, ck.ScreenedPoisson(spot(at)), 0.1) for at in (first, second)]
    loads = [answers[0].discretized.load(spot(at))[:, 0] for at in (first, second)]
    assert answers[0].values[:, 0] @ loads[1] == pytest.approx(answers[1].values[:, 0] @ loads[0], rel=1e-10)


def test_a_solution_is_saved_and_loaded(tmp_path):
    solution = solve(DISK, ck.ScreenedPoisson("x"), 0.2)
    solution.save(tmp_path / "disk.npz")
    again = ck.load(tmp_path / "disk.npz", solution.scene)
    assert np.array_equal(again.evaluate(BELOW_ONE), solution.evaluate(BELOW_ONE))


def test_the_estimated_error_is_of_the_size_of_the_error():
    exact = solve(DISK, ck.ScreenedPoisson(lambda x: np.sin(4 * x[:, 0])), 0.025)
    solution = solve(DISK, ck.ScreenedPoisson(lambda x: np.sin(4 * x[:, 0])), 0.1)
    error = np.abs(solution.evaluate(BELOW_ONE) - exact.evaluate(BELOW_ONE)).max()
    assert 0.3 < solution.error.largest / error < 10


def test_points_outside_are_refused():
    with pytest.raises(ck.InputError, match="points must lie within 3 spacings"):
        solve(DISK, ck.ScreenedPoisson(1.0), 0.2).evaluate([[2.0, 0.0]])


def polygon(*corners):
    return ck.source("solid", of=ck.source("mesh.polyline", points=[*corners, corners[0]]))


def test_what_is_refused():
    pin = ck.Boundary("pin", ck.source("analytic.point", at=[0.1, 0.2]), both=ck.Dirichlet(0.0))
    with pytest.raises(ck.SceneError, match=r"as boundaries inside; change that, or use form='collocation'"):
        ck.solve(ck.Scene(DISK, ck.Laplace(), [pin]), 0.2, form="galerkin")
    refused = {"degree": 3}, {"refine": "auto"}, {"samples": "plain"}
    words = "degree 2 on solids, got degree=3", "refine='off' on solids", "samples='auto' on"
    for options, accepted in zip(refused, words, strict=True):
        with pytest.raises(ck.SceneError, match=f"takes .*{accepted}"):
            solve(DISK, ck.ScreenedPoisson(1.0), 0.2, **options)
    with pytest.raises(ck.SceneError, match="crosses itself, or two parts of it overlap, near"):
        solve(polygon([0, 0], [1, 1], [1, 0], [0, 1.2]), ck.ScreenedPoisson(1.0), 0.1)
    circles = [ck.source("analytic.circle", center=[x, 0.0]) for x in (0.0, 1.2)]
    with pytest.raises(ck.SceneError, match="crosses itself, or two parts of it overlap, near"):
        solve(ck.source("solid", of=ck.source("union", members=circles)), ck.ScreenedPoisson(1.0), 0.2)
    boxes = [ck.source("analytic.box", lower=[x, 0.0], upper=[x + 1.0, 1.0]) for x in (0.0, 0.7)]
    with pytest.raises(ck.SceneError, match="crosses itself, or two parts of it overlap, near"):
        solve(ck.source("union", members=boxes), ck.ScreenedPoisson(1.0), 0.1)
    with pytest.raises(ck.InputError, match="no boundary"):
        solve(DISK, ck.ScreenedPoisson(1.0), 0.2).signed_distance("edge", [[0.0, 0.0]])


class Plain:
    """A disk that tells its closest points alone."""

    dim, manifold_dim, exact, bounds, closest_point = 2, 2, True, DISK.bounds, staticmethod(DISK.closest_point)


class WithMesh(Plain):
    """The same with a mesh of the inside."""

    mesh = staticmethod(DISK.mesh)


@pytest.mark.parametrize(("disk", "words"), [(Plain, "neither a skin nor a mesh"), (WithMesh, "has a curved one")])
def test_a_solid_without_a_boundary_of_its_own_is_refused(disk, words):
    with pytest.raises(ck.SceneError, match=words):
        solve(disk(), ck.ScreenedPoisson(1.0), 0.1)


def test_the_estimate_names_a_value_beside_a_flux():
    """Where they meet on a smooth part of the edge, u behaves like a root; at a right angle it need not."""
    slow = "a value and a flux are prescribed side by side"
    for source, zone in ((DISK, "y < 0"), (BALL, "z < 0")):
        mixed = [(ck.Neumann(1.0), zone), ck.Dirichlet(0.0)]
        assert slow in solve(source, ck.Poisson(0.0), 0.2, mixed).error.slow
    sides = {0: ck.Dirichlet(0.0), **{side: ck.Neumann(1.0) for side in range(1, 6)}}
    for edge in (sides, ck.Dirichlet(0.0), ck.Robin(1.0, 1.0, 0.0)):
        assert solve(CUBE, ck.ScreenedPoisson(1.0), 0.2, edge).error.slow == ""


def form_and_reason(source, boundaries=(), **options):
    described = ck.discretize(ck.Scene(source, ck.ScreenedPoisson(1.0), boundaries), 0.2, **options).describe()
    return described["form"], described["form_reason"]


@pytest.mark.parametrize("source", [DISK, CUBE, ck.source("moved", of=DISK, translation=[1.0, 2.0])])
def test_the_default_form_on_solids(source):
    assert form_and_reason(source) == ("galerkin", "the default")


def test_where_solids_take_the_collocation_form():
    pin = ck.Boundary("pin", ck.source("analytic.point", at=[0.1, 0.2]), both=ck.Dirichlet(0.0))
    squares = [ck.source("analytic.box", lower=[x, 0.0], upper=[x + 1.0, 1.0]) for x in (0.0, 0.7)]
    cases = {
        "as boundaries inside": form_and_reason(DISK, [pin]),
        "degree 2 on solids": form_and_reason(DISK, degree=3),
        "may overlap": form_and_reason(ck.source("union", members=squares)),
        "closest points alone": form_and_reason(Plain()),
    }
    for words, (form, reason) in cases.items():
        assert form == "collocation", words
        assert words in reason
    assert form_and_reason(WithMesh()) == form_and_reason(Plain())


def test_a_solid_that_collocation_solves_with_a_boundary_inside_is_warned_of():
    pin = ck.Boundary("pin", ck.source("analytic.point", at=[0.1, 0.2]), both=ck.Dirichlet(0.0))
    scene = ck.Scene(DISK, ck.ScreenedPoisson(1.0), [pin])
    reason = "The form 'collocation' solves this scene, since the form 'galerkin' takes .* as boundaries inside"
    with pytest.warns(ck.CpmkitWarning) as caught:
        ck.solve(scene, 0.2, estimate=False)
    assert any(re.match(reason, str(warning.message)) for warning in caught)
    assert re.match(reason, ck.explain(scene, 0.2).warnings[0])
    parts = ck.Scene(DISK, ck.ScreenedPoisson(1.0), [pin], [(ck.Dirichlet(0.0), "x < 0"), ck.Neumann(0.0)])
    with pytest.raises(ck.SceneError, match=r"'collocation' takes one condition .* 'galerkin' takes .*: change one of"):
        ck.solve(parts, 0.2)
