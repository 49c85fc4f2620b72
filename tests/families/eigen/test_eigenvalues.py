"""Eigenvalues of -Lap are the exact ones, to second order by collocation and to fourth in the Galerkin form.

None is missed or made up, and functions belong to them.
"""

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner
from model_problems import on_circle, order_of, origins, rotation, sphere_points
from scipy.optimize import brentq

import cpmkit as ck
from cpmkit.cli import main

CIRCLE = ck.source("analytic.circle", center=(0, 0))
SPHERE = ck.source("analytic.sphere")
CUT = ck.source("analytic.point", at=on_circle(np.array([1.022 * np.pi]))[0])


#: By form, what an order that is fitted to three spacings exceeds.
ORDERS = {"collocation": 1.8, "galerkin": 3.4}
forms = pytest.mark.parametrize("form", ORDERS)
dear_forms = pytest.mark.parametrize("form", [pytest.param("collocation", marks=pytest.mark.slow), "galerkin"])


def great_circle(**sides):
    circle = ck.source("analytic.circle", center=[0, 0, 0], radius=1.0, normal=rotation()[0])
    return ck.Boundary("circle", circle, **sides)


def errors_of(scene, exact, spacings, **options):
    """The largest error of an eigenvalue, at each spacing."""
    return [np.abs(ck.solve(scene, h, **options).eigenvalues - exact).max() for h in spacings]


CURVES = {
    "circle": (CIRCLE, [], ck.Neumann(), [0, 1, 1, 4, 4, 9, 9, 16, 16, 25, 25, 36]),
    "cut, Dirichlet": (CIRCLE, [ck.Boundary("cut", CUT, both=ck.Dirichlet(0))], ck.Neumann(), np.arange(1, 8) ** 2 / 4),
    "cut, Dirichlet and Neumann": (
        CIRCLE,
        [ck.Boundary("cut", CUT, left=ck.Dirichlet(0.0), right=ck.Neumann())],
        ck.Neumann(),
        np.arange(1, 12, 2) ** 2 / 16,
    ),
    "arc": (
        ck.source("analytic.arc", center=(0, 0), start=0.3, end=2.7),
        [],
        {0: ck.Dirichlet(0), 1: ck.Neumann(0)},
        (np.arange(1, 12, 2) * np.pi / 4.8) ** 2,
    ),
}


@forms
@pytest.mark.parametrize("name", CURVES)
def test_curves(name, form):
    surface, boundaries, edge, exact = CURVES[name]
    scene = ck.Scene(surface, ck.Eigen(count=len(exact)), boundaries, edge=edge)
    spacings = (0.1, 0.05, 0.025)
    errors = errors_of(scene, exact, spacings, form=form)
    assert errors[-1] <= (2e-3 if form == "collocation" else 1e-5) * exact[-1]
    assert order_of(spacings, errors) >= ORDERS[form]


@forms
def test_a_robin_condition_moves_eigenvalues(form):
    """On a bar of length 1 with du/db + u = 0 at both ends, lambda = w^2 with tan(w) = 2 w / (w^2 - 1)."""
    bar = ck.source("analytic.segment", start=[0, 0.3], end=[1, 0.3])
    scene = ck.Scene(bar, ck.Eigen(count=3), edge=ck.Robin(1.0, 1.0, 0.0))
    exact = np.array([1.30654237418881, 3.67319440630425, 6.58462004256417]) ** 2
    spacings = (0.1, 0.05, 0.025)
    errors = errors_of(scene, exact, spacings, form=form)
    assert errors[-1] <= (1e-2 if form == "collocation" else 1e-5) * exact[-1]
    assert order_of(spacings, errors) >= ORDERS[form]


def test_a_condition_that_feeds_brings_eigenvalues_below_zero_and_the_least_are_found():
    """On a bar of length 1 with du/db = 30 u at its ends, lambda = -w^2 with w tanh(w / 2) = 30, or w / tanh(w / 2)."""
    bar = ck.source("analytic.segment", start=[0, 0.3], end=[1, 0.3])
    scene = ck.Scene(bar, ck.Eigen(count=3), edge=ck.Robin(1.0, -30.0, 0.0))
    exact = [
        -(brentq(lambda w: w * np.tanh(w / 2) - 30, 1, 60) ** 2),
        -(brentq(lambda w: w / np.tanh(w / 2) - 30, 3, 60) ** 2),
        brentq(lambda w: np.tan(w / 2) * w + 30, np.pi + 1e-6, 2 * np.pi - 1e-6) ** 2,
    ]
    found = ck.solve(scene, 0.01).eigenvalues
    assert found == pytest.approx(exact, rel=2e-3)


