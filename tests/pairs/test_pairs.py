"""Every two features that can meet, in one small scene of the plane, against its exact solution.

A feature is a change of a case (pairs/features.py). Bugs live where two of them meet: each is tested on its own
elsewhere.
"""

from itertools import combinations

import pytest

from pairs.case import Case
from pairs.features import CANNOT_MEET, FEATURES
from pairs.measure import error_of

#: The error of a case is at most this many times this power of the spacing.
BOUNDS = {1: 1.0, 2: 1.0}
#: There ghosts whose mirror point is beyond another boundary are of first order.
NO_ROOM = "several boundaries in one stencil"


def made_of(names):
    case = Case()
    for name in FEATURES:
        if name in names:
            case = FEATURES[name](case)
    return case


def bound_of(case, names):
    """Return the largest error that is right."""
    power = 1 if NO_ROOM in names and case.solid else case.options.get("order", 2)
    return BOUNDS[power] * case.spacing**power


MEETING = [pair for pair in combinations(FEATURES, 2) if frozenset(pair) not in CANNOT_MEET]
PAIRS = [(), *((name,) for name in FEATURES), *MEETING]


@pytest.mark.parametrize("names", PAIRS, ids=" x ".join)
def test_where_two_features_meet_the_solution_is_right(names, tmp_path):
    case = made_of(names)
    error, _ = error_of(case, tmp_path)
    assert error <= bound_of(case, names)


def test_pairs_that_cannot_meet_are_of_features_and_have_a_reason():
    for pair, reason in CANNOT_MEET.items():
        assert pair <= set(FEATURES)
        assert len(pair) == 2
        assert reason
