"""A tolerance, a time or a memory in; the answer, its error and the way to it out."""

from itertools import pairwise

import coarse_meshes as meshes
import numpy as np
import pytest
from model_problems import sphere_points
from plane_zones import POINTS, slit
from sample_shapes import box

import cpmkit as ck
from cpmkit.accuracy import spacing_search
from cpmkit.accuracy.error_estimate import estimate_alone

CIRCLE, SPHERE = ck.source("analytic.circle"), ck.source("analytic.sphere")
AT = np.stack([np.cos(turn := np.linspace(0, 2 * np.pi, 700)), np.sin(turn)], axis=1)


def wave(x):
    """Of order four around the circle: u = cos 4t is right for 17 u."""
    angle = np.arctan2(x[:, 1], x[:, 0])
    return np.cos(4 * angle)


ON_CIRCLE = ck.Scene(CIRCLE, ck.ScreenedPoisson(lambda x: 17 * wave(x)))


def true_error(solution, norm):
    off = (solution.evaluate(AT) - wave(AT)) / 2
    return np.sqrt(np.mean(off**2)) if norm == "rms" else np.abs(off).max()


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
@pytest.mark.parametrize("norm", ["rms", "max"])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-5])
def test_the_error_is_below_the_tolerance(form, norm, tolerance):
    solution = ck.solve(ON_CIRCLE, tolerance=tolerance, norm=norm, form=form)
    trade = solution.solve_history
    assert trade.status == "reached"
    assert true_error(solution, norm) < tolerance
    assert 0.4 < trade.error / true_error(solution, norm) < 6
    assert trade.error == pytest.approx(solution.error.of(norm)) == trade.steps[-1].error
    assert trade.steps[-1].unknowns == solution.discretized.size
    spacings = [step.spacing for step in trade.steps]
    assert all(coarse / fine < 2.5 for coarse, fine in pairwise(spacings))


def test_the_way_is_the_same_on_a_moved_and_scaled_scene():
    far = ck.source("analytic.circle", radius=1e-3, center=[5.0, -7.0])
    move = lambda x: (x - [5.0, -7.0]) * 1e3  # noqa: E731
    scaled = ck.Scene(far, ck.ScreenedPoisson(lambda x: (16e6 + 1e6) * wave(move(x)), c=1e6))
    ways = [ck.solve(scene, tolerance=1e-4).solve_history for scene in (ON_CIRCLE, scaled)]
    assert [step.unknowns for step in ways[0].steps] == [step.unknowns for step in ways[1].steps]
    assert ways[0].error == pytest.approx(ways[1].error, rel=1e-4)


def test_solves_grow_like_the_logarithm_of_what_is_requested():
    counts = [len(ck.solve(ON_CIRCLE, tolerance=tolerance).solve_history.steps) for tolerance in (1e-2, 1e-4, 1e-6)]
    assert counts[0] <= counts[1] <= counts[2] <= 8


def test_what_a_solution_says_by_itself_spares_a_correction(monkeypatch):
    """Else the second spacing is not chosen by the first solution, and estimates alone ask for more caution."""
    at = sphere_points()
    exact, goals = at.prod(axis=1), [("rms", 1e-3), ("rms", 3e-4), ("max", 1e-3)]
    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: 13 * x.prod(axis=1)))

    def solves():
        counts = []
        for norm, tolerance in goals:
            one = ck.solve(scene, tolerance=tolerance, norm=norm)
            off = (one.evaluate(at) - exact) / np.ptp(exact)
            assert (np.sqrt(np.mean(off**2)) if norm == "rms" else np.abs(off).max()) < tolerance
            counts.append(len(one.solve_history.steps))
        return counts

    few = solves()
    monkeypatch.setattr("cpmkit.accuracy.adaptive_run.estimate_alone", lambda solution: None)
    many = solves()
    assert sum(few) < sum(many)
    assert all(one <= other for one, other in zip(few, many, strict=True))


@pytest.mark.parametrize(
    ("problem", "options"),
    [(ck.Eigen(4), {}), (ck.ScreenedPoisson(1.0), {"form": "collocation"})],
    ids=["modes", "other"],
)
def test_where_a_solution_says_nothing_by_itself_estimates_do(problem, options):
    solution = ck.solve(ck.Scene(SPHERE, problem), 0.25, estimate=True, **options)
    assert estimate_alone(solution) is None
    assert solution.error.of("rms") > 0


def test_eigenvalues_are_as_many_as_requested_and_as_right():
    solution = ck.solve(ck.Scene(SPHERE, ck.Eigen(4)), tolerance=1e-2)
    assert solution.channels == 4
    assert solution.solve_history.status == "reached"
    np.testing.assert_allclose(solution.eigenvalues[1:], 2, rtol=1e-2)
    spacings = [step.spacing for step in solution.solve_history.steps]
    assert len(set(spacings)) == len(spacings)  # further modes of pilots are left out, and not solved without


