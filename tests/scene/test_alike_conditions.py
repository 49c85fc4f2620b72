"""Conditions are alike if they say the same, whatever objects say it."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.plugin import Expression
from cpmkit.scene.conditions import depends_on_sides


def one(x):
    return x[:, 0]


ALIKE = [
    (ck.Dirichlet(1.0), ck.Dirichlet(1)),
    (ck.Dirichlet([1.0, 2.0]), ck.Dirichlet(np.array([1, 2]))),
    (ck.Dirichlet([1.0, one]), ck.Dirichlet((1, one))),
    (ck.Neumann(one), ck.Neumann(one)),
    (ck.Dirichlet(Expression("x*y", 3)), ck.Dirichlet(Expression("x*y", 3))),
    (ck.Robin(1.0, 2.0, 3.0), ck.Robin(1, 2, 3)),
    (ck.NonlinearFlux(one), ck.NonlinearFlux(one)),
]
UNLIKE = [
    (ck.Dirichlet(0.0), ck.Neumann(0.0)),
    (ck.Dirichlet(1.0), ck.Dirichlet(2.0)),
    (ck.Dirichlet(1.0), ck.Dirichlet([1.0, 1.0])),
    (ck.Dirichlet(1.0), ck.Dirichlet(1.0, order=1)),
    (ck.Dirichlet(one), ck.Dirichlet(lambda x: x[:, 0])),
    (ck.Dirichlet(one), ck.Dirichlet(1.0)),
    (ck.Dirichlet(Expression("x*y", 3)), ck.Dirichlet(Expression("x+y", 3))),
    (ck.Robin(1.0, 2.0, 3.0), ck.Robin(2.0, 2.0, 3.0)),
]


@pytest.mark.parametrize(("first", "second"), ALIKE)
def test_what_says_the_same_is_one_condition_for_both_sides(first, second):
    assert not depends_on_sides(first, second)
    given = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), left=first, right=second)
    assert given.condition("left") is given.condition("right")


@pytest.mark.parametrize(("first", "second"), UNLIKE)
def test_what_says_something_else_is_not(first, second):
    assert depends_on_sides(first, second)
    given = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), left=first, right=second)
    assert given.condition("right") is second


def test_a_contact_has_a_left_unless_it_is_the_same_from_both_sides():
    for contact, differs in (
        (ck.Transmission(), False),
        (ck.Transmission(left=2.0, right=2.0, resistance=0.1, flux=one), False),
        (ck.Transmission(left=2.0), True),
        (ck.Transmission(jump=1.0), True),
        (ck.Transmission(jump=one), True),
    ):
        assert depends_on_sides(contact, contact) == differs
