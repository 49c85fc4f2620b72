"""Sums over samples of products of linear forms in u and du/db, as matrices and loads.

At one sample a condition adds products x y of two linear forms. Each form is a sum over the s sides of a boundary (1 or
2) of a factor times u and a factor times du/db on that side, and is given by the array (s, 2) of these factors.
Products at samples that read the same unknowns are summed in one dense block before they are added to the sparse
matrix.
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
    """Return where each of g groups of samples with equal columns starts in ``order``, and the length of it, (g + 1,).

    ``rows`` (k, s) are the rows of ``columns`` (b, w) that each of k samples reads on its s sides, and ``order`` (k,)
    the samples sorted by these columns.
    """
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
def add_symmetric_products(
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
    """Add the sum of ``x y^T + y x^T`` over k samples to a matrix; forms x, y are sums of factors times rows.

    Parameters
    ----------
    order, starts
        The samples sorted by group, and where each group starts; samples of one group read the same columns.
    rows : (k, s)
        For each sample and side a row of ``columns``, ``values`` and ``slopes``.
    x, y : (k, s, 2)
        Factors of values and of slopes.
    columns, values, slopes : (b, w)
        Entries of the rows that evaluate u and du/db; entries of one row may have the same column.
    unknowns : (g, s w)
        The columns of each group, ascending, with repetitions.
    indptr, indices, data
        The matrix (n, n) in CSR format, columns ascending; ``data`` is added to.
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
    """Rows that evaluate u and du/db at b samples: their entries (b, w) and common columns (b, w), which may repeat.

    ``n`` is the number of unknowns, and so of columns.
    """

    columns: Any
    values: Floats
    slopes: Floats
    n: int


def sample_rows(values: csr_array, slopes: csr_array) -> SampleRows:
    """Return the rows of matrices ``values`` and ``slopes`` (b, n), which evaluate u and du/db, with common columns."""
    (columns, u), (slope_columns, slope), n = _padded_entries(values), _padded_entries(slopes), values.shape[1]
    if np.array_equal(columns, slope_columns):
        return SampleRows(columns, u, slope, n)
    both = np.hstack([columns, slope_columns])
    return SampleRows(both, np.hstack([u, np.zeros_like(slope)]), np.hstack([np.zeros_like(u), slope]), n)


def _padded_entries(rows: csr_array) -> tuple[Any, Floats]:
    """Return the columns (b, w) and the entries (b, w) of the rows of a matrix, with zeros added to shorter rows."""
    count, b = np.diff(rows.indptr), rows.shape[0]
    width = int(count.max(initial=0))
    if not width or count.min() == width:
        return rows.indices.reshape(b, width), rows.data.reshape(b, width)
    place = np.minimum(np.arange(width), np.maximum(count - 1, 0)[:, None])
    at = np.minimum(rows.indptr[:-1, None] + place, len(rows.indices) - 1)
    return rows.indices[at], np.where(np.arange(width) < count[:, None], rows.data[at], 0.0)


def symmetric_sum(read: SampleRows, rows: Ints, products: Sequence[tuple[Floats, Floats]]) -> csr_array:
    """Return the sum (n, n) of ``x y^T + y x^T`` over k points and all products, symmetric to the last bit.

    Parameters
    ----------
    read : SampleRows
        Rows that evaluate u and du/db at all samples.
    rows : (k, s) int64
        The sample on each side at each point.
    products : sequence of two (k, s, 2) float64
        For each product the factors of x and of y.
    """
    from scipy.sparse import csr_array

    from cpmkit.forms.galerkin.space.pattern_kernels import pattern
    from cpmkit.runtime.index_sets import inverse_index

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
    add_symmetric_products(order, starts, rows, x, y, columns, values, slopes, unknowns, indptr, indices, data)
    found = csr_array((data, indices, indptr), shape=(n, n))
    found.has_canonical_format = True
    return found


@dataclass(frozen=True, eq=False)
class LoadRows:
    """The matrix (n, j k) that maps j kinds of data at k points, one kind after the other, to the load.

    Attributes
    ----------
    read : SampleRows
        Rows that evaluate u and du/db at all samples.
    rows : (k, s) int64
        The sample on each side at each point.
    factors : (j, k, s, 2) float64
        For each kind of data the factors of u and du/db in the linear form that the data multiply.
    """

    read: SampleRows
    rows: Ints
    factors: Floats

    def __matmul__(self, data: Floats) -> Floats:
        """Return the load (n, channels) of ``data`` (j k, channels)."""
        columns, values, slopes, n = self.read
        loads = np.zeros((n, data.shape[1]))
        for channel, own in enumerate(data.T):
            factors = np.einsum("jksf,jk->fks", self.factors, own.reshape(len(self.factors), -1))
            of_u, of_slope = (np.bincount(self.rows.ravel(), one.ravel(), len(values))[:, None] for one in factors)
            loads[:, channel] = np.bincount(columns.ravel(), (of_u * values + of_slope * slopes).ravel(), n)
        return loads
