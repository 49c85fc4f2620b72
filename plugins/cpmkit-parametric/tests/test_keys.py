"""Every map or key that is not accepted is answered in one sentence that names it."""

from __future__ import annotations

import numpy as np
import pytest

import cpmkit.plugins
from cpmkit import source
from cpmkit.errors import InputError

CIRCLE = {"x": ["cos(t)", "sin(t)"], "range": [0, "2*pi"]}
STRIP = {"x": ["cos(u)", "sin(u)", "v"], "u": [0, "2*pi"], "v": [0, 1]}


def line(t):
    return np.stack([t, t**2], axis=1)


BAD = [
    ("curve", {**CIRCLE, "range": [1, 1]}, "range must run from a smaller to a larger finite number"),
    ("curve", {**CIRCLE, "range": [2, 1]}, "range must run from a smaller"),
    ("curve", {**CIRCLE, "range": [0, np.inf]}, "range must run from a smaller"),
    ("curve", {**CIRCLE, "range": 1}, "range must be two numbers"),
    ("curve", {**CIRCLE, "range": "ab"}, "range must be two numbers"),
    ("curve", {**CIRCLE, "range": [0, "t"]}, "uses 't'"),
    ("curve", {**CIRCLE, "range": [0, None]}, "range must hold numbers"),
    ("curve", {**CIRCLE, "x": ["t"]}, "x must be 2 or 3 formulas in t, or a callable"),
    ("curve", {**CIRCLE, "x": "cos(t)"}, "x must be 2 or 3 formulas"),
    ("curve", {**CIRCLE, "x": ["cos(t)", None]}, "x must be 2 or 3 formulas"),
    ("curve", {**CIRCLE, "x": ["cos(s)", "t"]}, "uses 's'; offered are"),
    ("curve", {**CIRCLE, "x": ["cos(t", "t"]}, "does not parse"),
    ("curve", {**CIRCLE, "x": ["__import__('os')", "t"]}, "uses .__import__"),
    ("curve", {**CIRCLE, "x": ["t.real", "t"]}, "uses 't.real'"),
    ("curve", {**CIRCLE, "x": ["cos(t, t)", "t"]}, "calls cos with 2 arguments"),
    ("curve", {**CIRCLE, "x": ["9**9**9**t", "t"]}, "x is not finite"),
    ("curve", {**CIRCLE, "x": ["9**9**9", "t"]}, "x is not finite at 513 of 513 parameters"),
    ("curve", {**CIRCLE, "x": ["1/(t - pi)", "t"]}, "x is not finite at 1 of 513 parameters, first at"),
    ("curve", {**CIRCLE, "x": ["sqrt(t - 1)", "t"]}, "x is not finite at"),
    ("curve", {**CIRCLE, "x": ["sqrt(-1)", "t"]}, "x is not finite at"),
    ("curve", {**CIRCLE, "x": ["1", "2"]}, "x is constant along a parameter"),
    ("curve", {**CIRCLE, "range": [0, "pi"], "periodic": True}, "do not meet, as a periodic one must: .* 2 apart"),
    ("curve", {**CIRCLE, "periodic": "yes"}, "periodic of the kind .parametric.curve. must be true or false"),
    ("curve", {**CIRCLE, "derivatives": line}, "derivatives belong to a callable x"),
    ("curve", {"x": line, "range": [0, 1], "derivatives": 3}, "derivatives must be a callable"),
    ("curve", {"x": line, "range": [0, 1], "derivatives": lambda t: [line(t)]}, "must return the 2 arrays"),
    ("curve", {"x": line, "range": [0, 1], "derivatives": lambda t: [line(t), line(t)]}, "first derivatives disagree"),
    ("curve", {"x": lambda t: line(t).T, "range": [0, 1]}, "x must return shape"),
    ("curve", {"x": lambda t: t, "range": [0, 1]}, "x must return shape"),
    ("curve", {"x": lambda t: "no", "range": [0, 1]}, "x must return an array of numbers"),
    ("curve", {**CIRCLE, "translation": [0, 0, 0]}, "translation must be 2 finite numbers"),
    ("curve", {"x": CIRCLE["x"]}, "lacks the key 'range'"),
    ("surface", {**STRIP, "x": ["u", "v"]}, "x must be 3 formulas in u and v"),
    ("surface", {**STRIP, "x": ["u", "v", "x"]}, "uses 'x'"),
    ("surface", {**STRIP, "x": ["cos(u)", "sin(u)", "u"]}, "x is constant along a parameter"),
    ("surface", {**STRIP, "v": [1, 1]}, "v must run from a smaller"),
    ("surface", {**STRIP, "periodic_v": True}, "ends of the range of v do not meet"),
    ("surface", {**STRIP, "periodic_u": True, "glue_u": "flip"}, "with the other parameter flipped: .* 1 apart"),
    ("surface", {**STRIP, "glue_u": "flip"}, "glue_u must be 'straight', or 'flip' with periodic_u"),
    ("surface", {**STRIP, "periodic_u": True, "glue_u": "twist"}, "glue_u must be"),
    ("torus_knot", {"a": 2, "b": 4}, "a and b must share no factor"),
    ("torus_knot", {"a": 2.5}, "a must be a whole number from 1 to 1000"),
    ("torus_knot", {"minor": 4.0}, "minor must be smaller than major"),
    ("helix", {"pitch": 0}, "pitch must be a finite number above zero"),
    ("planar_curve", {"b": 0}, "b must be a whole number"),
    ("planar_curve", {"c": "x"}, "c must be 1 numbers"),
    ("revolution", {"profile": ["t"], "range": [0, 1]}, "profile must be 2 formulas in t"),
    ("revolution", {"profile": ["u", "t"], "range": [0, 1]}, "uses 'u'"),
    ("revolution", {"profile": ["t", "t"], "range": [-1, 1]}, "profile must keep a distance from the axis"),
    ("moebius", {"half_width": 1.0}, "half_width must be smaller than radius"),
    ("klein", {"radius": 1.0, "width": 0.85}, "width must be below 0.8 times radius"),
    ("moebius", {"halfwidth": 1.0}, "unknown key 'halfwidth'"),
]


@pytest.mark.parametrize(("kind", "keys", "sentence"), BAD)
def test_a_bad_key_is_named(kind, keys, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        source(f"parametric.{kind}", **keys)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


def test_every_declared_kind_has_a_factory():
    declared = {kind.kind for kind in cpmkit.plugins.installed_kinds() if kind.kind.startswith("parametric.")}
    plugin = cpmkit.plugins.load_plugin("parametric.curve")
    assert set(plugin.cpmkit_sources()) == declared
