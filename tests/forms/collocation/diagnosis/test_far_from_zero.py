"""Where coordinates are rounded too coarsely for a surface, a solution says so."""

import numpy as np
import pytest

import cpmkit as ck


class OwnCircle:
    """A class of one's own, which knows nothing of translations."""

    dim, manifold_dim, exact = 2, 1, True

    def __init__(self, center, radius):
        self.center, self.radius = np.array(center, dtype=float), radius

    @property
    def bounds(self):
        return np.stack([self.center - self.radius, self.center + self.radius])

    def closest_point(self, x):
        away = x - self.center
        away[~away.any(axis=1)] = [1.0, 0.0]
        points = self.center + self.radius * away / np.linalg.norm(away, axis=1, keepdims=True)
        return ck.ClosestPoints(points, np.linalg.norm(x - points, axis=1), np.full(len(x), -1))


def far(source, spacing):
    warnings = ck.solve(
        ck.Scene(source, ck.ScreenedPoisson(1.0, c=1.0 / spacing**2)), spacing, form="collocation"
    ).warnings
    return [text for text in warnings if "from zero" in text]


@pytest.mark.parametrize(("center", "radius"), [(0.0, 1.0), (1e3, 1.0), (1e-3, 1e-6), (1e5, 1e2)])
def test_nothing_is_said_where_digits_are_enough(center, radius):
    assert far(OwnCircle([center, 0], radius), 0.2 * radius) == []


def test_a_class_of_ones_own_is_named_earlier_than_a_source_that_moves_itself():
    (text,) = far(OwnCircle([1e5, 0], 1e-3), 2e-4)
    assert "1e+05 from zero, where coordinates are rounded to 1e-11: a solution may be off by its slope times" in text
    assert far(ck.source("analytic.circle", center=[1e5, 0], radius=1e-3), 2e-4) == []
    assert len(far(ck.source("analytic.circle", center=[1e5, 0], radius=1e-6), 2e-7)) == 1
