"""Solving again at twice the spacing tells the error."""

import numpy as np
import pytest
from model_problems import circle_jump, origins, sphere_points

import cpmkit as ck


def test_effectivity_on_the_circle_with_a_jump():
    """Estimate over true error, mean of four positions of the lattice."""
    scene, points, exact = circle_jump()
    for h in (0.1, 0.05, 0.025):
        ratios = []
        for origin in origins(2)[:4]:
            estimate = ck.estimate_error(scene, h, origin=origin * h)
            ratios.append(estimate.error[0] / np.abs(estimate.solution.evaluate(points) - exact).max())
        assert 0.7 <= np.mean(ratios) <= 1.6


def test_on_a_sphere_with_several_channels():
    def u(x):
        return np.stack([x[:, 0] * x[:, 1], 10 * x[:, 2]], axis=1)

    scene = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(lambda x: u(x) * [7.0, 3.0], c=1.0))
    estimate = ck.estimate_error(scene, 0.2)
    true = np.abs(estimate.solution.evaluate(sphere_points()) - u(sphere_points())).max(axis=0)
    assert np.all((estimate.error / true > 0.5) & (estimate.error / true < 2.0))
    assert np.all(estimate.bound >= true)
    assert "error about" in str(estimate)


@pytest.mark.parametrize("form", ["collocation", "galerkin"])
def test_what_the_source_leaves_is_that_of_the_form(form):
    """A mesh stands for a sphere less well in closest points from some way off than in integrals."""
    vertices, faces = ck.source("analytic.sphere").mesh(0.4)
    mesh = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="smooth")
    scene = ck.Scene(mesh, ck.ScreenedPoisson(lambda x: 3 * x[:, 2]))
    estimate = ck.estimate_error(scene, 0.2, form=form, solver="direct")
    floor = ck.explain(scene, 0.2, form=form, dry_run=True).floor
    assert floor > 1e-6
    assert f"beside {'at most' if form == 'galerkin' else 'about'} " in str(estimate)
    if form == "collocation":
        assert estimate.floor[0] == pytest.approx(floor, rel=0.1)
    else:  # by a solution on the triangles, which differs by less than the areas
        assert floor / 4 < estimate.floor[0] < min(floor, 2e-3)


def test_a_printed_estimate_says_what_a_noisy_cloud_leaves():
    """A cloud estimates its own error, so that nothing printed is called a bound; a mesh has a bound."""
    rng = np.random.default_rng(0)
    points = sphere_points()
    scan = rng.normal(size=(5000, 3))
    scan *= (1 + 0.01 * rng.normal(size=(5000, 1))) / np.linalg.norm(scan, axis=1, keepdims=True)
    scene = ck.Scene(ck.source("pointcloud.points", points=scan, neighbours=50), ck.ScreenedPoisson("3*z"))
    solution = ck.solve(scene, 0.16)
    true, estimate = solution.evaluate(points) - points[:, 2], solution.error
    assert estimate.rms[0] < 0.1 * estimate.floor[0]  # the difference of two spacings sees nothing of the noise
    assert np.abs(true).max() < estimate.bound[0]
    assert f"beside about {100 * estimate.floor[0]:.2g} percent that the source leaves" in str(estimate)
    assert "at most" not in str(estimate) + str(ck.explain(scene, 0.16)) + str(ck.explain(scene, 0.16, dry_run=True))
    reached = ck.solve(scene, tolerance=3e-3).solve_history
    assert reached.status == "reached"
    assert "beside about" in reached.summary
    with pytest.warns(ck.CpmkitWarning, match=r"may leave, about .* of the range at any spacing"):
        ck.solve(scene, tolerance=1e-5)


