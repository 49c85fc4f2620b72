"""Products of sparse matrices with vectors, on all threads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.threads import run_parcels

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Entries of a parcel: a few milliseconds of work.
PARCEL_ENTRIES = 1 << 19


def matrix_of_rows(weights: Floats, columns: Ints, count: int) -> csr_array:
    """Return the matrix (n, count) whose row k has ``weights[k]`` (w,) at ``columns[k]``, in that order."""
    from scipy.sparse import csr_array

    n, width = columns.shape
    starts = np.arange(n + 1, dtype=np.int32 if columns.size < 2**31 else np.int64) * width
    return csr_array((weights.ravel(), columns.ravel(), starts), shape=(n, count))


def placing(rows: Ints, count: int) -> csr_array:
    """Return the matrix (count, k) that adds k entries to the ``rows`` (k,) of a vector."""
    from scipy.sparse import csr_array

    return csr_array((np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(count, len(rows)))


@dataclass(frozen=True, eq=False)
class ThreadedProduct:
    """A matrix whose products with vectors run on all threads, equal to SciPy's bit by bit.

    Attributes
    ----------
    matrix : csr_array (n, m)
        The matrix, whose rows all have about the same number of entries.
    """

    matrix: csr_array

    @cached_property
    def rows(self) -> int:
        """Rows of a parcel."""
        per_row = max(self.matrix.nnz // max(self.matrix.shape[0], 1), 1)
        return int(max(PARCEL_ENTRIES // per_row, 1))

    @cached_property
    def blocks(self) -> list[csr_array]:
        """The matrix cut into blocks of rows, which share its entries."""
        from scipy.sparse import csr_array

        matrix, blocks = self.matrix, []
        for start in range(0, matrix.shape[0], self.rows):
            pointers = matrix.indptr[start : start + self.rows + 1]
            entries = slice(pointers[0], pointers[-1])
            block = csr_array((len(pointers) - 1, matrix.shape[1]), dtype=matrix.dtype)
            # Set one by one: given at once, SciPy copies parts of larger arrays, and there are two matrices in memory.
            block.data, block.indices = matrix.data[entries], matrix.indices[entries]
            block.indptr = pointers - pointers[0]
            blocks.append(block)
        return blocks

    def __matmul__(self, x: Floats) -> Floats:
        """Return the product with ``x`` of shape (m,) or (m, k)."""
        return self.product(x, lambda *block: block[-1])

    def product(self, x: Floats, finish: Callable[[int, int, Floats], Floats]) -> Floats:
        """Return ``finish(start, stop, rows)`` of each block of rows of the product, while it is in the cache."""
        result = np.empty((self.matrix.shape[0], *x.shape[1:]))

        def multiply(start: int, stop: int) -> None:
            result[start:stop] = finish(start, stop, self.blocks[start // self.rows] @ x)

        run_parcels(multiply, len(result), self.rows)
        return result