@pytest.mark.parametrize(("count", "near"), [(5, None), (4, 6.0)])
def test_modes_to_a_tolerance_are_those_that_are_requested(count, near):
    scene = ck.Scene(SPHERE, ck.Eigen(count, near=near))
    found = ck.solve(scene, tolerance=3e-2)  # which solves for further modes, as the last may be within a multiplet
    same = ck.solve(scene, found.spacing, origin=found.discretization()["origin"], solver="direct")
    assert found.channels == count
    np.testing.assert_allclose(found.eigenvalues, same.eigenvalues, rtol=1e-6, atol=1e-6)
    assert found.evaluate(sphere_points(50)).shape == (50, count)
    (warning,) = (text for text in found.warnings if "multiplet" in text)
    assert warning.startswith(f"count={count} ends inside a multiplet")


def test_steps_in_time_are_shortened_and_count():
    heat = ck.Heat(lambda x: x[:, 0], until=1.0, step=0.25, scheme="backward-euler")
    solution = ck.solve(ck.Scene(CIRCLE, heat), tolerance=2e-2)
    trade, exact = solution.solve_history, np.exp(-1) * AT[:, 0]
    assert trade.steps[-1].step < trade.steps[0].step == 0.25
    off = np.sqrt(np.mean((solution.evaluate(AT) - exact) ** 2)) / np.ptp(exact)
    assert trade.status == "reached"
    assert 0.4 * off < trade.error <= 2e-2
    assert solution.error.in_time > 0.5 * trade.error  # the spacing is no matter here


@pytest.mark.parametrize("problem", [ck.ScreenedPoisson("x"), ck.Heat("x", until=0.5, step=0.1)])
def test_a_search_that_never_ends_well_ends(problem, monkeypatch):
    """A steady scene has three answers; one with steps may have more, as they are shortened five times at most."""
    monkeypatch.setattr("cpmkit.accuracy.spacing_search._is_accepted", lambda run, aim: False)
    solution = ck.solve(ck.Scene(CIRCLE, problem), tolerance=1e-2)
    answers = [step for step in solution.solve_history.steps if step.purpose in ("answer", "correction")]
    assert solution.solve_history.status == "not reached"
    assert len(answers) <= (3 if problem.family == "steady" else 20)


@pytest.mark.parametrize("norm", ["rms", "max"])
@pytest.mark.parametrize("step", [0.015, 0.24])
def test_steps_are_shortened_for_a_bump_that_coarse_lattices_do_not_resolve(step, norm):
    """A bump is carried once around a circle and comes back as diffusion alone leaves it."""
    tolerance, kappa, count = 1e-2, 1e-3, 4000

    def bump(x):
        return np.exp(-8 * ((x - [1.0, 0.0]) ** 2).sum(axis=1))

    heat = ck.Heat(bump, until=2 * np.pi, step=step, kappa=kappa, velocity=["-y", "x"], conservative=True)
    solution = ck.solve(ck.Scene(CIRCLE, heat), tolerance=tolerance, norm=norm)
    angle = 2 * np.pi * np.arange(count) / count
    at = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    waves = np.fft.rfft(bump(at)) * np.exp(-2 * np.pi * kappa * np.arange(count // 2 + 1) ** 2)
    exact = np.fft.irfft(waves, count)
    off = np.abs(solution.evaluate(at) - exact) / np.ptp(exact)
    error = off.max() if norm == "max" else np.sqrt((off**2).mean())
    assert solution.solve_history.status == "reached"
    assert error <= tolerance
    assert 0.6 < solution.error.of(norm) / error < 3


@pytest.mark.parametrize("c", [1e-6, 1.0, 400.0])
@pytest.mark.parametrize(("tolerance", "residual"), [(1e-2, 1e-6), (1e-4, 1e-7)])
def test_the_error_of_the_solver_is_below_a_twentieth_of_the_tolerance(c, tolerance, residual):
    """A multigrid stops where the error of the discretisation is twenty times what it leaves."""
    ring = ck.source("analytic.circle", normal=[0, 0, 1])
    both = ck.Boundary("ring", ring, left=ck.Dirichlet(1.0), right=ck.Dirichlet(lambda x: x[:, 0]))
    for boundaries in ([], [both]):
        scene = ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: x[:, 2] + x[:, 0] * x[:, 1], c=c), boundaries)
        solve = lambda residual, scene=scene: ck.solve(scene, 0.2, solver="multigrid", solver_tolerance=residual)  # noqa: E731
        loose, right = solve(residual), solve(1e-12)
        assert loose.report.iterations < right.report.iterations
        at = right.discretized.points
        off = np.abs(loose.evaluate(at) - right.evaluate(at)).max() / np.ptp(right.evaluate(at))
        assert off < tolerance / 20


