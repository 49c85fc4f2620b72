"""Counts at a spacing are foretold from two coarser ones."""

import numpy as np
import pytest

from cpmkit.forms.cost_model import Growth, rising_growth


@pytest.mark.parametrize("m", [1, 2, 3])
@pytest.mark.parametrize("b", [0.0, 7.0])
def test_counts_that_grow_so_are_met_exactly(m, b):
    true = Growth(3.0, b, m)
    found = rising_growth((0.1, true.at(0.1)), (0.17, true.at(0.17)), m)
    assert np.allclose([found.a, found.b], [3.0, b])
    for spacing in (0.3, 0.01):
        assert found.at(spacing) == pytest.approx(true.at(spacing))
        assert found.spacing_with(true.at(spacing)) == pytest.approx(spacing)


def test_a_term_below_zero_is_left_out_where_counts_must_rise():
    few = (0.2, 10.0)  # a coarse lattice that sees a tenth of the manifold
    rising = rising_growth((0.1, 400.0), few, 2)
    assert (rising.a, rising.b) == pytest.approx((4.0, 0.0))
