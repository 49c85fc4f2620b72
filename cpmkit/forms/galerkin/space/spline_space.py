"""Tensor products of B-splines, their samples, and the sparsity pattern of matrices summed over these samples.

Splines are evaluated as polynomials on the lattice cell of a patch. Along each axis t = x / h - r + 1/2 is in [0, 1]
inside the cell, whose centre is node r of the lattice of spacing h. Points outside have the same polynomial.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.dof_map import DofMap, connected_pieces, lines_through
from cpmkit.forms.galerkin.space.pattern_kernels import sparsity_pattern
from cpmkit.forms.galerkin.space.quantised_samples import QuantisedSamples
from cpmkit.mesh.cell_quadrature import Samples
from cpmkit.mesh.subdivision import expand_counts
from cpmkit.runtime.index_sets import inverse_index
from cpmkit.types import Floats, Ints, SparseMatrix

#: A piece with fewer samples per unknown than the first number has lines along axes without a run; than the second,
#: along all axes. Without lines 23 of 72 flat plates with ragged rims in lattice planes have singular matrices, and 9
#: of 336 plates with slots, necks and holes negative eigenvalues. With 1 for both the error at necks doubles.
SPARSE_SHARES = 1.0, 1 / 3


@cache
def spline_pieces(degree: int) -> Floats:
    """Return the polynomials in t of the degree + 1 splines that are not zero on a cell, along an axis.

    Row k has the coefficients (degree + 1,) of spline k, that of 1 first, by the recursion of Cox and de
    Boor: spline k of degree p is (t + p - k)/p times spline k - 1 of degree p - 1, plus (k + 1 - t)/p times spline k of
    degree p - 1.
    """
    if degree == 0:
        return np.ones((1, 1))
    lower, pieces = spline_pieces(degree - 1), np.zeros((degree + 1, degree + 1))
    for k in range(degree + 1):
        for source, start, slope in ((k - 1, degree - k, 1), (k, k + 1, -1)):
            if 0 <= source < degree:
                pieces[k, :-1] += start * lower[source] / degree
                pieces[k, 1:] += slope * lower[source] / degree
    return pieces


def spline_values(t: Floats, degree: int) -> Floats:
    """Return the values (..., degree + 1) at t (...) of the splines that are not zero on a cell, along an axis."""
    return _evaluate(t, spline_pieces(degree).T)


def spline_slopes(t: Floats, degree: int) -> Floats:
    """Return the derivatives (..., degree + 1) at t (...) of the splines that are not zero on a cell, along an axis."""
    return _evaluate(t, np.asarray(np.polynomial.polynomial.polyder(spline_pieces(degree).T), dtype=np.float64))


def _evaluate(t: Floats, coefficients: Floats) -> Floats:
    """Return the values (..., w) of w polynomials at t (...) by Horner's rule; ``coefficients`` (k, w), of 1 first."""
    values = np.multiply.outer(t, coefficients[-1]) if len(coefficients) > 1 else np.zeros((*t.shape, 1))
    for row in coefficients[-2:0:-1]:
        values = (values + row) * t[..., None]
    return np.asarray(values + coefficients[0], dtype=np.float64)


def value_rows(dof_map: DofMap, patch: Ints, points: Floats) -> SparseMatrix:
    """Return the matrix (k, n) that evaluates u at ``points`` (k, d), each by the splines of its ``patch`` (k,).

    A patch is a connected part of the manifold in one lattice cell. Points are relative to the lattice's origin.
    """
    values = spline_values(_cell_coordinates(dof_map, patch, points), dof_map.degree)
    entries = values[:, 0]
    for axis in range(1, dof_map.dim):
        entries = _outer(entries, values[:, axis])
    return _patch_rows(dof_map, patch, entries)


def derivative_rows(dof_map: DofMap, patch: Ints, points: Floats, directions: Floats) -> SparseMatrix:
    """Return the matrix (k, n) that evaluates the derivative of u along ``directions`` (k, d) at ``points`` (k, d).

    Each point, relative to the origin of the lattice, is evaluated by the splines that its ``patch`` (k,) reads.
    """
    t = _cell_coordinates(dof_map, patch, points)
    along = directions * dof_map.magnification(patch)[:, None] / dof_map.spacing
    values = spline_values(t, dof_map.degree)
    slopes = spline_slopes(t, dof_map.degree) * along[:, :, None]
    products, entries = values[:, 0], slopes[:, 0]
    for axis in range(1, dof_map.dim):
        entries = _outer(entries, values[:, axis]) + _outer(products, slopes[:, axis])
        products = _outer(products, values[:, axis])
    return _patch_rows(dof_map, patch, entries)


