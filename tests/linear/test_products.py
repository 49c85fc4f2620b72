"""Products on all threads equal SciPy's, and do not depend on how many threads there are."""

import numpy as np
import pytest
from scipy.sparse import random_array

from cpmkit import InputError
from cpmkit.linear import operators
from cpmkit.linear.operators import ThreadedProduct
from cpmkit.plugin import run_parcels, thread_count


@pytest.mark.parametrize("threads", ["1", "2", "5"])
@pytest.mark.parametrize("shape", [(700,), (700, 1), (700, 3)])
def test_products_equal_scipys_bit_by_bit(monkeypatch, threads, shape):
    monkeypatch.setenv("CPMKIT_THREADS", threads)
    monkeypatch.setattr(operators, "PARCEL_ENTRIES", 500)
    rng = np.random.default_rng(0)
    matrix = random_array((1000, 700), density=0.02, format="csr", rng=rng)
    x = rng.normal(size=shape)
    product = ThreadedProduct(matrix)
    assert len(product.blocks) > 10
    np.testing.assert_array_equal(product @ x, matrix @ x)


def test_blocks_share_the_matrixs_entries(monkeypatch):
    monkeypatch.setattr(operators, "PARCEL_ENTRIES", 500)
    matrix = random_array((1000, 1000), density=0.02, format="csr", rng=np.random.default_rng(0))
    blocks = ThreadedProduct(matrix).blocks
    assert len(blocks) > 10
    assert all(np.shares_memory(block.data, matrix.data) for block in blocks)
    assert all(np.shares_memory(block.indices, matrix.indices) for block in blocks)


def test_every_row_is_worked_on_once(monkeypatch):
    monkeypatch.setenv("CPMKIT_THREADS", "3")
    seen = np.zeros(1000, dtype=int)

    def mark(start, stop):
        seen[start:stop] += 1

    run_parcels(mark, 1000, 7)
    assert np.all(seen == 1)


def test_a_parcels_error_is_raised(monkeypatch):
    monkeypatch.setenv("CPMKIT_THREADS", "2")
    with pytest.raises(ZeroDivisionError):
        run_parcels(lambda start, stop: 1 // (start - 14), 100, 7)


@pytest.mark.parametrize("target", ["0", "-1", "two", "1.5"])
def test_a_number_of_threads_that_is_none(monkeypatch, target):
    monkeypatch.setenv("CPMKIT_THREADS", target)
    with pytest.raises(InputError, match="CPMKIT_THREADS must be a whole number above zero"):
        thread_count()