def test_a_time_and_a_memory_bound_the_work():
    at = sphere_points()
    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: 7 * x[:, 0] * x[:, 1]))
    small, large = (ck.solve(scene, memory=size) for size in ("32 MB", "80 MB"))
    assert small.solve_history.predicted_bytes < 32e6 < large.solve_history.predicted_bytes < 80e6
    assert small.solve_history.status == large.solve_history.status == "within"
    assert large.error.of("rms") < small.error.of("rms")
    assert np.abs(large.evaluate(at) - at[:, 0] * at[:, 1]).max() < 2 * large.error.bound.max()
    with pytest.warns(ck.CpmkitWarning, match="not reached"):
        bound = ck.solve(scene, tolerance=1e-7, memory="32 MB")
    assert bound.solve_history.status == "not reached"
    assert bound.discretized.size == pytest.approx(small.discretized.size, rel=0.2)
    assert "30.52 MiB" in bound.solve_history.summary
    with pytest.raises(ck.ResolutionError, match=r"less than the .* of a coarse solve"):
        ck.solve(scene, memory="1 MB")


def test_an_answer_to_a_memory_knows_its_error():
    solution = ck.solve(slit("flux")[0], memory="64 MiB")
    assert np.isfinite(solution.solve_history.error)


def test_a_time_of_nothing_is_answered_by_the_pilots():
    with pytest.warns(ck.CpmkitWarning, match="1e-06 seconds were not enough"):
        trade = ck.solve(ON_CIRCLE, seconds=1e-6).solve_history
    assert [step.purpose for step in trade.steps] == ["pilot", "pilot"]
    assert trade.status == "not reached"


def test_a_tolerance_that_is_reached_is_not_contradicted_by_a_warning_of_large_errors():
    """At the spacings that serve for a tolerance of 1e-2, a plain torus counts as folded."""
    scene = ck.Scene(ck.source("analytic.torus", minor=0.3), ck.ScreenedPoisson("x"))
    solution = ck.solve(scene, tolerance=1e-2)
    assert solution.solve_history.status == "reached"
    with pytest.warns(ck.CpmkitWarning, match="Errors may be large"):
        ck.solve(scene, spacing=solution.spacing)
    assert not solution.warnings


def test_what_a_representation_leaves_is_the_floor():
    vertices, faces = SPHERE.mesh(0.5)
    coarse = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="smooth")
    scene = ck.Scene(coarse, ck.ScreenedPoisson(lambda x: 3 * x[:, 2]))
    with pytest.warns(ck.CpmkitWarning, match="below what the .* may leave, .* or a spacing in place of"):
        solution = ck.solve(scene, tolerance=1e-9)
    assert solution.solve_history.status == "floor"
    assert solution.discretized.size < 100_000


@pytest.mark.parametrize("mesh", [meshes.hull(meshes.icosphere(1)), meshes.capsule(16)[0]], ids=["sphere", "capsule"])
def test_triangles_that_are_read_as_they_are_have_no_floor(mesh):
    """They are the surface: the error, of a finer solution on the same triangles, falls as far as is asked for."""
    faceted = ck.source("mesh.triangles", vertices=mesh[0], faces=mesh[1], closest="faceted")
    scene = ck.Scene(faceted, ck.ScreenedPoisson(lambda x: np.cos(2 * x[:, 0]) + 3 * x[:, 1]))
    solution = ck.solve(scene, tolerance=1e-4)
    assert solution.solve_history.status == "reached"
    points = mesh[0][mesh[1]].mean(axis=1)
    finer = ck.solve(scene, solution.spacing / 2).evaluate(points)
    assert np.sqrt(np.mean((solution.evaluate(points) - finer) ** 2)) < 1e-4 * np.ptp(finer)


def test_a_search_that_made_all_its_answers_does_not_blame_the_memory(monkeypatch):
    monkeypatch.setattr(spacing_search, "MOST_ANSWERS", 0)
    scene = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson("2*x"))
    with pytest.warns(
        ck.CpmkitWarning, match=r"not reached: .*; the search ends here; spacing=0\.\d+ is the next to try"
    ):
        ck.solve(scene, tolerance=1e-7)


def test_what_triangles_do_not_reach_within_the_memory_is_reported():
    vertices, faces = meshes.hull(meshes.icosphere(1))
    faceted = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")
    with pytest.warns(
        ck.CpmkitWarning, match="tolerance 1e-09 not reached: .* no finer solve fits into 64 MiB of memory"
    ):
        solution = ck.solve(ck.Scene(faceted, ck.ScreenedPoisson(lambda x: x[:, 0])), tolerance=1e-9, memory="64 MiB")
    assert solution.solve_history.status == "not reached"