def _cell_coordinates(dof_map: DofMap, patch: Ints, points: Floats) -> Floats:
    """Return the coordinates t (k, d) of ``points`` (k, d) in the cells of their patches (k,): in [0, 1] inside."""
    return np.asarray(dof_map.magnify(patch, points) / dof_map.spacing - dof_map.cells[patch] + 0.5)


def _outer(first: Floats, second: Floats) -> Floats:
    """Return the outer products (k, v w) of rows of ``first`` (k, v) and ``second`` (k, w); columns vary fastest."""
    return (first[:, :, None] * second[:, None, :]).reshape(len(first), first.shape[1] * second.shape[1])


def _patch_rows(dof_map: DofMap, patch: Ints, entries: Floats) -> SparseMatrix:
    """Return the matrix (k, n) with ``entries`` (k, w) summed in the columns of the unknowns of the patches (k,)."""
    from scipy.sparse import csr_array

    k, width = entries.shape
    if not k:  # without boundaries: SciPy's checks of an empty matrix take a twentieth of a small solve
        return csr_array((0, dof_map.size))
    index = np.int32 if max(k * width, dof_map.size) < 2**31 else np.int64
    starts = np.arange(0, k * width + 1, width, dtype=index)
    columns = dof_map.unknowns[patch].ravel().astype(index)
    rows = csr_array((entries.ravel(), columns, starts), shape=(k, dof_map.size))
    rows.sum_duplicates()
    return rows


@dataclass(frozen=True, eq=False)
class SplineSpace:
    """Splines with the samples over which they are integrated, and the sparsity pattern of their matrices."""

    dof_map: DofMap  #: The patches of the samples, and the n unknowns, which are coefficients of splines.
    #: The samples of ``dof_map``, in its order: those on the manifold, then those on boundaries.
    samples: QuantisedSamples
    #: (n,) int32: an index of each unknown in ``dof_map.unknowns.ravel()``: in the patch with the largest sum of
    #: weights among those that read the unknown.
    heaviest: Any
    #: (r, degree + 2) int32: all sequences of degree + 2 neighbouring unknowns along an axis, one more than a patch
    #: reads. If an unknown has several neighbours in one direction, there is a run through each neighbour.
    runs: Any
    #: (s, degree + 1) int32: sequences of degree + 1 unknowns along an axis inside one patch, through each unknown that
    #: is in no run, and through unknowns of pieces with too little energy (`_lines_in_weak_pieces`).
    short_runs: Any
    #: indptr, indices (n + 1,), (z,) int32 or int64: the sparsity pattern of matrices in CSR, columns ascending.
    indptr: Any
    indices: Any

    @property
    def manifold_dim(self) -> int:
        """Dimension m of the manifold."""
        return self.dof_map.dim - self.samples.codim

    def matrix(self, data: Floats) -> SparseMatrix:
        """Return the matrix (n, n) with the entries ``data`` (z,); it shares the arrays of the sparsity pattern."""
        from scipy.sparse import csr_array

        n = self.dof_map.size
        matrix = csr_array((data, self.indices, self.indptr), shape=(n, n))
        matrix.has_canonical_format = True
        return matrix

    def means_at_unknowns(self, values: Floats) -> Floats:
        """Return the mean (n,) of ``values`` (q,) or of a constant (1,) over the samples of each unknown's patches."""
        if len(values) == 1:
            return np.full(self.dof_map.size, values[0])
        patches, unknowns = len(self.dof_map.cells), self.dof_map.unknowns
        sums = np.bincount(self.dof_map.patch, values, minlength=patches)
        counts = np.bincount(self.dof_map.patch, minlength=patches).astype(float)
        width = unknowns.shape[1]
        totals = [np.bincount(unknowns.ravel(), by_patch.repeat(width)) for by_patch in (sums, counts)]
        return np.asarray(totals[0] / totals[1])


