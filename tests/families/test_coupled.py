"""Channels that are tied to each other: exact solutions, what must hold of any, what is refused."""

import numpy as np
import pytest
from model_problems import order_of

import cpmkit as ck

SPHERE, CIRCLE = ck.source("analytic.sphere"), ck.source("analytic.circle")
RING = ck.source("analytic.circle", center=[0, 0, 0.3], normal=[0, 0, 1], radius=0.91**0.5)
POINTS = SPHERE.mesh(0.4)[0]
SPACINGS = (0.3, 0.2, 0.15)


def exact(x):
    return np.stack([x[:, 0] * x[:, 2], x[:, 1]], axis=1)


def twist(x):
    """Neither symmetric nor constant."""
    one = np.ones(len(x))
    return np.stack([np.stack([2 + x[:, 2], one], axis=1), np.stack([-x[:, 0], 3 * one], axis=1)], axis=1)


def f_of_twist(x):
    return exact(x) * [6.0, 2.0] + np.einsum("pij,pj->pi", twist(x), exact(x))


def constant(*rows):
    return lambda x: np.tile(np.array(rows, dtype=float), (len(x), 1, 1))


@pytest.mark.parametrize("ring", [None, {"left": ck.Dirichlet(exact), "right": ck.Dirichlet(exact)}])
def test_third_order(ring):
    boundaries = [] if ring is None else [ck.Boundary("ring", RING, **ring)]
    scene = ck.Scene(SPHERE, ck.Coupled(twist, f_of_twist), boundaries)
    errors = [np.abs(ck.solve(scene, h).evaluate(POINTS) - exact(POINTS)).max() for h in SPACINGS]
    assert order_of(SPACINGS, errors) > 2.7


def test_channels_that_are_not_tied_are_as_each_alone():
    f = [lambda x: x[:, 0], lambda x: x[:, 1] + x[:, 2]]
    untied = ck.Scene(SPHERE, ck.Coupled(constant([0, 0], [0, 3]), f, c=1.0))
    together = ck.solve(untied, 0.25, solver="direct").evaluate(POINTS)
    for k, (c, most) in enumerate(
        [(1.0, 1e-12), (4.0, 2e-7)]
    ):  # what is not in c is put on the grid a little otherwise
        alone = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(f[k], c=c)), 0.25, solver="direct").evaluate(POINTS)
        assert np.abs(together[:, k] - alone.ravel()).max() < most


def test_channels_may_be_mixed_before_or_after():
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    tie = np.array([[3.0, -1.0], [-1.0, 2.0]])
    given = [
        ck.Coupled(constant(*tie), exact),
        ck.Coupled(constant(*(turn @ tie @ turn.T)), lambda x: exact(x) @ turn.T),
    ]
    plain, turned = (ck.solve(ck.Scene(SPHERE, one), 0.25).evaluate(POINTS) for one in given)
    assert np.abs(plain @ turn.T - turned).max() < 1e-8


@pytest.mark.parametrize("tie", [1.0, 100.0])
def test_solvers_agree(tie):
    scene = ck.Scene(SPHERE, ck.Coupled(constant([tie, -tie], [-tie, tie]), exact, c=0.5))
    one, other = (ck.solve(scene, 0.3, solver=name).evaluate(POINTS) for name in ("direct", "multigrid"))
    assert np.abs(one - other).max() < 1e-7


def test_what_ties_two_channels_keeps_their_sum():
    tied = ck.Coupled(constant([5, -5], [-5, 5]), [1.0, lambda x: x[:, 2]], c=1.0)
    solution = ck.solve(ck.Scene(SPHERE, tied), 0.25)
    alone = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: 1 + x[:, 2], c=1.0)), 0.25)
    assert np.abs(solution.evaluate(POINTS).sum(axis=1) - alone.evaluate(POINTS).ravel()).max() < 1e-8


@pytest.mark.parametrize("solver", ["direct", "multigrid"])
def test_a_mixture_that_nothing_fixes_is_refused(solver):
    tied = ck.Coupled(constant([1, -1], [-1, 1]), exact)
    with pytest.raises(ck.SceneError, match=r"takes the constant \((-0.707, -0.707|0.707, 0.707)\) to zero"):
        ck.solve(ck.Scene(SPHERE, tied), 0.3, solver=solver)
    imposed = ck.Boundary("ring", RING, both=ck.Dirichlet(exact))
    assert np.isfinite(ck.solve(ck.Scene(SPHERE, tied, [imposed]), 0.3, solver=solver).values).all()


@pytest.mark.parametrize(
    ("coupling", "messages"),
    [
        (lambda x: np.ones((len(x), 2)), "one row and column a channel"),
        (constant([1, 0, 0], [0, 1, 0], [0, 0, 1]), "one row and column a channel"),
        (constant([np.nan, 0], [0, 1]), "finite"),
        (constant([0, 0], [0, 0]), "Nothing fixes"),
    ],
)
def test_what_is_no_coupling_is_refused(coupling, messages):
    with pytest.raises(ck.CpmkitError, match=messages):
        ck.solve(ck.Scene(SPHERE, ck.Coupled(coupling, exact)), 0.4)


def test_the_collocation_form_refuses_it():
    with pytest.raises(ck.CpmkitError, match="coupled channels"):
        ck.solve(ck.Scene(CIRCLE, ck.Coupled(constant([1, 0], [0, 1]), [1.0, 0.0])), 0.3, form="collocation")