def test_the_origin_that_is_given_is_that_of_the_answer():
    solution = ck.solve(ON_CIRCLE, tolerance=1e-3, origin=[0.01, 0.02])
    np.testing.assert_array_equal(solution.discretization()["origin"], [0.01, 0.02])
    assert true_error(solution, "rms") < 1e-3


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_an_origin_that_is_given_costs_no_further_solve(tolerance):
    free, imposed = (
        ck.solve(ON_CIRCLE, tolerance=tolerance, **kind).solve_history for kind in ({}, {"origin": [0.01, 0.02]})
    )
    assert len(imposed.steps) == len(free.steps)
    assert all(coarse.spacing > 1.2 * fine.spacing for coarse, fine in pairwise(imposed.steps))


@pytest.mark.parametrize("closest", ["faceted", "smooth"])
def test_a_body_with_flat_sides_is_solved_to_the_tolerance(closest):
    """u = sum cos(pi x_i / a) on the cube |x_i| <= a: its twelve triangles are right as they are, however read."""
    half, turned = 0.6, np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    corners, triangles = box([-half] * 3, [half] * 3)
    cube = ck.source("mesh.triangles", vertices=corners @ turned.T, faces=triangles, closest=closest)

    def f(x):
        flat = np.cos(np.pi * (x @ turned) / half)
        own = flat[np.arange(len(x)), np.abs(x @ turned).argmax(axis=1)]
        return (1 + (np.pi / half) ** 2) * (flat.sum(axis=1) - own) + own

    solution = ck.solve(ck.Scene(cube, ck.ScreenedPoisson(f)), tolerance=5e-3)
    at = np.random.default_rng(0).uniform(-half, half, (900, 3))
    at[:300, 0] = at[300:600, 1] = at[600:, 2] = half
    u = np.cos(np.pi * at / half).sum(axis=1)
    assert solution.solve_history.status == "reached"
    assert np.sqrt(np.mean((solution.evaluate(at @ turned.T) - u) ** 2)) / 6 < 5e-3


def solved_to(tolerance, refine):
    """A solution on a slit plate, of which the tolerance is true."""
    scene, value = slit("value")
    solution = ck.solve(scene, tolerance=tolerance, refine=refine)
    off = (solution.evaluate(POINTS) - value(POINTS)) / np.ptp(value(POINTS))
    assert solution.solve_history.status == "reached"
    assert np.sqrt(np.mean(off**2)) < tolerance
    return solution


def test_ends_inside_a_surface_are_solved_to_a_tolerance():
    solved_to(8e-3, "auto")


@pytest.mark.slow
def test_ends_inside_a_surface_are_refined_to_a_tolerance():
    solutions = [solved_to(2e-3, refine) for refine in ("auto", "off")]
    refined, plain = (solution.discretized.size for solution in solutions)
    assert refined < plain / 2


@pytest.mark.parametrize(
    ("options", "messages"),
    [
        ({"spacing": 0.1, "tolerance": 1e-3}, "each decides how fine the lattice is"),
        ({"spacing": 0.1, "memory": 1e9}, "each decides how fine the lattice is"),
        ({"tolerance": 2.0}, "must be below 1"),
        ({"tolerance": 0.0}, "above zero|positive|greater"),
        ({"tolerance": 1e-3, "norm": "L2"}, "norm must be 'rms' or 'max', got 'L2'"),
        ({"norm": "max", "spacing": 0.1}, "says how tolerance is meant, and there is none"),
        ({"memory": "2 apples"}, "such as '2 GiB'"),
        ({"seconds": -1.0}, "seconds"),
        ({"tolerance": 1e-3, "backend": "fem"}, "backend='fem' goes with one solve"),
        ({"tolerance": 1e-3, "checkpoint": "state.npz"}, "checkpoint='state.npz' goes with one solve"),
        ({"spacing": 0.1, "estimate": "rough"}, "estimate must be True, False, 'tight' or None, got 'rough'"),
        ({"tolerance": 1e-3, "strenght": 1}, "strenght"),
    ],
)
def test_what_cannot_be_requested_is_reported(options, messages):
    with pytest.raises(ck.InputError, match=messages):
        ck.solve(ON_CIRCLE, **options)


def test_explicit_steps_are_tied_to_a_spacing():
    wave_on = ck.Wave(lambda x: x[:, 0], until=1.0, step=0.01, scheme="leapfrog")
    with pytest.raises(ck.InputError, match="use scheme='newmark'"):
        ck.solve(ck.Scene(CIRCLE, wave_on), tolerance=1e-3)
