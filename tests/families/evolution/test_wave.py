"""Waves: second order, reflection at conditions, bounded for long times, refused where they would grow."""

import numpy as np
import pytest
from model_problems import angle_after, on_circle, order_of, sphere_points

import cpmkit as ck

THETA_C = 1.022 * np.pi
SPACINGS = (0.15, 0.1, 0.05)
LONG, SHORT = 20.0, 5.0
travelled = angle_after(THETA_C, (0.0, 0.0))


def theta(x):
    return np.arctan2(x[:, 1], x[:, 0])


def cut_circle(wave, condition):
    at = on_circle(np.array([THETA_C]))[0]
    boundary = ck.Boundary("cut", ck.source("analytic.point", at=at), both=condition)
    return ck.Scene(ck.source("analytic.circle"), wave, [boundary])


def arc(wave, edge):
    return ck.Scene(ck.source("analytic.arc", center=(0, 0), start=0.3, end=2.7), wave, edge=edge)


def errors(make, points, exact, spacings, courant, **options):
    """Errors at the end of ``make(step)``, with steps of ``courant`` spacings."""
    return [np.abs(ck.solve(make(courant * h), h, **options).evaluate(points) - exact).max() for h in spacings]


S = np.linspace(1e-6, 2 * np.pi - 1e-6, 1000)
AROUND = on_circle(THETA_C + S)
REFLECTED = {
    "Dirichlet": (np.sin, ck.Dirichlet(0.0)),
    "Neumann": (np.cos, ck.Neumann(0.0)),
}


@pytest.mark.parametrize(("scheme", "bound"), [("leapfrog", 1.2e-2), ("newmark", 4e-3), ("implicit", 1.5e-2)])
def test_a_travelling_wave(scheme, bound):
    end = LONG if scheme == "leapfrog" else SHORT

    def make(step):
        return ck.Scene(
            ck.source("analytic.circle"),
            ck.Wave(
                lambda x: np.cos(2 * theta(x)),
                until=end,
                step=step,
                initial_rate=lambda x: 2 * np.sin(2 * theta(x)),
                scheme=scheme,
            ),
        )

    found = errors(make, AROUND, np.cos(2 * (theta(AROUND) - end)), SPACINGS, 0.5)
    assert order_of(SPACINGS, found) >= 1.9
    assert found[-1] <= bound


@pytest.mark.parametrize("name", REFLECTED)
@pytest.mark.parametrize(("scheme", "bound"), [("leapfrog", 5e-3), ("newmark", 1.6e-3), ("implicit", 5e-3)])
def test_waves_are_reflected_at_a_cut(name, scheme, bound):
    shape, condition = REFLECTED[name]
    end = LONG if scheme == "leapfrog" else SHORT

    def make(step):
        wave = ck.Wave(lambda x: shape(1.5 * travelled(x)), until=end, step=step, scheme=scheme)
        return cut_circle(wave, condition)

    found = errors(make, AROUND, shape(1.5 * S) * np.cos(1.5 * end), SPACINGS, 0.5)
    assert order_of(SPACINGS, found) >= 1.7
    assert found[-1] <= bound


@pytest.mark.parametrize("scheme", ["leapfrog", "newmark", "implicit"])
@pytest.mark.parametrize("kind", ["Dirichlet", "Neumann"])
def test_ends_that_move(kind, scheme):
    """u = sin 2 (theta - t) / 2 of speed 1 in spite of the ends, which move as it does; speed^2 = 4 needs a source."""

    def u(x, t):
        return np.sin(2 * (theta(x) - t)) / 2

    def slope(t, angle):
        return np.cos(2 * (angle - t))

    edges = {
        "Dirichlet": ck.Dirichlet(u),
        "Neumann": {0: ck.Neumann(lambda x, t: -slope(t, 0.3)), 1: ck.Neumann(lambda x, t: slope(t, 2.7))},
    }

    def make(step):
        wave = ck.Wave(
            lambda x: u(x, 0.0),
            until=2.5,
            step=step,
            initial_rate=lambda x: -np.cos(2 * theta(x)),
            speed=2.0,
            f=lambda x, t: 12 * u(x, t),
            scheme=scheme,
        )
        return arc(wave, edges[kind])

    points = on_circle(np.linspace(0.3, 2.7, 1000))
    found = errors(make, points, u(points, 2.5), SPACINGS, 0.25)
    assert order_of(SPACINGS, found) >= 1.7
    assert found[-1] <= 5e-3


