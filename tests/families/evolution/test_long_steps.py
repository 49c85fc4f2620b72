"""Steps too long for a velocity: warned of where what is carried lags or is damped, and not elsewhere."""

import numpy as np
import pytest

import cpmkit as ck

CIRCLE = ck.source("analytic.circle")
ANGLES = np.linspace(0, 2 * np.pi, 400, endpoint=False)
POINTS = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
ROUND = 2 * np.pi


def turning(x):
    return np.stack([-x[:, 1], x[:, 0]], axis=1)


def run(form, scheme, waves, kappa, steps, velocity=turning, until=ROUND, f=0.0):
    heat = ck.Heat(
        lambda x: np.cos(waves * np.arctan2(x[:, 1], x[:, 0])),
        until=until,
        step=until / steps,
        kappa=kappa,
        velocity=velocity,
        scheme=scheme,
        f=f,
    )
    solution = ck.solve(ck.Scene(CIRCLE, heat), 0.1, form=form)
    return solution, [text for text in solution.warnings if "is long for the velocity" in text]


@pytest.mark.parametrize(
    ("form", "scheme", "waves", "kappa", "long", "short"),
    [
        ("galerkin", "bdf2", 3, 0.01, 50, 200),
        ("galerkin", "crank-nicolson", 3, 0.01, 25, 100),
        ("galerkin", "backward-euler", 1, 0.01, 50, 400),
        ("collocation", "bdf2", 1, 0.1, 12, 50),
        ("collocation", "backward-euler", 1, 0.1, 25, 200),
    ],
)
def test_what_is_advected_once_round(form, scheme, waves, kappa, long, short):
    """exp(-kappa m^2 t) cos(m (angle - t)): errors are shares of what is left of the wave."""
    left = np.exp(-kappa * waves**2 * ROUND)
    for steps, messages in ((long, True), (short, False)):
        solution, warnings = run(form, scheme, waves, kappa, steps)
        error = np.abs(solution.evaluate(POINTS) - left * np.cos(waves * ANGLES)).max() / left / 2
        assert len(warnings) == messages
        assert (error > 0.07) == messages


def test_the_step_that_is_advised_is_short_enough():
    _, (sentence,) = run("galerkin", "bdf2", 3, 0.01, 25)
    step = float(sentence.split("use a step of ")[1].split(" or less")[0])
    assert not run("galerkin", "bdf2", 3, 0.01, int(np.ceil(ROUND / step)))[1]


def test_what_comes_to_rest_is_right_however_long_its_steps():
    """Driven by f it ends at a steady state, which steps of 5 spacings reach as well as short ones."""
    ends = [run("galerkin", "bdf2", 1, 0.3, steps, until=30.0, f=lambda x: x[:, 0]) for steps in (60, 600)]
    assert not ends[0][1]
    assert np.abs(ends[0][0].evaluate(POINTS) - ends[1][0].evaluate(POINTS)).max() < 1e-3


def test_without_a_velocity_nothing_is_said():
    assert not run("galerkin", "bdf2", 3, 0.01, 12, velocity=None)[1]
