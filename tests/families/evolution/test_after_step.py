"""What is done after each step of a run, and runs that end at rest."""

import numpy as np
import pytest
from model_problems import order_of

import cpmkit as ck

SPHERE = ck.source("analytic.sphere")
FORMS = ("galerkin", "collocation")


def unit(points, values):
    return values / np.linalg.norm(values, axis=1, keepdims=True)


def curved(points):
    x, y, z = points.T
    return unit(points, points + 0.5 * np.stack([y * z, x**2, -x * y], axis=1))


def run(form="galerkin", spacing=0.3, initial=curved, until=0.2, step=0.02, after_step=unit, **others):
    solving = {key: others.pop(key) for key in ("checkpoint", "checkpoint_every", "resume") if key in others}
    heat = ck.Heat(initial, until, step, after_step=after_step, **others)
    return ck.solve(ck.Scene(SPHERE, heat), spacing, form=form, **solving)


@pytest.mark.parametrize("form", FORMS)
def test_a_projection_on_a_target_holds_after_each_step_and_bdf2_is_of_first_order(form):
    points = SPHERE.mesh(0.4)[0]
    runs = [run(form, step=0.2 / n).evaluate(points) for n in (8, 16, 32, 128)]
    assert np.abs(np.linalg.norm(runs[-1], axis=1) - 1).max() < 3e-3
    errors = [np.abs(one - runs[-1]).max() for one in runs[:-1]]
    assert 0.9 < order_of([1 / 8, 1 / 16, 1 / 32], errors) < 1.3


@pytest.mark.parametrize("form", FORMS)
def test_what_changes_nothing_leaves_every_bit(form):
    plain, same = run(form, after_step=None), run(form, after_step=lambda points, values: values)
    assert np.array_equal(plain.values, same.values)


@pytest.mark.parametrize("form", FORMS)
def test_conditions_hold_after_what_is_done_after_a_step(form):
    cut = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), left=ck.Dirichlet(1), right=ck.Dirichlet(0))
    heat = ck.Heat(0.5, 20.0, 0.05, after_step=lambda points, values, t: np.clip(values, 0, 1), rest=1e-6)
    solution = ck.solve(ck.Scene(ck.source("analytic.circle"), heat, [cut]), 0.1, form=form)
    assert np.allclose(solution.evaluate([[0, 1], [-1, 0]]), [0.25, 0.5], atol=2e-3)
    assert solution.time < 20
    assert not solution.warnings


def test_the_time_and_the_points_are_given():
    seen = []

    def shifted(points, values, t):
        seen.append((t, points.shape, values.shape))
        return values + 1

    solution = run(initial=0.0, until=0.1, step=0.04, after_step=shifted, scheme="backward-euler")
    assert np.allclose(solution.evaluate(SPHERE.mesh(0.5)[0]), 3, atol=1e-9)
    times = [time for time, _, _ in seen]
    assert times[-3:] == [0.04, 0.08, 0.1]
    assert not solution.warnings  # no drift of heat is told


@pytest.mark.parametrize(("after_step", "messages"), [(1.0, "function"), (lambda p, v: v[:3], "shape")])
def test_what_returns_no_values_is_refused(after_step, messages):
    with pytest.raises(ck.InputError, match=messages):
        run(after_step=after_step)
    with pytest.raises(ck.InputError, match="NaN"):
        run(after_step=lambda points, values: values * np.nan)


def test_a_run_ends_at_rest_without_the_frames_that_are_past_it():
    heat = ck.Heat(lambda x: 1 + x[:, 2], until=50, step=0.1, rest=1e-3, frames=[1, 2, 40])
    solution = ck.solve(ck.Scene(SPHERE, heat), 0.25)
    assert [frame.time for frame in solution.frames] == [1, 2]
    # The slowest mode, of size exp(-2 t) / 3^(1/2), then changes twice as fast, over a size of (4/3)^(1/2).
    rests_at = 0.5 * np.log(1 / 1e-3)
    assert abs(solution.time - rests_at) <= 0.15
    assert solution.steps == round(solution.time / 0.1)
    assert not solution.warnings


def test_a_run_that_does_not_come_to_rest_says_so():
    with pytest.warns(ck.CpmkitWarning, match="did not come to rest until 0.5"):
        ck.solve(ck.Scene(SPHERE, ck.Heat(lambda x: 1 + x[:, 2], 0.5, 0.1, rest=1e-3)), 0.3)


@pytest.mark.parametrize("form", FORMS)
def test_a_run_goes_on_bit_by_bit_and_stays_at_rest(tmp_path, form):
    path = tmp_path / "state.npz"
    whole = run(form)
    run(form, until=0.1, checkpoint=path)
    assert np.array_equal(run(form, resume=path).values, whole.values)
    with pytest.raises(ck.InputError, match="another run"):
        run(form, after_step=lambda points, values: 0.5 * values, resume=path)
    still = {"initial": lambda x: 1 + x[:, 2], "after_step": None, "until": 9.0, "step": 0.1, "rest": 1e-2}
    rested = run(form, **still, checkpoint=path)
    again = run(form, **still, resume=path)
    assert again.steps == rested.steps < 90
    assert np.array_equal(again.values, rested.values)
