"""Three harmonics, and solutions that differ on two sides of the equator with data in time: errors and orders."""

import numpy as np
import pytest
from model_problems import order_of, sphere_points

import cpmkit as ck

FORMS = pytest.mark.parametrize("form", ["collocation", "galerkin"])
SPHERE = ck.source("analytic.sphere")
EQUATOR = ck.source("analytic.circle", normal=[0, 0, 1])
POINTS = sphere_points(2000)
#: Eigenvalues of -Lap, and eigenfunctions.
HARMONICS = {2: lambda x: x[:, 2], 6: lambda x: x[:, 0] * x[:, 1], 12: lambda x: x[:, 0] * x[:, 1] * x[:, 2]}


def three(x, amplitude=lambda eigenvalue: 1.0):
    return sum(amplitude(eigenvalue) * y(x) for eigenvalue, y in HARMONICS.items())


def positions(h, count):
    return np.random.default_rng(0).uniform(0, h, (count, 3))


def mean_error(problem, exact, h, count):
    """The mean over positions of the lattice of the greatest error."""
    scene = ck.Scene(SPHERE, problem)
    return np.mean(
        [
            np.abs(ck.solve(scene, h, form="galerkin", origin=o).evaluate(POINTS) - exact).max()
            for o in positions(h, count)
        ]
    )


def heat_errors(spacings, count, scheme="bdf2"):
    exact = three(POINTS, lambda eigenvalue: np.exp(-0.1 * eigenvalue))
    return [mean_error(ck.Heat(three, 0.1, h / 20, scheme=scheme), exact, h, count) for h in spacings]


@pytest.mark.parametrize("scheme", ["bdf2", "crank-nicolson"])
def test_heat_of_three_harmonics_cheaply(scheme):
    errors = heat_errors((0.3, 0.2), 1, scheme)
    assert errors[1] < 6e-4
    assert order_of((0.3, 0.2), errors) > 2


@pytest.mark.slow
def test_heat_of_three_harmonics():
    errors = heat_errors((0.2, 0.1), 4)
    assert errors[0] < 6e-4
    assert errors[1] < 1.3e-4


def wave_errors(spacings, count):
    exact = three(POINTS, lambda eigenvalue: np.cos(3.0 * np.sqrt(eigenvalue)))
    return [mean_error(ck.Wave(three, 3.0, 0.1 * h), exact, h, count) for h in spacings]


def test_newmark_of_three_harmonics_cheaply():
    assert wave_errors((0.3,), 1)[0] < 1e-2


@pytest.mark.slow
def test_newmark_of_three_harmonics():
    errors = wave_errors((0.2, 0.1, 0.05), 1)
    assert np.all(np.array(errors) < [3e-3, 1.2e-3, 5e-4])


def above(x, t):
    return np.exp(-2 * t) * x[:, 2] + t * x[:, 0]


def below(x, t):
    return np.exp(-2 * t) * (x[:, 0] + 2 * x[:, 2]) + t * x[:, 1]


def either(x, t):
    return np.where(x[:, 2] > 0, above(x, t), below(x, t))


def source(x, t):
    return np.where(x[:, 2] > 0, x[:, 0], x[:, 1]) * (1 + 2 * t)


def slope(height):
    """The slope out of the side above the equator is -exp(-2 t), out of the other 2 exp(-2 t)."""
    return lambda x, t: height * np.exp(-2 * t) + 0 * x[:, 0]


def robin(height, u):
    return ck.Robin(1.0, 2.0, lambda x, t: slope(height)(x, t) + 2 * u(x, t))


SIDES = {
    "Dirichlet": {"left": ck.Dirichlet(above), "right": ck.Dirichlet(below)},
    "Neumann": {"left": ck.Neumann(slope(-1)), "right": ck.Neumann(slope(2))},
    "mixed": {"left": ck.Neumann(slope(-1)), "right": ck.Dirichlet(below)},
    "Robin": {"left": robin(-1, above), "right": robin(2, below)},
    "transmission": {"across": ck.Transmission(lambda x, t: above(x, t) - below(x, t), slope(1))},
}