@forms
def test_a_resistance_between_two_sides(form):
    """A bar from -1 to 1 with the resistance R at 0: even modes do not feel it, odd ones have w tan(w) = 2 / R."""
    bar, middle = ck.source("analytic.segment", start=[-1, 0.3], end=[1, 0.3]), ck.source("analytic.point", at=[0, 0.3])
    coupling = ck.Boundary("middle", middle, across=ck.Transmission(resistance=0.5))
    odd = [brentq(lambda w: w * np.tan(w) - 4, k * np.pi + 1e-9, (k + 0.5) * np.pi - 1e-9) for k in range(2)]
    exact = np.sort([0, np.pi**2, *np.square(odd)])
    spacings = (0.1, 0.05, 0.025)
    errors = errors_of(ck.Scene(bar, ck.Eigen(count=4), [coupling]), exact, spacings, form=form)
    assert errors[-1] <= (1e-2 if form == "collocation" else 1e-5) * exact[-1]
    assert order_of(spacings, errors) >= ORDERS[form]


@forms
def test_rows_21_sphere(form):
    exact = np.array([0, 2, 2, 2, 6, 6, 6, 6, 6, 12, 12, 12])
    scene, spacings = ck.Scene(SPHERE, ck.Eigen(count=12)), (0.3, 0.25, 0.18)
    found = [ck.solve(scene, h, form=form).eigenvalues for h in spacings]
    assert np.abs(found[-1][1:4] - 2).max() <= 0.01 * 2
    assert np.abs(found[-1][4:9] - 6).max() <= 0.02 * 6
    for two in (1, 4):
        assert order_of(spacings, [np.abs(one - exact)[two] for one in found]) >= ORDERS[form]


@forms
@pytest.mark.parametrize(
    ("edge", "exact", "share"),
    [
        (ck.Neumann(), [0, 2, 2, 6, 6, 6], {"collocation": 0.006, "galerkin": 1e-4}),
        (ck.Dirichlet(0), [2, 6, 6, 12, 12, 12], {"collocation": 0.006, "galerkin": 1e-4}),
    ],
)
def test_row_22_hemisphere(edge, exact, share, form):
    spacings = (0.2, 0.125, 0.1)
    scene = ck.Scene(ck.source("analytic.cap"), ck.Eigen(), edge=edge)
    errors = [np.abs(ck.solve(scene, h, form=form).eigenvalues - exact) for h in spacings]
    assert np.all(errors[1][1:] <= share[form] * np.asarray(exact[1:]))
    assert order_of(spacings, [error.max() for error in errors]) >= ORDERS[form]


@dear_forms
def test_a_sphere_cut_into_a_dirichlet_and_a_neumann_half(form):
    scene = ck.Scene(SPHERE, ck.Eigen(count=9), [great_circle(left=ck.Dirichlet(0), right=ck.Neumann(0))])
    spacings, exact = (0.25, 0.2, 0.14), np.array([0, 2, 2, 2, 6, 6, 6, 6, 6])
    assert order_of(spacings, errors_of(scene, exact, spacings, form=form)) >= ORDERS[form]
    solution = ck.solve(scene, 0.2, form=form)
    height = sphere_points(200) @ rotation()[0]
    constant = solution.evaluate(sphere_points(200))[:, 0]
    assert np.abs(constant[height > 0.05]).max() <= 1e-10
    assert np.ptp(constant[height < -0.05]) <= 1e-10


@forms
def test_no_eigenvalue_is_missed_or_made_up_at_any_position_of_the_lattice(form):
    exact = np.repeat([0, 2, 6, 12], [1, 3, 5, 7])
    for origin in origins(3)[:2]:
        solution = ck.solve(ck.Scene(SPHERE, ck.Eigen(count=16)), 0.25, origin=0.25 * origin, form=form)
        assert np.abs(solution.eigenvalues - exact).max() <= (0.03 if form == "collocation" else 2e-3) * 12
        assert not solution.imaginary.any()


@forms
def test_eigenfunctions_belong_to_their_values(form):
    solution = ck.solve(ck.Scene(SPHERE, ck.Eigen(count=4)), 0.2, form=form)
    points = sphere_points(400)
    values = solution.evaluate(points)
    assert solution.channels == 4
    assert np.abs(values[:, 0] - 1).max() <= 1e-8
    span = np.linalg.lstsq(points, values[:, 1:], rcond=None)[0]
    assert np.abs(points @ span - values[:, 1:]).max() <= 2e-2
    assert np.mean(values**2, axis=0) == pytest.approx(1.0, rel=2e-2)
    assert np.abs(values[:, 1:].T @ values[:, 1:] / 400 - np.eye(3)).max() <= 2e-2


@forms
def test_the_same_scene_gives_the_same_functions(form):
    scene = ck.Scene(CIRCLE, ck.Eigen(count=5))
    first, second = (ck.solve(scene, 0.1, form=form).values for _ in range(2))
    assert np.array_equal(first, second)


@forms
def test_each_pair_is_judged(form):
    scene = ck.Scene(CIRCLE, ck.Eigen(count=5))
    solution = ck.solve(scene, 0.1, form=form)
    assert solution.report.residual == solution.residuals.max() <= 1e-10
    exact = ck.solve(scene, 0.1, solver_tolerance=1e-17, form=form)  # what rounding leaves is accepted
    assert exact.report.converged
    assert exact.residuals.max() < 1e-12


