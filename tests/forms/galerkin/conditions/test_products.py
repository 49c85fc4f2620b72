"""Sums of products of what samples read, against those of dense rows."""

import numpy as np
import pytest
from scipy.sparse import csr_array, random_array, vstack

from cpmkit.forms.galerkin.conditions.nitsche import linear_form_rows, sum_of_symmetrised_products

UNKNOWNS, SAMPLES = 40, 12


def read(kind, rng):
    """Return rows that read u and its slope, several samples the same unknowns."""
    if kind == "one pattern":
        columns = np.sort(rng.permuted(np.tile(np.arange(UNKNOWNS), (4, 1)), axis=1)[:, :9], axis=1)
        columns = columns[rng.integers(4, size=SAMPLES)]
        starts = 9 * np.arange(SAMPLES + 1)
        return [csr_array((rng.normal(size=9 * SAMPLES), columns.ravel(), starts), (SAMPLES, UNKNOWNS)) for _ in "us"]
    density = {"patterns apart": 0.2, "rows of nothing": 0.02}[kind]
    return [random_array((SAMPLES, UNKNOWNS), density=density, format="csr", rng=rng) for _ in "us"]


@pytest.mark.parametrize("kind", ["one pattern", "patterns apart", "rows of nothing"])
@pytest.mark.parametrize("sides", [1, 2])
def test_products_are_those_of_dense_rows(kind, sides):
    """The last sample is read on both sides of one product, as where both see the same splines."""
    rng = np.random.default_rng(3)
    values, slopes = read(kind, rng)
    rows = rng.integers(SAMPLES, size=(20, sides))
    rows[-1] = SAMPLES - 1
    products = [tuple(rng.normal(size=(2, 20, sides, 2))) for _ in range(2)]
    products[1][1][3:] = 0.0  # nothing is added there
    both = np.stack([values.toarray(), slopes.toarray()])

    def dense(factors):
        return np.einsum("ksf,fksn->kn", factors, both[:, rows])

    half = sum(dense(x).T @ dense(y) for x, y in products)
    traces = vstack([values, slopes], format="csr")
    found = sum_of_symmetrised_products(
        [[linear_form_rows(factors, rows, traces) for factors in product] for product in products]
    )
    assert (found != found.T).nnz == 0
    np.testing.assert_allclose(found.toarray(), half + half.T, atol=1e-13)


def test_products_of_no_samples_are_an_empty_matrix():
    traces = vstack(read("one pattern", np.random.default_rng(3)), format="csr")
    none = linear_form_rows(np.zeros((0, 2, 2)), np.zeros((0, 2), dtype=int), traces)
    assert sum_of_symmetrised_products([(none, none)]).nnz == 0