def two_sided_errors(name, form, spacings):
    errors = []
    for h in spacings:
        heat = ck.Heat(lambda x: either(x, 0.0), until=0.5, step=h / 20, f=source)
        scene = ck.Scene(SPHERE, heat, [ck.Boundary("equator", EQUATOR, **SIDES[name])])
        errors.append(np.abs(ck.solve(scene, h, form=form).evaluate(POINTS) - either(POINTS, 0.5)).max())
    return errors


@pytest.mark.parametrize("name", SIDES)
def test_conditions_that_move_on_two_sides_cheaply(name):
    assert two_sided_errors(name, "galerkin", (0.3,))[0] < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", SIDES)
@FORMS
def test_conditions_that_move_on_two_sides(name, form):
    errors = np.array(two_sided_errors(name, form, (0.2, 0.1)))
    bounds = {"galerkin": np.array([1e-3, 3e-4]), "collocation": np.array([2e-2, 6e-3])}
    assert np.all(errors < bounds[form])


@pytest.mark.parametrize("boundaries", [[], [ck.Boundary("equator", EQUATOR, both=ck.Dirichlet(0.3))]], ids=len)
def test_newmark_keeps_the_energy(boundaries):
    wave = ck.Wave(three, until=5.0, step=0.05, frames=20, f=lambda x: x[:, 0])
    solution = ck.solve(ck.Scene(SPHERE, wave, boundaries), 0.3)
    energies = np.array([frame.energy for frame in solution.frames])
    assert np.abs(energies / energies[0] - 1).max() < 1e-9
    assert solution.summary()["time"]["energy"][-1] == solution.energy.tolist()
    assert solution.summary()["time"]["scheme"] == "newmark"


@pytest.mark.parametrize("problem", [ck.Heat(three, 0.1, 0.01, frames=5), ck.Wave(three, 0.3, 0.01, frames=3)], ids=str)
@pytest.mark.parametrize("solver", ["direct", "multigrid"])
def test_a_run_goes_on_bit_by_bit(problem, solver, tmp_path):
    scene, state = ck.Scene(SPHERE, problem), tmp_path / "state.npz"
    whole = ck.solve(scene, 0.4, solver=solver, checkpoint=state, checkpoint_every=7)

    def stop(stage, share):
        if stage == "steps" and share > 0.75:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ck.solve(scene, 0.4, solver=solver, checkpoint=state, checkpoint_every=2, progress=stop)
    again = ck.solve(scene, 0.4, solver=solver, resume=state)
    for one, other in zip((*whole.frames, whole), (*again.frames, again), strict=True):
        np.testing.assert_array_equal(one.values, other.values)
        np.testing.assert_array_equal(one.energy, other.energy)


@pytest.mark.parametrize("step", [0.03, 0.6])
def test_noise_stays_bounded_and_is_reported(step):
    """Whatever the step, also beside conditions; undamped, waves of a few spacings stay for ever."""
    noise = ck.Wave(lambda x: np.sin(1e4 * x[:, 0]) * np.cos(1.7e4 * x[:, 1]), until=50 * step, step=step, frames=10)
    scene = ck.Scene(SPHERE, noise, [ck.Boundary("equator", EQUATOR, left=ck.Dirichlet(0.0), right=ck.Neumann(0.0))])
    with pytest.warns(ck.CpmkitWarning, match="waves of four spacings or less"):
        solution = ck.solve(scene, 0.4)
    energies = np.array([frame.energy for frame in solution.frames])
    assert np.abs(energies / energies[0] - 1).max() < 1e-9
    assert max(np.abs(frame.evaluate(POINTS)).max() for frame in solution.frames) < 3


def test_explain_reports_the_form_and_the_solver():
    messages = ck.explain(ck.Scene(SPHERE, ck.Heat(three, 0.1, 0.01)), 0.3, dry_run=True)
    assert messages.solver == "direct"
    assert "form 'galerkin'" in str(messages)
    finer = ck.explain(ck.Scene(SPHERE, ck.Wave(three, 0.1, 0.01)), 0.05, dry_run=True)
    assert finer.solver == "multigrid"
