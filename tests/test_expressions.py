"""A formula in a scene file is arithmetic over a closed list of names, and nothing else."""

import numpy as np
import pytest

from cpmkit import SceneError
from cpmkit.expressions import Expression

POINTS = np.random.default_rng(0).uniform(0.1, 1, (50, 3))
X, Y, Z = POINTS.T


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", np.ones(50)),
        ("x*y - z/2", X * Y - Z / 2),
        ("0.5 + 0.5*sin(x/20)", 0.5 + 0.5 * np.sin(X / 20)),
        ("-x**2 % 0.3", -(X**2) % 0.3),
        ("arctan2(y, x) + pi", np.arctan2(Y, X) + np.pi),
        ("(x > 0.5) * maximum(y, z)", (X > 0.5) * np.maximum(Y, Z)),
    ],
)
def test_formulas_are_numpy(text, value):
    np.testing.assert_allclose(Expression(text, 3)(POINTS), value, rtol=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "x.__class__",
        "[x for x in (1,)]",
        "open('f')",
        "sin(x, where=1)",
        "w + 1",
        "lambda: 1",
        "x and y",
        "'x'",
        "True",
        "x y",
        "",
        "sin()",
        "(1 < x < 2)",
    ],
)
def test_anything_else_is_refused(text):
    with pytest.raises(SceneError, match="the formula"):
        Expression(text, 3)


def test_z_does_not_exist_in_the_plane():
    with pytest.raises(SceneError, match="'z'"):
        Expression("x + z", 2)
