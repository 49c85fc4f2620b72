"""Clouds of two sheets nearer to each other than their samples: refused in a sentence that says what to give."""

import numpy as np
import pytest
from cpmkit_pointcloud import points

import cpmkit as ck
from cpmkit.errors import InputError

GRID = np.linspace(-1, 1, 17)
SHEET = np.array([[x, y, 0.0] for x in GRID for y in GRID])


def two_sheets(gap, **keys):
    return points(points=np.concatenate([SHEET, SHEET + [0, 0, gap]]), closed=False, **keys)


@pytest.mark.parametrize("gap", [0.05, 0.15])
def test_sheets_nearer_than_samples_are_refused_with_what_to_do(gap):
    scene = ck.Scene(two_sheets(gap), ck.ScreenedPoisson(1.0))
    with pytest.raises(InputError, match=r"The cloud makes no surface near .* several sheets.*give normals"):
        ck.solve(scene, 0.15, estimate=False)


def test_sheets_farther_apart_than_samples_have_values_of_their_own():
    apart = ck.ScreenedPoisson(lambda p: np.where(p[:, 2] < 0.375, 1.0, -1.0))
    solution = ck.solve(ck.Scene(two_sheets(0.75), apart), 0.2, estimate=False)
    np.testing.assert_allclose(solution.evaluate([[0, 0, 0], [0, 0, 0.75]]), [1.0, -1.0], atol=1e-9)
