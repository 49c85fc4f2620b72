"""The nearest samples, out of the cells around, are those of a tree."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import cpmkit as ck
from cpmkit.forms.galerkin.sample_search import SampleSearch

SOURCES = {
    "circle": ("analytic.circle", {"center": [0, 0], "radius": 1.0}, 0.1),
    "helix": ("parametric.helix", {}, 0.1),
    "torus": ("analytic.torus", {"major": 1.0, "minor": 0.45}, 0.2),
    "cap": ("analytic.cap", {}, 0.15),
}


def search_on(name):
    kind, keys, spacing = SOURCES[name]
    form = ck.discretize(ck.Scene(ck.source(kind, **keys), ck.ScreenedPoisson(1.0)), spacing, form="galerkin")
    return SampleSearch(form.space.dof_map, form.sampled.samples)


def places(search, count=600):
    """On the manifold, beside it, several cells away, and far out of its box."""
    rng = np.random.default_rng(0)
    samples = search.samples.points
    away = rng.choice([0.0, 1e-3, 0.4, 3.0, 100.0], size=(count, 1)) * search.dof_map.spacing
    return samples[rng.integers(0, len(samples), count)] + away * rng.normal(size=(count, samples.shape[1]))


@pytest.mark.parametrize("count", [1, 12, 96])
@pytest.mark.parametrize("name", SOURCES)
def test_they_are_those_of_a_tree(name, count):
    search = search_on(name)
    x, samples = places(search), search.samples.points
    distance, near = search.nearest(x, count)
    expected = cKDTree(samples).query(x, count)[0].reshape(len(x), count)
    np.testing.assert_allclose(distance, expected, atol=1e-13)
    np.testing.assert_allclose(np.linalg.norm(samples[near] - x[:, None], axis=2), expected, atol=1e-13)
    assert all(len(set(row)) == count for row in near)


@pytest.mark.parametrize("name", ["torus", "cap"])
def test_on_a_surface_no_tree_is_made(name):
    search = search_on(name)
    search.nearest(search.samples.points[::7], 12)
    assert "_tree" not in vars(search)


def test_what_is_found_in_the_cells_is_all_that_is_near():
    search = search_on("torus")
    x = places(search)
    distance, _near, complete = search._by_cell.nearest(x, 12)
    assert 0.5 < complete.mean() < 0.9
    expected = cKDTree(search.samples.points).query(x[complete], 12)[0]
    np.testing.assert_allclose(distance[complete], expected, atol=1e-13)


def test_no_points_have_none():
    distance, near = search_on("torus").nearest(np.zeros((0, 3)), 12)
    assert distance.shape == near.shape == (0, 12)
