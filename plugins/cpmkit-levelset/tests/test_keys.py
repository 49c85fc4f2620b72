"""What a level set cannot be made of is refused with one sentence that says what to do."""

import numpy as np
import pytest

import cpmkit as ck

BOX = [[-2, -2, -2], [2, 2, 2]]
BALL = "x**2 + y**2 + z**2 - 1"


def squares(p):
    return (p**2).sum(axis=1) - 1


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"phi": "x**2 + y**2 + z**2 + 1", "bounds": BOX}, "no zero set in the bounds.*from 1 to 13"),
        ({"phi": f"({BALL})**2", "bounds": BOX}, "no zero set in the bounds"),
        ({"phi": "log(x) + y + z", "bounds": BOX}, "phi must be finite in the bounds"),
        ({"phi": "x + y + z", "bounds": BOX}, "runs out of the bounds at .* widen the bounds"),
        ({"phi": "q**2 - 1", "bounds": BOX}, "phi .* uses 'q'"),
        ({"phi": "x**2 + y**2 + z**2 - 1", "bounds": [[-2, -2], [2, 2]]}, "uses 'z'"),
        ({"phi": "floor(x) + z", "bounds": BOX}, "'floor.*' in|phi uses 'floor.*which jumps"),
        ({"phi": "x % 1 - y", "bounds": BOX}, "phi uses 'x % 1'"),
        ({"phi": "3", "bounds": BOX}, "phi must depend on x, y, z"),
        (
            {"phi": squares, "bounds": BOX},
            "expression must be a formula, .*; levelset.callable takes functions",
        ),
        ({"phi": BALL, "bounds": [1, 2, 3]}, "bounds must be two corners"),
        ({"phi": BALL, "bounds": "wide"}, "bounds must be two corners"),
        ({"phi": BALL, "bounds": BOX[::-1]}, "bounds must hold the lower corner"),
        ({"phi": BALL, "bounds": BOX, "trim": "x - 5 + 10"}, "trim leaves nothing"),
        ({"phi": BALL, "bounds": BOX, "trim": "floor(x)"}, "trim uses 'floor"),
        ({"phi": "x**2 + y**2 - 1", "bounds": [[-2, -2], [2, 2]], "trim": "x**2 - 0.5"}, "cuts the curve at 4 points"),
        ({"phi": BALL, "bounds": BOX, "resolution": 3.5}, "resolution must be a whole number"),
        ({"phi": BALL, "bounds": BOX, "centre": 0}, "unknown key 'centre'"),
        ({"phi": BALL}, "lacks the key 'bounds'"),
    ],
)
def test_formulas(keys, message):
    with pytest.raises(ck.InputError, match=message) as caught:
        ck.source("levelset.expression", **keys)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"phi": BALL}, "phi of levelset.callable must be a function"),
        ({"hessian": 3}, "hessian of levelset.callable must be a function"),
        ({"gradient": lambda p: p}, "gradient must be that of phi"),
        ({"gradient": squares}, r"gradient must return shape \(n, 3\)"),
        ({"phi": lambda p: "a"}, r"phi must return numbers of shape \(n,\)"),
    ],
)
def test_functions(keys, message):
    given = {"phi": squares, "gradient": lambda p: 2 * p, "bounds": BOX, **keys}
    with pytest.raises(ck.InputError, match=message):
        ck.source("levelset.callable", **given)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({}, "either values or a file, got neither"),
        ({"values": np.zeros((8, 8)), "file": __file__}, "got both"),
        ({"file": "nowhere.npy"}, "no file 'nowhere.npy'; looked in"),
        ({"values": np.zeros((4, 8))}, "6 grid points or more, got shape"),
        ({"values": np.zeros(8)}, "2 or 3 axes"),
        ({"values": [["a"] * 8] * 8}, "array of numbers"),
        ({"values": np.full((8, 8), np.nan)}, "64 of 64 are NaN"),
        ({"values": np.ones((8, 8))}, "no zero set"),
        ({"values": np.ones((8, 8)), "spacing": -1}, "spacing must be"),
        ({"values": np.ones((8, 8)), "origin": [0, 0, 0]}, "origin must be 2"),
    ],
)
def test_grids(keys, message):
    with pytest.raises(ck.InputError, match=message):
        ck.source("levelset.grid", **{"spacing": 0.1, **keys})


def test_a_file_of_something_else_is_refused(tmp_path):
    (tmp_path / "phi.npy").write_text("1 2 3")
    with pytest.raises(ck.InputError, match="is not a"):
        ck.source("levelset.grid", file=tmp_path / "phi.npy", spacing=0.1)


def test_a_grid_file_gives_the_same_surface_as_its_values(tmp_path):
    p = -1.5 + 0.1 * np.indices((31, 31)).transpose(1, 2, 0)
    values = (p**2).sum(axis=-1) - 1
    np.save(tmp_path / "phi.npy", values)
    one = ck.source("levelset.grid", file=tmp_path / "phi.npy", spacing=0.1, origin=[-1.5, -1.5])
    two = ck.source("levelset.grid", values=values, spacing=0.1, origin=[-1.5, -1.5])
    x = np.random.default_rng(0).uniform(-1, 1, (20, 2))
    np.testing.assert_array_equal(one.closest_point(x).points, two.closest_point(x).points)


@pytest.mark.parametrize("numbers", [{"a": -0.5}, {"b": 0.0, "c": 1.0}, {"c": 100.0}])
def test_goursat_numbers_without_a_bounded_surface_are_refused(numbers):
    with pytest.raises(ck.InputError, match="give no bounded surface"):
        ck.source("levelset.goursat", **numbers)
