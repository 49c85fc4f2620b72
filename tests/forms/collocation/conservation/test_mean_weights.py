"""Past an end the weights of means are continuous, end sums as the trapezoidal rule does, and have no first moment."""

import numpy as np
import pytest

from cpmkit.forms.collocation.mean_weights import _tail_weights

#: Distances of the first node past the end, in spacings.
FIRST = (np.arange(400) + 0.5) / 400


def test_the_weights_are_continuous():
    at = np.linspace(0, 2.0, 20001)
    assert _tail_weights(np.zeros(1)) == 1.0
    assert _tail_weights(np.full(1, 2.0)) == 0.0
    assert np.abs(np.diff(_tail_weights(at))).max() <= 3.6 * at[1]


def test_the_two_nodes_past_an_end_weigh_what_the_trapezoidal_rule_lacks():
    np.testing.assert_allclose(_tail_weights(FIRST) + _tail_weights(FIRST + 1), 0.5 - FIRST, atol=1e-12)


def test_the_first_moment_vanishes():
    moment = np.mean(FIRST * _tail_weights(FIRST) + (FIRST + 1) * _tail_weights(FIRST + 1))
    assert moment == pytest.approx(0.0, abs=1e-5)


def sum_of_exp(t, spacing):
    """Sum of exp(x) over nodes up to the end at 0, which is t spacings before the next node; exactly 1."""
    beyond = np.concatenate([t - np.arange(int(40 / spacing), 0, -1), [t, t + 1]])
    return spacing * float(np.sum(_tail_weights(np.maximum(beyond, 0.0)) * np.exp(spacing * beyond)))


def test_sums_are_of_second_order_at_any_end_and_of_third_over_all_ends():
    spacings = (0.1, 0.05, 0.025)
    errors = [np.array([sum_of_exp(t, h) - 1 for t in FIRST[::4]]) for h in spacings]
    worst, mean = [np.abs(one).max() for one in errors], [abs(one.mean()) for one in errors]
    assert np.polyfit(np.log(spacings), np.log(worst), 1)[0] >= 1.9
    assert np.polyfit(np.log(spacings), np.log(mean), 1)[0] >= 2.8
