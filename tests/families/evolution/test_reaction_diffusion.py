"""Channels that spread and act on each other: orders in space and time together, what is kept, what is refused."""

import numpy as np
import pytest
from model_problems import order_of

import cpmkit as ck

SPHERE, CIRCLE = ck.source("analytic.sphere"), ck.source("analytic.circle")
KAPPA = (0.3, 0.05)
FORMS = ("galerkin", "collocation")


def exchange(u, points):
    return np.stack([-u[:, 0] * u[:, 1] ** 2, u[:, 0] * u[:, 1] ** 2], axis=1)


def on_sphere(x, t):
    return np.stack([np.exp(-t) * x[:, 2], 1 + np.cos(t) * x[:, 0]], axis=1)


def source_on_sphere(x, t):
    u = on_sphere(x, t)
    change = np.stack([-u[:, 0], -np.sin(t) * x[:, 0]], axis=1)
    laplacian = np.stack([-2 * KAPPA[0] * u[:, 0], -2 * KAPPA[1] * (u[:, 1] - 1)], axis=1)
    return change - laplacian - exchange(u, x)


def on_circle(x, t):
    angle = np.arctan2(x[:, 1], x[:, 0]) % (2 * np.pi)
    return np.stack([2 + np.exp(-t) * np.cos(angle / 2), 1 + 0.5 * t * np.cos(angle / 2)], axis=1)


def source_on_circle(x, t):
    u = on_circle(x, t)
    angle = np.arctan2(x[:, 1], x[:, 0]) % (2 * np.pi)
    change = np.stack([2 - u[:, 0], 0.5 * np.cos(angle / 2)], axis=1)
    laplacian = np.stack([KAPPA[0] * (2 - u[:, 0]), KAPPA[1] * (1 - u[:, 1])], axis=1) / 4
    return change - laplacian - exchange(u, x)


def cut_circle(problem):
    at = ck.source("analytic.point", at=[1, 0])
    before = ck.Dirichlet([lambda x, t: 2 - np.exp(-t), lambda x, t: 1 - 0.5 * t])
    after = ck.Dirichlet([lambda x, t: 2 + np.exp(-t), lambda x, t: 1 + 0.5 * t])
    return ck.Scene(CIRCLE, problem, [ck.Boundary("cut", at, left=before, right=after)])


def arc(problem):
    return ck.Scene(ck.source("analytic.arc", start=0.3, end=4.0), problem, edge=ck.Dirichlet(on_circle))


CASES = {
    "sphere": (lambda problem: ck.Scene(SPHERE, problem), on_sphere, source_on_sphere, (0.3, 0.2, 0.15)),
    "cut circle": (cut_circle, on_circle, source_on_circle, (0.16, 0.08, 0.04)),
    "arc": (arc, on_circle, source_on_circle, (0.16, 0.08, 0.04)),
}
ANGLES = np.linspace(0.4, 3.9, 30)


def run(problem_args, spacing, step, scene=lambda problem: ck.Scene(SPHERE, problem), form="auto", **solving):
    given = {"reaction": exchange, "kappa": KAPPA, "until": 1.0, "step": step, **problem_args}
    return ck.solve(scene(ck.ReactionDiffusion(**given)), spacing, form=form, **solving)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("case", CASES)
def test_sbdf2_is_of_second_order_in_space_and_time(case, form):
    scene, exact, f, spacings = CASES[case]
    points = SPHERE.mesh(0.3)[0] if case == "sphere" else np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
    target = {"initial": lambda x: exact(x, 0.0), "f": f}
    runs = [run(target, h, h / 4, scene, form) for h in spacings]
    errors = [np.abs(one.evaluate(points) - exact(points, 1.0)).max() for one in runs]
    assert order_of(spacings, errors) > 1.75


def test_euler_is_of_first_order():
    points, steps = SPHERE.mesh(0.3)[0], (0.1, 0.05, 0.025)
    target = {"initial": lambda x: on_sphere(x, 0.0), "f": source_on_sphere, "scheme": "euler"}
    runs = [run(target, 0.3, step).evaluate(points) for step in steps]
    errors = [np.abs(one - on_sphere(points, 1.0)).max() for one in runs]
    assert 0.9 < order_of(steps, errors) < 1.2


def test_a_reaction_that_only_exchanges_keeps_the_total():
    solution = run({"initial": lambda x: 1 + 0.5 * x[:, :2], "frames": 4}, 0.3, 0.05)
    totals = [frame.totals.sum() for frame in solution.frames]
    assert abs(solution.frames[0].totals[0] - solution.totals[0]) > 0.1
    assert np.ptp(totals) < 1e-11 * totals[0]


def test_channels_of_equal_kappa_are_as_one_kappa():
    one, two = (run({"initial": lambda x: 1 + 0.5 * x[:, :2], "kappa": k}, 0.3, 0.1) for k in (0.2, [0.2, 0.2]))
    assert np.array_equal(one.values, two.values)


