"""Sums over samples of products of linear forms in u and du/db, as matrices and loads.

A form of a condition at one sample is a product x y of two linear forms. Each is a sum over the sides of a boundary of
factors times u and times du/db there: factors (s, 2) for s sides. Products of samples that read the same unknowns are
summed in one dense block before they are added to the sparse matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@compiled
def starts_of_groups(columns: Any, rows: Ints, order: Ints) -> Ints:
    """Return (g + 1,) the places in ``order`` (k,) where ``rows`` (k, s) read other columns than the row before."""
    starts = np.empty(len(order) + 1, dtype=np.int64)
    used = 0
    for at in range(len(order)):
        same = at > 0
        for side in range(rows.shape[1]):
            if not same:
                break
            one, before = columns[rows[order[at], side]], columns[rows[order[at - 1], side]]
            for b in range(len(one)):
                if one[b] != before[b]:
                    same = False
                    break
        if not same:
            starts[used] = at
            used += 1
    starts[used] = len(order)
    return starts[: used + 1]


@compiled
def add_products(
    order: Ints,
    starts: Ints,
    rows: Ints,
    x: Floats,
    y: Floats,
    columns: Any,
    values: Floats,
    slopes: Floats,
    unknowns: Any,
    indptr: Any,
    indices: Any,
    data: Floats,
) -> None:
    """Add ``x y^T + y x^T`` summed over k; x and y are sums over sides of factors times values and slopes.

    Parameters
    ----------
    order, starts
        The k sorted by group, and where each group starts; rows of one group have the same columns.
    rows : (k, s)
        For each side a row of ``columns``, ``values`` and ``slopes``.
    x, y : (k, s, 2)
        Factors of values and of slopes.
    columns, values, slopes : (b, w)
        Entries of one row may have the same column.
    unknowns : (g, s w)
        The columns of each group, ascending.
    indptr, indices, data
        The matrix (n, n) in CSR format, columns ascending.
    """
    sides, width = rows.shape[1], columns.shape[1]
    most = sides * width
    local, own = np.empty(len(indptr) - 1, dtype=np.int64), np.empty(most, dtype=np.int64)
    left, right, sums = np.empty(most), np.empty(most), np.empty((most, most))
    for g in range(len(starts) - 1):
        count = 0
        for j in unknowns[g]:
            if count == 0 or own[count - 1] != j:
                own[count] = j
                local[j] = count
                count += 1
        sums[:count, :count] = 0.0
        for at in range(starts[g], starts[g + 1]):
            k = order[at]
            left[:count] = 0.0
            right[:count] = 0.0
            for side in range(sides):
                row = rows[k, side]
                for b in range(width):
                    place, value, slope = local[columns[row, b]], values[row, b], slopes[row, b]
                    left[place] += x[k, side, 0] * value + x[k, side, 1] * slope
                    right[place] += y[k, side, 0] * value + y[k, side, 1] * slope
            for a in range(count):
                factor = left[a]
                for b in range(count):
                    sums[a, b] += factor * right[b]
        for a in range(count):
            at = indptr[own[a]]
            for b in range(count):
                while indices[at] != own[b]:
                    at += 1
                data[at] += sums[a, b] + sums[b, a]


class SampleRows(NamedTuple):
    """Rows that evaluate u and du/db at b samples: entries (b, w) in common columns below n, which may repeat."""

    columns: Any
    values: Floats
    slopes: Floats
    n: int


def sample_rows(values: csr_array, slopes: csr_array) -> SampleRows:
    """Return the matrices (b, n) that evaluate u and du/db as entries in common columns."""
    (columns, u), (slope_columns, slope), n = _padded_entries(values), _padded_entries(slopes), values.shape[1]
    if np.array_equal(columns, slope_columns):
        return SampleRows(columns, u, slope, n)
    both = np.hstack([columns, slope_columns])
    return SampleRows(both, np.hstack([u, np.zeros_like(slope)]), np.hstack([np.zeros_like(u), slope]), n)


def _padded_entries(rows: csr_array) -> tuple[Any, Floats]:
    """Return the columns and the entries (b, w) of a matrix; shorter rows are filled with zeros."""
    count, b = np.diff(rows.indptr), rows.shape[0]
    width = int(count.max(initial=0))
    if not width or count.min() == width:
        return rows.indices.reshape(b, width), rows.data.reshape(b, width)
    place = np.minimum(np.arange(width), np.maximum(count - 1, 0)[:, None])
    at = np.minimum(rows.indptr[:-1, None] + place, len(rows.indices) - 1)
    return rows.indices[at], np.where(np.arange(width) < count[:, None], rows.data[at], 0.0)


def symmetric_sum(read: SampleRows, rows: Ints, products: Sequence[tuple[Floats, Floats]]) -> csr_array:
    """Return the sum (n, n) of ``x y^T + y x^T``, symmetric to the last bit.

    Parameters
    ----------
    read : Readings
        At all samples.
    rows : (k, s) int64
        The samples on each side.
    products : sequence of two (k, s, 2) float64
        The factors of x and of y.
    """
    from scipy.sparse import csr_array

    from cpmkit.forms.galerkin.space.pattern_kernels import pattern
    from cpmkit.runtime.inverse_index import inverse_index

    columns, values, slopes, n = read
    kept = [np.flatnonzero(y.any(axis=(1, 2))) for _, y in products]
    x, y = (np.concatenate([one[of][own] for one, own in zip(products, kept, strict=True)]) for of in (0, 1))
    rows = np.concatenate([rows[own] for own in kept])
    order = np.lexsort(columns[rows[:, ::-1], 0].T) if rows.size else np.arange(len(rows))
    starts = starts_of_groups(columns, rows, order)
    width = rows.shape[1] * columns.shape[1]
    unknowns = np.sort(columns[rows[order[starts[:-1]]]].reshape(len(starts) - 1, width), axis=1)
    unknowns = unknowns.astype(np.int32 if unknowns.size * width < 2**31 else np.int64, copy=False)
    indptr, none = np.zeros(n + 1, dtype=unknowns.dtype), np.zeros((0, 1), dtype=unknowns.dtype)
    indices = pattern(unknowns, *inverse_index(unknowns.ravel(), n), none, *inverse_index(none.ravel(), n), indptr)
    data = np.zeros(len(indices))
    add_products(order, starts, rows, x, y, columns, values, slopes, unknowns, indptr, indices, data)
    found = csr_array((data, indices, indptr), shape=(n, n))
    found.has_canonical_format = True
    return found


@dataclass(frozen=True, eq=False)
class LoadRows:
    """A matrix (n, j k) that multiplies j kinds of data of k samples, one kind after the other.

    Attributes
    ----------
    read : Readings
        At all samples.
    rows : (k, s) int64
        The samples on each side.
    factors : (j, k, s, 2) float64
        Factors of the rows of u and du/db, by which the data are multiplied.
    """

    read: SampleRows
    rows: Ints
    factors: Floats

    def __matmul__(self, data: Floats) -> Floats:
        """Return (n, channels)."""
        columns, values, slopes, n = self.read
        loads = np.zeros((n, data.shape[1]))
        for channel, own in enumerate(data.T):
            factors = np.einsum("jksf,jk->fks", self.factors, own.reshape(len(self.factors), -1))
            of_u, of_slope = (np.bincount(self.rows.ravel(), one.ravel(), len(values))[:, None] for one in factors)
            loads[:, channel] = np.bincount(columns.ravel(), (of_u * values + of_slope * slopes).ravel(), n)
        return loads
