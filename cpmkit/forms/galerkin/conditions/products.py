"""What conditions read at samples as entries of common columns, and the matrices that products of these sum up to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cpmkit.protocols import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csc_array, csr_array


class Readings(NamedTuple):
    """Rows that read u and its slope at k samples, entries (k, w) of the same columns, which may repeat."""

    columns: Any
    values: Floats
    slopes: Floats

    def at(self, rows: Ints) -> Readings:
        """Return those of some samples."""
        return Readings(self.columns[rows], self.values[rows], self.slopes[rows])


def readings(values: csr_array, slopes: csr_array) -> Readings:
    """Return matrices (k, n) that read u and its slope as entries of common columns."""
    (columns, own), (others, along) = _entries(values), _entries(slopes)
    if np.array_equal(columns, others):
        return Readings(columns, own, along)
    both = np.hstack([columns, others])
    return Readings(both, np.hstack([own, np.zeros_like(along)]), np.hstack([np.zeros_like(own), along]))


def _entries(rows: csr_array) -> tuple[Any, Floats]:
    """Return the columns and the entries (k, w) of a matrix, shorter rows with zeros behind their own."""
    count, (k, _) = np.diff(rows.indptr), rows.shape
    width = int(count.max(initial=0))
    if not width or count.min() == width:
        return rows.indices.reshape(k, width), rows.data.reshape(k, width)
    place = np.minimum(np.arange(width), np.maximum(count - 1, 0)[:, None])
    at = np.minimum(rows.indptr[:-1, None] + place, len(rows.indices) - 1)
    return rows.indices[at], np.where(np.arange(width) < count[:, None], rows.data[at], 0.0)


def symmetric(columns: Any, products: Sequence[tuple[Floats, Floats]], n: int) -> csr_array:
    """Return the sum (n, n) of ``x y^T + y x^T`` over the rows of pairs (k, w) of ``columns``: to the last bit so."""
    from scipy.sparse import csr_array

    from cpmkit.forms.galerkin.conditions.product_kernels import add_products, starts_of_groups
    from cpmkit.forms.galerkin.space.pattern_kernels import inverted, pattern

    kept = [np.flatnonzero(by.any(axis=1)) for _, by in products]
    columns = np.concatenate([columns[rows] for rows in kept])
    tested, by = (
        np.concatenate([one[side][rows] for one, rows in zip(products, kept, strict=True)]) for side in (0, 1)
    )
    order = np.lexsort((columns[:, -1], columns[:, 0])) if columns.size else np.arange(len(columns))
    starts = starts_of_groups(columns, order)
    unknowns = np.sort(columns[order[starts[:-1]]], axis=1)
    unknowns = unknowns.astype(np.int32 if unknowns.size * unknowns.shape[1] < 2**31 else np.int64, copy=False)
    indptr = np.zeros(n + 1, dtype=unknowns.dtype)
    none = np.zeros((0, 1), dtype=unknowns.dtype)
    table, no_runs = inverted(unknowns.ravel(), n), inverted(none.ravel(), n)
    indices = pattern(unknowns, *table, none, *no_runs, indptr)
    data = np.zeros(len(indices))
    add_products(order, starts, columns, tested, by, unknowns, indptr, indices, data)
    found = csr_array((data, indices, indptr), shape=(n, n))
    found.has_canonical_format = True
    return found


def loading(columns: Any, by: Sequence[Floats], n: int) -> csc_array:
    """Return the matrix (n, j k) that multiplies data of k samples by the j sets of entries ``by`` (k, w) in turn."""
    from scipy.sparse import csc_array

    k, width = columns.shape
    starts = np.arange(0, len(by) * k * width + 1, max(width, 1), dtype=columns.dtype)[: len(by) * k + 1]
    entries = np.concatenate([one.ravel() for one in by])
    return csc_array((entries, np.tile(columns.ravel(), len(by)), starts), shape=(n, len(by) * k))
