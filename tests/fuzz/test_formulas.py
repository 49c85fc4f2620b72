"""Whatever text is given as a formula, it has values and derivatives or is refused in a sentence, and soon."""

from __future__ import annotations

import numpy as np
import pytest
from counted_calls import counted_calls
from fuzzing import answered, long, short
from hypothesis import given
from hypothesis import strategies as st

from cpmkit.plugin import COORDINATES, FUNCTIONS, Expression, formula_jets, formula_tree
from cpmkit.studies.studyfile import expand_names

#: Of functions, in all that is done with one formula: some seconds.
MOST_CALLS = 2_000_000
POINTS = np.random.default_rng(0).uniform(-2, 2, (30, 3))
#: What broke: each made another exception than a CpmkitError, or took minutes.
BROKE = [
    "1/0", "1%0", "0**-1", "9**9**9", "1" * 400, "(-1)**0.5", "(-8)**(1/3)", "+".join(["x"] * 1200), "~" * 3000 + "x",
    "-" * 5000 + "x", "-" * 100_000 + "x", "x) + (y", "sin(" * 150 + "x" + ")" * 150, "hypot(x,y,z)", "sin(x, y)",
    "x" * 1_000_000, "1" * 5000, "(x/3)**(10**9)", "(1/3)**(10**9)", "'\x00'", "\ud800", "x**" * 3000 + "x",
    "+".join(f"0.0001*sin({k}*x)*cos({k}*y)" for k in range(1, 201)), "[" * 5000, "lambda:" * 2000 + "x", "x\\\n+y",
]  # fmt: skip
PIECES = [*FUNCTIONS, *"xyztew()+-*/%<>,.0123456789 #[]{}'\"\n_", "**", "pi", "1e308", "1e999", "if", "else", "1j", "×"]
numbers = st.floats().map(repr) | st.integers().map(str)
leaves = st.sampled_from([*COORDINATES, "t", "pi", "e"]) | numbers


def compound(inner):
    """Return formulas of formulas, with any number of arguments."""
    calls = st.builds("{}({})".format, st.sampled_from([*FUNCTIONS, "f"]), st.lists(inner, max_size=3).map(",".join))
    operators = st.sampled_from(["+", "-", "*", "/", "**", "%", "<", ">=", " and ", "//"])
    return calls | st.builds("({}{}{})".format, inner, operators, inner) | inner.map("(-{})".format)


soup = st.lists(st.sampled_from(PIECES), max_size=40).map("".join)
formulas = st.recursive(leaves, compound, max_leaves=40) | soup | st.text(max_size=30)


def target(text):
    """Ask a formula, its derivatives and [let] for all that they do."""

    def values():
        given_array = POINTS.copy()
        found = Expression(text, 3)(given_array, t=0.3)
        assert found.shape == (30,)
        np.testing.assert_array_equal(given_array, POINTS)

    def derivatives():
        rows = formula_jets([formula_tree(text, COORDINATES)], COORDINATES, "phi").rows(2, POINTS.T)
        assert rows.shape == (10, 30)

    for call in (values, derivatives, lambda: expand_names({"a": text, "b": "a*(a + 1)"})):
        assert counted_calls(lambda call=call: answered(call)) < MOST_CALLS


@pytest.mark.parametrize("number", range(len(BROKE)))
def test_what_broke_once_is_answered(number):
    target(BROKE[number])


@short
@given(formulas)
def test_any_formula_is_answered(text):
    target(text)


@long
@given(formulas)
def test_a_long_session_of_formulas(text):
    target(text)
