"""Descents start in each valley of the distance to the cells, the nearest first, and along the ends besides."""

from __future__ import annotations

import numpy as np
import pytest
from cpmkit_parametric import moebius, torus_knot
from cpmkit_parametric.cells import MOST_QUERY_STARTS


def valleys(found, neighbours, chosen):
    """Return by query the cells of the valleys, by distance: found by looking at all pairs."""
    rows = [dict(zip(found[1][own], found[2][own], strict=True)) for own in chosen]
    lowest = [[c for c in row if all((row[n], n) >= (row[c], c) for n in neighbours[c] if n in row)] for row in rows]
    return [sorted(cells, key=lambda c: (row[c], c)) for cells, row in zip(lowest, rows, strict=True)]


@pytest.mark.parametrize("source", [moebius(), torus_knot()], ids=["moebius", "knot"])
def test_starts_are_the_valleys(source):
    tree, rng = source.tree, np.random.default_rng(4)
    x = rng.uniform(*(1.2 * source.bounds), size=(60, 3))
    found, starts = tree._surviving_pairs(x), tree.descent_starts(x)
    own = [found[0] == one for one in range(len(x))]
    touches = np.isfinite(tree.ends[found[1]]).any(axis=1)
    inside = valleys(found, tree.neighbours, own)
    along = valleys(found, tree.neighbours_along, [one & touches for one in own])
    counts = [[min(len(one), MOST_QUERY_STARTS) for one in each] for each in (inside, along)]
    np.testing.assert_array_equal(starts.query, np.repeat(np.arange(len(x)), np.sum(counts, axis=0)))
    shape = np.array(tree.finest.shape)
    for query in range(len(x)):
        parameters = starts.parameters[starts.query == query]
        cells = inside[query][:MOST_QUERY_STARTS] + along[query][:MOST_QUERY_STARTS]
        middles = (np.stack(np.unravel_index(cells, tree.finest.shape), axis=1) + 0.5) / shape
        assert (np.abs(parameters - middles) <= 0.5 / shape + 1e-12).all()
        ends = np.isfinite(tree.ends[along[query][:MOST_QUERY_STARTS]])
        assert np.isin(parameters[counts[0][query] :][ends], [0.0, 1.0]).all()
