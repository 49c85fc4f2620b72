"""Derivatives of formulas are right to rounding, of what has kinks between the kinks, and are found soon."""

import numpy as np
import pytest

from cpmkit import SceneError
from cpmkit.plugin import formula_jets, formula_tree

NAMES = ("x", "y", "z")
POINTS = np.random.default_rng(0).uniform(0.1, 0.9, (3, 40))
SMOOTH = [
    "x*y*z - x/y + (x - z**2)**2",
    "sin(x*y)*cos(z) + tan(x/2)",
    "arcsin(x/2)*arccos(y/2) + arctan(x*z) + arctan2(y, x + z)",
    "sinh(x)*cosh(y) + tanh(x*z) + exp(-x*y)",
    "log(x + y)*sqrt(z + 1) + hypot(x, y)*(z + 1)**0.5",
    "x**-3 + y**13 + x**2.5 + x**y + 2**z + (-x)**2 + z**0 + y**1",
    "abs(x - 2)**3 + maximum(x, y + 2)**2 + minimum(x*y, z + 3)",
    "(7*x) % 3 + x % (y + 5) + floor(9*x)*y*z + sign(x - 1)*x**2",
    "(x < 2)*x**2*y + (y >= 3)*exp(x) - (x > z - 2)*z**3",
]


def jets(text):
    return formula_jets([formula_tree(text, NAMES)], NAMES, "phi")


@pytest.mark.parametrize("text", SMOOTH)
def test_first_and_second_derivatives_agree_with_differences(text):
    made, h = jets(text), 1e-4
    value, *rest = made.rows(2, POINTS)
    slopes, curvatures = rest[:3], iter(rest[3:])
    steps = h * np.eye(3)[:, :, None]
    np.testing.assert_array_equal(made.rows(1, POINTS), [value, *slopes])
    np.testing.assert_array_equal(made.rows(0, POINTS), [value])
    scale = 1 + np.abs(rest).max()
    for i in range(3):
        ahead, behind = made.rows(1, POINTS + steps[i]), made.rows(1, POINTS - steps[i])
        np.testing.assert_allclose(slopes[i], (ahead[0] - behind[0]) / (2 * h), atol=1e-6 * scale)
        for j in range(i, 3):
            differences = (ahead[1 + j] - behind[1 + j]) / (2 * h)
            np.testing.assert_allclose(next(curvatures), differences, atol=1e-5 * scale)


@pytest.mark.parametrize("text", SMOOTH)
def test_few_points_are_worked_out_like_many(text):
    """Points in one batch and in several have the same rows, with NaN where they are NaN."""
    made, some = jets(text), np.random.default_rng(1).uniform(-2, 2, (3, 2048))
    some[:, :9] = 0.0
    for order in range(3):
        few = [made.rows(order, part) for part in np.array_split(some, 30, axis=1)]
        np.testing.assert_allclose(np.concatenate(few, axis=1), made.rows(order, some), rtol=1e-14, atol=0)


def test_derivatives_are_right_to_rounding():
    x, y, _ = POINTS
    _, fx, fy, _, fxx, fxy, _, fyy, *_ = jets("exp(sin(x*y))").rows(2, POINTS)
    f, c, s = np.exp(np.sin(x * y)), np.cos(x * y), np.sin(x * y)
    expected = [y * c * f, x * c * f, y**2 * (c**2 - s) * f, (c + x * y * (c**2 - s)) * f]
    for found, exact in zip([fx, fy, fxx, fxy], expected, strict=True):
        np.testing.assert_allclose(found, exact, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(fyy, x**2 * (c**2 - s) * f, rtol=1e-13, atol=1e-15)


def test_arguments_that_are_not_chosen_play_no_part():
    rows = jets("minimum(x, sqrt(x - 5) + 100) + maximum(y, -1/(z - z))").rows(2, POINTS)
    assert np.isnan(rows[0]).all()  # NumPy's minimum of a number and NaN is NaN
    rows = jets("minimum(x, 2 + sqrt(y - 0.1))").rows(2, np.full((3, 1), 0.1))
    np.testing.assert_array_equal(rows[:, 0], [0.1, 1, 0, 0, 0, 0, 0, 0, 0, 0])


def operations(text):
    return jets(text).programs[2].operations


@pytest.mark.parametrize(
    "written",
    [
        lambda n: "+".join(f"0.01*sin({k}*x)*cos({k}*y)" for k in range(1, n + 1)),
        lambda n: "sin(" * n + "x*y" + ")" * n,
    ],
    ids=["long", "nested"],
)
def test_long_and_nested_formulas_take_operations_in_proportion(written):
    few, twice, most = (operations(written(n)) for n in (20, 40, 80))
    assert twice <= 2.05 * few
    assert most <= 2.05 * twice
    assert np.isfinite(jets(written(80)).rows(2, POINTS)).all()


def test_powers_of_any_size_take_one_operation():
    for text in ("0.001*(x/3)**(10**9) + (1/3)**(10**9)", "x**9**9**9"):
        assert operations(text) < 60


def test_too_many_operations_are_refused():
    text = "*".join(f"(x + {k}*y*z)" for k in range(1, 400))
    with pytest.raises(SceneError, match=r"phi takes \d+ operations .* at most 4000"):
        jets(text)