@pytest.mark.parametrize("scheme", ["leapfrog", "newmark", "implicit"])
def test_the_sphere(scheme):
    points, spacings = sphere_points(500), (0.3, 0.25, 0.18)

    def make(step):
        return ck.Scene(ck.source("analytic.sphere"), ck.Wave(lambda x: x[:, 2], until=1.5, step=step, scheme=scheme))

    found = errors(make, points, points[:, 2] * np.cos(1.5 * np.sqrt(2)), spacings, 0.4)
    assert order_of(spacings, found) >= 1.6
    assert found[-1] <= 2e-2


def noise(x):
    """Rough data, other at every node."""
    return np.sin(1e4 * x[:, 0]) * np.cos(1.7e4 * x[:, 1])


@pytest.mark.parametrize(
    ("scheme", "courant", "degree"),
    [("leapfrog", 0.6, 3), ("leapfrog", 0.1, 3), ("leapfrog", 0.6, 5), ("implicit", 0.3, 2), ("implicit", 0.5, 4)],
)
@pytest.mark.parametrize("name", ["closed", "Dirichlet", "Neumann", "ends"])
def test_rough_data_stay_bounded(scheme, courant, degree, name):
    """Undamped, they grow by factors of thirty to 1e8 in this time, as the spacing and the origin have it."""
    wave = ck.Wave(noise, until=50.0, step=0.1 * courant, scheme=scheme)
    scenes = {
        "closed": ck.Scene(ck.source("analytic.circle"), wave),
        "Dirichlet": cut_circle(wave, ck.Dirichlet(0.0)),
        "Neumann": cut_circle(wave, ck.Neumann(0.0)),
        "ends": arc(wave, ck.Dirichlet(0.0)),
    }
    solution = ck.solve(scenes[name], 0.1, degree=degree, origin=[0.013, 0.021])
    assert np.abs(solution.values).max() <= 3.0


def test_without_damping_leapfrog_grows(monkeypatch):
    monkeypatch.setattr("cpmkit.families.evolution.stepping.LEAPFROG_DAMPING", 0.0)
    wave = ck.Wave(noise, until=60.0, step=0.05, scheme="leapfrog")
    with pytest.raises(ck.ResolutionError, match="The solution grows without a cause: at time"):
        ck.solve(arc(wave, ck.Dirichlet(0.0)), 0.1, origin=[0.013, 0.021])
    wave = ck.Wave(noise, until=3.0, step=0.05, scheme="leapfrog")
    solution = ck.solve(arc(wave, ck.Dirichlet(0.0)), 0.1, origin=[0.013, 0.021])
    assert any("waves of two spacings" in messages for messages in solution.warnings)


def test_the_longest_accepted_step_is_stable_in_the_plane_and_in_space():
    """A solid has the largest eigenvalues."""
    wave = ck.Wave(noise, until=30.0, step=0.2 * 0.85 / np.sqrt(2), scheme="leapfrog")
    box = ck.source("analytic.box", lower=[-1, -1], upper=[1, 1])
    assert np.abs(ck.solve(ck.Scene(box, wave), 0.2).values).max() <= 3.0
    wave = ck.Wave(noise, until=30.0, step=0.25 * 0.85 / np.sqrt(3), scheme="leapfrog")
    for surface in (ck.source("analytic.sphere"), ck.source("analytic.box", lower=[-1] * 3, upper=[1] * 3)):
        assert np.abs(ck.solve(ck.Scene(surface, wave), 0.25).values).max() <= 3.0


def test_what_would_grow_is_refused():
    circle = ck.source("analytic.circle")

    def solve(scheme="leapfrog", step=0.05, **options):
        wave = ck.Wave(noise, until=1.0, step=step, scheme=scheme)
        return ck.solve(cut_circle(wave, ck.Dirichlet(0.0)), 0.1, form="collocation", **options)

    for degree in (2, 4):
        with pytest.raises(ck.InputError, match=f"degree={degree} does not go with leapfrog: .* complex eigenvalues"):
            solve(degree=degree)
    with pytest.raises(ck.ResolutionError, match=r"step=0.0602 is too long for leapfrog .* at most 0\.0601"):
        solve(step=0.0602)
    with pytest.raises(ck.ResolutionError, match=r"step=0\.01 is too short for the implicit scheme.* at least 0\.03"):
        solve("implicit", step=0.01)
    with pytest.raises(ck.SceneError, match=r"no undamped steps, .* scheme 'leapfrog' or 'implicit', or the form"):
        solve("newmark")
    with pytest.raises(ck.InputError, match="auto or newmark or implicit or leapfrog, got 'bdf2'"):
        ck.Scene(circle, ck.Wave(noise, until=1.0, step=0.1, scheme="bdf2"))
    with pytest.raises(ck.InputError, match="speed of wave"):
        ck.Wave(noise, until=1.0, step=0.1, speed=0.0)