@pytest.mark.parametrize("degree", [2, 3])
def test_a_coarser_lattice_that_resolves_less_is_not_taken(degree):
    """At .36 a unit sphere bends too sharply, and its eigenvalues were by chance those of .18."""
    scene = ck.Scene(ck.source("analytic.sphere"), ck.Eigen(4))
    solution = ck.solve(scene, 0.18, form="collocation", degree=degree, origin=[0.0, 0.0, 0.0])
    true = np.abs(solution.eigenvalues[1:4] - 2) / 2
    assert np.all(solution.error.rms[1:4] > 0.5 * true)


@pytest.mark.parametrize("form", ["collocation", "galerkin"])
def test_heat_that_grows_has_an_estimate(form):
    """c = -100 makes no standing waves, which a coarser lattice would have to resolve."""
    heat = ck.Heat(initial=lambda x: x[:, 0], until=0.02, step=0.005, c=-100.0)
    solution = ck.solve(ck.Scene(ck.source("analytic.sphere"), heat), 0.15, form=form)
    true = 0.5 * abs(solution.evaluate([[1.0, 0.0, 0.0]])[0] / np.exp(98 * 0.02) - 1)
    assert 0.5 < solution.error.largest[0] / true < 2


@pytest.mark.parametrize(("step", "first"), [(0.05, True), (0.003, False)])
def test_the_step_is_to_be_halved_first_where_it_makes_most_of_the_error(step, first):
    """A spot that turns with the sphere is hardly resolved either way."""
    heat = ck.Heat("exp(-8*((x - 1)**2 + y**2 + z**2))", until=0.5, step=step, kappa=1e-3, velocity=["-4*y", "4*x", 0])
    error = ck.solve(ck.Scene(ck.source("analytic.sphere"), heat), 0.15).error
    assert ("halve the step first" in str(error)) is first
    assert "waves or peaks that the spacing hardly resolves" in error.slow
    assert bool(error.in_time > 0.5 * error.rms[0]) is first


def test_a_run_with_twice_the_step_that_fails_leaves_the_solution_and_says_so():
    """Of a reaction the check of the step repeats the run with twice the step, which may be too long."""
    reaction = ["20*(0.1 - u1 + u1**2*u2)", "20*(0.9 - u1**2*u2)"]
    noise = ["1 + 0.01*sin(7*x)", "1 + 0.01*sin(7*y)"]
    pattern = ck.ReactionDiffusion(noise, reaction, kappa=[0.05, 1.0], until=2.0, step=0.025)
    solution = ck.solve(ck.Scene(ck.source("analytic.sphere"), pattern), 0.3)
    assert np.isfinite(solution.values).all()
    message = (
        r"a run with twice the step, 0\.05, and that run failed \(The reaction ceased to be finite at time [\d.]+\)"
    )
    with pytest.raises(ck.ResolutionError, match=rf"{message}\. Your own run with step=0\.025 is unaffected; .* halve"):
        _ = solution.error


def test_a_printed_estimate_says_what_the_steps_in_time_add():
    heat = ck.Heat("x", until=1.0, step=0.1)
    error = ck.solve(ck.Scene(ck.source("analytic.sphere"), heat), 0.3).error
    assert f" percent of the range ({100 * error.in_time:.2g} from the steps in time)" in str(error)
    still = ck.solve(ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson("x")), 0.3).error
    assert "in time" not in str(still)


def test_printed_errors_of_eigenvalues_are_percentages_of_each_without_a_place():
    scene = ck.Scene(ck.source("analytic.sphere"), ck.Eigen(3))
    error = ck.solve(scene, 0.3).error
    shares = ", ".join(f"{100 * share:.2g}" for share in error.rms)
    assert str(error) == f"error about {shares} percent of each eigenvalue at spacing 0.3, rarely above twice that"
    history = ck.solve(scene, tolerance=5e-3).solve_history
    share = f"{100 * history.error:.2g} percent"
    assert f"tolerance 0.005 reached: error about {share} of each eigenvalue at spacing" in str(history)
    assert str(history).splitlines()[-2].endswith(f"error about {share}")
