"""Every key that is not accepted is answered in one sentence that names it."""

from __future__ import annotations

import numpy as np
import pytest

import cpmkit.plugins
from cpmkit import source
from cpmkit.errors import InputError

BAD = [
    ("point", {"at": [1.0]}, "at must be 2 or 3 numbers"),
    ("point", {"at": 3.0}, "at must be 2 or 3 numbers"),
    ("point", {"at": ["a", "b"]}, "at must be 2 numbers"),
    ("point", {"at": [np.nan, 0]}, "at must be 2 finite numbers"),
    ("point", {}, "lacks the key 'at'"),
    ("segment", {"start": [0, 0], "end": [0, 0]}, "start and end must differ"),
    ("segment", {"start": [0, 0], "end": [0, 0, 1]}, "end must be 2 finite numbers"),
    ("circle", {"radius": 0}, "radius must be a finite number above zero"),
    ("circle", {"radius": -1.0}, "radius must be a finite number above zero"),
    ("circle", {"radius": "big"}, "radius must be a finite number above zero"),
    ("circle", {"centre": [0, 0]}, "unknown key 'centre'"),
    ("circle", {"center": [0, 0], "normal": [0, 0, 1]}, "normal belongs to a center of 3 numbers"),
    ("circle", {"normal": [0, 0, 0]}, "normal must have a direction"),
    ("circle", {"normal": [0, 1]}, "normal must be 3 finite numbers"),
    ("arc", {"start": 1.0, "end": 1.0}, "less than a full turn"),
    ("arc", {"start": 0.0, "end": 7.0}, "less than a full turn"),
    ("arc", {"start": 0.0, "end": -1e-300}, "less than a full turn"),
    ("arc", {"start": 0.0, "end": np.inf}, "finite numbers"),
    (
        "arc",
        {"start": 0, "end": 1, "normal": [0, 0, 1], "x_axis": [0, 0, 2]},
        "x_axis must not be parallel to the normal",
    ),
    ("sphere", {"center": [0, 0, 0, 0]}, "center must be 2 or 3 numbers"),
    ("sphere", {"scale": 0}, "scale must be a finite number above zero"),
    ("sphere", {"translation": [0, 0]}, "translation must be 3 finite numbers"),
    ("sphere", {"rotation": 0.5}, "rotation must be a vector of 3 numbers or a 3 x 3 matrix"),
    ("sphere", {"rotation": "x"}, "rotation must be"),
    ("sphere", {"rotation": [[0, 1, 0], [1, 0, 0], [0, 0, 1]]}, "determinant -1"),
    ("sphere", {"rotation": [[2, 0, 0], [0, 2, 0], [0, 0, 2]]}, "orthogonal"),
    ("sphere", {"center": [0, 0], "rotation": [0, 0, 1]}, "an angle or a 2 x 2 matrix"),
    ("sphere", {"center": [0, 0], "rotation": np.nan}, "of finite numbers"),
    ("cap", {"height": 1.0}, "height must lie between"),
    ("cap", {"height": -2.0}, "height must lie between"),
    ("cap", {"height": None}, "height must be"),
    ("cap", {"axis": [0, 0, 0]}, "axis must have a direction"),
    ("torus", {"major": 1.0, "minor": 1.0}, "minor must be smaller than major"),
    ("torus", {"minor": 0.0}, "minor must be a finite number above zero"),
    ("torus", {"center": [0, 0]}, "center must be 3 finite numbers"),
    ("cylinder", {"length": 0}, "length must be a finite number above zero"),
    ("cylinder", {"axis": "z"}, "axis must be 3 numbers"),
]


@pytest.mark.parametrize(("kind", "keys", "sentence"), BAD)
def test_a_bad_key_is_named(kind, keys, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        source(f"analytic.{kind}", **keys)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


def test_every_declared_kind_has_a_factory_of_keywords_only():
    declared = {kind.kind for kind in cpmkit.plugins.installed_kinds() if kind.kind.startswith("analytic.")}
    plugin = cpmkit.plugins.load_plugin("analytic.sphere")
    assert set(plugin.cpmkit_sources()) == declared


def test_queries_that_are_not_finite_points_are_refused():
    sphere = source("analytic.sphere")
    for x in ([[0, 0, np.nan]], [[0, 0]], [0, 0, 0], [[0, 0, np.inf]]):
        with pytest.raises(InputError, match="points must"):
            sphere.closest_point(x)
