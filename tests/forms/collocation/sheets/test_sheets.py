"""Several sheets of a surface in one band: each is solved as if the others were not there."""

import numpy as np
import pytest
from model_problems import max_error, order_of, sphere_points
from sheet_problems import circles, spiral
from thin_ellipsoid import odd_solution

import cpmkit as ck
from cpmkit.scenefile.look import Look
from cpmkit.view.drawing import draw_mesh

SPACINGS = (0.05, 0.035, 0.025)


@pytest.mark.parametrize("gap", [1, 2, 3, 5, 8, 10])
def test_two_circles(gap):
    """The outer one shrinks with the spacing; the order is that of the error on the inner one."""
    errors = []
    for h in SPACINGS:
        scene, points, exact = circles(gap * h)
        error = np.abs(ck.solve(scene, h, form="collocation").evaluate(points) - exact)
        assert error.max() <= 3e-3 * (h / 0.05) ** 2 * 1.2
        errors.append(error[:1000].max())
    assert order_of(SPACINGS, errors) >= 1.8


@pytest.mark.parametrize("gap", [1.5, 2, 4])
def test_a_spiral(gap):
    errors = [max_error(*spiral(gap * h), h, form="collocation") for h in SPACINGS]
    assert errors[-1] <= 2e-4
    assert order_of(SPACINGS, errors) >= 1.6


@pytest.mark.slow
def test_a_thin_smooth_ellipsoid():
    """Of axes 1 : 1 : 0.1, its upper and lower half two to six spacings apart, with u odd from one to the other."""
    scene, u = odd_solution(0.1)
    points = sphere_points(2000) * [1, 1, 0.1]
    spacings = (0.1, 0.07, 0.05)
    errors = [max_error(scene, points, u(points), h, form="collocation") for h in spacings]
    assert errors[-1] <= 4e-3
    assert order_of(spacings, errors) >= 1.8
    plain = ck.solve(scene, spacings[0], sheets=False).evaluate(points) - u(points)
    assert np.abs(plain).max() >= 0.5


def test_a_band_without_conflict_has_no_table():
    """A torus with a curve: nothing is built, nothing is counted."""
    circle = ck.source("analytic.circle", center=[0, 0, 0.45], normal=[0, 0, 1], radius=1.0)
    torus = ck.source("analytic.torus", major=1.0, minor=0.45)
    scene = ck.Scene(torus, ck.Laplace(), [ck.Boundary("top", circle, both=ck.Dirichlet(1.0))])
    layout = ck.solve(scene, 0.1, form="collocation").discretized.tables.layout
    assert layout.band.sheets is None
    assert all(one.sheets is None for one in layout.boundaries.on_lattice)


def test_an_explanation_names_the_twins():
    scene, _, _ = circles(0.05)
    explanation = ck.explain(scene, 0.025, form="collocation", dry_run=True)
    band = ck.solve(scene, 0.025, form="collocation").discretized.tables.layout.band
    (twins,) = [part for part in explanation.parts if part.name == "twins"]
    assert int(twins.amount.replace(",", "")) == band.inner - band.own_inner > 100
    assert explanation.unknowns == band.inner
    assert "twins" not in str(ck.explain(circles(0.5)[0], 0.025, dry_run=True))


def test_a_picture_can_show_the_twins():
    solution = ck.solve(circles(0.05)[0], 0.025, form="collocation")
    band = solution.discretized.tables.layout.band
    assert len(solution.doubled) == band.inner - band.own_inner > 100
    on_either = np.abs(np.hypot(*solution.doubled.T)[:, None] - [1, 1.05]).min(axis=1)
    assert on_either.max() <= 1e-12
    mesh = solution.display_mesh()
    shown, bare = (draw_mesh(solution, mesh, Look(twins=twins), 400, False).ink.points for twins in (True, False))
    assert len(shown) == 24 * len(solution.doubled)
    assert not len(bare)


def test_the_plain_method_mixes_sheets_and_can_be_selected(tmp_path):
    scene, points, exact = circles(0.05)
    plain = ck.solve(scene, 0.025, sheets=False)
    assert np.abs(plain.evaluate(points) - exact).max() > 1
    assert plain.discretized.tables.layout.band.sheets is None
    plain.save(tmp_path / "plain.npz")
    assert (ck.load(tmp_path / "plain.npz", scene).values == plain.values).all()
    with pytest.raises(ck.InputError, match="sheets must be true or false, got "):
        ck.solve(scene, 0.025, sheets="no")


def test_a_cut_in_one_circle_is_not_seen_by_the_other():
    """Jumping data on the inner circle, two spacings away from the outer one; each side keeps its own."""
    for h in (0.05, 0.035):
        scene, points, exact = circles(2 * h)
        cut = ck.source("analytic.point", at=[np.cos(0.7), np.sin(0.7)])
        at = np.sin(1.4)
        boundary = ck.Boundary("cut", cut, left=ck.Dirichlet(at), right=ck.Dirichlet(at))
        cut_scene = ck.Scene(scene.surface, scene.problem, [boundary])
        assert max_error(cut_scene, points, exact, h, form="collocation") <= 4e-3 * (h / 0.05) ** 2
        jump = ck.Boundary("cut", cut, left=ck.Dirichlet(at + 5), right=ck.Dirichlet(at - 5))
        values = ck.solve(ck.Scene(scene.surface, scene.problem, [jump]), h, form="collocation").evaluate(points)
        assert np.abs(values - exact)[1000:].max() <= 4e-3 * (h / 0.05) ** 2
        assert np.abs(values - exact)[:1000].max() >= 4
