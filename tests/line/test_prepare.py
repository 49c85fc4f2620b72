"""Tables once, many equations and right-hand sides: each answer is that of a solve of its own, bit by bit."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from counted_calls import counted_calls
from model_problems import sphere_points

import cpmkit as ck
from cpmkit.plugin import Condition, Mixed

SPHERE = ck.source("analytic.sphere")
POINTS = sphere_points(30)


def circle(normal):
    return ck.source("analytic.circle", normal=normal)


def product(x):
    return x[:, 0] * x[:, 1]


def scene(problem, left, right):
    return ck.Scene(SPHERE, problem, [ck.Boundary("equator", circle([0, 0, 1]), left=left, right=right)])


@cache
def prepared_by(form):
    return ck.prepare(scene(ck.Laplace(), ck.Dirichlet(1.0), ck.Robin(1.0, 2.0, 0.3)), 0.3, form=form)


@pytest.fixture(scope="module")
def prepared():
    return prepared_by("collocation")


CASES = {
    "another equation": (ck.ScreenedPoisson(product), 1.0, 0.3),
    "other data": (ck.Laplace(), 2.0, product),
    "channels": (ck.Poisson([product, 1.0]), [1.0, 2.0], 0.3),
    "coefficients": (ck.Elliptic(product, diffusivity=lambda x: 2 + x[:, 2], c=1.0), product, 0.0),
    "heat": (ck.Heat(product, until=0.1, step=0.05), 0.0, 0.0),
    "heat with data in time": (ck.Heat(0.0, until=0.1, step=0.05), lambda x, *, t: t + 0 * x[:, 0], 0.0),
    "wave": (ck.Wave(product, until=0.2, step=0.08), 0.0, 0.0),
    "eigenvalues": (ck.Eigen(3), 0.0, 0.0),
}


@pytest.mark.parametrize("name", [name for name, (problem, *_) in CASES.items() if problem.family == "steady"])
def test_so_it_is_in_the_galerkin_form(name):
    problem, value, gamma = CASES[name]
    sides = {"left": ck.Dirichlet(value), "right": ck.Robin(1.0, 2.0, gamma)}
    own = ck.solve(scene(problem, **sides), 0.3)
    prepared = prepared_by("auto")
    assert prepared.discretized.form == "galerkin"
    target = prepared.discretized.sampled.queries
    again = prepared.solve(problem=problem, data={"equator": sides})
    np.testing.assert_array_equal(again.values, own.values)
    np.testing.assert_array_equal(again.evaluate(POINTS, side="left"), own.evaluate(POINTS, side="left"))
    assert again.warnings == own.warnings
    assert prepared.discretized.sampled.queries - target <= 8 * len(POINTS)
    assert again.discretized.space is prepared.discretized.space


@pytest.mark.parametrize("name", CASES)
def test_each_answer_is_that_of_a_solve_of_its_own(prepared, name):
    problem, value, gamma = CASES[name]
    sides = {"left": ck.Dirichlet(value), "right": ck.Robin(1.0, 2.0, gamma)}
    own = ck.solve(scene(problem, **sides), 0.3, form="collocation")
    target = prepared.discretized.tables.layout.queries["equator"]
    again = prepared.solve(problem=problem, data={"equator": sides})
    np.testing.assert_array_equal(again.values, own.values)
    np.testing.assert_array_equal(again.evaluate(POINTS, side="left"), own.evaluate(POINTS, side="left"))
    assert again.warnings == own.warnings
    assert again.scene.problem is problem
    assert prepared.discretized.tables.extension is again.discretized.tables.extension
    read = prepared.discretized.tables.layout.queries["equator"] - target
    assert read <= 4 * len(POINTS)  # the tables, which ask thousands, ask nothing: this is for the points that are read


def test_the_edge_takes_other_data_and_fluxes_inside_do_too():
    arc = ck.source("analytic.arc", start=0.3, end=2.7)
    mid = ck.source("analytic.point", at=[0, 1])

    def with_data(edge, jump, flux):
        across = ck.Transmission(jump=jump, flux=flux, left=1.0, right=1.0)
        return ck.Scene(arc, ck.ScreenedPoisson(1.0), [ck.Boundary("a of b", mid, across=across)], edge=edge)

    old = with_data({0: ck.Dirichlet(0.0), 1: ck.Neumann(1.0)}, 0.0, 0.0)
    new = with_data({0: ck.Dirichlet(1.0), 1: ck.Neumann(2.0)}, 3.0, 4.0)
    data = {"a of b": new.boundaries[0].across, "edge": new.edge}
    for form in ("collocation", "galerkin"):
        again = ck.prepare(old, 0.1, form=form).solve(data=data)
        np.testing.assert_array_equal(again.values, ck.solve(new, 0.1, form=form).values)
    wall = with_data({0: ck.Dirichlet(0.0), 1: ck.Neumann(0.0)}, 0.0, 0.0)
    with pytest.raises(ck.SceneError, match="a flux of zero has none"):
        ck.prepare(wall, 0.1, form="collocation").solve(data=data)
    again = ck.prepare(wall, 0.1, form="galerkin").solve(data=data)  # whose samples hold any flux
    np.testing.assert_array_equal(again.values, ck.solve(new, 0.1, form="galerkin").values)
    bare = ck.prepare(ck.Scene(arc, ck.ScreenedPoisson(1.0)), 0.1, form="galerkin")  # without samples at its ends
    with pytest.raises(ck.SceneError, match="which this scene was prepared without"):
        bare.solve(data={"edge": ck.Neumann(1.0)})


def test_factors_are_made_once_for_one_left_side():
    prepared = ck.prepare(
        scene(ck.ScreenedPoisson(1.0), ck.Dirichlet(1.0), ck.Dirichlet(0.0)), 0.3, solver="direct", form="collocation"
    )
    problems = [
        *((ck.ScreenedPoisson(f), int(f == 1.0)) for f in (1.0, "x", [1.0, 2.0])),
        (ck.ScreenedPoisson(1.0, c=2.0), 1),
        (ck.Heat(product, until=0.4, step=0.1), 2),  # BDF2 begins with a step of backward Euler
        (ck.Heat(1.0, until=0.2, step=0.1), 0),
    ]
    for problem, factors in problems:
        made = counted_calls(lambda problem=problem: prepared.solve(problem=problem), "factorize_operator")
        assert made == factors


@pytest.mark.parametrize(("form", "solver"), [("collocation", "reference"), ("galerkin", "multigrid")])
def test_a_guess_saves_iterations(form, solver):
    prepared = ck.prepare(
        scene(ck.ScreenedPoisson(product), ck.Dirichlet(1.0), ck.Dirichlet(0.0)), 0.25, solver=solver, form=form
    )
    first = prepared.solve()
    near = prepared.solve(problem=ck.ScreenedPoisson(lambda x: 1.000001 * product(x)), guess=first)
    assert near.report.iterations < 0.7 * first.report.iterations
    with pytest.raises(ck.InputError, match="guess must be a solution on the same tables"):
        prepared.solve(guess=ck.solve(prepared.discretized.scene, 0.3))
    with pytest.raises(ck.InputError, match=r"guess must be a solution on the same tables.* got 3"):
        prepared.solve(guess=3)


def test_warnings_are_those_of_the_new_data():
    """Two circles that cross with equal values say nothing; with different values the crossing is told."""
    boundaries = [
        ck.Boundary("one", circle([0, 0, 1]), both=ck.Dirichlet(1.0)),
        ck.Boundary("other", circle([1, 0, 0]), both=ck.Dirichlet(1.0)),
    ]
    prepared = ck.prepare(ck.Scene(SPHERE, ck.Laplace(), boundaries), 0.25)
    assert not any("cross with different values" in text for text in prepared.solve().warnings)
    crossed = prepared.solve(data={"other": ck.Dirichlet(2.0)})
    assert any("cross with different values" in text for text in crossed.warnings)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"data": {"equator": ck.Dirichlet(1)}}, "holds conditions on left and right, got left"),
        ({"data": {"meridian": ck.Dirichlet(1)}}, "data are given for 'meridian'; the scene has edge, 'equator'"),
        (
            {"data": {"equator": {"left": ck.Neumann(1), "right": ck.Robin(1.0, 2.0)}}},
            "left, is dirichlet in the tables, got 'neumann'",
        ),
        (
            {"data": {"equator": {"left": ck.Dirichlet(1), "right": ck.Robin(1.0, 3.0)}}},
            "right, is robin in the tables.*only data may differ",
        ),
        ({"data": {"edge": {0: ck.Neumann()}}}, "data of the edge must be one condition"),
        ({"problem": ck.Eigen(3)}, "data where an eigenvalue problem takes zero alone"),
        ({"spacing": 0.1}, "no option 'spacing'"),
    ],
)
def test_what_the_tables_do_not_hold_is_refused(prepared, given, message):
    with pytest.raises(ck.CpmkitError, match=message):
        prepared.solve(**given)


def test_a_transmission_by_the_equations_diffusivity_takes_no_other():
    cut = [ck.Boundary("cut", circle([0, 0, 1]), across=ck.Transmission(jump=1.0))]
    old, problem = ck.Scene(SPHERE, ck.ScreenedPoisson(1.0), cut), ck.Elliptic(1.0, diffusivity=2.0, c=1.0)
    with pytest.raises(ck.SceneError, match="the tables hold the diffusivity"):
        ck.prepare(old, 0.3, form="collocation").solve(problem=problem)
    again = ck.prepare(old, 0.3, form="galerkin").solve(problem=problem)  # where no table holds it
    own = ck.solve(ck.Scene(SPHERE, problem, cut), 0.3, form="galerkin")
    np.testing.assert_array_equal(again.values, own.values)


@dataclass(frozen=True, eq=False)
class Convection(Condition):
    """A kind from outside, whose law is made anew whenever it is asked."""

    transfer: float
    ambient: float
    kind = "convection"

    @property
    def law(self):
        return Mixed(1.0, self.transfer, self.transfer * self.ambient)


def test_a_condition_from_outside_is_known_again():
    def with_ambient(ambient, problem):
        return ck.Scene(SPHERE, problem, [ck.Boundary("wall", circle([0, 0, 1]), both=Convection(2.0, ambient))])

    prepared = ck.prepare(with_ambient(1.0, ck.ScreenedPoisson(1.0)), 0.3)
    problem = ck.ScreenedPoisson(product)
    again = prepared.solve(problem=problem, data={"wall": Convection(2.0, 3.0)})
    np.testing.assert_array_equal(again.values, ck.solve(with_ambient(3.0, problem), 0.3).values)


def test_one_condition_for_several_loops_takes_one():
    bar, imposed = ck.source("analytic.segment", start=[0, 0], end=[1, 0]), ck.Dirichlet(0.0)
    scene = ck.Scene(bar, ck.Laplace(), edge={0: imposed, 1: imposed})
    prepared = ck.prepare(scene, 0.05, form="collocation")
    moved = ck.Dirichlet(2.0)
    np.testing.assert_allclose(prepared.solve(data={"edge": {0: moved, 1: moved}}).evaluate([[0.5, 0]]), 2.0)
    with pytest.raises(ck.SceneError, match="one object for several loops"):
        prepared.solve(data={"edge": {0: ck.Dirichlet(1.0), 1: ck.Dirichlet(2.0)}})
    again = ck.prepare(scene, 0.05, form="galerkin").solve(data={"edge": {0: ck.Dirichlet(1.0), 1: ck.Dirichlet(2.0)}})
    np.testing.assert_allclose(again.evaluate([[0.5, 0]]), 1.5)


def test_another_back_end_is_prepared_too():
    prepared = ck.prepare(ck.Scene(SPHERE, ck.ScreenedPoisson(1.0)), 0.3, backend="fem")
    again = prepared.solve(problem=ck.ScreenedPoisson(product))
    own = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(product)), 0.3, backend="fem")
    np.testing.assert_array_equal(again.values, own.values)