@pytest.mark.parametrize("form", FORMS)
def test_a_run_goes_on_bit_by_bit(tmp_path, form):
    path = tmp_path / "state.npz"
    target = {"initial": lambda x: on_sphere(x, 0.0), "reaction": lambda u, x, t: np.cos(t) * exchange(u, x)}
    whole = run(target, 0.4, 0.07, form=form)
    run({**target, "until": 0.49}, 0.4, 0.07, form=form, checkpoint=path)
    assert np.array_equal(run(target, 0.4, 0.07, form=form, resume=path).values, whole.values)
    with pytest.raises(ck.InputError, match="another run"):
        run({**target, "reaction": lambda u: 0 * u}, 0.4, 0.07, form=form, resume=path)


RING = ck.source("analytic.circle", center=[0, 0, 0.3], normal=[0, 0, 1], radius=0.91**0.5)
CONDITIONS = {
    "dirichlet": {"both": ck.Dirichlet(1.0)},
    "neumann": {"left": ck.Neumann(1.0), "right": ck.Neumann(0.5)},
    "robin": {"left": ck.Robin(2.0, 1.0, 0.3), "right": ck.Dirichlet(0.5)},
}


def ringed(channels, kappa, **conditions):
    start = ck.ReactionDiffusion(
        lambda x: np.stack([1 + 0.5 * x[:, 2] + 0.2 * x[:, 0]] * channels, axis=1),
        lambda u: 0 * u,
        kappa,
        until=0.2,
        step=0.05,
    )
    return ck.Scene(SPHERE, start, [ck.Boundary("ring", RING, **conditions)])


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", CONDITIONS)
def test_channels_that_do_not_react_are_as_each_alone(kind, form):
    together = ck.solve(ringed(2, KAPPA, **CONDITIONS[kind]), 0.4, form=form)
    alone = [ck.solve(ringed(1, kappa, **CONDITIONS[kind]), 0.4, form=form) for kappa in KAPPA]
    for k, one in enumerate(alone):
        assert np.abs(together.values[:, k] - one.values.ravel()).max() < 1e-9
        for side in ("left", "right"):
            assert together.flux("ring", side)[k] == pytest.approx(one.flux("ring", side), rel=1e-8, abs=1e-9)


def test_transmission_takes_one_kappa():
    contact = ck.Transmission(resistance=2.0)
    assert ringed(2, 0.1, across=contact).channels == ringed(2, [0.1, 0.1], across=contact).channels == 2
    with pytest.raises(ck.SceneError, match="one kappa for all channels, got 2 that differ"):
        ringed(2, KAPPA, across=contact)


def test_a_stiff_reaction_that_blows_up_reports_the_time_and_what_to_do():
    with pytest.raises(ck.ResolutionError, match=r"at time .*use a shorter step"):
        run({"initial": 2.0, "reaction": lambda u: -1000 * u**3, "kappa": 1.0}, 0.4, 0.1)
    with pytest.warns(ck.CpmkitWarning, match="swing back and forth"):
        run({"initial": 2.0, "reaction": lambda u: -100 * u, "kappa": 1.0, "until": 0.5}, 0.4, 0.1)


@pytest.mark.parametrize(
    ("wrong", "messages"),
    [
        ({"kappa": [0.1, -1.0]}, "kappa"),
        ({"kappa": [0.1, 0.2, 0.3]}, "3"),
        ({"reaction": 1.0}, "reaction"),
        ({"reaction": lambda u: u[:, :1]}, "shape"),
        ({"scheme": "bdf2"}, "sbdf2 or euler"),
        ({"reaction": lambda u: u / 0.0 * 0.0}, "finite"),
    ],
)
def test_what_is_no_reaction_diffusion_is_refused(wrong, messages):
    with pytest.raises(ck.CpmkitError, match=messages):
        run({"initial": lambda x: 1 + x[:, :2], **wrong}, 0.4, 0.1)


@pytest.mark.parametrize(
    ("form", "spacing", "advected", "too_short"), [("galerkin", 0.25, 7, 10), ("collocation", 0.15, 5, 8)]
)
def test_a_pattern_is_reported_where_its_waves_are_too_short_for_the_lattice(form, spacing, advected, too_short):
    for degree in (advected, too_short):
        waves = {"initial": lambda x, k=degree: ((x[:, 0] + 1j * x[:, 1]) ** k).real, "reaction": np.zeros_like}
        ended = run({**waves, "kappa": 1e-9, "until": 0.01}, spacing, 0.01, form=form)
        radians = spacing * np.sqrt(degree * (degree + 1))  # over a spacing
        assert (radians > ended.discretized.traits.dispersion.coarsest) == (degree == too_short)
        assert any("spacings long" in sentence for sentence in ended.warnings) == (degree == too_short)


def test_what_has_come_to_a_constant_is_no_pattern():
    grown = run(
        {"reaction": lambda u: u * (1 - u), "initial": lambda x: 0.5 + 1e-9 * x[:, 0] ** 11, "kappa": 1e-6}, 0.3, 0.1
    )
    assert not any("spacings long" in sentence for sentence in grown.warnings)