@forms
def test_those_near_a_number(form):
    solution = ck.solve(ck.Scene(CIRCLE, ck.Eigen(count=4, near=12.0)), 0.05, form=form)
    assert solution.eigenvalues == pytest.approx([9, 9, 16, 16], rel=2e-3)
    at_one = ck.solve(ck.Scene(CIRCLE, ck.Eigen(count=3, near=1.0)), 0.05, form=form)
    assert at_one.eigenvalues == pytest.approx([0, 1, 1], abs=1e-3)


@forms
def test_the_iterative_solver_finds_the_same(form):
    scene = ck.Scene(SPHERE, ck.Eigen(count=4))
    iterative = "reference" if form == "collocation" else "multigrid"
    found = [ck.solve(scene, 0.4, solver=solver, form=form).eigenvalues for solver in ("direct", iterative)]
    assert found[0] == pytest.approx(found[1], abs=1e-7)


@forms
def test_diffusivity_and_potential_take_part(form):
    """-u'' + (4 cos 2 x - 2) u = lambda u is Mathieu's equation with q = 2; its first values are a0, b1, a1 less 2."""
    scene = ck.Scene(CIRCLE, ck.Eigen(count=3, c=lambda x: 4 * (x[:, 0] ** 2 - x[:, 1] ** 2) - 2))
    exact = np.array([-1.513956885056520, -1.390676501225319, 2.379199880488686]) - 2
    spacings = (0.1, 0.05, 0.025)
    errors = errors_of(scene, exact, spacings, form=form)
    assert errors[-1] <= 2e-3
    assert order_of(spacings, errors) >= ORDERS[form]
    doubled = ck.solve(ck.Scene(CIRCLE, ck.Eigen(count=3, diffusivity=lambda x: 2 + 0 * x[:, 0])), 0.05, form=form)
    assert doubled.eigenvalues == pytest.approx([0, 2, 2], abs=2e-3)


@forms
def test_units_change_nothing(form):
    values = []
    for radius in (1e-6, 1.0, 1e6):
        scene = ck.Scene(ck.source("analytic.circle", radius=radius), ck.Eigen(count=5))
        values.append(ck.solve(scene, 0.1 * radius, form=form).eigenvalues * radius**2)
    assert values[0] == pytest.approx(values[1], abs=1e-9)
    assert values[2] == pytest.approx(values[1], abs=1e-9)


def test_what_is_written(tmp_path):
    solution = ck.solve(ck.Scene(CIRCLE, ck.Eigen(count=3)), 0.1)
    solution.save(tmp_path / "modes.json")
    messages = json.loads((tmp_path / "modes.json").read_text())
    assert messages["eigenvalues"] == solution.eigenvalues.tolist()
    assert messages["residuals"] == solution.residuals.tolist()
    assert messages["scene"]["problem"]["equation"] == "-Lap u = lambda u"
    solution.save(tmp_path / "modes.npz")
    assert np.load(tmp_path / "modes.npz")["lattice_eigenvalues"].shape == (3,)
    assert "eigenvalues" in repr(solution)


@pytest.mark.parametrize("condition", [ck.Dirichlet(1.0), ck.Neumann(lambda x: x[:, 0]), ck.Robin(1.0, 1.0, [0, 2])])
def test_data_that_are_not_zero_are_refused(condition):
    with pytest.raises(ck.SceneError, match="'cut' has data where an eigenvalue problem takes zero"):
        ck.Scene(CIRCLE, ck.Eigen(), [ck.Boundary("cut", CUT, left=ck.Dirichlet(0), right=condition)])


@pytest.mark.parametrize("keys", [{"count": 0}, {"count": 2.0}, {"count": True}, {"near": np.nan}, {"diffusivity": -1}])
def test_wrong_arguments_are_refused(keys):
    with pytest.raises(ck.InputError, match=f"^{next(iter(keys))} of eigen"):
        ck.Eigen(**keys)


def test_more_eigenvalues_than_unknowns_are_refused():
    with pytest.raises(ck.InputError, match="count=500 is more than the 200 eigenvalues"):
        ck.solve(ck.Scene(CIRCLE, ck.Eigen(count=500)), 0.1)


def test_the_command_line_prints_eigenvalues(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "modes.toml").write_text(
        '[surface]\nkind = "analytic.circle"\n[problem]\nkind = "eigen"\ncount = 3\n[discretization]\nspacing = 0.1\n'
    )
    done = CliRunner().invoke(main, ["solve", "modes.toml"])
    assert done.exit_code == 0, done.output
    assert re.search(r"^eigenvalues \S+, 1(\.0000\d+)?, 1(\.0000\d+)?$", done.stdout, re.MULTILINE), done.stdout