def build_spline_space(dof_map: DofMap, samples: Samples | QuantisedSamples, cut: Ints | None = None) -> SplineSpace:
    """Return the spline space with the unknowns of ``dof_map`` and its ``samples``, quantised if they are not yet.

    ``cut`` (k,) are the patches of a solid that its skin cuts: runs beside no such patch are left out.
    """
    samples = QuantisedSamples.of(samples, dof_map) if isinstance(samples, Samples) else samples
    n = dof_map.size
    patches, width = dof_map.unknowns.shape
    starts, places = inverse_index(dof_map.unknowns.ravel(), n)
    weight = np.bincount(dof_map.patch, samples.weights, minlength=patches)
    heaviest = _heaviest_places(weight[places // width], starts, places)
    runs_by_axis = [_runs_along(dof_map, stride) for stride in dof_map.strides]
    runs = np.concatenate(runs_by_axis)
    in_no_run = np.ones(n, dtype=bool)
    in_no_run[runs] = False
    short_runs = lines_through(dof_map, heaviest[in_no_run])
    if cut is None:
        lines = _lines_in_weak_pieces(dof_map, samples, runs_by_axis, heaviest)
        short_runs = np.concatenate([short_runs, lines])
    else:
        runs = _runs_beside(dof_map, cut, runs)
    short_runs = np.unique(short_runs, axis=0)
    short_runs = short_runs[short_runs[:, 0] != short_runs[:, 1]]  # isolated pieces have one unknown all along
    indptr = np.zeros(n + 1, dtype=np.int32 if len(places) * width < 2**31 else np.int64)
    run_table = inverse_index(runs.ravel(), n)
    indices = sparsity_pattern(dof_map.unknowns, starts, places, runs, *run_table, indptr)
    return SplineSpace(dof_map, samples, heaviest, runs, short_runs, indptr, indices)


def _runs_along(dof_map: DofMap, stride: int) -> Any:
    """Return all runs (r, degree + 2), sequences of neighbouring unknowns, along the axis of a ``stride``.

    An unknown may have several neighbours in one direction.
    """
    from scipy.sparse import csr_array

    n, unknowns = dof_map.size, dof_map.unknowns
    before = np.flatnonzero(np.arange(unknowns.shape[1]) // stride % dof_map.width < dof_map.degree)
    low, high = unknowns[:, before].ravel(), unknowns[:, before + stride].ravel()
    differ = low != high  # an isolated piece of the manifold has one unknown
    pairs = low[differ], high[differ]
    following = csr_array((np.ones(len(pairs[0]), dtype=np.int8), pairs), shape=(n, n))
    runs = np.arange(n, dtype=np.int32)[:, None]
    for _ in range(dof_map.width):
        row, place = expand_counts(np.diff(following.indptr)[runs[:, -1]])
        after = following.indices[following.indptr[runs[row, -1]] + place]
        runs = np.column_stack([runs[row], after]).astype(np.int32)
    return runs


def _runs_beside(dof_map: DofMap, patches: Ints, runs: Ints) -> Ints:
    """Return the ``runs`` (r, degree + 2) whose first or last degree + 1 unknowns are a line in one of ``patches``."""
    n, width = dof_map.size, dof_map.width
    blocks = dof_map.unknowns[patches].reshape(-1, *(width,) * dof_map.dim)
    ends = [np.moveaxis(blocks, 1 + axis, -1)[..., [0, -1]].reshape(-1, 2) for axis in range(dof_map.dim)]
    codes = np.unique(np.concatenate(ends).astype(np.int64) @ [n, 1])
    beside = [np.isin(runs[:, [k, k + width - 1]].astype(np.int64) @ [n, 1], codes) for k in range(2)]
    return np.asarray(runs[beside[0] | beside[1]])


def _lines_in_weak_pieces(
    dof_map: DofMap, samples: QuantisedSamples, runs_by_axis: Sequence[Ints], heaviest: Ints
) -> Ints:
    """Return lines (k, degree + 1) of unknowns inside patches, through each unknown of pieces with too little energy.

    Such pieces are connected, between ties, and have few samples. On a flat piece z^2 f has no mass and energy if f
    vanishes at all samples, and differences along runs do not control it if the piece is in one layer of cells. The
    lines are along the axes without a run, and with very few samples along all axes. Curves in space have lines along
    axes without a run everywhere: on a straight curve along x, y^2 z has no energy.
    """
    count, piece = connected_pieces(dof_map, across_ties=False)
    share = np.bincount(piece[dof_map.unknowns[dof_map.patch, 0]], samples.weights > 0, count) / np.bincount(piece)
    most_without_run, most = SPARSE_SHARES if samples.codim == 1 else (np.inf, SPARSE_SHARES[1])
    lines = []
    for axis, runs in enumerate(runs_by_axis):
        has_no_run = np.bincount(piece[runs[:, 0]], minlength=count) == 0
        chosen = share < np.where(has_no_run, most_without_run, most)
        by_axis = lines_through(dof_map, heaviest[chosen[piece]]).reshape(dof_map.dim, -1, dof_map.width)
        lines.append(by_axis[axis])
    return np.concatenate(lines)


def _heaviest_places(weights: Floats, starts: Ints, places: Ints) -> Ints:
    """Return for each unknown (n,) its place with the largest weight, the first of several.

    A place is an index into the flattened table of the unknowns of patches. Unknown i has one or more places,
    ``places[starts[i] : starts[i + 1]]``, with weights in the same slice of ``weights``.
    """
    largest = np.maximum.reduceat(weights, starts[:-1])
    hits = np.flatnonzero(weights == largest.repeat(np.diff(starts)))
    row = np.searchsorted(starts, hits, side="right") - 1
    first = np.ones(len(hits), dtype=bool)
    first[1:] = row[1:] != row[:-1]
    return np.asarray(places[hits[first]])
