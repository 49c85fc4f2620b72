"""Steklov eigenvalues, du/db = lambda u at an edge or on sides of a curve, are the exact ones, in either form."""

import numpy as np
import pytest
from model_problems import order_of, rotation

import cpmkit as ck

#: By form, what an order that is fitted to three spacings exceeds.
ORDERS = {"collocation": 1.7, "galerkin": 3.4}
forms = pytest.mark.parametrize("form", ORDERS)
dear_forms = pytest.mark.parametrize("form", [pytest.param("collocation", marks=pytest.mark.slow), "galerkin"])
DISC = ck.source("solid", of=ck.source("analytic.circle", center=(0, 0)))
SPHERE = ck.source("analytic.sphere")


def great_circle(**sides):
    circle = ck.source("analytic.circle", center=[0, 0, 0], radius=1.0, normal=rotation()[0])
    return ck.Boundary("circle", circle, **sides)


def errors_of(scene, exact, spacings, **options):
    return [np.abs(ck.solve(scene, h, **options).eigenvalues - exact).max() for h in spacings]


@pytest.mark.parametrize("form", ["galerkin"])
def test_the_ends_of_a_segment_have_two(form):
    """Linear functions: 0, and 2 over the length; lambda stands in the conditions of two points alone."""
    segment = ck.source("analytic.segment", start=[0, 0], end=[3, 4])
    scene = ck.Scene(segment, ck.Eigen(count=2), edge=ck.Steklov())
    np.testing.assert_allclose(ck.solve(scene, 0.5, form=form).eigenvalues, [0, 2 / 5], atol=1e-9)
    with pytest.raises(ck.InputError, match="count=3 is more than the 2 eigenvalues that there are"):
        ck.solve(ck.Scene(segment, ck.Eigen(count=3), edge=ck.Steklov()), 0.5, form=form)


def test_disc():
    """r^m cos(m phi) has lambda = m."""
    scene = ck.Scene(DISC, ck.Eigen(count=7), edge=ck.Steklov())
    spacings = (0.1, 0.05, 0.025)
    errors = errors_of(scene, [0, 1, 1, 2, 2, 3, 3], spacings)
    assert errors[-1] <= 5e-4
    assert order_of(spacings, errors) >= 1.8


def test_first_order():
    spacings = (0.1, 0.05, 0.025)
    errors = errors_of(ck.Scene(DISC, ck.Eigen(count=5), edge=ck.Steklov()), [0, 1, 1, 2, 2], spacings, order=1)
    assert 0.7 <= order_of(spacings, errors) <= 1.6


@forms
@pytest.mark.parametrize("height", [0.0, 0.35])
def test_caps(height, form):
    """tan(theta / 2)^m cos(m phi) has lambda = m / sin(theta) at the rim; rms over places of the rim in its cells."""
    exact = np.array([0, 1, 1, 2, 2, 3, 3]) / np.sqrt(1 - height**2)
    scene = ck.Scene(ck.source("analytic.cap", height=height), ck.Eigen(count=7), edge=ck.Steklov())
    spacings = (0.3, 0.25, 0.2)
    errors = []
    for h in spacings:
        places = [errors_of(scene, exact, [h], origin=[0, 0, height + k / 2 * h], form=form)[0] for k in range(2)]
        errors.append(np.sqrt(np.mean(np.square(places))))
    assert errors[-1] <= (0.1 if form == "collocation" else 2e-3)
    assert order_of(spacings, errors) >= ORDERS[form]


@dear_forms
def test_both_sides_of_a_curve(form):
    scene = ck.Scene(SPHERE, ck.Eigen(count=10), [great_circle(both=ck.Steklov())])
    spacings = (0.25, 0.18, 0.125) if form == "collocation" else (0.3, 0.25, 0.18)
    errors = errors_of(scene, [0, 0, 1, 1, 1, 1, 2, 2, 2, 2], spacings, form=form)
    assert errors[-1] <= (5e-3 if form == "collocation" else 2e-4)
    assert order_of(spacings, errors) >= ORDERS[form]


@dear_forms
def test_one_side_of_a_curve_and_a_dirichlet_curve_elsewhere(form):
    """Between latitudes, with u = 0 at the upper, lambda = m coth(m t), t the change of log tan(theta / 2)."""
    lower, upper = np.arccos(0.0), np.arccos(0.8)
    ring = ck.source("analytic.circle", center=[0, 0, 0.8], radius=0.6, normal=[0, 0, 1])
    equator = ck.source("analytic.circle", center=[0, 0, 0], radius=1.0, normal=[0, 0, 1])
    boundaries = [
        ck.Boundary("ring", ring, both=ck.Dirichlet(0)),
        ck.Boundary("equator", equator, left=ck.Steklov(), right=ck.Dirichlet(0)),
    ]
    t = np.log(np.tan(lower / 2) / np.tan(upper / 2))
    exact = [1 / t] + [m / np.tanh(m * t) for m in (1, 1, 2, 2)]
    spacings = (0.25, 0.2, 0.16)
    errors = errors_of(ck.Scene(SPHERE, ck.Eigen(count=5), boundaries), exact, spacings, form=form)
    assert errors[-1] <= (0.07 if form == "collocation" else 2e-4)
    assert order_of(spacings, errors) >= ORDERS[form]


def test_functions_are_constant_and_linear_on_the_disc():
    solution = ck.solve(ck.Scene(DISC, ck.Eigen(count=3), edge=ck.Steklov()), 0.05)
    points = np.random.default_rng(1).uniform(-0.7, 0.7, (200, 2))
    values = solution.evaluate(points)
    assert np.abs(values[:, 0] - 1).max() <= 1e-9
    span = np.linalg.lstsq(points, values[:, 1:], rcond=None)[0]
    assert np.abs(points @ span - values[:, 1:]).max() <= 1e-3


@forms
def test_a_piece_without_lambda_is_refused(form):
    boundaries = [great_circle(left=ck.Steklov(), right=ck.Neumann())]
    with pytest.raises(ck.SceneError, match="there every lambda is an eigenvalue"):
        ck.solve(ck.Scene(SPHERE, ck.Eigen(), boundaries), 0.25, form=form)


def test_only_an_eigenvalue_problem_takes_it():
    with pytest.raises(ck.SceneError, match="the edge's condition: 'steklov' has a lambda"):
        ck.Scene(DISC, ck.ScreenedPoisson(1.0), edge=ck.Steklov())


def test_a_scene_file_holds_it(tmp_path):
    text = """
    [surface]
    kind = "analytic.cap"
    edge = {{ steklov = {} }}
    [problem]
    kind = "eigen"
    count = 3
    """
    (tmp_path / "scene.toml").write_text(text.format("true"))
    assert ck.solve(ck.load_scene(tmp_path / "scene.toml").scene, 0.2).eigenvalues == pytest.approx([0, 1, 1], abs=5e-3)
    (tmp_path / "scene.toml").write_text(text.format("1.0"))
    with pytest.raises(ck.SceneError, match="steklov of edge must be true"):
        ck.load_scene(tmp_path / "scene.toml")
